"""Draw the cases of the benchmark of hidden effects: hidden effects, their parameters, and the synthetic campaign.

The number of a case is its random seed. Cases from `FIRST_TEST_CASE` on are the held-out test set: nothing may be
changed because of one of them. Cases below it are for development, with which thresholds may be tuned; those from
`FIRST_EARLIER_CASE` on were reserved for testing before, and some of them judged the method of commit a73dad3.
"""

import dataclasses
import enum
import math

import numpy as np

from edhas_jax.core.structs import replace
from edhas_jax.diagnosis.search.candidates import SENSOR_FAULTS, SINGLE_EFFECT_SLOTS, Candidate
from edhas_jax.machine.effects import LIBRARY, EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import PumpBench, Rig
from edhas_jax.measurements.campaign import Campaign, Channel, Use
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.sensor_models import SensorLag, SensorModel, record
from edhas_jax.measurements.synthetic_campaign import PlannedRun, draw_parameters, planned_campaign, synthesise
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from edhas_jax.simulation.rk4_reference import Unstable

FIRST_EARLIER_CASE, FIRST_TEST_CASE = 11000, 40000
MIN_VISIBILITY = 60.0  # χ² that no change of the uncertain parameters can explain; less cannot be detected
MODEL_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir)
UNCERTAIN = {
    "coil_resistance": 0.02, "force_constant": 0.02, "mover_damping": 0.25, "coulomb_friction": 0.25,
    "static_friction": 0.25, "oil_viscosity": 0.15, "air_fraction": 0.4, "valve_spring_rate": 0.05,
    "valve_damping": 0.15, "piston_clearance": 0.1, "load_orifice_area": 0.03, "pump_damping": 0.3,
}  # fmt: skip
CHANNELS = {
    "voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6),
    "outlet_pressure": Channel("MPa", 1.5e3), "outlet_flow": Channel("L/min", 2e-7),
}  # fmt: skip
BENCH_RUNS = tuple(
    PlannedRun(use, seconds, {"frequency": frequency, "amplitude": 1e-3 * mm, "load_orifice_area": 1e-6 * area})
    for use, seconds, frequency, mm, area in (
        (Use.FIT, 0.72, 5.0, 3.5, 4.2), (Use.FIT, 0.42, 10.0, 3.5, 4.2), (Use.FIT, 0.27, 20.0, 3.5, 4.2),
        (Use.FIT, 0.22, 30.0, 3.5, 4.2), (Use.FIT, 0.42, 10.0, 3.5, 1.2), (Use.FIT, 0.27, 20.0, 3.0, 1.0),
        (Use.HOLDOUT, 0.32, 15.0, 3.5, 2.0), (Use.HOLDOUT, 0.24, 25.0, 3.0, 1.5),
    )
)  # fmt: skip
SAMPLE_INTERVAL = 2e-4  # s
STEPS_PER_SAMPLE = 12  # for the estimate of the visibility
MAX_DRAWS = 12  # draws of the parameters of an effect, and of the whole case, until everything hidden is visible
UNMODELLED_LAG = (20e-6, 50e-6)  # s; range of the lag of every sensor with the option --sensor-lags
MAX_OFFSET = 0.03  # largest offset of a sensor, as a share of the range of its signal
PUMP_EFFECTS = [kind for kind in LIBRARY if set(kind.slots) <= set(PumpBench.slots)]


class Family(enum.Enum):
    """What is hidden in a case."""

    NULL = "null"  # nothing
    ONE = "one"  # one effect of the library
    SENSOR = "sensor"  # the fault of one sensor
    PAIR = "pair"  # two effects
    WITHHELD = "withheld"  # one effect that is withheld from the library of the diagnosis


# families of ten consecutive cases
FAMILIES = (
    Family.ONE, Family.NULL, Family.ONE, Family.SENSOR, Family.ONE, Family.PAIR, Family.ONE, Family.WITHHELD,
    Family.ONE, Family.NULL,
)  # fmt: skip


def family_of(number: int) -> Family:
    """What is hidden in the case of a number."""
    return FAMILIES[number % len(FAMILIES)]


