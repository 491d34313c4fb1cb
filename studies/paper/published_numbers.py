"""Numbers that Actuators 2022, 11(10), 281 states, and published ranges of the quantities that it does not state."""

import dataclasses

import jax.numpy as jnp


@dataclasses.dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper.

    Attributes:
        key: its name in the results.
        title: its name in tables.
        unit: the unit of all values of this class.
        measured: the measured value; None: not stated.
        simulated: the simulated value.
        digits: digits after the decimal point in tables.
        bound: whether the paper states only that the value is below `simulated`.
        size: the reference of relative errors, where the simulated value is zero.
        inferred: whether the paper states errors only, from which this follows if its earlier model delivers the swept
            volume.
    """

    key: str
    title: str
    unit: str
    measured: float | None
    simulated: float
    digits: int
    bound: bool = False
    size: float | None = None
    inferred: bool = False

    @property
    def full_title(self) -> str:
        """The title with the unit."""
        return f"{self.title}, {self.unit}" if self.unit else self.title

    def format_value(self, value: float | None) -> str:
        """A value of this figure as text without the unit."""
        return "–" if value is None or value != value else f"{value:.{self.digits}f}"

    def error(self, value: float) -> float:
        """The relative difference from the paper's simulation; 0 where a bound is kept."""
        if self.bound and value <= self.simulated:
            return 0.0
        return (value - self.simulated) / (self.size or self.simulated)


FIGURES = {
    figure.key: figure
    for figure in (
        PaperFigure("lag", "10 Hz: phase lag at the peak", "°", 1.57, 1.21, 2),
        PaperFigure("loss", "10 Hz: amplitude loss at the peak", "%", 0.86, 0.57, 2),
        PaperFigure("pressure", "10 Hz: outlet pressure above rest, peak", "MPa", 0.037, 0.038, 4),
        PaperFigure("proportion", "mean flow: at 20 Hz / twice that at 10 Hz", "", 1.0, 1.0, 3),
        PaperFigure("knee", "mean flow: frequency of the largest", "Hz", 30.0, 30.0, 1),
        PaperFigure("filling", "mean flow: at 30 Hz / swept volume", "", 0.881, 0.918, 3, inferred=True),
        PaperFigure("leak_mean", "10 Hz: leakage past the plungers, mean", "L/min", None, 0.005, 5, bound=True),
        PaperFigure("leak_stroke", "10 Hz: leakage past one, in the stroke", "L/min", None, 0.005, 4, bound=True),
        PaperFigure("leak_spike", "10 Hz: leakage and backflow, spike", "L/min", None, 0.015, 4),
        PaperFigure("response", "15 mm step: response time", "s", 0.392, 0.3785, 4),
        PaperFigure("steady", "15 mm step: steady error", "mm", 0.103, 0.0, 4, size=15.0),
    )
}
# targets of the calibration: (value, tolerated deviation)
CALIBRATION_TARGETS = {
    "lag": (1.21, 0.02), "loss": (0.57, 0.02), "pressure": (0.038, 2e-4), "proportion": (1.0, 0.01),
    "slope": (0.0, 0.02),
}  # fmt: skip
FITTED = ("lag", "loss", "pressure", "proportion", "knee")  # "slope" = 0 at 30 Hz puts the knee there

# errors between model and experiment that the paper states: (figure, error in %, reference of the error)
STATED_ERRORS = (("pressure", 2.6, "simulated"), ("filling", 4.2, "measured"), ("response", 3.4, "measured"))
EARLIER_MODEL_ERROR = 13.5  # per cent by which its earlier model, without friction dynamics, exceeds the largest flow


@dataclasses.dataclass(frozen=True)
class OpenQuantity:
    """A quantity that the paper does not state.

    Attributes:
        name: its name.
        unit: SI unit.
        low: lower end of the published range.
        high: upper end of the published range.
        source: where the range comes from.
        fixed_by: the figures that determine it in the calibration; empty: it is not calibrated.
    """

    name: str
    unit: str
    low: float
    high: float
    source: str
    fixed_by: str = ""


