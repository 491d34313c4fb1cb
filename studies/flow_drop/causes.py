"""What could make the mean flow fall above 30 Hz: each cause as one number of one machine, scanned and sized.

The machine is the calibrated one (configs/paper_calibrated.yaml) with valves that are in time, at atmospheric pressure
at rest: nothing in it falls, and nothing protects it. A cause adds one thing to it, whose size is one parameter.
"""

import dataclasses
import math

import numpy as np

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.effects import Effect, SuctionLineInertance, SuctionLineResistance, SupplySag, ValveAdhesion
from edhas_jax.machine.rigs import PumpBench
from studies.paper.configs import NAMES, machines
from studies.paper.published_numbers import BALL_DENSITY, OPEN
from studies.paper.readings import mean_flows

# balls of 6.25 mm on a spring of 80 Hz, which close in time, and a tank in place of a loaded accumulator
IN_TIME = {
    "valve_seat_diameter": 5e-3, "valve_mass": 1e-3, "valve_spring_rate": 500.0, "valve_preload": 0.2,
    "accumulator_pressure": 0.1e6,
}  # fmt: skip
BALL_10_MM = BALL_DENSITY * math.pi / 6.0 * 0.01**3
SCAN = (10.0, 20.0, 24.0, 27.0, 30.0, 33.0, 36.0, 40.0, 45.0, 52.0, 60.0)  # Hz
KNEE = (27.0, 33.0)  # Hz: the largest flow is "at about 30 Hz"
PROPORTIONAL = 0.95  # least flow at 20 Hz over twice that at 10 Hz
FALLEN = 0.95  # most of its largest that the flow keeps at 45 Hz
PER_RANGE, ROUNDS = 12, 2  # sizes tried at once, and how often around the best


@dataclasses.dataclass(frozen=True)
class Cause:
    """A cause whose size is the parameter `name`, SI.

    `plausible` is the range that others publish (`source`), weak end first; sizes up to `furthest` are tried to say
    what it would take. `besides` are numbers that go with it, `effect` what has to be mounted.
    """

    title: str
    name: str
    unit: str
    plausible: tuple[float, float]
    furthest: float
    source: str
    besides: dict[str, float] = dataclasses.field(default_factory=dict)
    effect: type[Effect] | None = None

    def machine(self, base: PumpBench) -> PumpBench:
        """The machine that can have it."""
        if self.effect is not None:
            base = structs.replace(base, effects=(*base.effects, self.effect()))
        return edhas.change(base, **self.besides)

    def at(self, base: PumpBench, size: float) -> PumpBench:
        """The machine that has it at a size (SI)."""
        return edhas.change(self.machine(base), **{self.name: size})

    def told(self, size: float) -> str:
        """A size as text with its unit."""
        percent = self.unit == "-"
        return f"{100.0 * size:.3g} %" if percent else format_quantity(float(f"{size:.3g}"), self.unit)

    def believable(self, size: float) -> bool:
        """Whether a size lies in the plausible range."""
        low, high = sorted(self.plausible)
        return low * (1.0 - 1e-6) <= size <= high * (1.0 + 1e-6)


def _range(name: str) -> tuple[float, float]:
    return next((o.low, o.high) for o in OPEN if o.name == name)


