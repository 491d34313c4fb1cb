"""Which engine runs a loop: the first one that can, and what is said of those that cannot.

`EDHAS_ENGINE=gpu`, `native` or `xla` asks for one. Without it a GPU takes the loops of so many lanes that it is faster,
the native engine the others where it can, XLA everything else.
"""

import os
import warnings
from typing import Any, NamedTuple

from edhas_jax.compiler.gpu.engine import GpuEngine
from edhas_jax.compiler.loop_engine import AdjointLoop, Loop, LoopBody, LoopEngine, Untranslatable
from edhas_jax.compiler.native_engine import NativeEngine
from edhas_jax.compiler.xla_engine import XlaEngine

GPU, NATIVE = GpuEngine(), NativeEngine()
ENGINES: tuple[LoopEngine, ...] = (GPU, NATIVE, XlaEngine())  # in the order in which they are asked
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


def serving_engine(many_lanes: bool = False) -> LoopEngine:
    """The engine that is asked first for a loop.

    Args:
        many_lanes: whether the loop has as many lanes as `many_lanes` wants for a GPU.

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
        if engine.for_many_lanes and (not many_lanes or engine.unavailable()):
            continue
        problem = engine.unavailable()
        if not problem:
            return engine
        _say_once(f"the {engine.name} engine cannot serve: {problem}", engine)
    raise EngineError("no engine can serve")  # XLA always can


def many_lanes(lanes: int, dtype: Any) -> bool:
    """Whether a loop over so many lanes goes to a GPU: one that is asked for, or that is faster by the estimate.

    The choice is made for a task as a whole, by all its lanes, so that no design depends on which others are left.
    """
    asked = os.environ.get(VARIABLE, "")
    if asked:
        return asked == GPU.name
    if GPU.unavailable():
        return False
    # without machine code for the processor XLA would serve, which launches every step on its own
    return bool(NATIVE.unavailable()) or GPU.pays(lanes, dtype)


def engine_statuses() -> list[EngineStatus]:
    """Every engine, whether it serves, and why or why not.

    Raises:
        EngineError: see `serving_engine`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EngineFallback)
        serving = serving_engine()
    asked, rows = os.environ.get(VARIABLE), []
    for engine in ENGINES:
        problem, serves = engine.unavailable(), engine is serving
        if serves:
            reason = f"{VARIABLE}={engine.name}" if asked else "the first that can serve"
        elif problem:
            reason = problem
        elif engine.for_many_lanes and not asked:
            serves, reason = True, GPU.description()
        elif ENGINES.index(engine) < ENGINES.index(serving):
            reason = f"passed over because of {VARIABLE}={serving.name}"
        else:
            reason = f"takes the loops that the {serving.name} engine cannot run"
        rows.append(EngineStatus(engine.name, serves, reason))
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
    serving = serving_engine(body.many_lanes)
    for engine in ENGINES[ENGINES.index(serving) :]:
        if engine.unavailable() or engine.outside_scope(body):
            continue
        try:
            loop = getattr(engine, method)(body)
        except Untranslatable as error:
            _say_once(f"the {engine.name} engine cannot run a loop of this machine: {error}", engine)
            continue
        # without machine code for the processor only XLA would follow, which is slower still
        if os.environ.get(VARIABLE) or NATIVE.unavailable() or not engine.probably_slower(loop):
            loop.engine = engine.name
            return loop
    raise EngineError("no engine can run this loop")  # XLA takes every body


_said: set[str] = set()


def _say_once(problem: str, engine: LoopEngine) -> None:
    if problem in _said:
        return
    _said.add(problem)
    following = (e for e in ENGINES[ENGINES.index(engine) + 1 :] if not e.unavailable())
    name = next(following).name
    name = "XLA" if name == "xla" else f"the {name} engine"
    warnings.warn(f"{problem}; {name} serves instead (same results to rounding, slower)", EngineFallback, stacklevel=3)
