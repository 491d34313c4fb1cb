"""A decimal comma gives one clear message, also inside braces and brackets, where YAML reads two values."""

import pytest

from edhas_jax.config.machine_config import ConfigError, read_config
from edhas_jax.config.yaml_with_lines import FAST_FROM, parse_yaml

LONG = "\n# " + FAST_FROM * "."  # for the fast parser


@pytest.mark.parametrize("end", ["", LONG], ids=["short", "long"])
@pytest.mark.parametrize("value", ["2,5 mm", "-12,25 mm", "3,5e-3 m", "0,002"])
@pytest.mark.parametrize("entry", ["{{kind: sine, amplitude: {}, frequency: 10 Hz}}", "{{kind: sine, amplitude: {}}}"])
def test_in_braces_it_is_one_problem(entry, value, end):
    data, _, problems = parse_yaml(f"rig: pump_bench\nreference: {entry.format(value)}{end}")
    right = value.replace(",", ".")
    assert problems == [(2, f'reference.amplitude: "{value}" has a decimal comma; write "{right}"')]
    assert data["reference"].keys() <= {"kind", "amplitude", "frequency"} and data["reference"]["amplitude"] == right


def test_in_brackets_it_may_also_be_two_values():
    _, _, problems = parse_yaml("sizes: [5,5 um, 10 um]")
    assert problems == [
        (1, 'sizes[0]: "5,5 um" in brackets is two values; write 5.5 um if it is one, or a unit with each')
    ]


@pytest.mark.parametrize(
    "text", ["a: [1,2,3]", "a: {x: 1,y: 2}", "a: {x: 2, 5 mm: 1}", "a: [1 mm,2 mm]", 'a: ["2",5 mm]', "a: {x: 2,5: 7}"]
)
def test_other_commas_separate(text):
    assert parse_yaml(text)[2] == []


def test_a_configuration_says_nothing_else(tmp_path):
    file = tmp_path / "pump.yaml"
    file.write_text("rig: pump_bench\nreference: {kind: sine, amplitude: 2,5 mm}\nparameters:\n  frequency: 12,5 Hz\n")
    with pytest.raises(ConfigError) as refused:
        read_config(file)
    assert str(refused.value).splitlines() == [
        f'{file}:2: reference.amplitude: "2,5 mm" has a decimal comma; write "2.5 mm"',
        f'{file}:4: parameters.frequency: "12,5 Hz" has a decimal comma; write "12.5 Hz"',
    ]
