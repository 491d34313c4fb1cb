"""Rigs of one's own: what a class declares is the machine, and what is declared wrongly is refused with a reason."""

import signal as signals
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax import (
    Chirp,
    Effect,
    Mean,
    Oil,
    OilNode,
    Peak,
    Recorded,
    Rig,
    Sine,
    Step,
    change,
    drive,
    get,
    metric,
    par,
    signal,
    simulate,
    slot,
    state,
    struct,
)
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable
from edhas_jax.machine.effects.validation import check_derivatives, check_effect
from edhas_jax.machine.own_rig import check_rig, load_rig
from edhas_jax.machine.parameters import ParameterError, list_parameters, short_names
from edhas_jax.machine.rig_base import RigError
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.simulation.batch_trajectories import simulate_batch
from edhas_jax.simulation.run_checks import growth_at_start
from edhas_jax.simulation.run_settings import Simulation
from edhas_jax.simulation.validity import Status


@struct
class Lag:
    """A first-order lag."""

    time_constant: float = par(2.0, "s", (0.1, 100.0), "time constant")


class TwoLags(Rig):
    """Two lags side by side with inputs of their own: linear, with solutions in closed form."""

    time_step, duration = 0.05, 10.0

    first_input = drive("V", "input of the first lag", 1.0)
    second_input = drive("A", "input of the second lag", 0.0)
    slow: Lag = Lag(time_constant=4.0)
    fast: Lag = Lag()
    start: float = par(0.5, "V", (-10.0, 10.0), "start of the first lag")
    first = state("V", "first lag", "start")
    second = state("A", "second lag", 0.0)
    rate_of_input = signal("V/s", "rate of the first input")
    push = slot("first_lag", "V/s", "added to the rate of the first lag", "first", 0.1)

    def equations(self, y, s):
        s.set(rate_of_input=s.first_input_rate + 0.0 * y.first)
        return {
            "first": self.push.apply((s.first_input - y.first) / self.slow.time_constant, s),
            "second": (s.second_input - y.second) / self.fast.time_constant,
        }


def test_a_rig_is_what_its_class_declares():
    check_rig(TwoLags)
    machine = TwoLags()
    assert machine.name == "two_lags" and list(machine.states) == ["first", "second"]
    assert list(machine.signals) == ["time", "first_input", "second_input", "first", "second", "rate_of_input"]
    assert [(slot.name, slot.location) for slot in machine.slots] == [("push", "first_lag")]
    names = short_names(machine)
    assert names["slow", "time_constant"] == "slow.time_constant" and names["two_lags", "start"] == "start"
    units = {path: p.unit for p, _, path in list_parameters(machine) if p.name == "step_size"}
    assert units == {"first_input": "V", "second_input": "A"}
    changed = change(machine, start="-1 V", **{"fast.time_constant": 3.0})
    assert float(get(changed, "start")) == -1.0 and changed.initial_state() == {"first": -1.0, "second": 0.0}
    assert float(machine.start) == 0.5, "a machine is not changed in place"
    with pytest.raises(ParameterError, match="ambiguous"):
        change(machine, time_constant=1.0)


def test_a_run_is_the_solution_in_closed_form():
    run = simulate(TwoLags(), Simulation(duration=10.0, sample_rate=10.0))
    t = run.signals["time"]
    # the midpoint rule replaces e^(−h/τ) by its Padé approximant: the error grows to (h/τ)²/12 · (t/τ) e^(−t/τ)
    bound = 0.5 * (0.05 / 4.0) ** 2 / 12.0 * np.exp(-1.0)
    assert np.abs(run.signals["first"] - (1.0 - 0.5 * np.exp(-t / 4.0))).max() < 1.05 * bound
    assert run.valid and run.metrics["final_first"].value == run.signals["first"][-1]
    assert run.metrics["mean_first"].value == pytest.approx(np.trapezoid(run.signals["first"], t) / t[-1])


