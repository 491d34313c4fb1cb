"""The numbers that Actuators 2022, 11(10), 281 states, and what it leaves open, with the ranges that others publish."""

import dataclasses

import jax.numpy as jnp


@dataclasses.dataclass(frozen=True)
class Stated:
    """A figure of the paper: what was measured and what it simulated (None: not stated), in the unit it is shown in.

    `bound`: the paper says "below"; `size`: what an error is a share of, where the simulated value is zero;
    `inferred`: the paper tells errors only, from which this follows if its earlier model delivers the swept volume.
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

    def told(self, value: float | None) -> str:
        """A value of this figure as text, without the unit."""
        return "–" if value is None or value != value else f"{value:.{self.digits}f}"

    def error(self, value: float) -> float:
        """The distance from the paper's simulation as a share of it; 0 where a bound is kept."""
        if self.bound and value <= self.simulated:
            return 0.0
        return (value - self.simulated) / (self.size or self.simulated)


FIGURES = {
    figure.key: figure
    for figure in (
        Stated("lag", "10 Hz: phase lag at the peak", "°", 1.57, 1.21, 2),
        Stated("loss", "10 Hz: amplitude loss at the peak", "%", 0.86, 0.57, 2),
        Stated("pressure", "10 Hz: outlet pressure above rest, peak", "MPa", 0.037, 0.038, 4),
        Stated("proportion", "mean flow: at 20 Hz / twice that at 10 Hz", "", 1.0, 1.0, 3),
        Stated("knee", "mean flow: frequency of the largest", "Hz", 30.0, 30.0, 1),
        Stated("filling", "mean flow: at 30 Hz / swept volume", "", 0.881, 0.918, 3, inferred=True),
        Stated("leak_mean", "10 Hz: leakage past the plungers, mean", "L/min", None, 0.005, 5, bound=True),
        Stated("leak_stroke", "10 Hz: leakage past one, in the stroke", "L/min", None, 0.005, 4, bound=True),
        Stated("leak_spike", "10 Hz: leakage and backflow, spike", "L/min", None, 0.015, 4),
        Stated("response", "15 mm step: response time", "s", 0.392, 0.3785, 4),
        Stated("steady", "15 mm step: steady error", "mm", 0.103, 0.0, 4, size=15.0),
    )
}
# what the calibration aims at: the value, and the deviation that counts as one
AIMS = {
    "lag": (1.21, 0.02), "loss": (0.57, 0.02), "pressure": (0.038, 2e-4), "proportion": (1.0, 0.01),
    "slope": (0.0, 0.02),
}  # fmt: skip
FITTED = ("lag", "loss", "pressure", "proportion", "knee")  # a slope of 0 at 30 Hz is the knee

# the differences between model and experiment that the paper tells: figure, per cent, what they are a share of
ERRORS = (("pressure", 2.6, "simulated"), ("filling", 4.2, "measured"), ("response", 3.4, "measured"))
EARLIER_MODEL = 13.5  # per cent by which its earlier model, without friction dynamics, exceeds the largest flow


@dataclasses.dataclass(frozen=True)
class Open:
    """A quantity that the paper does not print: the range (SI) others publish, and who; what fixes it, if fitted."""

    name: str
    unit: str
    low: float
    high: float
    source: str
    fixed_by: str = ""


OPEN = (
    Open("position_gain", "V/m", 5e3, 4.5e4, "none published: 1/3 … 3 times the nominal", "lag, loss"),
    Open("emf_feedforward", "-", 0.75, 1.05, "none published: 75 … 105 % of the back-EMF", "lag, loss"),
    Open("load_orifice_area", "m^2", 2.9e-6, 11.3e-6, "valves of 0.02 … 0.3 MPa at 3 L/min", "pressure"),
    Open("valve_seat_diameter", "m", 3.2e-3, 8e-3, "0.8 of steel balls of 4 … 10 mm", "flow over frequency"),
    Open("valve_spring_rate", "N/m", 50.0, 3000.0, "natural frequency 17 … 290 Hz", "flow over frequency"),
    Open("valve_opening_pressure", "Pa", 1e3, 5e4, "ball check valves", "flow over frequency"),
    Open("valve_damping", "N*s/m", 0.14, 1.4, "none published: up to the nominal"),
    Open("valve_max_lift", "m", 0.8e-3, 3e-3, "ball check valves of that size"),
    Open("outlet_volume", "m^3", 5e-6, 60e-6, "0.1 … 2 m of 4 … 10 mm line"),
    Open("accumulator_pressure", "Pa", 0.1e6, 0.4e6, "0 … 0.3 MPa gauge"),
    Open("accumulator_gas_volume", "m^3", 0.05e-3, 0.5e-3, "0.05 … 0.5 L"),
    Open("oil_density", "kg/m^3", 840.0, 890.0, "Hopsan 870, Wolfram 850 kg/m³"),
    Open("oil_viscosity", "Pa*s", 0.025, 0.12, "ISO VG 32 and 46 at 20 … 45 °C"),
    Open("oil_bulk_modulus", "Pa", 1.2e9, 1.8e9, "Wolfram 1.4 GPa"),
    Open("air_fraction", "-", 1e-3, 5e-2, "Simscape and MapleSim 0.005"),
    Open("discharge_coefficient", "-", 0.6, 0.8, "Wolfram 0.62, Hopsan 0.67"),
    Open("piston_clearance", "m", 5e-6, 25e-6, "lapped plungers"),
    Open("piston_fit_length", "m", 10e-3, 40e-3, "lapped plungers"),
    Open("coulomb_friction", "N", 1.0, 15.0, "a pair of 12 mm seals"),
    Open("stribeck_velocity", "m/s", 3e-3, 0.1, "LuGre identifications"),
    Open("bristle_stiffness", "N/m", 1e4, 1e6, "LuGre identifications"),
    Open("pump_damping", "N*s/m", 1.0, 15.0, "π d L μ/δ of the gap"),
    Open("reversing_valve_area", "m^2", 2.9e-6, 11.3e-6, "valves of 0.02 … 0.3 MPa at 3 L/min"),
    Open("reversing_valve_time", "s", 3e-3, 30e-3, "10 … 100 ms to switch, three time constants"),
    Open("cylinder_sliding_friction", "N", 3.0, 60.0, "no-load friction tests (SAE J1335)"),
    Open("cylinder_damping", "N*s/m", 20.0, 1000.0, "no-load friction tests (SAE J1335)"),
    Open("load_mass", "kg", 0.3, 5.0, "rod and piston of the printed size; no load is named"),
)
FREE = tuple(o for o in OPEN if o.fixed_by)
# how the paper ran its step is not printed either: other readings of the test than ours, and what they change
READINGS = (
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


def complete(chosen: dict) -> dict:
    """Parameters of the machine (SI) from quantities of `OPEN`: the ball's mass from its seat, preload, break-away.

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
