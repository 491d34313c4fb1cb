"""The package beside other JAX code in one process: neither changes what the other computes."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.design.batch.batch import BatchSettings, run_designs
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.design.gradient.forward import forward
from edhas_jax.design.gradient.reverse import reverse
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.simulation.batch_trajectories import simulate_batch
from tests.support import ROOT

# single precision, one device, a loop, a matrix product and random numbers; and every setting of JAX
FOREIGN = """
import json, os
import jax, jax.numpy as jnp

def foreign():
    x = jax.random.normal(jax.random.key(0), (64, 64))
    y = jax.jit(lambda x: jax.lax.fori_loop(0, 5, lambda i, y: jnp.tanh(y @ x / 8.0), x))(x)
    seen = {"dtype": str(y.dtype), "sum": float(y.sum()).hex(), "devices": jax.device_count()}
    seen["settings"] = {n: repr(v) for n, v in sorted(jax.config.values.items())}
    return seen | {"flags": os.environ.get("XLA_FLAGS"), "result": y.tobytes().hex() if hasattr(y, "tobytes") else ""}
"""
OURS = """
from tests.project.test_foreign_jax import ours
"""


def ours() -> dict[str, list[str]]:
    """Numbers of every kind of computation, to the bit."""
    machine = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
    table = {"valve_mass": np.array([2e-3, 4e-3]), "frequency": np.array([20.0, 25.0])}
    batch = run_designs(machine, table, BatchSettings(step=1e-4, max_cycles=3))
    single = edhas.simulate(machine, edhas.Simulation(duration=0.02, step=5e-5))
    traces = simulate_batch(machine, table, {"valve_mass": np.ones(2)}, 5e-5, 10, 20, ("outlet_pressure",))
    settings, names = GradientSettings(256, 1e-2, 3), ["valve_mass", "frequency"]
    tables = [mode(machine, table, names, ["mean_flow"], settings).slopes["mean_flow"] for mode in (forward, reverse)]
    numbers = {
        "batch": [batch["mean_flow"], batch["phase_lag"]],
        "run": [single.signals["outlet_pressure"], single.energy["copper"]],
        "trajectories": [traces.values["outlet_pressure"], traces.slopes["outlet_pressure"]],
        "gradients": tables,
    }
    return {n: [float(x).hex() for a in arrays for x in np.ravel(a)[-8:]] for n, arrays in numbers.items()}


def python(code: str) -> dict:
    environment = {n: v for n, v in os.environ.items() if n not in ("XLA_FLAGS", "JAX_ENABLE_X64")}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def alone():
    """What the foreign code sees in a process without the package."""
    return python(FOREIGN + "print(json.dumps(foreign()))")


@pytest.mark.parametrize("order", ["foreign code first", "package first"])
def test_neither_changes_the_other(alone, order):
    first = FOREIGN + "before = foreign()\n" + OURS if order.startswith("foreign") else OURS + FOREIGN
    found = python(first + "numbers = ours()\nafter = foreign()\nprint(json.dumps([after, numbers]))")
    assert found[0] == alone
    assert found[0]["dtype"] == "float32" and "x64" in "".join(alone["settings"])
    assert found[1] == ours()


def test_importing_the_package_does_not_even_import_jax():
    seen = python("import json, sys, edhas_jax; print(json.dumps('jax' in sys.modules))")
    assert seen is False
