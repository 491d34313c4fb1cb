"""Baseline methods that name a missing effect, from the same calibrated model and the same candidates as the diagnosis.

* Sparse regression of the discrepancy (PySINDy's STLSQ): the measured rates of change minus those of the model's
  equations, regressed on the contribution of each effect to the equations.
* Forward selection by BIC: the signatures of the candidates, which are their contributions to the signals, fitted to
  the residual of the calibrated model by least squares, without another fit of the uncertain parameters.
* Residual correlation: the candidates whose signatures are most parallel to the residual.

Every candidate has its parameters at the middle of their plausible ranges. The answer of a method is the names of the
candidates that it would add, best first; an empty answer says that nothing is missing.
"""

import math
import warnings

import jax.numpy as jnp
import numpy as np
from scipy.signal import savgol_filter

from edhas_jax.diagnosis.calibration.fit import Fit, FitProblem
from edhas_jax.diagnosis.search.candidates import (
    Candidate,
    build_problem,
    candidate_unknowns,
    mount_candidate,
    screening_grid,
)
from edhas_jax.diagnosis.search.evaluated_fit import start_coordinates
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import find_parameter, get_parameter, replace_value, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import MeasurementModel

MIN_COSINE = 0.1  # cosine between signature and residual below which a candidate is not named; chance gives 0.01
STLSQ_THRESHOLD = 0.03  # share of the discrepancy of a rate below which a term is dropped
STLSQ_RIDGE = 1e-2  # regularisation as a share of the squared norm of a term, because many terms are nearly parallel
SAVITZKY_GOLAY = (11, 3)  # samples and polynomial order of the filter that differentiates the measurements
MAX_ANSWERS = 3
MEASURED = ("voltage", "current", "piston_position", "outlet_pressure")
RATES = ("current", "piston_velocity", "outlet_pressure")  # states whose rates follow from differentiated signals