@dataclasses.dataclass(frozen=True)
class Hidden:
    """A hidden effect or sensor fault, with its parameters (SI) and its visibility.

    `visible` is the χ² in the fitted runs that remains after the best compensation by the uncertain parameters.
    """

    candidate: Candidate
    values: dict[str, float]
    visible: float


@dataclasses.dataclass(frozen=True)
class HiddenCase:
    """A synthetic campaign and what is hidden in it; `noise_factor` is its noise over the usual one."""

    number: int
    family: Family
    hidden: tuple[Hidden, ...]
    noise_factor: float
    campaign: Campaign

    @property
    def withheld(self) -> list[type]:
        """The effects that are removed from the library before the diagnosis."""
        return [h.candidate.kind for h in self.hidden] if self.family is Family.WITHHELD else []


def draw_case(number: int, unmodelled_lags: bool = False) -> HiddenCase:
    """Draw the case of a number.

    Args:
        number: the number, which determines the case.
        unmodelled_lags: whether every sensor has a small lag that is not in the library of the diagnosis.

    Raises:
        RuntimeError: no draw was visible.
    """
    rng = np.random.default_rng([20221011, number])
    family = family_of(number)
    noise_factor = float(rng.choice([1.0, 2.0]))
    channels = {n: dataclasses.replace(c, noise=noise_factor * c.noise) for n, c in CHANNELS.items()}
    for attempt in range(MAX_DRAWS):
        kinds = _hidden_kinds(number, family, attempt, rng)
        refined = [kind for kind in MODEL_EFFECTS if kind not in kinds]
        machine = PumpBench(effects=tuple(kind() for kind in refined))
        plan = planned_campaign(f"hidden{number:04d}", machine, UNCERTAIN, channels, BENCH_RUNS, SAMPLE_INTERVAL)
        base = draw_parameters(plan, machine, rng)
        hidden = [
            h
            for candidate in _hidden_candidates(kinds, rng)
            if (h := _draw_visible(plan, base, candidate, rng)) is not None
        ]
        if len(hidden) < len(kinds):
            continue
        truth, faults = base, {}
        for h in hidden:
            truth, chains = _with_hidden(h.candidate, h.values, truth)
            faults |= chains
        front_ends = {}
        if unmodelled_lags:
            front_ends = {n: (SensorLag(lag_time=float(rng.uniform(*UNMODELLED_LAG))),) for n in channels}
        try:
            campaign = synthesise(plan, truth, rng, faults, front_ends)
        except Unstable:
            continue
        return HiddenCase(number, family, tuple(hidden), noise_factor, campaign)
    raise RuntimeError(f"case {number}: nothing visible in {MAX_DRAWS} draws")


