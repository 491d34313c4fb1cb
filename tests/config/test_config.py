"""Configurations: reading, writing, and that writing is the inverse of reading."""

import json
import os

import jax
import jsonschema
import numpy as np
import pytest
import yaml

from edhas_jax.config.declared_keys import quantity, size_in
from edhas_jax.config.document import Entry
from edhas_jax.config.machine_config import ConfigError, build_config, read_config
from edhas_jax.config.machine_keys import machine_schema
from edhas_jax.config.writer import dump_config
from edhas_jax.core.structs import replace
from edhas_jax.core.units import exact_quantity
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controllers import CascadeController, OpenLoop
from edhas_jax.machine.components.set_points import Chirp, Sine, Step
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.parameters import ParameterError, get_parameter, list_parameters, set_parameters
from edhas_jax.machine.rigs import RIGS, ActuatorSystem, PumpBench
from edhas_jax.simulation.run_settings import Precision, Simulation
from tests.support import CONFIGS

# configurations of sweeps, sensitivities and sizings have tests of their own
SHIPPED = sorted(p for p in CONFIGS.glob("*.yaml") if p.name.split("_")[0] not in ("sweep", "sensitivity.yaml", "size"))


def same(a, b) -> bool:
    if jax.tree.structure(a) != jax.tree.structure(b):
        return False
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return all(np.allclose(x, y, rtol=1e-13, atol=0.0) for x, y in pairs)


def machine_with_changed_parameters(rig: str):
    """A rig with all effects that fit and every parameter moved off its default."""
    machine = RIGS[rig]()
    slot_names = {slot.name for slot in machine.slots}
    fitting = [cls() for cls in LIBRARY if any(slot.name in slot_names for slot in cls.slots)]
    fitting = [e for e in fitting if rig != "actuator_bench" or e.id != "seal_friction"]  # it reads chamber pressures
    machine = replace(machine, effects=tuple(fitting))
    values = {}
    for p, value, path in list_parameters(machine):
        high = p.span[1]
        values[f"{path}.{p.name}"] = value * 1.0123456789012345 if value * 1.02 < high else value * 0.987
    return set_parameters(machine, values)


@pytest.mark.parametrize("rig", RIGS)
def test_round_trip(rig, tmp_path):
    machine = machine_with_changed_parameters(rig)
    settings = Simulation(duration=1 / 3, accuracy=0.00123, sample_rate=4321.0, precision=Precision.FLOAT32)
    (tmp_path / "dump.yaml").write_text(dump_config(machine, settings), encoding="utf-8")
    config = read_config(tmp_path / "dump.yaml")
    assert same(config.machine, machine)
    assert config.simulation == settings
    assert dump_config(config) == config.text


def read_alone(kind, text):
    """The value of a text, and whether it is a problem."""
    entry = Entry(text, ("given",))
    value = kind.read(entry)
    return value, bool(entry.problems)


@pytest.mark.parametrize("rig", RIGS)
def test_both_ends_of_a_range_may_be_given_and_nothing_beyond(rig):
    tested = 0
    for p, _, path in list_parameters(machine_with_changed_parameters(rig)):
        low, high = p.span
        for end, beyond in ((low, low - 1e-6 * (high - low)), (high, high + 1e-6 * (high - low))):
            if np.isfinite(beyond):
                assert read_alone(quantity(p), exact_quantity(end, p.unit)) == (end, False), (path, p.name)
                assert read_alone(quantity(p), exact_quantity(beyond, p.unit)) == (None, True), (path, p.name)
                tested += 1
    assert tested > 40


def test_zero_is_a_size_where_it_has_a_meaning():
    """An accuracy of zero is an exact sensor; an interval of zero has no samples."""
    accuracy, interval = size_in("s", "1 ms", 0.0), size_in("s", "1 ms", 0.0, above=True)
    assert read_alone(accuracy, "0 s") == (0.0, False) and read_alone(interval, "0 s") == (None, True)
    assert read_alone(interval, "1 ns") == (1e-9, False)
    assert read_alone(accuracy, "-1 ns") == read_alone(interval, "-1 ns") == (None, True)
    share = size_in("-", "2 %", 0.0, most=1.0)
    assert read_alone(share, "100 %") == (1.0, False) and read_alone(share, "100.1 %") == (None, True)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.name)
def test_shipped_configurations(path, tmp_path):
    config = read_config(path)
    assert path.read_text(encoding="utf-8").startswith("# yaml-language-server: $schema=edhas.schema.json\n")
    jsonschema.validate(yaml.safe_load(config.text), machine_schema(), jsonschema.Draft202012Validator)
    dumped = dump_config(config)
    jsonschema.validate(yaml.safe_load(dumped), machine_schema(), jsonschema.Draft202012Validator)
    assert same(build_config(yaml.safe_load(dumped)).machine, config.machine)


