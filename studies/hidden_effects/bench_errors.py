"""What the usual errors of a bench change in the signals: trigger and settings of each run, and the sensors.

The sizes are those that the campaign states, or the usual ones. Rival methods may explain with them, as with the
uncertain parameters, whatever they can.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.parameters import get_parameter, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun
from edhas_jax.measurements.measurement_model import MeasurementModel

RunSignals = Mapping[str, np.ndarray]


def bench_error_changes(fitted: Fit) -> list[list[RunSignals]]:
    """The change of the signals by each error of the bench at one standard deviation.

    Args:
        fitted: the calibrated model.

    Returns:
        For each error the changes of the signals (samples,) of all fitted runs in SI.
    """
    runs = fitted.problem.model().runs
    before = [out.values for out in fitted.outcomes]
    return [*_of_sensors(fitted, runs, before), *_of_runs(fitted, runs, before)]


def _of_sensors(fitted: Fit, runs: Sequence[BenchRun], before: list[RunSignals]) -> Iterator[list[RunSignals]]:
    """Gain, offset and time shift of each signal, the same in all runs."""
    for name, sensor in fitted.problem.campaign.accuracy.signals.items():
        rates = [np.gradient(of[name], run.time) for run, of in zip(runs, before, strict=True)]
        shifts = [-sensor.shift * rate for rate in rates]
        for changes in ([sensor.gain * of[name] for of in before],
                        [np.full_like(of[name], sensor.offset) for of in before], shifts):  # fmt: skip
            yield [
                {n: change if n == name else np.zeros_like(v) for n, v in of.items()}
                for of, change in zip(before, changes, strict=True)
            ]


def _of_runs(fitted: Fit, runs: Sequence[BenchRun], before: list[RunSignals]) -> Iterator[list[RunSignals]]:
    """Trigger and settings, of one run after the other."""
    accuracy = fitted.problem.campaign.accuracy
    of_all = [
        [{n: -accuracy.trigger * np.gradient(v, run.time) for n, v in of.items()}
         for run, of in zip(runs, before, strict=True)]
    ]  # fmt: skip
    of_all += [_of_setting(fitted, runs, name, share) for name, share in accuracy.settings.items() if share > 0.0]
    for changes in of_all:
        for r in range(len(runs)):
            yield [of if k == r else {n: np.zeros_like(v) for n, v in of.items()} for k, of in enumerate(changes)]


def _of_setting(fitted: Fit, runs: Sequence[BenchRun], name: str, share: float) -> list[RunSignals]:
    """The change of the signals of all runs where a setting is larger by a share."""
    per_sample = fitted.resolution.coarse
    before, after = (
        _signals(fitted, fitted.machine, runs, per_sample),
        _signals(fitted, *_with_setting(fitted.machine, runs, name, 1.0 + share), per_sample),
    )
    return [{n: a[n] - v for n, v in b.items()} for a, b in zip(after, before, strict=True)]


def _with_setting(machine: Rig, runs: Sequence[BenchRun], name: str, factor: float) -> tuple[Rig, list[BenchRun]]:
    """A machine and runs with another value of a parameter, which the runs set or the machine has."""
    if not any(name in run.conditions for run in runs):
        return set_parameters(machine, {name: factor * float(get_parameter(machine, name))}), list(runs)
    changed = [
        dataclasses.replace(run, conditions={n: v * (factor if n == name else 1.0) for n, v in run.conditions.items()})
        for run in runs
    ]
    return machine, changed


def _signals(fitted: Fit, machine: Rig, runs: Sequence[BenchRun], per_sample: int) -> list[RunSignals]:
    model = MeasurementModel(fitted.problem.campaign, machine, (), runs, fitted.instruments)
    found = model.predict_all_runs(np.zeros(0), per_sample)
    return [found[r].values for r in range(len(runs))]
