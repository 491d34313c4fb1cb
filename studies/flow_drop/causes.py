"""Candidate causes of the drop of mean flow above 30 Hz, each as one parameter of one machine, scanned and sized.

The base machine is the calibrated one (configs/paper_calibrated.yaml) with fast valves and atmospheric pressure at
rest: its flow does not drop. A cause adds one thing to it, the size of which is one parameter.
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
from studies.paper.published_numbers import BALL_DENSITY, OPEN_QUANTITIES
from studies.paper.readings import mean_flows

# balls of 6.25 mm on a spring of 80 Hz, which close fast enough, and a tank in place of a pressurised accumulator
BASE_CHANGES = {
    "valve_seat_diameter": 5e-3, "valve_mass": 1e-3, "valve_spring_rate": 500.0, "valve_preload": 0.2,
    "accumulator_pressure": 0.1e6,
}  # fmt: skip
BALL_10_MM = BALL_DENSITY * math.pi / 6.0 * 0.01**3
SCAN_FREQUENCIES = (10.0, 20.0, 24.0, 27.0, 30.0, 33.0, 36.0, 40.0, 45.0, 52.0, 60.0)  # Hz
PEAK_RANGE = (27.0, 33.0)  # Hz: the paper has the largest flow "at about 30 Hz"
MIN_PROPORTIONALITY = 0.95  # smallest ratio of the flow at 20 Hz to twice that at 10 Hz
MAX_REMAINING_FLOW = 0.95  # largest ratio of the flow at 45 Hz to the largest flow
SIZES_PER_GRID, GRID_REFINEMENTS = 12, 2  # sizes in one grid; grids, each around the best size so far


@dataclasses.dataclass(frozen=True)
class Cause:
    """A candidate cause.

    Attributes:
        title: its name in tables.
        name: the parameter that is its size.
        unit: SI unit of the parameter.
        plausible: range of published sizes, from the weak to the strong end.
        largest_tried: strongest size that is simulated, beyond the plausible range.
        source: where the plausible range comes from.
        further_changes: other parameters that change with it, SI.
        effect: the effect that has to be mounted, if any.
    """

    title: str
    name: str
    unit: str
    plausible: tuple[float, float]
    largest_tried: float
    source: str
    further_changes: dict[str, float] = dataclasses.field(default_factory=dict)
    effect: type[Effect] | None = None

    def machine(self, base: PumpBench) -> PumpBench:
        """The machine with the effect and the further changes of the cause, its size at the default."""
        if self.effect is not None:
            base = structs.replace(base, effects=(*base.effects, self.effect()))
        return edhas.change(base, **self.further_changes)

    def with_size(self, base: PumpBench, size: float) -> PumpBench:
        """The machine with the cause at a size (SI)."""
        return edhas.change(self.machine(base), **{self.name: size})

    def size_text(self, size: float) -> str:
        """A size as text with its unit."""
        percent = self.unit == "-"
        return f"{100.0 * size:.3g} %" if percent else format_quantity(float(f"{size:.3g}"), self.unit)

    def is_plausible(self, size: float) -> bool:
        """Whether a size lies in the plausible range."""
        low, high = sorted(self.plausible)
        return low * (1.0 - 1e-6) <= size <= high * (1.0 + 1e-6)


def _range(name: str) -> tuple[float, float]:
    return next((o.low, o.high) for o in OPEN_QUANTITIES if o.name == name)


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
class SizedCause:
    """A cause at a size, and the mean flow over frequency that results.

    Attributes:
        cause: the cause.
        size: its size, SI.
        peak_frequency: frequency of the largest flow [Hz]; NaN where the flow still rises at 60 Hz.
        proportionality: flow at 20 Hz over twice that at 10 Hz.
        relative_flow: flow at 30 Hz over that without the cause.
        remaining_flow: flow at 45 Hz over the largest.
        falling_sizes: smallest and largest of the tried sizes at which the flow falls as in the paper.
    """

    cause: Cause
    size: float
    peak_frequency: float
    proportionality: float
    relative_flow: float
    remaining_flow: float
    falling_sizes: tuple[float, float] | None = None

    @property
    def peaks_near_30_hz(self) -> bool:
        """Whether the flow is proportional to frequency up to about 30 Hz and largest there."""
        return PEAK_RANGE[0] <= self.peak_frequency <= PEAK_RANGE[1] and self.proportionality >= MIN_PROPORTIONALITY

    @property
    def falls(self) -> bool:
        """Whether it peaks near 30 Hz and falls beyond, as the paper says."""
        return self.peaks_near_30_hz and self.remaining_flow <= MAX_REMAINING_FLOW

    @property
    def explains_fall(self) -> bool:
        """Whether the flow falls as in the paper at a plausible size."""
        return self.falls and self.cause.is_plausible(self.size)


def base_machine() -> PumpBench:
    """The machine whose flow does not drop."""
    return edhas.change(machines(NAMES)[0], **BASE_CHANGES)


def flow_at_sizes(base: PumpBench, cause: Cause, sizes: np.ndarray, frequencies) -> np.ndarray:
    """Mean flow [L/min] at several sizes of a cause, (frequencies, sizes)."""
    return mean_flows(cause.machine(base), {cause.name: np.asarray(sizes, float)}, frequencies)


def find_sizes(base: PumpBench, cause: Cause, rounds: int = GRID_REFINEMENTS) -> list[SizedCause]:
    """The size in the plausible range at which the flow falls as the paper says.

    Where there is none: the strong end of the range, and the size beyond it at which the flow peaks near 30 Hz, if any.
    """
    inside = _best_size(base, cause, *cause.plausible, rounds)
    if inside.falls:
        return [inside]
    strong, beyond = cause.plausible[1], _best_size(base, cause, cause.plausible[1], cause.largest_tried, rounds)
    flow = flow_at_sizes(base, cause, [strong], SCAN_FREQUENCIES)[:, 0]
    end = _evaluate(cause, strong, flow, _flow_without_cause(base))
    return [end, beyond] if beyond.peaks_near_30_hz else [end]


def _flow_without_cause(base: PumpBench) -> float:
    """Mean flow [L/min] at 30 Hz without any cause."""
    return mean_flows(base, {"valve_mass": np.array([BASE_CHANGES["valve_mass"]])}, (30.0,))[0, 0]


def _best_size(base: PumpBench, cause: Cause, one: float, other: float, rounds: int) -> SizedCause:
    """The size between two at which the flow is nearest to the statement of the paper, by successively finer grids."""
    low, high = sorted((math.log(one), math.log(other)))
    ends, found, free = (low, high), [], _flow_without_cause(base)
    for _ in range(rounds):
        sizes = np.exp(np.linspace(*ends, SIZES_PER_GRID))
        flow = flow_at_sizes(base, cause, sizes, SCAN_FREQUENCIES)
        found += [_evaluate(cause, size, column, free) for size, column in zip(sizes, flow.T, strict=True)]
        best = min(found, key=_deviation_from_paper)
        width = (ends[1] - ends[0]) / (SIZES_PER_GRID - 1)
        ends = max(math.log(best.size) - width, low), min(math.log(best.size) + width, high)
    falling = [s.size for s in found if s.falls]
    return dataclasses.replace(best, falling_sizes=(min(falling), max(falling)) if falling else None)


def _evaluate(cause: Cause, size: float, flow: np.ndarray, free: float) -> SizedCause:
    at = dict(zip(SCAN_FREQUENCIES, flow.tolist(), strict=True))
    peak = peak_of_parabola(np.array(SCAN_FREQUENCIES), flow)
    ratios = at[20.0] / (2.0 * at[10.0]), at[30.0] / free, at[45.0] / float(flow.max())
    return SizedCause(cause, float(size), peak, *ratios)


def _deviation_from_paper(s: SizedCause) -> float:
    """Deviation from the statement of the paper; the peak counts in octaves, as 120 Hz where there is none."""
    peak = 2.0 * SCAN_FREQUENCIES[-1] if math.isnan(s.peak_frequency) else s.peak_frequency
    excess = max(s.remaining_flow - MAX_REMAINING_FLOW, 0.0)
    return abs(math.log2(peak / 30.0)) + 10.0 * max(MIN_PROPORTIONALITY - s.proportionality, 0.0) + excess


def peak_of_parabola(frequency: np.ndarray, flow: np.ndarray) -> float:
    """The maximum of a parabola through the largest flow and its neighbours [Hz]; NaN if it is the first or last."""
    k = int(flow.argmax())
    if k in (0, len(flow) - 1):
        return math.nan
    curvature, slope, _ = np.polyfit(frequency[k - 1 : k + 2] - frequency[k], flow[k - 1 : k + 2], 2)
    return float(frequency[k] - 0.5 * slope / curvature)