def test_paper_is_the_default_machine():
    config = read_config(CONFIGS / "paper.yaml")
    assert [e.id for e in config.machine.effects] == ["lugre_friction", "piston_leakage", "entrained_air"]
    assert same(config.machine, replace(PumpBench(), effects=tuple(type(e)() for e in config.machine.effects)))
    assert config.simulation == Simulation(sample_rate=5000.0, duration=0.5)
    assert config.name == "paper pump"
    system = read_config(CONFIGS / "paper_step.yaml")
    assert isinstance(system.machine, ActuatorSystem)
    assert system.machine.target.step_size == 15e-3


def test_schema_file_is_current():
    text = json.dumps(machine_schema(), indent=2, ensure_ascii=False) + "\n"
    path = CONFIGS / "edhas.schema.json"
    if os.environ.get("EDHAS_UPDATE_GOLDEN") == "1":
        path.write_text(text, encoding="utf-8")
    assert path.read_text(encoding="utf-8") == text
    jsonschema.Draft202012Validator.check_schema(machine_schema())


@pytest.mark.parametrize(
    "wrong",
    [
        {"rig": "pumpbench"},
        {"rig": "pump_bench", "parameters": {"piston_diameter": 12}},
        {"rig": "pump_bench", "paramters": {}},
        {"rig": "pump_bench", "effects": ["lugre"]},
        {"rig": "pump_bench", "simulation": {"step": "20 us", "accuracy": "1 %"}},
        {"rig": "pump_bench", "controller": {"kind": "pid"}},
        {"effects": []},
    ],
)
def test_schema_refuses(wrong):
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(wrong, machine_schema(), jsonschema.Draft202012Validator)


def test_without_has_the_refined_effects_but_those_it_lists():
    def effects(**keys):
        return [effect.id for effect in build_config({"rig": "pump_bench", **keys}).machine.effects]

    assert effects() == []
    assert effects(without=[]) == ["lugre_friction", "piston_leakage", "entrained_air"]
    assert effects(without=["piston_leakage"], effects=["coil_heating"]) == [
        "coil_heating", "lugre_friction", "entrained_air",
    ]  # fmt: skip
    with pytest.raises(ConfigError, match=r"without\[0\]: no refined effect `karnopp_friction` of this rig"):
        effects(without=["karnopp_friction"])
    with pytest.raises(ConfigError, match=r"effects\[0\]: `entrained_air` is listed under `without` too"):
        effects(without=["entrained_air"], effects=["entrained_air"])


def test_short_names_are_those_of_the_kind():
    def controller(**keys):
        return build_config({"rig": "pump_bench", "controller": keys}).machine.controller

    cascade = controller(kind="cascade", kp="100 1/s", cascade_velocity_gain="200 V*s/m")
    assert (cascade.cascade_position_gain, cascade.cascade_velocity_gain) == (100.0, 200.0)
    assert controller(kp="10 kV/m").position_gain == 1e4
    with pytest.raises(ConfigError, match="controller.kv: unknown parameter .* write `kind: cascade`, which has it"):
        controller(kv="200 V*s/m")
    with pytest.raises(ConfigError, match="controller.position_gain: given twice, also as controller.kp"):
        controller(kp="10 kV/m", position_gain="10 kV/m")


def test_overrides():
    config = read_config(
        CONFIGS / "paper.yaml",
        ["piston_clearance=15 um", "reference.frequency=20Hz", "duration=2 s", "step=10 us", "precision=float32"],
    )
    assert get_parameter(config.machine, "piston_clearance") == 15e-6
    assert config.machine.reference.frequency == 20.0
    assert config.simulation == Simulation(sample_rate=5000.0, duration=2.0, step=1e-5, precision=Precision.FLOAT32)
    system = read_config(CONFIGS / "paper_step.yaml", ["target=5 mm", "accuracy=1 %", "sample_rate=1 kHz"])
    assert system.machine.target.step_size == 5e-3
    assert system.simulation == Simulation(duration=0.6, accuracy=0.01, sample_rate=1000.0)


def test_an_override_of_the_step_replaces_the_accuracy(tmp_path):
    (tmp_path / "a.yaml").write_text("rig: actuator_bench\nsimulation: {accuracy: 0.5 %}\n")
    assert read_config(tmp_path / "a.yaml", ["step=10us"]).simulation == Simulation(sample_rate=5000.0, step=1e-5)


