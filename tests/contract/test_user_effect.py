"""An effect in a file of the user works with simulate, vmap, grad and the command line without further code."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.simulation.integrator import step

SOURCE = '''
import jax.numpy as jnp
from edhas_jax import Effect, par, state

class GuideFriction(Effect):
    """Dahl friction of the guide."""

    guide_friction: float = par(2.0, "N", (1e-6, 1e3), "friction while sliding")
    guide_stiffness: float = par(2e6, "N/m", (1.0, 1e9), "stiffness before sliding")
    bending = state("m", "bending of the contact")

    def mover_friction(self, s, z):
        return self.guide_stiffness * z.bending

    def rates(self, s, z):
        v = s.piston_velocity
        return {"bending": v - self.guide_stiffness * jnp.abs(v) * z.bending / self.guide_friction}
'''


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    folder = tmp_path_factory.mktemp("user")
    (folder / "my_effects.py").write_text(SOURCE)
    path = folder / "guide.yaml"
    path.write_text(
        "rig: actuator_bench\neffects: [lugre_friction, my_effects.py:GuideFriction]\n"
        "parameters: {guide_friction: 3 N}\nsimulation: {duration: 0.3 s}\n"
    )
    return path


def mean_square_current(machine, strength, samples=200):
    """Mean square of the current over the first steps of a run, a smooth function of the parameter."""
    machine = edhas.change(machine, guide_friction=strength)
    h = 5e-5

    def one(y, n):
        y, _ = step(machine, y, n * h, h)
        return y, y["current"] ** 2

    start = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    return jnp.mean(jax.lax.scan(one, start, jnp.arange(float(samples)))[1])


def test_simulate(config):
    loaded = edhas.load(config, trust=[config.parent / "my_effects.py"])
    run = edhas.simulate(loaded.machine, loaded.simulation)
    bare = edhas.simulate(edhas.change(loaded.machine, guide_friction=1e-6), loaded.simulation)
    lost = run.ledger().loc["guide_friction", "energy"]
    travel = np.trapezoid(np.abs(run.signals["piston_velocity"]), run.signals["time"])
    assert lost == pytest.approx(3.0 * travel, rel=0.02)  # Dahl's friction slides at its level nearly all the time
    assert run.metrics["rms_current"].value > 1.2 * bare.metrics["rms_current"].value
    assert abs(run.energy_residual()) < 1e-6


def test_vmap_and_grad(config):
    machine = edhas.load(config, trust=[config.parent / "my_effects.py"]).machine
    strengths = jnp.array([0.5, 2.0, 8.0])
    batched = jax.vmap(lambda f: mean_square_current(machine, f))(strengths)
    single = jnp.stack([mean_square_current(machine, f) for f in strengths])
    np.testing.assert_allclose(batched, single, rtol=1e-10)
    slope = jax.grad(lambda f: mean_square_current(machine, f))(2.0)
    forward = jax.jvp(lambda f: mean_square_current(machine, f), (2.0,), (1.0,))[1]
    difference = (mean_square_current(machine, 2.0 + 1e-4) - mean_square_current(machine, 2.0 - 1e-4)) / 2e-4
    assert float(slope) == pytest.approx(float(forward), rel=1e-9)
    assert float(slope) == pytest.approx(float(difference), rel=1e-5)


def test_command_line(config, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    own = ["--effect", f"{config.parent}/my_effects.py:GuideFriction"]
    assert main(["simulate", str(config), "--out", "run", "--no-figure", "--set", "guide_friction=1 N", *own]) == 0
    assert "guide_friction" in capsys.readouterr().out
    assert edhas.get(edhas.open_run(tmp_path / "run").machine, "guide_friction") == 1.0
    assert main(["effects", "--config", str(config), *own]) == 0
    assert "guide_friction" in capsys.readouterr().out
    assert main(["effects", f"{Path(config).parent / 'my_effects.py'}:GuideFriction"]) == 0
    assert "bending" in capsys.readouterr().out
