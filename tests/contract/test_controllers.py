"""Requirements on every controller, checked for the package and for two controllers as a user would write them."""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.config.machine_config import ConfigError, build_config, read_config
from edhas_jax.config.writer import dump_config
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.design.batch.batch import BatchSettings, run_designs
from edhas_jax.design.sweep.identity import effect_code
from edhas_jax.machine.components.controller_sampling import Sampled
from edhas_jax.machine.interface.controller_base import Controller, ControllerError
from edhas_jax.machine.parameters import COMPONENT_KINDS
from edhas_jax.machine.rigs import RIGS, ActuatorBench
from edhas_jax.machine.user_controller import check_controller, load_controller
from edhas_jax.simulation.integrator import step
from tests.support import ROOT
from tests.support.reference import random_state
from tests.support.xla import jit

PAGE = (ROOT / "docs/controllers.md").read_text(encoding="utf-8").partition("## A controller of your own")[2]
PYTHON, YAML = (re.search(rf"```{language}\n(.*?)```", PAGE, re.S)[1] for language in ("python", "yaml"))
EXAMPLE: dict = {"__name__": "documented"}
exec(compile(PYTHON, "docs/controllers.md", "exec"), EXAMPLE)


class Proportional(Controller):
    """A proportional controller."""

    stiffness: float = par(1e4, "V/m", (0.0, 1e8), "gain")

    def command(self, y, s):
        return self.stiffness * (s.reference - s.piston_position)


CONTROLLERS = (*COMPONENT_KINDS["controller"].values(), EXAMPLE["FilteredLead"], Proportional)
by_controller = pytest.mark.parametrize("controller", CONTROLLERS, ids=lambda c: c.__name__)
TRACKING = [c for c in CONTROLLERS if c is not COMPONENT_KINDS["controller"]["open_loop"]]
H = 20e-6


def bench(controller, **parts):
    return ActuatorBench(controller=controller(), **parts)


@by_controller
def test_declaration_is_complete(controller):
    assert issubclass(controller, Controller) and controller.__doc__.strip().split("\n")[0].endswith((".", ":", "T_f."))
    for p in structs.parameters(controller):
        assert p.doc and p.span[0] <= p.default <= p.span[1]
    assert set(controller().initial()) == set(controller().rates(*_initial_signals(controller)))


def _initial_signals(controller):
    machine = bench(controller)
    y = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    return y, machine.evaluate(y, 0.0, H, y)[0]


@by_controller
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_acts_on_every_rig(controller, precision, rig):
    check_controller(rig(controller=controller()), precision)
    check_controller(rig(controller=controller(), sampling=Sampled()), precision)


@by_controller
def test_control_law_and_its_derivatives_are_finite(controller):
    machine = bench(controller)

    def control_law(machine, y, t):
        s, rates = machine.evaluate(y, t, H, y)
        return {"command": s.unlimited_voltage} | {n: rates[n] for n in machine.controller.initial()}

    law, slopes = jit(control_law), jit(jax.jacfwd(control_law, argnums=(0, 1)))
    rest = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    rng = np.random.default_rng(0)
    states = [rest, *(random_state(machine, rng) for _ in range(5))]
    # also exactly on the set point, at exactly its velocity
    value, rate = machine.reference.value_and_rate(0.05)
    on_set_point = {"piston_position": value, "piston_velocity": rate}
    on_set_point |= {"smooth_reference": value, "smooth_velocity": rate}
    states.append(rest | {n: v for n, v in on_set_point.items() if n in rest})
    for y in states:
        for leaf in jax.tree.leaves((law(machine, y, 0.05), slopes(machine, y, 0.05))):
            assert np.isfinite(leaf).all()


@pytest.mark.parametrize("sampled", [False, True], ids=["continuous", "sampled"])
@pytest.mark.parametrize("controller", TRACKING, ids=lambda c: c.__name__)
def test_tracking_and_energy_balance(controller, sampled):
    machine = bench(controller, **({"sampling": Sampled(sample_time=1e-4)} if sampled else {}))
    if "nominal_mass" in (p.name for p in structs.parameters(controller)):
        machine = edhas.change(machine, nominal_mass=0.12, nominal_damping=20.0)
    if hasattr(machine.controller, "cascade_velocity_gain"):
        machine = edhas.change(machine, cascade_velocity_gain=60.0)
    machine = edhas.change(machine, frequency=3.0)
    run = edhas.simulate(machine, edhas.Simulation(duration=0.45))
    assert run.metrics["tracking_error"].value < 0.15 * 3.5e-3
    assert abs(run.energy_residual()) < 1e-6


def mean_square_current(machine, name, value, steps=150):
    """The mean square of the current over the first steps, which depends on every gain."""
    machine = edhas.change(machine, **{name: value})

    def one(y, n):
        y, _ = step(machine, y, n * H, H)
        return y, y["current"] ** 2

    start = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    return jnp.mean(jax.lax.scan(one, start, jnp.arange(float(steps)))[1])


