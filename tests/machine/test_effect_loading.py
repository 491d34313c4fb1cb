"""Loading of effects by name, and the check that an effect acts on a machine."""

import os
import textwrap
from pathlib import Path

import jax
import pytest

from edhas_jax.core.structs import replace
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controllers import CascadeController
from edhas_jax.machine.effects import LIBRARY, EffectError, LugreFriction, loading
from edhas_jax.machine.effects.loading import effect_spec
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.rigs import RIGS, ActuatorBench, ActuatorSystem, PumpBench, components_by_name

GOOD = """
    import jax.numpy as jnp
    from edhas_jax.machine.effects import Effect, state
    from edhas_jax.core.structs import par

    class SealDrag(Effect):
        seal_force: float = par(3.0, "N", (0.0, 100.0), "force of the seal")
        seal_stiffness: float = par(1e4, "N/m", (0.0, 1e6), "stiffness of the lip")
        bend = state("m", "bending of the lip")

        def mover_friction(self, s, z):
            return self.seal_stiffness * z.bend

        def rates(self, s, z):
            limit = self.seal_force / self.seal_stiffness
            return {"bend": s.piston_velocity - jnp.abs(s.piston_velocity) * z.bend / limit}
"""


def load_effect(spec, folder="."):
    """The class of a spec; its file may run."""
    return loading.load_effect(spec, folder, trust=[Path(folder) / spec.partition(":")[0]])


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "my_effects.py").write_text(textwrap.dedent(GOOD))
    return tmp_path


def test_load_from_the_library_by_id():
    assert load_effect("lugre_friction") is LugreFriction
    assert {load_effect(cls.id) for cls in LIBRARY} == set(LIBRARY)


def test_load_from_a_module():
    assert load_effect("edhas_jax.machine.effects.mover.lugre_friction:LugreFriction") is LugreFriction


def test_load_from_a_file_of_the_user(folder):
    cls = load_effect("my_effects.py:SealDrag", folder)
    assert cls.id == "seal_drag"
    assert load_effect(f"{folder}/my_effects.py:SealDrag") is cls
    assert load_effect(effect_spec(cls)) is cls
    for rig in RIGS.values():
        check_effect(cls(), rig())


def test_a_changed_file_is_read_anew(folder):
    first = load_effect("my_effects.py:SealDrag", folder)
    (folder / "my_effects.py").write_text(textwrap.dedent(GOOD).replace("3.0", "30.0"))
    os.utime(folder / "my_effects.py", ns=(1, 1))
    assert load_effect("my_effects.py:SealDrag", folder)().seal_force == 30.0
    assert first().seal_force == 3.0


def test_the_check_changes_neither_effect_nor_machine(folder):
    effect = load_effect("my_effects.py:SealDrag", folder)()
    machine = PumpBench()
    check_effect(effect, machine)
    assert machine.effects == ()
    assert "mover_friction" not in vars(effect)
    assert not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(effect))


def rig_with_slots_of(cls):
    return ActuatorSystem if set(cls.slots) <= set(ActuatorSystem.slots) else PumpBench


def test_library_effects_act_on_rigs_with_their_slots():
    for cls in LIBRARY:
        check_effect(cls(), rig_with_slots_of(cls)())
    check_effect(LugreFriction(), ActuatorBench())
    with pytest.raises(EffectError, match=r"acts on the cylinder \(slot cylinder_friction_force\), which pump_bench"):
        check_effect(load_effect("karnopp_friction")(), PumpBench())


def test_an_effect_whose_slots_are_unused_is_refused():
    machine = replace(PumpBench(), amplifier=CurrentAmplifier(), controller=CascadeController())
    with pytest.raises(EffectError, match="amplifier_lag has no influence: .*coil_voltage_change"):
        check_effect(load_effect("amplifier_lag")(), machine)


def test_a_mounted_effect_can_be_checked_again():
    machine = replace(PumpBench(), effects=(LugreFriction(),))
    check_effect(machine.effects[0], machine)
    with pytest.raises(EffectError, match="given twice"):
        check_effect(LugreFriction(), machine)


def message_for_body(folder, body: str) -> str:
    code = f"""
import math
import jax
import numpy as np
import jax.numpy as jnp
from edhas_jax.machine.effects import Effect, state
from edhas_jax.core.structs import par

class Bad(Effect):
{textwrap.indent(textwrap.dedent(body), "    ")}
"""
    (folder / "bad.py").write_text(code)
    with pytest.raises(EffectError) as caught:
        check_effect(load_effect("bad.py:Bad", folder)(), PumpBench())
    return str(caught.value)