def signatures(fitted: Fit, candidates: list[Candidate], per_sample: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """The residual of a fit, and the contribution of each candidate to the signals.

    Args:
        fitted: the fit of the model without the candidates.
        candidates: candidate effects and sensor faults.
        per_sample: time steps per sample.

    Returns:
        The residual and the signatures by candidate (all samples of the fitted runs), in units of noise.
    """
    campaign, runs = fitted.problem.campaign, fitted.problem.model().runs

    def predicted_runs(problem: FitProblem, x: np.ndarray) -> list[dict[str, np.ndarray]]:
        predicted = problem.model().predict_all_runs(x, per_sample)
        return [predicted[r].values for r in range(len(runs))]

    def over_noise(rows: list[dict[str, np.ndarray]]) -> np.ndarray:
        return np.concatenate([row[n] / c.noise for row in rows for n, c in campaign.channels.items()])

    base = predicted_runs(fitted.problem, fitted.x)
    contributions = []
    for candidate in candidates:
        if candidate.signal is not None:
            sensor = candidate.kind(**middle(candidate, campaign))
            changed = [
                row | {candidate.signal: np.asarray(sensor.record(run.time, row[candidate.signal]))}
                for run, row in zip(runs, base, strict=True)
            ]
        else:
            problem = build_problem(campaign, fitted.problem.machine, fitted.problem.instruments, (), candidate)
            values = fitted.values | {candidate.prefix + n: v for n, v in middle(candidate, campaign).items()}
            changed = predicted_runs(problem, start_coordinates(problem, values))
        contributions.append(over_noise(changed) - over_noise(base))
    return over_noise([run.signals for run in runs]) - over_noise(base), contributions


def middle(candidate: Candidate, campaign: Campaign) -> dict[str, float]:
    """The parameters of a candidate at the middle of their plausible ranges (SI), by name."""
    unknowns = candidate_unknowns(candidate, campaign)
    points = screening_grid(unknowns)
    x = points[len(points) // 2]
    return {u.name.removeprefix(candidate.prefix): float(u.value(v)) for u, v in zip(unknowns, x, strict=True)}


def correlation(residual: np.ndarray, contributions: list[np.ndarray], candidates: list[Candidate]) -> list[str]:
    """The names of the candidates with the largest cosines between signature and residual, above `MIN_COSINE`."""
    cosines = [_cosine(residual, s) for s in contributions]
    order = np.argsort(-np.array(cosines))
    return [candidates[k].name for k in order[:MAX_ANSWERS] if cosines[k] > MIN_COSINE]


def _cosine(residual: np.ndarray, signature: np.ndarray) -> float:
    length = float(np.linalg.norm(signature) * np.linalg.norm(residual))
    return abs(float(signature @ residual)) / length if np.isfinite(length) and length > 0.0 else 0.0


def forward_bic(residual: np.ndarray, contributions: list[np.ndarray], candidates: list[Candidate]) -> list[str]:
    """Forward selection: the candidate that decreases χ² most is added as long as BIC = χ² + k ln n decreases."""
    count, chosen = len(residual), []
    remaining_residual, cost = residual, float(residual @ residual)
    remaining = {k: s for k, s in enumerate(contributions) if np.isfinite(s).all() and s @ s > 0.0}
    while len(chosen) < MAX_ANSWERS and remaining:
        best = max(remaining, key=lambda k: (remaining[k] @ remaining_residual) ** 2 / (remaining[k] @ remaining[k]))
        columns = np.stack([contributions[k] for k in (*chosen, best)], axis=1)
        new_residual = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
        if cost - float(new_residual @ new_residual) < math.log(count):
            break
        chosen.append(best)
        del remaining[best]
        remaining_residual, cost = new_residual, float(new_residual @ new_residual)
    return [candidates[k].name for k in chosen]


def sparse_discrepancy(fitted: Fit, candidates: list[Candidate], per_sample: int) -> list[str]:
    """Sequentially thresholded least squares (PySINDy) on the discrepancy of the rates of current, speed and pressure.

    The discrepancy is ẏ − f(y) at the measured y. States that are not measured are taken from the calibrated model, and
    its own ẏ − f(y) is subtracted so that they have little influence. The candidate terms are the contributions of the
    effects to f. An effect that acts through its own states or through valves does not contribute to these rates
    directly, and sensors do not appear in the equations: neither can be found by this method.

    Args:
        fitted: the fit of the model without the candidates.
        candidates: candidate effects and sensor faults.
        per_sample: time steps per sample.

    Returns:
        The names of the effects with the largest coefficients, at most `MAX_ANSWERS`.
    """
    import pysindy

    campaign, runs = fitted.problem.campaign, fitted.problem.model().runs
    effects = [s for s in candidates if s.signal is None]
    states = (n for n in fitted.machine.initial_state() if n in SIGNALS)
    signals_used = tuple(dict.fromkeys((*states, "gas_volume", *MEASURED)))
    model = MeasurementModel(campaign, fitted.machine, (), runs, signals=signals_used)
    found = model.predict_all_runs(np.zeros(0), per_sample)
    modelled = {n: np.concatenate([found[r].values[n] for r in range(len(runs))]) for n in signals_used}
    modelled["gas_volume_change"] = modelled["gas_volume"] - float(fitted.machine.accumulator.accumulator_gas_volume)
    measured = modelled | _derivative(runs, [run.signals for run in runs], 0)
    first_derivatives = [
        _derivative(runs, rows, 1)
        for rows in ([run.signals for run in runs], [found[r].values for r in range(len(runs))])
    ]
    second_derivatives = [
        _derivative(runs, rows, 2)
        for rows in ([run.signals for run in runs], [found[r].values for r in range(len(runs))])
    ]
    measured["piston_velocity"], modelled["piston_velocity"] = (d["piston_position"] for d in first_derivatives)
    rates_at_measured, volts = _rates(campaign, fitted.machine, runs, measured)
    rates_of_model, volts_of_model = _rates(campaign, fitted.machine, runs, modelled)
    change = {n: first_derivatives[0][n] - first_derivatives[1][n] for n in ("current", "outlet_pressure")}
    change["piston_velocity"] = second_derivatives[0]["piston_position"] - second_derivatives[1]["piston_position"]
    # the voltage is measured, and depends on states of the controller that are not measured
    voltage_discrepancy = measured["voltage"] - modelled["voltage"] - (volts - volts_of_model)
    change["current"] = change["current"] - voltage_discrepancy / float(fitted.machine.coil.coil_inductance)
    discrepancy = np.array([change[n] - (rates_at_measured[n] - rates_of_model[n]) for n in RATES])
    table = []
    for candidate in effects:
        machine, _ = mount_candidate(candidate, fitted.machine, fitted.instruments)
        values = {f"{candidate.id}.{n}": v for n, v in middle(candidate, campaign).items()}
        rates_with_effect, _ = _rates(campaign, set_parameters(machine, values), runs, measured)
        table.append([rates_with_effect[n] - rates_at_measured[n] for n in RATES])
    table = np.array(table)  # (candidates, equations, samples)
    scale = discrepancy.std(axis=1)
    table = (table / scale[:, None]).reshape(len(effects), -1)
    discrepancy = (discrepancy / scale[:, None]).ravel()
    sizes = np.sqrt(np.mean(np.square(table), axis=1))
    usable = np.isfinite(sizes) & (sizes > 0.0)
    regression = pysindy.STLSQ(threshold=STLSQ_THRESHOLD, alpha=STLSQ_RIDGE * discrepancy.size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # no term remains, which is a valid answer
        regression.fit((table[usable] / sizes[usable, None]).T, discrepancy[:, None])
    weights = np.zeros(len(effects))
    weights[usable] = np.abs(regression.coef_[0])
    order = np.argsort(-weights)
    return [effects[k].name for k in order[:MAX_ANSWERS] if weights[k] > 0.0]


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
