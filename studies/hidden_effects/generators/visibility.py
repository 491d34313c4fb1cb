"""How much of a change of the signals neither the uncertain parameters nor the usual errors of a bench can explain.

    visible = min over x of |s − J x|² + |x|²

s is the change of all signals of the fitted runs in units of their noise, x what may compensate it, in units of its
prior standard deviation: the uncertain parameters; per run the trigger, the settings and the coil resistance; per
signal gain, offset and time shift. J are their sensitivities at the true machine. White noise is assumed.
"""

import dataclasses

import numpy as np

from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from studies.hidden_effects.generators.benches import EXACT_CONDITIONS

STEPS_PER_SAMPLE = 12
TRIGGER = 0.2e-3  # s, standard deviation of the start of a record
SETTING = 0.005  # relative, of a setting from run to run
WARM_UP = 0.005  # relative, of the coil resistance from run to run
GAIN, OFFSET, SHIFT = 0.003, 0.001, 20e-6  # of a signal: relative, of its range, s

Signals = dict[str, np.ndarray]


class VisibilityTest:
    """What the changes of a machine change in its measurements, less what else could explain it.

    Args:
        plan: a campaign without signals, the channels with their true noise.
        machine: the machine without the change.
    """

    def __init__(self, plan: Campaign, machine: Rig):
        self.plan, self.machine, self.runs = plan, machine, plan.runs_for(Use.FIT)
        unknowns = uncertain_unknowns(plan, machine)
        model = MeasurementModel(plan, machine, unknowns, self.runs)
        found = model.predict_all_runs(np.zeros(len(unknowns)), STEPS_PER_SAMPLE, with_sensitivities=True)
        self.before = [found[r].values for r in range(len(self.runs))]
        sensitivities = self._stacked([found[r].sensitivities for r in range(len(self.runs))])
        self.parameters = _Projection(sensitivities)
        columns = [*sensitivities.T, *self._of_runs(sensitivities, [u.name for u in unknowns]), *self._of_sensors()]
        self.all = _Projection(np.stack(columns, axis=1))

    def change(self, machine: Rig) -> np.ndarray:
        """The change of the signals by another machine, in units of noise (samples of all runs and signals,)."""
        return self.change_of_signals(self.signals(machine))

    def signals(self, machine: Rig, plan: Campaign | None = None) -> list[Signals]:
        """The signals of the fitted runs with another machine, or with the conditions of another plan."""
        plan = self.plan if plan is None else plan
        model = MeasurementModel(plan, machine, (), plan.runs_for(Use.FIT))
        found = model.predict_all_runs(np.zeros(0), STEPS_PER_SAMPLE)
        return [found[r].values for r in range(len(self.runs))]

    def change_of_signals(self, after: list[Signals]) -> np.ndarray:
        """The same for given signals of the fitted runs."""
        return self._stacked(after) - self._stacked(self.before)

    def _stacked(self, runs: list[Signals]) -> np.ndarray:
        """All signals of all runs one below the other, in units of noise."""
        return np.concatenate([run[n] / channel.noise for run in runs for n, channel in self.plan.channels.items()])

    def _alone(self, r: int, values: Signals) -> np.ndarray:
        """Values of one run, zero in the others."""
        zero = [{n: np.zeros_like(v) for n, v in run.items()} for run in self.before]
        return self._stacked([values if k == r else run for k, run in enumerate(zero)])

    def _rates(self, r: int) -> Signals:
        return {n: np.gradient(v, self.runs[r].time) for n, v in self.before[r].items()}

    def _of_runs(self, sensitivities: np.ndarray, names: list[str]) -> list[np.ndarray]:
        """What trigger, settings and warm-up of each run change by one standard deviation."""
        columns = []
        for name, share in (("coil_resistance", WARM_UP), *((n, SETTING) for n in self._settings())):
            if name in names:
                whole = sensitivities[:, names.index(name)] * share / self.plan.uncertain[name]
            else:
                changed = [
                    dataclasses.replace(r, conditions=r.conditions | {name: r.conditions.get(name, 0.0) * (1 + share)})
                    for r in self.plan.runs
                ]
                changed = dataclasses.replace(self.plan, runs=tuple(changed))
                whole = self.change_of_signals(self.signals(self.machine, changed))
            ones = [{n: np.ones_like(v) * c.noise for n, c in self.plan.channels.items() for v in [run[n]]}
                    for run in self.before]  # fmt: skip
            columns += [whole * self._alone(r, run) for r, run in enumerate(ones)]
        for r in range(len(self.runs)):
            columns.append(self._alone(r, {n: TRIGGER * v for n, v in self._rates(r).items()}))
        return columns

    def _settings(self) -> list[str]:
        return [n for n in dict.fromkeys(n for r in self.runs for n in r.conditions) if n not in EXACT_CONDITIONS]

    def _of_sensors(self) -> list[np.ndarray]:
        """What gain, offset and shift of each signal change by one standard deviation."""
        columns = []
        for name in self.plan.channels:
            extent = np.ptp(np.concatenate([run[name] for run in self.before]))
            rates = [self._rates(r) for r in range(len(self.runs))]
            for of_run in (
                [GAIN * run[name] for run in self.before],
                [np.full_like(run[name], OFFSET * extent) for run in self.before],
                [SHIFT * rate[name] for rate in rates],
            ):
                rows = [
                    {n: v if n == name else np.zeros_like(run[n]) for n in run}
                    for run, v in zip(self.before, of_run, strict=True)
                ]
                columns.append(self._stacked(rows))
        return columns


class _Projection:
    """The least squares compensation by columns (samples, n) whose coordinates have a standard normal prior."""

    def __init__(self, columns: np.ndarray):
        self._columns = columns
        self._factor = np.linalg.cholesky(columns.T @ columns + np.eye(columns.shape[1]))

    def visible(self, change: np.ndarray) -> float:
        """The smallest |s − J x|² + |x|² for a change s."""
        compensated = np.linalg.solve(self._factor, self._columns.T @ change)
        return float(change @ change - compensated @ compensated)

    def overlap(self, one: np.ndarray, other: np.ndarray) -> float:
        """The scalar product of what remains of two changes, with the metric of `visible`."""
        a, b = (np.linalg.solve(self._factor, self._columns.T @ v) for v in (one, other))
        return float(one @ other - a @ b)