OPEN_QUANTITIES = (
    OpenQuantity("position_gain", "V/m", 5e3, 4.5e4, "none published: 1/3 … 3 times the nominal", "lag, loss"),
    OpenQuantity("emf_feedforward", "-", 0.75, 1.05, "none published: 75 … 105 % of the back-EMF", "lag, loss"),
    OpenQuantity("load_orifice_area", "m^2", 2.9e-6, 11.3e-6, "valves of 0.02 … 0.3 MPa at 3 L/min", "pressure"),
    OpenQuantity("valve_seat_diameter", "m", 3.2e-3, 8e-3, "0.8 of steel balls of 4 … 10 mm", "flow over frequency"),
    OpenQuantity("valve_spring_rate", "N/m", 50.0, 3000.0, "natural frequency 17 … 290 Hz", "flow over frequency"),
    OpenQuantity("valve_opening_pressure", "Pa", 1e3, 5e4, "ball check valves", "flow over frequency"),
    OpenQuantity("valve_damping", "N*s/m", 0.14, 1.4, "none published: up to the nominal"),
    OpenQuantity("valve_max_lift", "m", 0.8e-3, 3e-3, "ball check valves of that size"),
    OpenQuantity("outlet_volume", "m^3", 5e-6, 60e-6, "0.1 … 2 m of 4 … 10 mm line"),
    OpenQuantity("accumulator_pressure", "Pa", 0.1e6, 0.4e6, "0 … 0.3 MPa gauge"),
    OpenQuantity("accumulator_gas_volume", "m^3", 0.05e-3, 0.5e-3, "0.05 … 0.5 L"),
    OpenQuantity("oil_density", "kg/m^3", 840.0, 890.0, "Hopsan 870, Wolfram 850 kg/m³"),
    OpenQuantity("oil_viscosity", "Pa*s", 0.025, 0.12, "ISO VG 32 and 46 at 20 … 45 °C"),
    OpenQuantity("oil_bulk_modulus", "Pa", 1.2e9, 1.8e9, "Wolfram 1.4 GPa"),
    OpenQuantity("air_fraction", "-", 1e-3, 5e-2, "Simscape and MapleSim 0.005"),
    OpenQuantity("discharge_coefficient", "-", 0.6, 0.8, "Wolfram 0.62, Hopsan 0.67"),
    OpenQuantity("piston_clearance", "m", 5e-6, 25e-6, "lapped plungers"),
    OpenQuantity("piston_fit_length", "m", 10e-3, 40e-3, "lapped plungers"),
    OpenQuantity("coulomb_friction", "N", 1.0, 15.0, "a pair of 12 mm seals"),
    OpenQuantity("stribeck_velocity", "m/s", 3e-3, 0.1, "LuGre identifications"),
    OpenQuantity("bristle_stiffness", "N/m", 1e4, 1e6, "LuGre identifications"),
    OpenQuantity("pump_damping", "N*s/m", 1.0, 15.0, "π d L μ/δ of the gap"),
    OpenQuantity("reversing_valve_area", "m^2", 2.9e-6, 11.3e-6, "valves of 0.02 … 0.3 MPa at 3 L/min"),
    OpenQuantity("reversing_valve_time", "s", 3e-3, 30e-3, "10 … 100 ms to switch, three time constants"),
    OpenQuantity("cylinder_sliding_friction", "N", 3.0, 60.0, "no-load friction tests (SAE J1335)"),
    OpenQuantity("cylinder_damping", "N*s/m", 20.0, 1000.0, "no-load friction tests (SAE J1335)"),
    OpenQuantity("load_mass", "kg", 0.3, 5.0, "rod and piston of the printed size; no load is named"),
)
CALIBRATED_QUANTITIES = tuple(o for o in OPEN_QUANTITIES if o.fixed_by)
# the paper does not state how its step was run: (interpretation, changes of parameters, settling band)
STEP_VARIANTS = (
    ("10 Hz, strokes from the middle, braked over 1 mm, within 2 %", {}, 0.02),
    ("pump braked over the last 0.3 mm", {"amplitude_band": 0.3e-3}, 0.02),
    ("pump braked over the last 3 mm", {"amplitude_band": 3e-3}, 0.02),
    ("step a quarter of a cycle later in the stroke", {"step_time": 0.025}, 0.02),
    ("step three eighths of a cycle later", {"step_time": 0.0375}, 0.02),
    ("9 Hz", {"frequency": 9.0}, 0.02),
    ("11 Hz", {"frequency": 11.0}, 0.02),
    ("settled within 5 %", {}, 0.05),
    ("settled within 1 %", {}, 0.01),
)
BALL_DENSITY, SEAT_OVER_BALL = 7850.0, 0.8


def with_derived_parameters(chosen: dict) -> dict:
    """Parameters of the machine (SI) from open quantities: with mass of the ball, preload and break-away friction.

    m_v = ρ π/6 (d_seat/0.8)³,   F_0 = p_open π d_seat²/4,   F_S = 1.5 F_C,   F_m = 1.5 F_d
    """
    out = dict(chosen)
    opening = out.pop("valve_opening_pressure", None)
    if "valve_seat_diameter" in out:
        seat = out["valve_seat_diameter"]
        out["valve_mass"] = BALL_DENSITY * jnp.pi / 6.0 * (seat / SEAT_OVER_BALL) ** 3
        out["valve_preload"] = opening * jnp.pi / 4.0 * seat**2
    for sliding, breakaway in (
        ("coulomb_friction", "static_friction"),
        ("cylinder_sliding_friction", "cylinder_breakaway_friction"),
    ):
        if sliding in out:
            out[breakaway] = 1.5 * out[sliding]
    return out