def test_all_wrong_overrides_are_reported():
    with pytest.raises(ConfigError) as caught:
        read_config(
            CONFIGS / "paper.yaml", ["piston_clearence=15 um", "duration=5", "frequency", "coil_resistance=-1 ohm"]
        )
    lines = str(caught.value).splitlines()
    assert len(lines) == 4
    for part in (
        "--set piston_clearence: unknown parameter; nearest: piston_clearance",
        "--set duration: a unit is missing",
        "--set frequency: write name=value",
        "--set coil_resistance: must lie in 1 mohm … 10 kohm (resistance R); got -1 ohm",
    ):
        assert any(part in line for line in lines), part


def test_sections():
    config = build_config(
        {
            "rig": "actuator_system",
            "controller": {"kind": "cascade", "cascade_position_gain": "100 1/s"},
            "amplifier": {"kind": "current", "amplifier_gain": "2 A/V"},
            "reference": {"kind": "sine", "frequency": "30 Hz"},
            "target": {"kind": "chirp", "amplitude": "5 mm"},
            "parameters": {
                "chirp.start_frequency": "2 Hz",
                "stops.pump_stroke": "11 mm",
                "end_stops.stop_damping": "3 s/m",
            },
        }
    )
    m = config.machine
    assert isinstance(m.controller, CascadeController)
    assert m.controller.cascade_position_gain == 100.0
    assert isinstance(m.amplifier, CurrentAmplifier)
    assert m.amplifier.amplifier_gain == 2.0
    assert (m.reference.frequency, m.reference.ramp_time) == (30.0, 0.0)
    assert isinstance(m.target, Chirp)
    assert (m.target.start_frequency, m.stops.pump_stroke, m.stops.stop_damping) == (2.0, 11e-3, 3.0)
    assert same(build_config(yaml.safe_load(config.text)).machine, m)


def test_open_loop_takes_volts():
    config = build_config(
        {
            "rig": "actuator_bench",
            "controller": {"kind": "open_loop"},
            "reference": {"kind": "sine", "amplitude": "24 V"},
        }
    )
    assert isinstance(config.machine.controller, OpenLoop)
    assert config.machine.reference.amplitude == 24.0
    assert "amplitude: 24 V" in config.text
    assert same(build_config(yaml.safe_load(config.text)).machine, config.machine)
    with pytest.raises(ConfigError, match="reference.amplitude: missing"):
        build_config({"rig": "actuator_bench", "controller": {"kind": "open_loop"}})


def test_user_effect_and_its_parameters(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from edhas_jax.machine.effects import Effect\nfrom edhas_jax.core.structs import par\n\n"
        "class SealDrag(Effect):\n"
        "    seal_damping: float = par(3.0, 'N*s/m', (0.0, 100.0), 'damping of the seal')\n\n"
        "    def mover_friction(self, s, z):\n        return self.seal_damping * s.piston_velocity\n"
    )
    (tmp_path / "a.yaml").write_text(
        "rig: pump_bench\neffects: [mine.py:SealDrag]\nparameters: {seal_drag.seal_damping: 5 N·s/m}\n"
    )
    config = read_config(tmp_path / "a.yaml", trust=[tmp_path / "mine.py"])
    assert get_parameter(config.machine, "seal_damping") == 5.0
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep/b.yaml").write_text(dump_config(config), encoding="utf-8")
    assert same(read_config(tmp_path / "deep/b.yaml").machine, config.machine)


def test_problems_of_a_mapping_have_no_line_numbers():
    with pytest.raises(ConfigError) as caught:
        build_config({"rig": "pump_bench", "parameters": {"piston_diameter": 12.0, "mover_mass": "1 m"}})
    assert str(caught.value).splitlines() == [
        'parameters.piston_diameter: a unit is missing; write for example "12 mm" (any unit of length)',
        'parameters.mover_mass: "1 m" is a length, not a mass; write for example "120 g" (any unit of mass)',
    ]
    with pytest.raises(ConfigError, match="not a list"):
        build_config([])


def test_a_parameter_name_of_two_components():
    machine = replace(ActuatorSystem(), reference=Step(), target=Step())
    with pytest.raises(ParameterError, match=r"ambiguous; write one of reference\.step_size, target\.step_size"):
        get_parameter(machine, "step_size")
    changed = set_parameters(machine, {"reference.step_size": 2e-3, "target.step_size": "3 mm"})
    assert (changed.reference.step_size, changed.target.step_size) == (2e-3, 3e-3)
    assert same(build_config(yaml.safe_load(dump_config(changed))).machine, changed)
    other = replace(machine, reference=Sine())
    assert get_parameter(other, "step.step_size") == 1e-3


def test_shipped_effects_pass_the_check():
    for path in SHIPPED:
        machine = read_config(path).machine
        for effect in machine.effects:
            check_effect(effect, machine)