def test_two_recorded_drives_act_each_on_its_own_lag():
    """In a batch a recording is taken interval by interval; both give what the analytic drives give."""
    interval, count = 0.5, 41
    sine = Sine(amplitude=1.0, frequency=0.1, ramp_time=0.0)
    t = interval * np.arange(count)
    omega = 2 * np.pi * 0.1
    recorded = TwoLags(
        first_input=Recorded(values=np.sin(omega * t), interval=interval),
        second_input=Recorded(values=np.full(count, 3.0), interval=interval),
    )
    traces = simulate_batch(recorded, {"start": np.zeros(2)}, None, 0.05, 10, count, ("first", "second")).values
    exact = simulate(change(TwoLags(first_input=sine), start=0.0), Simulation(duration=20.0, sample_rate=2.0)).signals
    # a cubic through samples at twenty per cycle follows a sine to 1e-3
    assert np.abs(traces["first"][:, 0] - exact["first"]).max() < 2e-3
    assert np.abs(traces["second"][:, 1] - 3.0 * (1.0 - np.exp(-t / 2.0))).max() < 1e-4


def test_the_rate_of_a_drive_is_there_for_imposed_motion():
    sine = Sine(amplitude=2.0, frequency=0.1, ramp_time=0.0)
    run = simulate(TwoLags(first_input=sine), Simulation(duration=10.0, sample_rate=10.0))
    omega = 2 * np.pi * 0.1
    assert np.abs(run.signals["rate_of_input"] - 2.0 * omega * np.cos(omega * run.signals["time"])).max() < 1e-9


class Push(Effect, rig=TwoLags):
    """A constant push.

    Source: none, a test.
    """

    strength: float = par(0.25, "V/s", (-10.0, 10.0), "rate", plausible=(0.1, 1.0))

    def push(self, s, z):
        return self.strength + 0.0 * s.first


def test_an_effect_acts_at_a_slot_of_the_rig_and_nowhere_else():
    machine = TwoLags(effects=(Push(),))
    end = simulate(machine, Simulation(duration=100.0, sample_rate=1.0)).signals["first"][-1]
    assert end == pytest.approx(1.0 + 0.25 * 4.0, abs=1e-6)
    with pytest.raises(EffectError, match="does not have"):
        check_effect(Push(), PumpBench())
    table = LawTable("curve", LawPlace("push", "first", (), TwoLags), np.array([0.0, 1.0]), np.array([0.25, 0.25]))
    assert table.place.value_unit == "V/s"
    same = simulate(TwoLags(effects=(table.effect(),)), Simulation(duration=100.0, sample_rate=1.0)).signals["first"]
    assert same[-1] == pytest.approx(end, abs=1e-9)


def rig(**body):
    """A class with one state and these attributes in place of the usual ones."""
    usual = {"x": state("m", "position"), "equations": lambda self, y, s: {"x": -y.x}, "__doc__": "A test."}
    return type("Wrong", (Rig,), usual | body)


def sets(**values):
    """Equations that set these signals."""

    def equations(self, y, s):
        s.set(**{n: v + 0.0 * y.x for n, v in values.items()})
        return {"x": -y.x}

    return equations


def raises(error: BaseException):
    """Equations that raise an error."""

    def equations(self, y, s):
        raise error

    return equations


def prints(self, y, s):
    """Equations that print."""
    jax.debug.print("x is {}", y.x)
    return {"x": -y.x}


def calls_python(self, y, s):
    """Equations that call Python in every step."""
    return {"x": jax.pure_callback(np.negative, jax.ShapeDtypeStruct((), float), y.x)}


