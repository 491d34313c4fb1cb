"""How much of a change of the signals neither the uncertain parameters nor the usual errors of a bench can explain.

    visible = min over x of |s − J x|² + |x|²

s is the change of all signals of the fitted runs in units of their noise, x what may compensate it, in units of its
prior standard deviation: the uncertain parameters; per run the trigger, the settings and the coil resistance; per
signal gain, offset and time shift. J are their sensitivities at the true machine. Correlated noise is whitened first.

A change that is large is not compensated in proportion to x, so that a linear remainder may be seen that a fit removes.
`VisibilityTest.visible_after_fit` therefore fits the uncertain parameters, without noise.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_toeplitz, solve_triangular
from scipy.signal import lfilter

from edhas_jax.machine.parameters import get_parameter, has_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.measurement_model import MeasurementModel, PredictedSignals
from edhas_jax.measurements.time_resolution import step_error
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns

STEPS_PER_SAMPLE, MAX_STEPS_PER_SAMPLE = 12, 96
MAX_ERROR = 0.1  # rms error of a signal by the time step, over its noise; where it is larger, more steps are taken
TRIGGER = 0.2e-3  # s, standard deviation of the start of a record
SETTING = 0.005  # relative, of a setting from run to run
WARM_UP = 0.005  # relative, of the coil resistance from run to run
GAIN, OFFSET, SHIFT = 0.003, 0.001, 20e-6  # of a signal: relative, of its range, s
WHITENING_ORDER = 12
MAX_DERIVATIVE = 20.0  # by one standard deviation of a parameter, over the range of a signal
MAX_FIT_STEPS, MAX_HALVINGS = 4, 3
SUFFICIENT_FALL = 0.9  # a fit goes on while a step leaves less than this share

Signals = dict[str, np.ndarray]


def whitening_filter(noise: np.ndarray) -> np.ndarray:
    """The filter (order + 1,) that makes noise like this white, of unit variance if the noise has unit variance.

    Source: Yule-Walker equations for an autoregressive model.
    """
    n = len(noise)
    correlations = np.array([noise[: n - k] @ noise[k:] / n for k in range(WHITENING_ORDER + 1)])
    coefficients = solve_toeplitz(correlations[:-1], correlations[1:])
    innovation = correlations[0] - coefficients @ correlations[1:]
    return np.concatenate([[1.0], -coefficients]) / np.sqrt(innovation / correlations[0])


class VisibilityTest:
    """What the changes of a machine change in its measurements, less what else could explain it.

    Args:
        plan: a campaign without signals, the channels with their true noise.
        machine: the machine without the change.
        settings: conditions of the runs that are not exact.
        whitening: filter that makes the noise white; (1,) for white noise.
    """

    def __init__(self, plan: Campaign, machine: Rig, settings: Sequence[str], whitening: np.ndarray | None = None):
        self.plan, self.machine, self.runs = plan, machine, plan.runs_for(Use.FIT)
        self._whitening = whitening
        unknowns = uncertain_unknowns(plan, machine)
        model = MeasurementModel(plan, machine, unknowns, self.runs)
        self._steps = _accurate_steps(model)
        found = model.predict_all_runs(np.zeros(len(unknowns)), self._steps, with_sensitivities=True)
        self.before = [found[r].values for r in range(len(self.runs))]
        self._model = model
        sensitivities = self.stacked([_bounded(found[r]) for r in range(len(self.runs))])
        self.parameters = _Projection(sensitivities)
        names = [u.name for u in unknowns]
        columns = [*sensitivities.T, *self._of_runs(sensitivities, names, settings), *self._of_sensors()]
        self.all = _Projection(np.stack(columns, axis=1))

    def change(self, machine: Rig) -> np.ndarray:
        """The change of the signals by another machine, in units of noise (samples of all runs and signals,)."""
        return self.change_to(self._signals(machine, self.plan))

    def change_to(self, after: list[Signals]) -> np.ndarray:
        """The same for given signals of the fitted runs."""
        return self.stacked(after) - self.stacked(self.before)

    def stacked(self, runs: list[Signals]) -> np.ndarray:
        """All signals of all runs one below the other, in units of noise, whitened."""
        rows = [run[n] / channel.noise for run in runs for n, channel in self.plan.channels.items()]
        if self._whitening is not None:
            rows = [lfilter(self._whitening, [1.0], row, axis=0) for row in rows]
        return np.concatenate(rows)

    def visible_after_fit(self, change: np.ndarray) -> float:
        """What is left visible of a change when the uncertain parameters are fitted to it (Gauss-Newton steps).

        Args:
            change: change of the signals, in units of noise (samples of all runs and signals,).

        Returns:
            The smallest |s − f(x) − B b|² + |x|² + |b|² found, f being the change by the parameters of the bare
            machine and B b that by the bench; points at which the bare machine cannot be simulated are passed over.
        """
        n = self.parameters.columns.shape[1]
        bench = _Projection(self.all.columns[:, n:])
        x, left, slopes = np.zeros(n), change, self.parameters.columns
        visible = bench.visible(left)
        for _ in range(MAX_FIT_STEPS):
            columns = np.concatenate([slopes, bench.columns], axis=1)
            target = left + slopes @ x
            step = np.linalg.solve(columns.T @ columns + np.eye(columns.shape[1]), columns.T @ target)[:n] - x
            for halving in range(MAX_HALVINGS):
                at = x + 0.5**halving * step
                signals, new_slopes = self._moved(at)
                new_left = change - signals
                reached = bench.visible(new_left) + at @ at if np.isfinite(new_left).all() else np.inf
                if reached < visible:
                    break
            else:
                break
            enough = reached > SUFFICIENT_FALL * visible
            x, left, slopes, visible = at, new_left, new_slopes, reached
            if enough:
                break
        return float(visible)

    def _moved(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The change of the signals by coordinates of the uncertain parameters, and its derivatives there."""
        found = self._model.predict_all_runs(x, self._steps, with_sensitivities=True)
        outcomes = [found[r] for r in range(len(self.runs))]
        moved = self.change_to([outcome.values for outcome in outcomes])
        return moved, np.nan_to_num(self.stacked([_bounded(outcome) for outcome in outcomes]))

    def _signals(self, machine: Rig, plan: Campaign) -> list[Signals]:
        """The signals of the fitted runs with another machine, under the conditions of a plan."""
        model = MeasurementModel(plan, machine, (), plan.runs_for(Use.FIT))
        found = model.predict_all_runs(np.zeros(0), self._steps)
        return [found[r].values for r in range(len(self.runs))]

    def _of_runs(self, sensitivities: np.ndarray, names: list[str], settings: Sequence[str]) -> list[np.ndarray]:
        """What trigger, settings and warm-up of each run change by one standard deviation."""
        columns, ends = [], np.cumsum([0] + [len(run.time) * len(self.plan.channels) for run in self.runs])
        parts = [slice(*ends[r : r + 2]) for r in range(len(self.runs))]
        warm = [("coil_resistance", WARM_UP)] if has_parameter(self.machine, "coil_resistance") else []
        for name, spread in (*warm, *((n, SETTING) for n in settings)):
            if name in names:
                whole = sensitivities[:, names.index(name)] * spread / self.plan.uncertain[name].size
            else:
                whole = self.change_to(self._signals(self.machine, self._with_setting(name, 1.0 + spread)))
            for part in parts:
                column = np.zeros_like(whole)
                column[part] = whole[part]
                columns.append(column)
        rates = self.stacked([self._rates(r) for r in range(len(self.runs))])
        for part in parts:
            column = np.zeros_like(rates)
            column[part] = TRIGGER * rates[part]
            columns.append(column)
        return columns

    def _with_setting(self, name: str, factor: float) -> Campaign:
        """The plan with one condition of all runs multiplied by a factor."""
        runs = []
        for run in self.plan.runs:
            value = run.conditions.get(name, float(get_parameter(self.plan.machine, name)))
            runs.append(dataclasses.replace(run, conditions=run.conditions | {name: factor * value}))
        return dataclasses.replace(self.plan, runs=tuple(runs))

    def _rates(self, r: int) -> Signals:
        return {n: CubicSpline(self.runs[r].time, v)(self.runs[r].time, 1) for n, v in self.before[r].items()}

    def _of_sensors(self) -> list[np.ndarray]:
        """What gain, offset and shift of each signal change by one standard deviation."""
        columns, rates = [], [self._rates(r) for r in range(len(self.runs))]
        for name in self.plan.channels:
            extent = np.ptp(np.concatenate([run[name] for run in self.before]))
            for of_run in (
                [GAIN * run[name] for run in self.before],
                [np.full_like(run[name], OFFSET * extent) for run in self.before],
                [SHIFT * rate[name] for rate in rates],
            ):
                rows = [
                    {n: v if n == name else np.zeros_like(run[n]) for n in run}
                    for run, v in zip(self.before, of_run, strict=True)
                ]
                columns.append(self.stacked(rows))
        return columns


