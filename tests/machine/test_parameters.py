"""Parameters of a machine by name: read, set with or without units, differentiated, refused in a sentence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.core.structs import replace
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.parameters import ParameterError, get_parameter, list_parameters, set_parameters
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench


def test_set_parameters():
    machine = replace(PumpBench(), effects=(LIBRARY[0](), LIBRARY[1]()))
    changed = set_parameters(machine, {"piston_clearance": 15e-6, "coil.coil_resistance": "1.5 ohm", "mover_mass": 1})
    assert get_parameter(changed, "piston_leakage.piston_clearance") == 15e-6
    assert get_parameter(changed, "coil_resistance") == 1.5
    assert get_parameter(machine, "coil_resistance") == 1.41
    assert [e.id for e in changed.effects] == [e.id for e in machine.effects]
    assert len(list_parameters(changed)) == len(list_parameters(machine))
    slope = jax.grad(
        lambda r: get_parameter(set_parameters(ActuatorBench(), {"coil_resistance": r}), "coil_resistance")
    )
    assert slope(1.0) == 1.0
    assert get_parameter(set_parameters(machine, {"mover_mass": jnp.float32(0.2)}), "mover_mass").dtype == jnp.float32


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"piston_clearance": 5.0}, "belongs to the effect piston_leakage"),
        ({"piston_diametr": 5.0}, "piston_diametr: unknown parameter; nearest: piston_diameter"),
        ({"mover_mass": -1.0}, "mover_mass: must lie in 100 mg … 10000 kg (moving mass of the actuator M); got -1 kg"),
        ({"mover_mass": float("nan")}, "not a finite number"),
        ({"mover_mass": True}, "a number or a text"),
        ({"mover_mass": np.ones(3)}, "a number or a text"),
        ({"mover_mass": None}, "a number or a text"),
        ({"mover_mass": "1 N"}, "is a force, not a mass"),
        ({"step_size": 1e-3, "target.step_size": 2e-3}, "given twice, also as step_size"),
        ({"coil.mover_mass": 1.0}, "write mover.mover_mass"),
    ],
)
def test_set_parameters_refuses(values, says):
    with pytest.raises(ParameterError) as caught:
        set_parameters(ActuatorSystem(), values)
    assert says in str(caught.value)