def mistakes():
    """What is declared, and what is said about it."""
    yield {"equations": lambda self, y, s: {}}, "no rate of x"
    yield {"equations": lambda self, y, s: {"x": -y.x, "v": y.x}}, "which is no state"
    yield {"equations": lambda self, y, s: {"x": -y.speed}}, "no state `speed`"
    yield {"equations": lambda self, y, s: {"x": -s.stiffness}}, "stiffness"
    yield {"flow": signal("m^3/s", "flow")}, "does not set the signal `flow`"
    yield {"x": state("m", "position", "nowhere")}, "no parameter of this rig"
    yield {"x": state("furlong per", "position")}, "not a unit"
    yield {"gain": par(1.0, "-", (0.0, 2.0), "gain"), "lag": Lag(), "__annotations__": {"gain": float}}, None
    yield {"effects_": 3.0, "__annotations__": {"effects_": float}}, "a part is a component"
    yield {"gain": par(3.0, "-", (0.0, 2.0), "gain")}, "outside its own span"
    for step in (0.0, -1.0, np.nan, np.inf, "1 ms", None, True):
        yield {"time_step": step}, "a finite number above 0 belongs here as time in s"
    yield {"duration": "1 s"}, "a finite number above 0 belongs here as time in s"
    yield {"u": drive("V", "input", "1 V")}, "'1 V'; a finite number belongs here as constant value"
    yield {"u": drive("V", "input", np.nan)}, "nan; a finite number belongs here as constant value"
    yield {"x": state("m", "position", None)}, "None; a finite number belongs here as start"
    yield {"push": slot("tank", "m/s", "push", "lvl")}, "a curve over `lvl`, which is no signal of this rig"
    yield {"push": slot("tank", "m/s", "push", "x", np.nan)}, "nan; a finite number belongs here as typical size"
    yield {"rush": metric("m", "peak", Peak(lambda m, s: s.speed))}, "there is no signal `speed`"
    yield {"rush": metric("m per", "peak", Peak(lambda m, s: s.x))}, "not a unit"
    yield {"rush": metric("m", "both", (Peak(lambda m, s: s.x), Mean(lambda m, s: s.x)))}, "positional argument"
    yield {"rush": metric("m", "ends", Mean(lambda m, s: (s.x, s.x)))}, "gives no number"
    yield {"x_squared": metric("m^2", "x", Mean(lambda m, s: m.mass * s.x**2))}, "mass"
    yield {"equations": sets(x=3.0)}, "s.set.x=….: `x` is a state, drive or number, which is not set"
    yield {"equations": sets(level=3.0)}, "s.set.level=….: `level` is not declared"
    yield {"equations": lambda self, y, s: {"x": y.x / 0.0}}, "derivative of the rate of x with respect to x at rest"
    yield {"equations": lambda self, y, s: {"x": jnp.sqrt(y.x)}}, "derivative of the rate of x with respect to x"
    yield {"equations": lambda self, y, s: sys.exit(0)}, "Wrong.equations .*test_own_rig.py.*: SystemExit: 0$"
    for error in (BaseException("mine"), GeneratorExit(), KeyboardInterrupt()):
        yield {"equations": raises(error)}, f"test_own_rig.py.*: {type(error).__name__}"
    yield {"equations": prints}, "test_own_rig.py:.*callback calls Python|test_own_rig.py:.*debug_print calls Python"
    yield {"equations": calls_python}, "test_own_rig.py:.*pure_callback calls Python in every time step"
    yield {"equations": lambda self, y, s: {"x": -y.x if y.x > 0 else y.x}}, "jnp.where"


@pytest.mark.parametrize(("body", "reason"), list(mistakes()), ids=lambda value: str(value)[:30])
def test_a_mistake_is_named(body, reason):
    if reason is None:
        return check_rig(rig(**body))
    with pytest.raises(RigError, match=reason):
        check_rig(rig(**body))


def interrupts():
    """Raise a KeyboardInterrupt as Ctrl-C does: not by a statement of the user's code."""
    signals.raise_signal(signals.SIGINT)


@pytest.mark.parametrize("where", [0, 1])
def test_an_interruption_is_no_error_of_the_equations(tmp_path, where):
    with pytest.raises(KeyboardInterrupt):
        if where:
            check_rig(rig(equations=lambda self, y, s: interrupts()))
        else:
            (tmp_path / "tank.py").write_text("import signal\nsignal.raise_signal(signal.SIGINT)\n")
            load_rig("tank.py:Tank", tmp_path, [tmp_path / "tank.py"])


def test_numbers_whose_squares_are_none_are_not_valid():
    run = simulate(rig(x=state("m", "position", 1e155))(), Simulation(duration=0.01))
    assert not run.valid and "x is not finite, or beyond 1e154" in run.reason


def test_a_name_has_one_meaning():
    with pytest.raises(RigError, match="declared twice|taken"):
        check_rig(rig(time=signal("s", "time again")))
    with pytest.raises(RigError, match="taken"):
        check_rig(rig(wrong=par(1.0, "-", (0.0, 2.0), "named like the rig")))
    with pytest.raises(RigError, match="Rig alone"):
        type("Derived", (TwoLags,), {})
    with pytest.raises(RigError, match="equations"):
        type("Empty", (Rig,), {})