CAUSES = (
    Cause("trapped air", "air_fraction", "-", _range("air_fraction"), 0.2, "several simulators: 0.5 %"),
    Cause("heavy balls", "valve_mass", "kg", (1e-3, BALL_10_MM), 16e-3, "steel balls up to 10 mm"),
    Cause("soft valve springs", "valve_spring_rate", "N/m", (500.0, 50.0), 10.0, "valves of 17 … 290 Hz"),
    Cause("late valves", "valve_spring_rate", "N/m", (3000.0, 50.0), 10.0, "valves of 17 … 290 Hz, balls of 10 mm",
          {"valve_mass": BALL_10_MM}),
    Cause("damped valves", "valve_damping", "N*s/m", (0.14, 1.4), 20.0, "none published: up to the nominal"),
    Cause("sticking valves", "adhesion_force", "N", (0.1, 5.0), 10.0, "oil stiction in seat valves", {}, ValveAdhesion),
    Cause("warm oil", "oil_viscosity", "Pa*s", (0.04, 0.006), 0.001, "ISO VG 32 … 46 up to 100 °C",
          {"piston_clearance": 25e-6}),
    Cause("narrow suction line", "line_resistance", "Pa*s/m^3", (1e7, 3e9), 1e10, "Hagen-Poiseuille: 6 mm, 0.01 … 2 m",
          {}, SuctionLineResistance),
    Cause("long suction line", "line_inertance", "kg/m^4", (1e6, 5e7), 5e8, "ρ l/A: 6 mm, 0.03 … 1.6 m", {},
          SuctionLineInertance),
    Cause("low pressure at rest", "accumulator_pressure", "Pa", (0.4e6, 0.1e6), 0.02e6, "0 … 0.3 MPa gauge"),
    Cause("low supply voltage", "supply_voltage", "V", (48.0, 43.2), 10.0, "printed: 48 V; −10 % for a rectifier"),
    Cause("sagging supply", "supply_resistance", "ohm", (0.05, 1.0), 10.0, "supply and leads", {}, SupplySag),
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Sized:
    """A cause at a size, and what the flow then does.

    `knee` [Hz] is where it is largest, NaN where it still rises at 60 Hz; `proportion` that at 20 Hz over twice that
    at 10 Hz, `filling` that at 30 Hz over what the machine delivers without the cause, `kept` that at 45 Hz over the
    largest. `between` are the sizes that were tried and do as the paper says, from the least to the largest.
    """

    cause: Cause
    size: float
    knee: float
    proportion: float
    filling: float
    kept: float
    between: tuple[float, float] | None = None

    @property
    def bends(self) -> bool:
        """Whether the flow is proportional up to about 30 Hz, and largest there."""
        return KNEE[0] <= self.knee <= KNEE[1] and self.proportion >= PROPORTIONAL

    @property
    def falls(self) -> bool:
        """Whether it does so and falls beyond, as the paper says."""
        return self.bends and self.kept <= FALLEN

    @property
    def guilty(self) -> bool:
        """Whether it falls at a size that can be believed."""
        return self.falls and self.cause.believable(self.size)


def base_machine() -> PumpBench:
    """The machine in which nothing makes the flow fall."""
    return edhas.change(machines(NAMES)[0], **IN_TIME)


def flow_of(base: PumpBench, cause: Cause, sizes: np.ndarray, frequencies) -> np.ndarray:
    """Mean flow [L/min] at several sizes of a cause, (frequencies, sizes)."""
    return mean_flows(cause.machine(base), {cause.name: np.asarray(sizes, float)}, frequencies)


def sizes_of(base: PumpBench, cause: Cause, rounds: int = ROUNDS) -> list[Sized]:
    """The size within the plausible range at which the flow falls as the paper says.

    Where there is none: the strong end of the range, and the size beyond it at which the flow bends, if any.
    """
    inside = _best(base, cause, *cause.plausible, rounds)
    if inside.falls:
        return [inside]
    strong, beyond = cause.plausible[1], _best(base, cause, cause.plausible[1], cause.furthest, rounds)
    end = _read(cause, strong, flow_of(base, cause, [strong], SCAN)[:, 0], _free(base))
    return [end, beyond] if beyond.bends else [end]


def _free(base: PumpBench) -> float:
    """Mean flow [L/min] at 30 Hz without any cause."""
    return mean_flows(base, {"valve_mass": np.array([IN_TIME["valve_mass"]])}, (30.0,))[0, 0]


def _best(base: PumpBench, cause: Cause, one: float, other: float, rounds: int) -> Sized:
    """The size between two at which the flow is nearest to the statement: a grid, then grids around its best."""
    low, high = sorted((math.log(one), math.log(other)))
    ends, found, free = (low, high), [], _free(base)
    for _ in range(rounds):
        sizes = np.exp(np.linspace(*ends, PER_RANGE))
        flow = flow_of(base, cause, sizes, SCAN)
        found += [_read(cause, size, column, free) for size, column in zip(sizes, flow.T, strict=True)]
        best = min(found, key=_shortfall)
        width = (ends[1] - ends[0]) / (PER_RANGE - 1)
        ends = max(math.log(best.size) - width, low), min(math.log(best.size) + width, high)
    falling = [s.size for s in found if s.falls]
    return dataclasses.replace(best, between=(min(falling), max(falling)) if falling else None)


def _read(cause: Cause, size: float, flow: np.ndarray, free: float) -> Sized:
    at = dict(zip(SCAN, flow.tolist(), strict=True))
    knee = knee_of(np.array(SCAN), flow)
    return Sized(cause, float(size), knee, at[20.0] / (2.0 * at[10.0]), at[30.0] / free, at[45.0] / float(flow.max()))


def _shortfall(s: Sized) -> float:
    """How far a flow is from the statement; the knee counts in octaves, as at 120 Hz where there is none."""
    knee = 2.0 * SCAN[-1] if math.isnan(s.knee) else s.knee
    return abs(math.log2(knee / 30.0)) + 10.0 * max(PROPORTIONAL - s.proportion, 0.0) + max(s.kept - FALLEN, 0.0)


def knee_of(frequency: np.ndarray, flow: np.ndarray) -> float:
    """Where a parabola through the largest flow and its neighbours has its top; NaN if it is the first or last."""
    k = int(flow.argmax())
    if k in (0, len(flow) - 1):
        return math.nan
    bend, rise, _ = np.polyfit(frequency[k - 1 : k + 2] - frequency[k], flow[k - 1 : k + 2], 2)
    return float(frequency[k] - 0.5 * rise / bend)
