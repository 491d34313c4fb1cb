"""Structs as pytrees of JAX: different classes have different structures, and leaves are restored to the same class."""

from itertools import combinations

import jax
import numpy as np

from edhas_jax.core.structs import par, replace, struct
from edhas_jax.machine.effects import InverterDeadTime
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.sensor_models import SENSOR_MODELS


@struct
class Stiffness:
    """A struct of one number."""

    rate: float = par(2.0, "N/m", (0.0, 10.0), "rate")


@struct
class Damping:
    """Another one of one number."""

    rate: float = par(3.0, "N s/m", (0.0, 10.0), "rate")


def test_structs_of_two_classes_have_two_structures():
    """JAX looks up compiled programs by structure: if two were equal, one class could run the program of the other."""
    for one, other in combinations((Stiffness, Damping, *SENSOR_MODELS), 2):
        structures = jax.tree.structure(one()), jax.tree.structure(other())
        assert structures[0] != structures[1] and structures[0] != jax.tree.structure((other(),))
    assert jax.tree.structure(Stiffness(rate=1.0)) == jax.tree.structure(Stiffness(rate=4.0))
    assert hash(jax.tree.structure(Stiffness(rate=1.0))) == hash(jax.tree.structure(Stiffness()))


def test_a_struct_is_taken_apart_and_put_together():
    pump = replace(PumpBench(), effects=(InverterDeadTime(dead_time_voltage=0.7),))
    leaves, structure = jax.tree.flatten(pump)
    again = jax.tree.unflatten(structure, leaves)
    assert type(again) is PumpBench and jax.tree.leaves(again) == leaves
    doubled = jax.tree.map(lambda leaf: 2.0 * np.asarray(leaf), pump)
    assert doubled.effects[0].dead_time_voltage == 1.4
    (path, value), *_ = jax.tree_util.tree_flatten_with_path(Stiffness())[0]
    assert jax.tree_util.keystr(path) == ".rate" and value == 2.0