def _bounded(predicted: PredictedSignals) -> Signals:
    """Derivatives within `MAX_DERIVATIVE` times the range of their signal; where a motion sticks they may be huge."""
    limits = {n: MAX_DERIVATIVE * np.ptp(v[np.isfinite(v)]) if np.isfinite(v).any() else 0.0
              for n, v in predicted.values.items()}  # fmt: skip
    return {n: np.clip(v, -limits[n], limits[n]) if limits[n] > 0.0 else v for n, v in predicted.sensitivities.items()}


def _accurate_steps(model: MeasurementModel) -> int:
    """Steps per sample with an error of at most `MAX_ERROR`; `MAX_STEPS_PER_SAMPLE` where no smaller number has it."""
    steps, centre = STEPS_PER_SAMPLE, np.zeros(len(model.unknowns))
    while steps < MAX_STEPS_PER_SAMPLE and not step_error(model, centre, steps) < MAX_ERROR:
        steps *= 2
    return steps


class _Projection:
    """The least squares compensation by columns (samples, n) whose coordinates have a standard normal prior."""

    def __init__(self, columns: np.ndarray):
        self.columns = columns
        self._factor = np.linalg.cholesky(columns.T @ columns + np.eye(columns.shape[1]))

    def visible(self, change: np.ndarray) -> float:
        """The smallest |s − J x|² + |x|² for a change s."""
        return self.overlap(change, change)

    def overlap(self, one: np.ndarray, other: np.ndarray) -> float:
        """The scalar product of what remains of two changes, with the metric of `visible`."""
        a, b = (solve_triangular(self._factor, self.columns.T @ v, lower=True) for v in (one, other))
        return float(one @ other - a @ b)
