"""Preview of an effect: the standard run that it changes most, without and with the effect."""

import numpy as np
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.machine.effects import LugreFriction, SupplySag
from edhas_jax.simulation.effect_preview import preview_effect


def test_the_run_with_the_largest_change_is_chosen():
    """A sagging supply changes only runs whose command reaches the supply limit."""
    preview = preview_effect(SupplySag())
    assert preview.conditions["supply_voltage"] == 15.0 and preview.largest_change() > 0.01
    limit = 15.0 - 0.3 * np.abs(preview.with_effect["current"])
    assert (np.abs(preview.with_effect["voltage"]) <= limit + 1e-9).all()
    assert (np.abs(preview.without_effect["voltage"]) > limit).any()


def test_a_refined_effect_is_compared_with_the_machine_without_it():
    preview = preview_effect(LugreFriction())
    assert "lugre_friction" not in [e.id for e in preview.machine.effects] and preview.largest_change() > 0.01


def test_command_line(tmp_path, capsys):
    assert main(["effects", "supply_sag", "--picture", str(tmp_path / "sag.png")]) == 0
    printed = capsys.readouterr().out
    assert "looks like" in printed and "confused with" in printed and "plausible" in printed
    assert (tmp_path / "sag.png").stat().st_size > 10_000
    assert main(["effects", "supply_sag", "--picture", str(tmp_path / "made" / "sag.png")]) == 0
    assert (tmp_path / "made" / "sag.png").exists()
    (tmp_path / "file").touch()
    assert main(["effects", "supply_sag", "--picture", str(tmp_path / "file" / "sag.png")]) == 2
    with pytest.raises(SystemExit):
        main(["effects", "--picture"])
