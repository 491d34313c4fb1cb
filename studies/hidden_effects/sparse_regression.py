"""Rival: sparse regression (PySINDy) of the discrepancy between measured rates and the equations of the model.

The discrepancy is ẏ − f(y) at the measured y. States that are not measured are taken from the calibrated model, and its
own ẏ − f(y) is subtracted so that they have little influence. The terms are the contributions of the effects to f, each
at the grid point whose term is most parallel to the discrepancy. What small changes of the uncertain parameters can
reproduce is projected out of discrepancy and terms. An effect that acts through its own states or through valves does
not contribute to these rates directly, and sensors do not appear in the equations: neither can be found by this method.
"""

import warnings
from collections.abc import Iterable

import jax.numpy as jnp
import numpy as np
from scipy.signal import savgol_filter

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.search.candidates import Candidate, candidate_unknowns, mount_candidate, screening_grid
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import find_parameter, get_parameter, replace_value, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import MeasurementModel
from studies.hidden_effects.answers import Answer
from studies.hidden_effects.correlation import MAX_NAMES, MAX_RANKED, answer_of_names

STLSQ_THRESHOLD = 0.1  # share of the discrepancy of a rate below which a term is dropped
STLSQ_RIDGE = 1e-2  # regularisation as a share of the squared norm of a term, because many terms are nearly parallel
SAVITZKY_GOLAY = (11, 3)  # samples and polynomial order of the filter that differentiates the measurements
PARAMETER_STEP = 0.01  # change of a parameter for its influence on the rates, in standard deviations of its prior
MEASURED = ("voltage", "current", "piston_position", "outlet_pressure")
RATES = ("current", "piston_velocity", "outlet_pressure")  # states whose rates follow from differentiated signals