@pytest.mark.parametrize(
    ("controller", "sampled"),
    [pytest.param(c, False, id=c.__name__) for c in TRACKING]
    + [pytest.param(EXAMPLE["FilteredLead"], True, id="sampled")],
)
def test_batches_and_derivatives(controller, sampled):
    p = structs.parameters(controller)[-1 if controller is COMPONENT_KINDS["controller"]["antsmc"] else 0]
    machine = edhas.change(bench(controller), ramp_time=0.0)
    if sampled:
        machine = structs.replace(machine, sampling=Sampled(sample_time=1.1e-4, computation_delay=5e-5))
    mean_square = functools.partial(mean_square_current, machine, p.name)
    number = jit(mean_square)
    values = p.default * jnp.array([0.8, 1.0, 1.2])
    np.testing.assert_allclose(jit(jax.vmap(mean_square))(values), [number(v) for v in values], rtol=1e-9)
    e = 1e-4 * p.default
    difference = (number(p.default + e) - number(p.default - e)) / (2.0 * e)
    assert float(jit(jax.grad(mean_square))(p.default)) == pytest.approx(float(difference), rel=1e-4)


def test_the_documented_controller_from_its_file(tmp_path, monkeypatch, capsys):
    (tmp_path / "my_controllers.py").write_text(PYTHON, encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(YAML + "sampling: {kind: sampled, sample_time: 0.1 ms}\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "mine.yaml", "--out", "run", "--no-figure", "--set", "lead_gain=14 kV/m",
                 "--controller", "my_controllers.py:FilteredLead"]) == 0  # fmt: skip
    assert "tracking_error" in capsys.readouterr().out
    machine = edhas.open_run("run").machine
    assert edhas.get(machine, "lead_gain") == 14e3 and edhas.get(machine, "lead_time") == 3e-3
    assert edhas.get(machine, "sample_time") == 1e-4
    config = read_config("mine.yaml")
    again = build_config(yaml.safe_load(dump_config(config)), base_dir=tmp_path).machine
    assert type(again.controller) is type(config.machine.controller)
    assert jax.tree.leaves(again) == jax.tree.leaves(config.machine)
    before = effect_code(machine)["controller"]
    (tmp_path / "my_controllers.py").write_text(PYTHON.replace("gain K", "the gain K"), encoding="utf-8")
    changed = read_config("mine.yaml", trust=["my_controllers.py"]).machine
    assert effect_code(changed)["controller"] != before
    assert "controller" not in effect_code(ActuatorBench())


def test_a_class_instead_of_a_name():
    controller = {"kind": Proportional, "stiffness": "5 kV/m"}
    machine = build_config({"rig": "actuator_bench", "controller": controller}).machine
    assert isinstance(machine.controller, Proportional) and machine.controller.stiffness == 5e3
    spec = f"{Proportional.__module__}:Proportional"
    assert load_controller(spec) is Proportional and f"kind: {spec!r}".replace("'", '"') in dump_config(machine)


def test_batches_of_a_user_controller():
    machine = bench(Proportional)
    table = {"stiffness": np.array([5e3, 2e4]), "frequency": np.array([5.0, 20.0])}
    result = run_designs(machine, table, BatchSettings(step=5e-5, tolerance=1e-3))
    assert (result["status"] == 0).all() and np.isfinite(result["tracking_error"]).all()


@pytest.mark.parametrize(
    ("body", "message_part"),
    [
        ({}, "no method `command`"),
        ({"command": lambda self, y, s: 0.0, "initial": lambda self: {}}, "`initial` but no `rates`"),
        ({"command": lambda self, y, s: 0.0, "rates": lambda self, y, s: {}}, "`rates` but no `initial`"),
    ],
)
def test_an_invalid_controller_class_is_refused(body, message_part):
    with pytest.raises(ControllerError, match=message_part):
        type("Wrong", (Controller,), body)
    with pytest.raises(ControllerError, match="derive from Controller alone"):
        type("Heir", (Proportional,), {"command": lambda self, y, s: 0.0})


@pytest.mark.parametrize(
    ("states", "message_part"),
    [
        ({"piston_position": 0.0}, "is taken"),
        ({"no name": 0.0}, "letters"),
        ({"x": float("nan")}, "finite"),
        (3, "no dict"),
    ],
)
def test_invalid_states_are_refused(states, message_part):
    body = {"command": lambda self, y, s: 0.0, "initial": lambda self: states, "rates": lambda self, y, s: {}}
    with pytest.raises(ControllerError, match=message_part):
        check_controller(ActuatorBench(controller=type("Wrong", (Controller,), body)()))


def test_a_controller_that_needs_the_current_is_refused_by_a_current_amplifier():
    with pytest.raises(ConfigError, match="mount a voltage amplifier"):
        build_config({"rig": "pump_bench", "amplifier": {"kind": "current"}, "controller": {"kind": "antsmc"}})
