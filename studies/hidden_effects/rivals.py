"""What others would use to name a missing effect, on the same calibrated model and the same candidates.

* sparse regression of the discrepancy (PySINDy's STLSQ): the measured rates of change less those of the model's
  equations, regressed on what each effect adds to the equations;
* forward selection by BIC: what each candidate adds to the signals, fitted to the residual of the calibrated model by
  least squares, nothing being left for the parameters to take up;
* residual correlation: the candidate whose signature is most parallel to the residual.

Each has every candidate at the middle of its plausible range, and answers with the names of what it would add, the best
first; an empty answer says that nothing is missing.
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

ALIKE = 0.1  # cosine between signature and residual below which correlation names nothing: chance gives 0.01
SPARSE = 0.03  # STLSQ: share of a rate's discrepancy below which a term is dropped
RIDGE = 1e-2  # its ridge, as a share of the squared length of a term: many terms are nearly parallel
SMOOTH = (11, 3)  # samples and order of the polynomials that differentiate the measurements
MOST = 3
MEASURED = ("voltage", "current", "piston_position", "outlet_pressure")
RATES = ("current", "piston_velocity", "outlet_pressure")  # the equations whose left side can be had by differentiation


def signatures(fitted: Fit, candidates: list[Candidate], per_sample: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """The residual of a fit, and what each candidate adds to the signals, in units of noise, in the fitted runs."""
    campaign, runs = fitted.problem.campaign, fitted.problem.model().runs
    every = tuple(range(len(runs)))

    def seen(problem: FitProblem, x: np.ndarray) -> list[dict[str, np.ndarray]]:
        found = problem.model().predict_all_runs(x, per_sample)
        return [found[r].values for r in every]

    def flat(rows: list[dict[str, np.ndarray]]) -> np.ndarray:
        return np.concatenate([row[n] / c.noise for row in rows for n, c in campaign.channels.items()])

    base = seen(fitted.problem, fitted.x)
    out = []
    for candidate in candidates:
        if candidate.signal is not None:
            link = candidate.kind(**middle(candidate, campaign))
            changed = [
                row | {candidate.signal: np.asarray(link.record(run.time, row[candidate.signal]))}
                for run, row in zip(runs, base, strict=True)
            ]
        else:
            problem = build_problem(campaign, fitted.problem.machine, fitted.problem.instruments, (), candidate)
            values = fitted.values | {candidate.prefix + n: v for n, v in middle(candidate, campaign).items()}
            changed = seen(problem, start_coordinates(problem, values))
        out.append(flat(changed) - flat(base))
    return flat([run.signals for run in runs]) - flat(base), out


def middle(candidate: Candidate, campaign: Campaign) -> dict[str, float]:
    """The parameters of a candidate at the middle of their plausible ranges, SI."""
    unknowns = candidate_unknowns(candidate, campaign)
    points = screening_grid(unknowns)
    x = points[len(points) // 2]
    return {u.name.removeprefix(candidate.prefix): float(u.value(v)) for u, v in zip(unknowns, x, strict=True)}


def correlation(residual: np.ndarray, signs: list[np.ndarray], candidates: list[Candidate]) -> list[str]:
    """The candidates by the cosine of their signature with the residual, those above `ALIKE`."""
    cosines = [_cosine(residual, s) for s in signs]
    order = np.argsort(-np.array(cosines))
    return [candidates[k].name for k in order[:MOST] if cosines[k] > ALIKE]


def _cosine(residual: np.ndarray, signature: np.ndarray) -> float:
    length = float(np.linalg.norm(signature) * np.linalg.norm(residual))
    return abs(float(signature @ residual)) / length if np.isfinite(length) and length > 0.0 else 0.0


def forward_bic(residual: np.ndarray, signs: list[np.ndarray], candidates: list[Candidate]) -> list[str]:
    """Forward selection: the candidate that lowers χ² most is added while BIC = χ² + k ln n falls."""
    count, chosen = len(residual), []
    left, cost = residual, float(residual @ residual)
    whole = {k: s for k, s in enumerate(signs) if np.isfinite(s).all() and s @ s > 0.0}
    while len(chosen) < MOST and whole:
        best = max(whole, key=lambda k: (whole[k] @ left) ** 2 / (whole[k] @ whole[k]))
        columns = np.stack([signs[k] for k in (*chosen, best)], axis=1)
        tried = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
        if cost - float(tried @ tried) < math.log(count):
            break
        chosen.append(best)
        del whole[best]
        left, cost = tried, float(tried @ tried)
    return [candidates[k].name for k in chosen]


def sparse_discrepancy(fitted: Fit, candidates: list[Candidate], per_sample: int) -> list[str]:
    """Sequentially thresholded least squares (PySINDy) on the discrepancy of the rates of current, speed and pressure.

    The discrepancy is what is left of ẏ − f(y) at the measured y; states that are not measured are the calibrated
    model's, whose own ẏ − f(y) is taken off so that they matter little. The candidate terms are what each effect adds
    to f there. An effect that acts through states of its own or through valves adds nothing to these rates at once, and
    sensors have no place in an equation: neither can be found this way.
    """
    import pysindy

    campaign, runs = fitted.problem.campaign, fitted.problem.model().runs
    able = [s for s in candidates if s.signal is None]
    states = (n for n in fitted.machine.initial_state() if n in SIGNALS)
    watch = tuple(dict.fromkeys((*states, "gas_volume", *MEASURED)))
    model = MeasurementModel(campaign, fitted.machine, (), runs, signals=watch)
    found = model.predict_all_runs(np.zeros(0), per_sample)
    modelled = {n: np.concatenate([found[r].values[n] for r in range(len(runs))]) for n in watch}
    modelled["gas_volume_change"] = modelled["gas_volume"] - float(fitted.machine.accumulator.accumulator_gas_volume)
    measured = modelled | _smooth(runs, [run.signals for run in runs], 0)
    speeds = [
        _smooth(runs, rows, 1) for rows in ([run.signals for run in runs], [found[r].values for r in range(len(runs))])
    ]
    bends = [
        _smooth(runs, rows, 2) for rows in ([run.signals for run in runs], [found[r].values for r in range(len(runs))])
    ]
    measured["piston_velocity"], modelled["piston_velocity"] = (d["piston_position"] for d in speeds)
    base, volts = _rates(campaign, fitted.machine, runs, measured)
    own, own_volts = _rates(campaign, fitted.machine, runs, modelled)
    change = {n: speeds[0][n] - speeds[1][n] for n in ("current", "outlet_pressure")}
    change["piston_velocity"] = bends[0]["piston_position"] - bends[1]["piston_position"]
    # the command is measured, and depends on more than the states that are known here
    unknown_volts = measured["voltage"] - modelled["voltage"] - (volts - own_volts)
    change["current"] = change["current"] - unknown_volts / float(fitted.machine.coil.coil_inductance)
    wanted = np.array([change[n] - (base[n] - own[n]) for n in RATES])
    table = []
    for candidate in able:
        machine, _ = mount_candidate(candidate, fitted.machine, fitted.instruments)
        values = {f"{candidate.id}.{n}": v for n, v in middle(candidate, campaign).items()}
        there, _ = _rates(campaign, set_parameters(machine, values), runs, measured)
        table.append([there[n] - base[n] for n in RATES])
    table = np.array(table)  # (candidates, equations, samples)
    scale = wanted.std(axis=1)
    table = (table / scale[:, None]).reshape(len(able), -1)
    wanted = (wanted / scale[:, None]).ravel()
    sizes = np.sqrt(np.mean(np.square(table), axis=1))
    sound = np.isfinite(sizes) & (sizes > 0.0)
    fitting = pysindy.STLSQ(threshold=SPARSE, alpha=RIDGE * wanted.size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that no term is left: an answer too
        fitting.fit((table[sound] / sizes[sound, None]).T, wanted[:, None])
    weights = np.zeros(len(able))
    weights[sound] = np.abs(fitting.coef_[0])
    order = np.argsort(-weights)
    return [able[k].name for k in order[:MOST] if weights[k] > 0.0]


def _smooth(runs: tuple[BenchRun, ...], rows: list[dict], order: int) -> dict[str, np.ndarray]:
    """The derivative of some order of the measured signals of all runs, one run after the other."""
    return {
        n: np.concatenate(
            [
                savgol_filter(row[n], *SMOOTH, deriv=order, delta=run.interval)
                for run, row in zip(runs, rows, strict=True)
            ]
        )
        for n in MEASURED
    }


def _rates(campaign: Campaign, machine: Rig, runs: tuple[BenchRun, ...], seen: dict) -> tuple[dict, np.ndarray]:
    """The rates of all states, and the voltage, at the samples of all runs; what is not `seen` is as at the start."""
    mounted_for = [campaign.machine_of(run, machine) for run in runs]
    lengths = [len(run.time) for run in runs]
    for name in runs[0].conditions:
        p, path = find_parameter(machine, name)
        values = np.repeat([float(get_parameter(m, name)) for m in mounted_for], lengths)
        machine = replace_value(machine, path, p.name, jnp.asarray(values))
    time = jnp.asarray(np.concatenate([run.time for run in runs]))
    start = machine.initial_state()
    y = {n: jnp.asarray(seen[n]) if n in seen else jnp.full(len(time), float(v)) for n, v in start.items()}
    signals, found = machine.evaluate(y, time, 1.0, y)
    found = found | signals.record.pressure_rates
    whole = {n: np.asarray(jnp.broadcast_to(v, time.shape)) for n, v in found.items()}
    return whole, np.asarray(signals.voltage)