def sparse_discrepancy(fitted: Fit, candidates: list[Candidate], per_sample: int) -> Answer:
    """Sequentially thresholded least squares (PySINDy) on the discrepancy of the rates of current, speed and pressure.

    Args:
        fitted: the fit of the model without the candidates.
        candidates: candidate effects and sensor faults.
        per_sample: time steps per sample.

    Returns:
        The names of the effects with the largest coefficients, at most `MAX_NAMES`.
    """
    import pysindy

    campaign, runs = fitted.problem.campaign, fitted.problem.model().runs
    measured, discrepancy = _discrepancy(fitted, runs, per_sample)
    scale = discrepancy.std(axis=1)[:, None]

    def change_of_rates(machine: Rig) -> np.ndarray:
        """The rates of a machine less those of the fitted one, all equations one after the other."""
        changed = _rates(campaign, machine, runs, measured)[0]
        return (np.array([changed[n] - fitted_rates[n] for n in RATES]) / scale).ravel()

    fitted_rates = _rates(campaign, fitted.machine, runs, measured)[0]
    of_parameters = [
        change_of_rates(set_parameters(fitted.machine, {u.name: float(u.value(x + PARAMETER_STEP))}))
        for u, x in zip(fitted.problem.unknowns, fitted.x, strict=True)
    ]
    basis = np.linalg.qr(np.array([v for v in of_parameters if v @ v > 0.0]).T)[0]
    target = _without(basis, (discrepancy / scale).ravel())
    names, terms = [], []
    for candidate in candidates:
        if candidate.signal is not None:
            continue
        machine, _ = mount_candidate(candidate, fitted.machine, fitted.instruments)
        changes = (change_of_rates(set_parameters(machine, v)) for v in _grid_values(candidate, campaign))
        usable = [row for row in changes if np.isfinite(row).all() and row @ row > 0.0]
        rows = [row / np.sqrt(np.mean(np.square(row))) for row in (_without(basis, row) for row in usable) if row.any()]
        if rows:
            names.append(candidate.name)
            terms.append(max(rows, key=lambda row: row @ target))
    regression = pysindy.STLSQ(threshold=STLSQ_THRESHOLD, alpha=STLSQ_RIDGE * target.size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # no term remains, which is a valid answer
        regression.fit(np.array(terms).T, target[:, None])
    weights = np.abs(regression.coef_[0])
    overlaps = np.array(terms) @ target
    order = np.argsort(-weights)
    ranked = [*order[weights[order] > 0.0], *(k for k in np.argsort(-overlaps) if weights[k] == 0.0)]
    named = tuple(names[k] for k in order[:MAX_NAMES] if weights[k] > 0.0)
    return answer_of_names(named, tuple(names[k] for k in ranked[:MAX_RANKED]))


def _discrepancy(fitted: Fit, runs: tuple[BenchRun, ...], per_sample: int) -> tuple[dict, np.ndarray]:
    """The states at which the rates are evaluated, and the discrepancy (equations, samples) of `RATES`."""
    campaign = fitted.problem.campaign
    states = (n for n in fitted.machine.initial_state() if n in SIGNALS)
    signals_used = tuple(dict.fromkeys((*states, "gas_volume", *MEASURED)))
    model = MeasurementModel(campaign, fitted.machine, (), runs, signals=signals_used)
    found = model.predict_all_runs(np.zeros(0), per_sample)
    modelled = {n: np.concatenate([found[r].values[n] for r in range(len(runs))]) for n in signals_used}
    modelled["gas_volume_change"] = modelled["gas_volume"] - float(fitted.machine.accumulator.accumulator_gas_volume)
    rows = [run.signals for run in runs], [found[r].values for r in range(len(runs))]
    measured = modelled | _derivative(runs, rows[0], 0)
    first_derivatives = [_derivative(runs, row, 1) for row in rows]
    second_derivatives = [_derivative(runs, row, 2) for row in rows]
    measured["piston_velocity"], modelled["piston_velocity"] = (d["piston_position"] for d in first_derivatives)
    rates_at_measured, volts = _rates(campaign, fitted.machine, runs, measured)
    rates_of_model, volts_of_model = _rates(campaign, fitted.machine, runs, modelled)
    change = {n: first_derivatives[0][n] - first_derivatives[1][n] for n in ("current", "outlet_pressure")}
    change["piston_velocity"] = second_derivatives[0]["piston_position"] - second_derivatives[1]["piston_position"]
    # the voltage is measured, and depends on states of the controller that are not measured
    voltage_discrepancy = measured["voltage"] - modelled["voltage"] - (volts - volts_of_model)
    change["current"] = change["current"] - voltage_discrepancy / float(fitted.machine.coil.coil_inductance)
    return measured, np.array([change[n] - (rates_at_measured[n] - rates_of_model[n]) for n in RATES])


def _grid_values(candidate: Candidate, campaign: Campaign) -> Iterable[dict[str, float]]:
    """The parameters (SI) of a candidate at each point of its grid, by their names in a machine."""
    unknowns = candidate_unknowns(candidate, campaign)
    for x in screening_grid(unknowns):
        yield {
            f"{candidate.id}.{u.name.removeprefix(candidate.prefix)}": float(u.value(v))
            for u, v in zip(unknowns, x, strict=True)
        }


def _without(basis: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """The part of a vector that is orthogonal to an orthonormal basis."""
    return vector - basis @ (basis.T @ vector)


def _derivative(runs: tuple[BenchRun, ...], rows: list[dict], order: int) -> dict[str, np.ndarray]:
    """The derivative of a given order of the measured signals, all runs concatenated."""
    return {
        n: np.concatenate(
            [
                savgol_filter(row[n], *SAVITZKY_GOLAY, deriv=order, delta=run.interval)
                for run, row in zip(runs, rows, strict=True)
            ]
        )
        for n in MEASURED
    }


def _rates(campaign: Campaign, machine: Rig, runs: tuple[BenchRun, ...], states: dict) -> tuple[dict, np.ndarray]:
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
    return whole, np.asarray(signals.voltage)
