"""The cases of the benchmark of hidden effects: what is hidden, how large, in which campaign; all drawn from a number.

Cases below `SEALED` are for development: thresholds may be tuned with them. Those from `SEALED` on are for judging
alone: nothing was ever changed because of one.
"""

import dataclasses
import enum
import math

import numpy as np

from edhas_jax.core.structs import replace
from edhas_jax.diagnosis.search.candidates import SENSOR_FAULTS, SINGLE_EFFECT_SLOTS, Candidate, mount_candidate
from edhas_jax.machine.effects import LIBRARY, EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import PumpBench, Rig
from edhas_jax.measurements.campaign import Campaign, Channel, Use
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.sensor_models import SensorLag, SensorModel, record
from edhas_jax.measurements.synthetic_campaign import PlannedRun, draw_parameters, planned_campaign, synthesise
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from edhas_jax.simulation.rk4_reference import Unstable

SEALED = 11000
VISIBLE = 60.0  # χ² that no change of the uncertain parameters takes up, below which nothing can be found
REFINED = (LugreFriction, PistonLeakage, EntrainedAir)
UNCERTAIN = {
    "coil_resistance": 0.02, "force_constant": 0.02, "mover_damping": 0.25, "coulomb_friction": 0.25,
    "static_friction": 0.25, "oil_viscosity": 0.15, "air_fraction": 0.4, "valve_spring_rate": 0.05,
    "valve_damping": 0.15, "piston_clearance": 0.1, "load_orifice_area": 0.03, "pump_damping": 0.3,
}  # fmt: skip
CHANNELS = {
    "voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6),
    "outlet_pressure": Channel("MPa", 1.5e3), "outlet_flow": Channel("L/min", 2e-7),
}  # fmt: skip
RUNS = tuple(
    PlannedRun(use, seconds, {"frequency": frequency, "amplitude": 1e-3 * mm, "load_orifice_area": 1e-6 * area})
    for use, seconds, frequency, mm, area in (
        (Use.FIT, 0.72, 5.0, 3.5, 4.2), (Use.FIT, 0.42, 10.0, 3.5, 4.2), (Use.FIT, 0.27, 20.0, 3.5, 4.2),
        (Use.FIT, 0.22, 30.0, 3.5, 4.2), (Use.FIT, 0.42, 10.0, 3.5, 1.2), (Use.FIT, 0.27, 20.0, 3.0, 1.0),
        (Use.HOLDOUT, 0.32, 15.0, 3.5, 2.0), (Use.HOLDOUT, 0.24, 25.0, 3.0, 1.5),
    )
)  # fmt: skip
INTERVAL = 2e-4
PER_SAMPLE = 12  # steps by which visibility is judged
TRIES = 12  # draws of a size, and of another effect where none is visible
CRUMB = (20e-6, 50e-6)  # s; lag of every sensor in the arm with crumbs
OFFSETS = 0.03  # of a signal's range, the largest offset of its sensor
PUMP = [kind for kind in LIBRARY if set(kind.slots) <= set(PumpBench.slots)]


class Family(enum.Enum):
    """What kind of case it is."""

    NULL = "null"
    ONE = "one"
    SENSOR = "sensor"
    PAIR = "pair"
    STRUCK = "struck"


