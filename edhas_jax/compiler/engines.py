"""Which engine runs a loop: the first one that can, and what is said of those that cannot.

`EDHAS_ENGINE=native` or `xla` asks for one; without it the native engine serves where it can, XLA everywhere else.
"""

import os
import warnings
from typing import NamedTuple

from edhas_jax.compiler.loop_engine import AdjointLoop, Loop, LoopBody, LoopEngine, Untranslatable
from edhas_jax.compiler.native_engine import NativeEngine
from edhas_jax.compiler.xla_engine import XlaEngine

ENGINES: tuple[LoopEngine, ...] = (NativeEngine(), XlaEngine())  # in the order in which they are asked
VARIABLE = "EDHAS_ENGINE"


class EngineError(RuntimeError):
    """The engine that was asked for is not there or cannot serve; the text says why."""


class EngineFallback(RuntimeWarning):
    """Another engine than expected runs a loop; results agree to rounding, the speed may differ."""


class EngineStatus(NamedTuple):
    """An engine, whether it serves in this process, and why or why not."""

    name: str
    serves: bool
    reason: str


def serving_engine() -> LoopEngine:
    """The engine that is asked first for every loop.

    Raises:
        EngineError: `EDHAS_ENGINE` names an engine that is not there or cannot serve.
    """
    asked = os.environ.get(VARIABLE, "")
    if asked:
        engine = next((e for e in ENGINES if e.name == asked), None)
        if engine is None:
            names = ", ".join(e.name for e in ENGINES)
            raise EngineError(f"{VARIABLE}={asked}: there is no such engine; one of {names}")
        problem = engine.unavailable()
        if problem:
            raise EngineError(f"{VARIABLE}={asked}: this engine cannot serve here: {problem}")
        return engine
    for engine in ENGINES:
        problem = engine.unavailable()
        if not problem:
            return engine
        _say_once(f"the {engine.name} engine cannot serve: {problem}")
    raise EngineError("no engine can serve")  # XLA always can


def engine_statuses() -> list[EngineStatus]:
    """Every engine, whether it serves, and why or why not.

    Raises:
        EngineError: see `serving_engine`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EngineFallback)
        serving = serving_engine()
    rows = []
    for engine in ENGINES:
        problem = engine.unavailable()
        if engine is serving:
            reason = f"{VARIABLE}={engine.name}" if os.environ.get(VARIABLE) else "the first that can serve"
        elif problem:
            reason = problem
        elif ENGINES.index(engine) < ENGINES.index(serving):
            reason = f"passed over because of {VARIABLE}={serving.name}"
        else:
            reason = f"takes the loops that the {serving.name} engine cannot run"
        rows.append(EngineStatus(engine.name, engine is serving, reason))
    return rows


def compile_loop(body: LoopBody) -> Loop:
    """Compile a loop with the serving engine, or with the next one that can.

    Warns:
        EngineFallback: once for each reason, where an engine cannot run the body.

    Raises:
        EngineError: see `serving_engine`.
    """
    return _first_that_can(body, "compile")


def compile_adjoint_loop(body: LoopBody) -> AdjointLoop:
    """As `compile_loop`, for a loop with its reverse-mode derivative."""
    return _first_that_can(body, "compile_adjoint")


def _first_that_can(body: LoopBody, method: str):
    serving = serving_engine()
    for engine in ENGINES[ENGINES.index(serving) :]:
        if engine.unavailable() or engine.outside_scope(body):
            continue
        try:
            return getattr(engine, method)(body)
        except Untranslatable as error:
            _say_once(f"the {engine.name} engine cannot run a loop of this machine: {error}")
    raise EngineError("no engine can run this loop")  # XLA takes every body


_said: set[str] = set()


def _say_once(problem: str) -> None:
    if problem not in _said:
        _said.add(problem)
        warnings.warn(f"{problem}; XLA serves instead (same results to rounding, slower)", EngineFallback, stacklevel=3)
