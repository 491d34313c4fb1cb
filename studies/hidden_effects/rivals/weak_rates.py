"""Rates of the measured states in weak form: integrals against test functions, which differentiate no measurement.

For a test function φ that is zero with its derivatives at the ends of a window, ∫φ ẏ dt = −∫φ̇ y dt, and for a speed of
which the position x is measured ∫φ v̇ dt = ∫φ̈ x dt. The discrepancy is the integral of ẏ − f(y) at the measured y,
less the same of the calibrated model: states that are not measured are the model's, so that they have little influence.

Source: Messenger, Bortz (2021), Weak SINDy: Galerkin-based data-driven model selection; test functions (1 − τ²)^p as in
PySINDy's `WeakPDELibrary`.
"""

import dataclasses
import functools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from scipy.signal import savgol_filter

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import find_parameter, get_parameter, replace_value
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import MeasurementModel

# for each state whose rate is regressed: the measured signal, and how many times it is differentiated
EQUATIONS = {
    "current": ("current", 1), "piston_velocity": ("piston_position", 2), "outlet_pressure": ("outlet_pressure", 1),
    "head_pressure": ("head_pressure", 1), "rod_pressure": ("rod_pressure", 1),
    "cylinder_velocity": ("cylinder_position", 2),
}  # fmt: skip
HALF_WINDOW = 2.4e-3  # s
POWER = 5  # p of the test functions; those are p − 1 times continuously differentiable
MIN_HALF_WINDOW = 6  # samples
SMOOTHING = (11, 3)  # samples and order of the Savitzky-Golay filter for the speeds at which f is evaluated


@dataclasses.dataclass(frozen=True)
class _Windows:
    """Weights (windows, samples) of the integrals of φ y, φ̇ y and φ̈ y over the windows of a run."""

    value: np.ndarray
    first: np.ndarray
    second: np.ndarray