def _hidden_kinds(number: int, family: Family, attempt: int, rng: np.random.Generator) -> list[type]:
    """The kinds of effects to hide: single ones in turn, or at random after an attempt that was not visible."""
    if family is Family.NULL:
        return []
    if family is Family.SENSOR:
        return [SENSOR_FAULTS[(number // len(FAMILIES) + attempt) % len(SENSOR_FAULTS)]]
    if family is Family.PAIR:
        while True:
            pair = [PUMP_EFFECTS[i] for i in rng.choice(len(PUMP_EFFECTS), 2, replace=False)]
            exclusive = [slot.name for kind in pair for slot in kind.slots if slot.name in SINGLE_EFFECT_SLOTS]
            if len(exclusive) == len(set(exclusive)):
                return pair
    if attempt:
        return [PUMP_EFFECTS[rng.integers(len(PUMP_EFFECTS))]]
    rounds, position = divmod(number, len(FAMILIES))
    turn = FAMILIES.count(family) * rounds + FAMILIES[:position].count(family)
    start = 0 if family is Family.ONE else len(PUMP_EFFECTS) // 2
    # neighbours in the library are similar: a stride coprime to its length visits all, far apart
    stride = next(s for s in range(7, 7 + len(PUMP_EFFECTS)) if math.gcd(s, len(PUMP_EFFECTS)) == 1)
    return [PUMP_EFFECTS[(start + stride * turn) % len(PUMP_EFFECTS)]]


def _hidden_candidates(kinds: list[type], rng: np.random.Generator) -> list[Candidate]:
    signals = list(CHANNELS)
    return [Candidate(k, str(rng.choice(signals))) if k in SENSOR_FAULTS else Candidate(k) for k in kinds]


def _draw_visible(plan: Campaign, base: Rig, candidate: Candidate, rng: np.random.Generator) -> Hidden | None:
    """Draw the parameters of a candidate from their plausible ranges until it is visible; None if no draw was."""
    model = MeasurementModel(plan, base, uncertain_unknowns(plan, base), plan.runs_for(Use.FIT))
    every_run = range(len(model.runs))
    predicted = model.predict_all_runs(np.zeros(len(model.unknowns)), STEPS_PER_SAMPLE, with_sensitivities=True)
    sensitivities = _over_noise(plan, [predicted[r].sensitivities for r in every_run])
    before = [predicted[r].values for r in every_run]
    for _ in range(MAX_DRAWS):
        values = _draw_values(candidate, before, rng)
        truth, faults = _with_hidden(candidate, values, base)
        if faults:
            after = [_recorded(run.time, signals, faults) for run, signals in zip(model.runs, before, strict=True)]
        else:
            predicted = MeasurementModel(plan, truth, (), model.runs).predict_all_runs(np.zeros(0), STEPS_PER_SAMPLE)
            after = [predicted[r].values for r in every_run]
        change = _over_noise(plan, after) - _over_noise(plan, before)
        # regularised least squares: the best compensation of the change by the uncertain parameters
        curvature = sensitivities.T @ sensitivities + np.eye(sensitivities.shape[1])
        compensation = np.linalg.solve(curvature, sensitivities.T @ change)
        visible = float(change @ (change - sensitivities @ compensation))
        if np.isfinite(visible) and visible > MIN_VISIBILITY:
            return Hidden(candidate, values, visible)
    return None


def _draw_values(candidate: Candidate, before: list[dict], rng: np.random.Generator) -> dict[str, float]:
    """Draw the parameters of a candidate from their plausible ranges: log-uniformly if positive, else uniformly."""
    values = {}
    for p in candidate.free_parameters():
        if candidate.kind in MODEL_EFFECTS:
            spread = UNCERTAIN.get(p.name, 0.0)
            values[p.name] = p.default * math.exp(spread * float(np.clip(rng.standard_normal(), -2.0, 2.0)))
        elif p.plausible is None:
            extent = np.ptp(np.concatenate([run[candidate.signal] for run in before]))
            values[p.name] = float(rng.uniform(-MAX_OFFSET, MAX_OFFSET) * extent)
        elif p.plausible[0] > 0.0 and candidate.signal is None or p.unit == "s":
            low, high = np.log(p.plausible)
            values[p.name] = float(np.exp(rng.uniform(low, high)))
        else:
            values[p.name] = float(rng.uniform(*p.plausible))
    return values


def _with_hidden(
    candidate: Candidate, values: dict[str, float], machine: Rig
) -> tuple[Rig, dict[str, tuple[SensorModel, ...]]]:
    """The machine with the effect added, or the measurement chain with the sensor fault."""
    if candidate.signal is not None:
        return machine, {candidate.signal: (candidate.kind(**values),)}
    changed, _ = candidate.mounted(machine, Instruments())
    effect = replace(changed.effects[-1], **values)
    return replace(changed, effects=(*changed.effects[:-1], effect)), {}


def _recorded(time: np.ndarray, values: dict, faults: dict) -> dict:
    """The signals of a run after the faults of their sensors."""
    return values | {n: np.asarray(record(chain, time, values[n])) for n, chain in faults.items()}


def _over_noise(plan: Campaign, runs: list[dict]) -> np.ndarray:
    """All signals of all runs concatenated along the samples, in units of noise."""
    return np.concatenate([run[n] / channel.noise for run in runs for n, channel in plan.channels.items()])