@pytest.mark.parametrize(
    ("line", "message_part"),
    [
        ("return s.no_such_thing", "pump_bench has no signal or parameter `no_such_thing`"),
        ("return z.bend", "`z` has no state `bend`"),
        ("return 1.0 if s.current > 0 else 2.0", "decide with jnp.where"),
        ("return max(s.current, 0.0)", "decide with jnp.where"),
        ("return np.tanh(s.current)", "take the one of jax.numpy"),
        ("return math.exp(s.current)", "stay with jax.numpy"),
        ("return None", "returns nothing"),
        ("return 1", "returns an int"),
        ("return True", "returns a bool"),
        ("return 'soft'", "returns a str"),
        ("return jnp.zeros(3)", "array of shape (3,)"),
        ("return jnp.int32(1)", "type int32"),
        ("return jax.lax.complex(s.current, s.current)", "type complex128"),
        ("return [][0]", "IndexError: list index out of range"),
        ("return s.current * s.time_step / undefined", "NameError"),
    ],
)
def test_wrong_code(folder, line, message_part):
    message = message_for_body(folder, f"def mover_force(self, s, z):\n    {line}\n")
    assert "Bad.mover_force" in message
    assert "bad.py:" in message
    assert message_part in message
    assert "\n" not in message


def test_a_constant_that_forces_float64(folder):
    (folder / "forced.py").write_text(
        "import numpy as np\nfrom edhas_jax.machine.effects import Effect\n\n"
        "class Forced(Effect):\n    def mover_force(self, s, z):\n        return np.sqrt(2.0) * s.current\n"
    )
    effect = load_effect("forced.py:Forced", folder)()
    check_effect(effect, PumpBench())
    with pytest.raises(EffectError, match=r"forced\.py:\d+\): a constant forces another precision"):
        check_effect(effect, PumpBench(), "float32")
    for cls in LIBRARY:
        check_effect(cls(), rig_with_slots_of(cls)(), "float32")


def test_if_on_a_parameter_is_refused_too(folder):
    body = """
        gain: float = par(1.0, "-", (0.0, 2.0), "gain")

        def motor_force_factor(self, s, z):
            return self.gain if self.gain > 0 else 1.0
    """
    assert "decide with jnp.where" in message_for_body(folder, body)


def test_constants_are_valid_contributions(folder):
    (folder / "fine.py").write_text(
        "import numpy as np\nfrom edhas_jax.machine.effects import Effect\n\n"
        "class Fine(Effect):\n    def mover_force(self, s, z):\n        return 2.0\n\n"
        "    def motor_force_factor(self, s, z):\n        return np.pi\n"
    )
    check_effect(load_effect("fine.py:Fine", folder)(), ActuatorBench())


@pytest.mark.parametrize(
    ("spec", "message_part"),
    [
        ("lugre_frict", "no effect `lugre_frict` in the library; nearest: lugre_friction"),
        ("my_effects.py", "write my_effects.py:ClassName"),
        ("nowhere.py:SealDrag", "no such file"),
        ("my_effects.py:SealDrg", "nearest: SealDrag"),
        ("my_effects.py:par", "not a subclass"),
        ("nowhere:SealDrag", "no module `nowhere`"),
        ("my_effects:SealDrag", "did you mean my_effects.py?"),
    ],
)
def test_wrong_spec(folder, spec, message_part):
    with pytest.raises(EffectError) as caught:
        load_effect(spec, folder)
    assert message_part in str(caught.value)


@pytest.mark.parametrize(
    ("code", "message_part"),
    [
        ("class Child(LugreFriction):\n    pass", "Child derives from LugreFriction: an effect is final"),
        ("class Child(LugreFriction, Effect):\n    pass", "Child derives from LugreFriction: an effect is final"),
        ("class Child(dict, Effect):\n    pass", "Child derives from dict: derive from Effect alone"),
        ("class Child(Effect):\n    mover_force = staticmethod(max)", "Child.mover_force: define it as `def mover_fo"),
        ("class Child(Effect):\n    mover_force = jax.jit(max)", "Child.mover_force: define it as `def mover_force"),
        ("class Child(Effect):\n    mover_force = state('N', '')", "Child.mover_force: define it as `def mover_force"),
        ("class Child(Effect):\n    mover_forc = staticmethod(max)", "Child.mover_forc is no slot; nearest: mover"),
        ("class Child(Effect):\n    rates = property(max)", "Child.rates: define it as `def rates(self, s, z)`"),
    ],
)
def test_an_invalid_effect_class_is_refused(folder, code, message_part):
    head = "import jax\nfrom edhas_jax.machine.effects import Effect, LugreFriction, state\n"
    (folder / "child.py").write_text(head + code + "\n")
    with pytest.raises(EffectError, match=r"child\.py:3: ") as caught:
        load_effect("child.py:Child", folder)
    assert message_part in str(caught.value)


def test_duplicate_ids_are_refused():
    with pytest.raises(EffectError, match="`lugre_friction` is taken twice in pump_bench"):
        components_by_name(replace(PumpBench(), effects=(LugreFriction(), LugreFriction())))


def test_errors_in_the_file_name_its_line(folder):
    (folder / "syntax.py").write_text("x = 1\ndef f(:\n    pass\n")
    with pytest.raises(EffectError, match=r"syntax\.py:2: syntax error"):
        load_effect("syntax.py:SealDrag", folder)
    (folder / "crash.py").write_text("x = 1\ny = x / 0\n")
    with pytest.raises(EffectError, match=r"crash\.py:2: ZeroDivisionError while the file is read: division by zero"):
        load_effect("crash.py:SealDrag", folder)
    (folder / "leave.py").write_text("raise SystemExit(3)\n")
    with pytest.raises(EffectError, match=r"leave\.py:1: SystemExit"):
        load_effect("leave.py:SealDrag", folder)