def test_the_rigs_of_the_package_obey_the_same_interface():
    machine = PumpBench()
    assert isinstance(machine, Rig) and machine.signals["current"].unit == "A"
    assert machine.cycle is machine.reference and machine.with_default_numbers().effects == ()
    assert jnp.isfinite(machine.largest_step())


class Blast(Rig):
    """dy/dt = r y², which is infinite at t = 1/(r y₀)."""

    duration = 1.0
    rate: float = par(1e6, "1/s", (0.0, 1e9), "rate")
    y = state("-", "size", 0.5)

    def equations(self, y, s):
        return {"y": self.rate * y.y**2}


def test_slopes_at_rest_are_those_with_a_recorded_drive_too():
    machine = TwoLags(first_input=Recorded(values=np.linspace(0.0, 1.0, 5), interval=1.0))
    check_derivatives(machine)
    name, rate = growth_at_start(machine)
    assert name == "first" and rate == pytest.approx(-1.0 / 4.0)


def test_what_grows_faster_than_the_step_is_not_jumped_over():
    """Without the pole after 2 µs, which steps of 20 µs and their halves do not see, it would be 0 ever after."""
    run = simulate(Blast(), Simulation(step=20e-6))
    assert run.status is Status.STEP_TOO_LARGE and "y grows e-fold within 1 µs at the start" in run.reason
    slow = simulate(change(Blast(), rate=0.1), Simulation(step=20e-6, duration=1.0))
    assert slow.valid and slow.signals["y"][-1] == pytest.approx(1.0 / (2.0 - 0.1), rel=1e-6)


class ClosedPot(Rig):
    """A pump delivers into a closed volume: Δp = β ΔV/V."""

    time_step, duration = 1e-3, 1.0
    oil: Oil = Oil()
    pressure = state("Pa", "pressure", 1e5)
    inflow = drive("m^3/s", "flow of the pump", 0.0)

    def equations(self, y, s):
        pot = OilNode(s, "pressure", self.oil, 1e-3)
        pot.add(s.inflow)
        return pot.rates()


@pytest.mark.parametrize(("share", "said"), [(0.09, False), (0.11, True)])
def test_a_pressure_that_no_part_stands_is_said(share, said):
    """β = 1.4 GPa: with a share of 0.09 of the volume pumped in the pressure is 126 MPa, with 0.11 154 MPa."""
    run = simulate(ClosedPot(inflow=Step(step_size=share * 1e-3, step_time=0.0)))
    assert run.valid and ("burst" in run.reason) is said, run.signals["pressure"][-1]


@pytest.mark.parametrize(
    ("duration", "start", "said"), [(1.0, 0.0, ""), (2.0, 0.0, "ends at 1 s"), (1.4, 0.4, "begins at 0.4 s")]
)
def test_a_run_beyond_the_record_of_its_drive_is_said(duration, start, said):
    record = Recorded(values=1e-6 * np.sin(np.linspace(0.0, 6.0, 101)) ** 2, interval=0.01, start=start)
    run = simulate(ClosedPot(inflow=record), Simulation(duration=duration))
    assert run.valid and ("the recorded inflow" in run.reason) == bool(said) and said in run.reason


@pytest.mark.parametrize(("rate", "said"), [(200.0, ""), (50.0, "a cycle of inflow has 5 samples")])
def test_few_samples_in_a_cycle_of_a_drive_are_said(rate, said):
    pot = ClosedPot(inflow=Sine(amplitude=1e-6, frequency=10.0))
    run = simulate(pot, Simulation(duration=1.0, sample_rate=rate))
    assert run.valid and ("samples" in run.reason) == bool(said) and said in run.reason


@pytest.mark.parametrize(("inflow", "said"), [
    (Step(step_size=1e-6, step_time=1.5), "ends before the step of the inflow at 1.5 s"),
    (Step(step_size=1e-6, step_time=0.5), ""),
    (Chirp(amplitude=1e-6, start_frequency=1.0, end_frequency=10.0, sweep_time=5.0), "within the sweep of the inflow"),
])  # fmt: skip
def test_a_run_that_ends_before_its_drive_has_acted_is_said(inflow, said):
    run = simulate(ClosedPot(inflow=inflow), Simulation(duration=1.0))
    assert run.valid and ("the run ends" in run.reason) == bool(said) and said in run.reason