def _windows(run: BenchRun) -> _Windows:
    half = max(round(HALF_WINDOW / run.interval), MIN_HALF_WINDOW)
    tau = np.arange(-half, half + 1) / half
    bump = 1.0 - tau**2
    value = bump**POWER
    first = -2.0 * POWER * tau * bump ** (POWER - 1)
    second = -2.0 * POWER * bump ** (POWER - 1) + 4.0 * POWER * (POWER - 1) * tau**2 * bump ** (POWER - 2)
    starts = np.arange(0, max(len(run.time) - 2 * half, 1), max(half // 2, 1))
    starts = starts[starts + 2 * half < len(run.time)]
    weights = np.zeros((3, len(starts), len(run.time)))
    width = half * run.interval
    for k, start in enumerate(starts):
        for row, shape in enumerate((value, first / width, second / width**2)):
            weights[row, k, start : start + 2 * half + 1] = shape / value.sum()
    return _Windows(*weights)


class WeakRates:
    """The discrepancy of the rates of a calibrated model, and what another machine would change in them.

    Args:
        fitted: the calibrated model.
        per_sample: time steps per sample.
    """

    def __init__(self, fitted: Fit, per_sample: int):
        self.campaign, self.machine = fitted.problem.campaign, fitted.machine
        self.runs = fitted.problem.model().runs
        states = fitted.machine.initial_state()
        measured = [n for n in self.campaign.channels if all(_is_usable(run.signals.get(n)) for run in self.runs)]
        self.equations = {state: of for state, of in EQUATIONS.items() if state in states and of[0] in measured}
        self._windows = [_windows(run) for run in self.runs]
        self._measured_names = measured
        names = dict.fromkeys((*(n for n in states if n in SIGNALS), *measured, "voltage"))
        names |= {"gas_volume": None} if "gas_volume_change" in states else {}
        model = MeasurementModel(self.campaign, self.machine, (), self.runs, signals=tuple(names))
        found = model.predict_all_runs(np.zeros(0), per_sample)
        self._modelled = self._states([found[r].values for r in range(len(self.runs))])
        complete = [found[r].values | {n: _filled(run.signals[n]) for n in measured} for r, run in enumerate(self.runs)]
        self.states = self._states(complete)
        self._before = _rates(self.campaign, self.machine, self.runs, self.states)[0]

    def _states(self, rows: Sequence[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
        """The states of all runs one after the other; speeds from positions."""
        out = {n: np.concatenate([row[n] for row in rows]) for n in rows[0]}
        for state, (signal, order) in EQUATIONS.items():
            if order == 2 and signal in self._measured_names:
                parts = [
                    savgol_filter(row[signal], *SMOOTHING, deriv=1, delta=run.interval)
                    for run, row in zip(self.runs, rows, strict=True)
                ]
                out[state] = np.concatenate(parts)
        if "gas_volume" in out:
            out["gas_volume_change"] = out["gas_volume"] - float(self.machine.accumulator.accumulator_gas_volume)
        return out

    @functools.cached_property
    def run_of_row(self) -> np.ndarray:
        """The index of the run of each row of a discrepancy (rows of all equations,)."""
        of_one = np.repeat(np.arange(len(self.runs)), [len(w.value) for w in self._windows])
        return np.tile(of_one, len(self.equations))

    def _integrals(self, values: np.ndarray, kind: str = "value") -> np.ndarray:
        """The integrals of values (samples of all runs,) over all windows."""
        ends = np.cumsum([len(run.time) for run in self.runs])[:-1]
        parts = zip(self._windows, np.split(values, ends), strict=True)
        return np.concatenate([getattr(windows, kind) @ part for windows, part in parts])

    def discrepancy(self) -> list[np.ndarray]:
        """For each equation the integrals (windows,) of measured rate less f, less the same of the model."""
        of_model, volts_of_model = _rates(self.campaign, self.machine, self.runs, self._modelled)
        volts = _rates(self.campaign, self.machine, self.runs, self.states)[1]
        out = []
        for state, (signal, order) in self.equations.items():
            change = self.states[signal] - self._modelled[signal]
            rate = -self._integrals(change, "first") if order == 1 else self._integrals(change, "second")
            expected = self._before[state] - of_model[state]
            if state == "current" and "voltage" in self._measured_names:
                # the voltage is measured, and depends on states of the controller that are not
                unexpected = self.states["voltage"] - self._modelled["voltage"] - (volts - volts_of_model)
                expected = expected + unexpected / float(self.machine.coil.coil_inductance)
            out.append(rate - self._integrals(expected))
        return out

    def change(self, machine: Rig) -> list[np.ndarray]:
        """For each equation the integrals (windows,) of the rates of a machine less those of the calibrated one."""
        after = _rates(self.campaign, machine, self.runs, self.states)[0]
        return [self._integrals(after[state] - self._before[state]) for state in self.equations]


def _is_usable(values: np.ndarray | None) -> bool:
    """Whether a signal is measured at more than half of the samples of a run."""
    return values is not None and np.isfinite(values).mean() > 0.5


def _filled(values: np.ndarray) -> np.ndarray:
    """A signal with its missing samples interpolated."""
    good = np.isfinite(values)
    index = np.arange(len(values))
    return values if good.all() else np.interp(index, index[good], values[good])


def _rates(campaign: Campaign, machine: Rig, runs: Sequence[BenchRun], states: dict) -> tuple[dict, np.ndarray]:
    """The rates of all states, and the voltage, at the samples of all runs; other states have initial values."""
    machines = [campaign.machine_of(run, machine) for run in runs]
    lengths = [len(run.time) for run in runs]
    for name in runs[0].conditions:
        p, path = find_parameter(machine, name)
        values = np.repeat([float(get_parameter(m, name)) for m in machines], lengths)
        machine = replace_value(machine, path, p.name, jnp.asarray(values))
    time = jnp.asarray(np.concatenate([run.time for run in runs]))
    start = machine.initial_state()
    y = {n: jnp.asarray(states[n]) if n in states else jnp.full(len(time), float(v)) for n, v in start.items()}
    signals, found = machine.evaluate(y, time, 1.0, y)
    found = found | signals.record.pressure_rates
    whole = {n: np.asarray(jnp.broadcast_to(v, time.shape)) for n, v in found.items()}
    return whole, np.asarray(jnp.broadcast_to(signals.voltage, time.shape))
