"""The order of convergence of the step on stretches without an event."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.machine.rigs import ActuatorBench, PumpBench, Rig
from edhas_jax.simulation.integrator import step
from tests.support.reference import changed, nominal
from tests.support.xla import jit

STEPS = (50e-6, 40e-6, 25e-6, 20e-6, 12.5e-6, 10e-6)
FINE = 0.5e-6
INTERVALS = 10


class Stretch(NamedTuple):
    """A smooth part of a run: the machine, from when to when [s], and why nothing switches in it."""

    machine: Rig
    begin: float
    end: float
    why: str


class Convergence(NamedTuple):
    """Slope of log error against log step, with the steps [s] and the errors (rms share of the range of the states)."""

    order: float
    steps: np.ndarray
    errors: np.ndarray


def stretches() -> dict[str, Stretch]:
    """The stretches on which the order is measured."""
    soft = changed(changed(nominal(ActuatorBench, "lugre_friction"), "amplitude", 1e-3), "ramp_time", 0.2)
    return {
        "actuator, no dry friction": Stretch(soft, 0.0, 0.1, "linear; within the supply and the stops"),
        "pump, 10 Hz, A delivers": Stretch(
            nominal(PumpBench), 0.189, 0.209, "the piston does not reverse, no valve leaves or meets its seat"
        ),
        "pump, 30 Hz, B delivers": Stretch(
            changed(nominal(PumpBench), "frequency", 30.0), 0.181, 0.187, "the same at three times the speed"
        ),
    }


@partial(jit, static_argnums=4)
def _advance(machine: Rig, y, t, h, intervals: int, per_interval):
    """The states after each of the intervals; another number of steps compiles nothing anew."""

    def interval(y, i):
        def one(j, y):
            return step(machine, y, t + (i * per_interval + j).astype(float) * h, h)[0]

        y = jax.lax.fori_loop(0, per_interval, one, y)
        return y, y

    return jax.lax.scan(interval, y, jnp.arange(intervals))[1]


def solution(stretch: Stretch, y, h: float) -> dict[str, np.ndarray]:
    """The states at the ends of the intervals of a stretch, from the state `y` at its begin."""
    length = (stretch.end - stretch.begin) / INTERVALS
    count = round(length / h)
    return jax.device_get(_advance(stretch.machine, y, stretch.begin, length / count, INTERVALS, count))


def beginning(stretch: Stretch, h: float = 2e-6) -> dict:
    """The state at the begin of a stretch, from rest: a state in mid-cycle is one that the machine can be in."""
    y = {n: jnp.asarray(v, float) for n, v in stretch.machine.initial_state().items()}
    if stretch.begin == 0.0:
        return y
    count = round(stretch.begin / h / INTERVALS)
    states = _advance(stretch.machine, y, 0.0, stretch.begin / count / INTERVALS, INTERVALS, count)
    return {n: v[-1] for n, v in states.items()}


def convergence(stretch: Stretch) -> Convergence:
    """Regression of log error on log step against a solution at a far smaller step."""
    y = beginning(stretch)
    exact = solution(stretch, y, FINE)
    # the bristles at full sliding do not move: their range would be rounding
    moving = [n for n, v in exact.items() if np.ptp(np.append(v, y[n])) > 1e-9 * np.abs(v).max()]
    length = (stretch.end - stretch.begin) / INTERVALS
    steps, errors = [], []
    for h in STEPS:
        got = solution(stretch, y, h)
        shares = [(got[n] - exact[n]) / np.ptp(np.append(exact[n], y[n])) for n in moving]
        steps.append(length / round(length / h))
        errors.append(float(np.sqrt(np.mean(np.square(shares)))))
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    return Convergence(float(slope), np.array(steps), np.array(errors))