# every second case hides one effect, in turn; the others are dealt in this order
ORDER = (
    Family.ONE, Family.NULL, Family.ONE, Family.SENSOR, Family.ONE, Family.PAIR, Family.ONE, Family.STRUCK,
    Family.ONE, Family.NULL,
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Hidden:
    """Something hidden: an effect or a sensor's fault with its parameters (SI), and how visible it is.

    `visible` is the χ² in the runs for fitting that is left when the uncertain parameters have taken up what they can.
    """

    candidate: Candidate
    values: dict[str, float]
    visible: float


@dataclasses.dataclass(frozen=True)
class HiddenCase:
    """A campaign with what is hidden in it; `louder` is the noise over that of the plan."""

    number: int
    family: Family
    hidden: tuple[Hidden, ...]
    louder: float
    campaign: Campaign

    @property
    def struck(self) -> list[type]:
        """The effects that a diagnosis is not told of."""
        return [h.candidate.kind for h in self.hidden] if self.family is Family.STRUCK else []


def draw_case(number: int, crumbs: bool = False) -> HiddenCase:
    """The case of that number; with `crumbs` every sensor lags by a little that no library knows."""
    rng = np.random.default_rng([20221011, number])
    family = ORDER[number % len(ORDER)]
    louder = float(rng.choice([1.0, 2.0]))
    channels = {n: dataclasses.replace(c, noise=louder * c.noise) for n, c in CHANNELS.items()}
    for attempt in range(TRIES):
        kinds = _kinds(number, family, attempt, rng)
        refined = [kind for kind in REFINED if kind not in kinds]
        machine = PumpBench(effects=tuple(kind() for kind in refined))
        plan = planned_campaign(f"hidden{number:04d}", machine, UNCERTAIN, channels, RUNS, INTERVAL)
        base = draw_parameters(plan, machine, rng)
        hidden = [h for candidate in _candidates(kinds, rng) if (h := _visible(plan, base, candidate, rng)) is not None]
        if len(hidden) < len(kinds):
            continue
        truth, faults = base, {}
        for h in hidden:
            truth, chains = _mount(h.candidate, h.values, truth)
            faults |= chains
        slow = {n: (SensorLag(lag_time=float(rng.uniform(*CRUMB))),) for n in channels} if crumbs else {}
        try:
            campaign = synthesise(plan, truth, rng, faults, slow)
        except Unstable:
            continue
        return HiddenCase(number, family, tuple(hidden), louder, campaign)
    raise RuntimeError(f"case {number}: nothing visible was drawn in {TRIES} tries")


def _kinds(number: int, family: Family, attempt: int, rng: np.random.Generator) -> list[type]:
    """What is hidden in the case: single effects come in turn, others at random where that cannot be seen."""
    if family is Family.NULL:
        return []
    if family is Family.SENSOR:
        return [SENSOR_FAULTS[(number // len(ORDER) + attempt) % len(SENSOR_FAULTS)]]
    if family is Family.PAIR:
        while True:
            pair = [PUMP[i] for i in rng.choice(len(PUMP), 2, replace=False)]
            taken = [slot.name for kind in pair for slot in kind.slots if slot.name in SINGLE_EFFECT_SLOTS]
            if len(taken) == len(set(taken)):
                return pair
    if attempt:
        return [PUMP[rng.integers(len(PUMP))]]
    turn = sum(f is family for f in ORDER) * (number // len(ORDER)) + ORDER[: number % len(ORDER)].count(family)
    start = 0 if family is Family.ONE else len(PUMP) // 2
    # neighbours in the library are alike: a stride that shares no factor with its length visits all, far apart
    stride = next(s for s in range(7, 7 + len(PUMP)) if math.gcd(s, len(PUMP)) == 1)
    return [PUMP[(start + stride * turn) % len(PUMP)]]


def _candidates(kinds: list[type], rng: np.random.Generator) -> list[Candidate]:
    signals = list(CHANNELS)
    return [Candidate(k, str(rng.choice(signals))) if k in SENSOR_FAULTS else Candidate(k) for k in kinds]


def _visible(plan: Campaign, base: Rig, candidate: Candidate, rng: np.random.Generator) -> Hidden | None:
    """The candidate at a size from its plausible range at which it is visible; None if no draw was."""
    model = MeasurementModel(plan, base, uncertain_unknowns(plan, base), plan.runs_for(Use.FIT))
    every = tuple(range(len(model.runs)))
    known = model.predict_all_runs(np.zeros(len(model.unknowns)), PER_SAMPLE, with_sensitivities=True)
    slopes = _whole(plan, [known[r].sensitivities for r in every])
    before = [known[r].values for r in every]
    for _ in range(TRIES):
        values = _size(candidate, before, rng)
        truth, faults = _mount(candidate, values, base)
        if faults:
            after = [_recorded(run.time, seen, faults) for run, seen in zip(model.runs, before, strict=True)]
        else:
            found = MeasurementModel(plan, truth, (), model.runs).predict_all_runs(np.zeros(0), PER_SAMPLE)
            after = [found[r].values for r in every]
        change = _whole(plan, after) - _whole(plan, before)
        taken = np.linalg.solve(slopes.T @ slopes + np.eye(slopes.shape[1]), slopes.T @ change)
        visible = float(change @ (change - slopes @ taken))
        if np.isfinite(visible) and visible > VISIBLE:
            return Hidden(candidate, values, visible)
    return None


def _size(candidate: Candidate, before: list[dict], rng: np.random.Generator) -> dict[str, float]:
    """Values of a candidate's parameters: within the plausible range, even in the logarithm where that has one sign."""
    out = {}
    for p in candidate.free_parameters():
        if candidate.kind in REFINED:
            spread = UNCERTAIN.get(p.name, 0.0)
            out[p.name] = p.default * math.exp(spread * float(np.clip(rng.standard_normal(), -2.0, 2.0)))
        elif p.plausible is None:
            extent = np.ptp(np.concatenate([run[candidate.signal] for run in before]))
            out[p.name] = float(rng.uniform(-OFFSETS, OFFSETS) * extent)
        elif p.plausible[0] > 0.0 and candidate.signal is None or p.unit == "s":
            low, high = np.log(p.plausible)
            out[p.name] = float(np.exp(rng.uniform(low, high)))
        else:
            out[p.name] = float(rng.uniform(*p.plausible))
    return out


def _mount(
    candidate: Candidate, values: dict[str, float], machine: Rig
) -> tuple[Rig, dict[str, tuple[SensorModel, ...]]]:
    """The machine with an effect in place, or the chain of the sensor that has a fault."""
    if candidate.signal is not None:
        return machine, {candidate.signal: (candidate.kind(**values),)}
    changed, _ = mount_candidate(candidate, machine, Instruments())
    own = replace(changed.effects[-1], **values)
    return replace(changed, effects=(*changed.effects[:-1], own)), {}


def _recorded(time: np.ndarray, seen: dict, faults: dict) -> dict:
    return seen | {n: np.asarray(record(chain, time, seen[n])) for n, chain in faults.items()}


def _whole(plan: Campaign, runs: list[dict]) -> np.ndarray:
    """All signals of all runs one below the other, in units of noise."""
    return np.concatenate([run[n] / channel.noise for run in runs for n, channel in plan.channels.items()])
