"""Write a campaign as a folder with `campaign.yaml` and one CSV file per run."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from edhas_jax.config.machine_keys import USUAL_EFFECTS
from edhas_jax.core import structs
from edhas_jax.core.literal_text import yaml_text
from edhas_jax.core.units import exact_quantity, from_si
from edhas_jax.machine.effects.loading import effect_spec
from edhas_jax.machine.interface.signals import Signal
from edhas_jax.machine.parameters import COMPONENT_KINDS, find_parameter, has_parameter, list_parameters, short_names
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.accuracy import BenchAccuracy
from edhas_jax.measurements.campaign import CAMPAIGN_FILE, Campaign, CampaignError, Spread, spread_entry
from edhas_jax.measurements.record_timing import START_TOLERANCE

NUMBER_FORMAT = "%.6g"


def write_campaign(campaign: Campaign, folder: Path) -> list[Path]:
    """Write a campaign into a new or empty folder.

    Args:
        campaign: its machine may differ from the nominal one by its parameters and by refined effects that it lacks.
        folder: the folder to create.

    Returns:
        The paths of the files, `campaign.yaml` first.

    Raises:
        CampaignError: the machine has another amplifier, controller or reference than nominal, which the file would
            not hold; the folder is not empty, or cannot be written.
    """
    nominal = type(campaign.machine)()
    for section in (name for name in COMPONENT_KINDS if hasattr(nominal, name)):
        if type(getattr(campaign.machine, section)) is not type(getattr(nominal, section)):
            raise CampaignError(f"{campaign.name}: a campaign with another {section} than nominal cannot be written")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise CampaignError(f"{folder}: exists already; nothing was written. Name another folder")
    paths = [folder / CAMPAIGN_FILE]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths[0].write_text(campaign_text(campaign), encoding="utf-8")
        for run in campaign.runs:
            columns = {"time [ms]": 1e3 * run.time}
            for name, values in run.signals.items():
                unit = campaign.channels[name].unit
                columns[f"{name} [{unit}]"] = from_si(values, campaign.machine.signals[name].unit, unit)
            path = folder / f"{run.name}.csv"
            table = np.stack(list(columns.values()), axis=1)
            np.savetxt(path, table, NUMBER_FORMAT, ",", header=",".join(columns), comments="", encoding="utf-8")
            paths.append(path)
    except OSError as error:
        raise CampaignError(f"{folder}: cannot be written: {error.strerror}") from None
    return paths


def _spread_text(machine: Rig, name: str, spread: Spread) -> str:
    """A spread as the value of an entry of `uncertain`."""
    if not spread.is_absolute:
        return f"{spread.size:g}"
    of_effects = {p.name: p for effect in USUAL_EFFECTS for p in structs.parameters(effect)}
    p = find_parameter(machine, name)[0] if has_parameter(machine, name) else of_effects[name]
    return f"{{{spread_entry(spread, p.unit)}}}"


def accuracy_lines(accuracy: BenchAccuracy, signals: Mapping[str, Signal]) -> list[str]:
    """The section `accuracy:` of a campaign; nothing for the defaults."""
    if accuracy == BenchAccuracy():
        return []
    lines = ["accuracy:   # standard deviations", f"  trigger: {exact_quantity(accuracy.trigger, 's')}"]
    lines.append(f"  clock_error: {exact_quantity(accuracy.clock_error, 's')}")
    if accuracy.recorder_filter != BenchAccuracy().recorder_filter:
        lines.append(f"  recorder_filter: {accuracy.recorder_filter!r}")
    lines += ["  settings:"] if accuracy.settings else []
    lines += [f"    {name}: {share!r}" for name, share in accuracy.settings.items()]
    lines += ["  signals:"] if accuracy.signals else []
    for name, sensor in accuracy.signals.items():
        words = [f"gain: {sensor.gain!r}", f"shift: {exact_quantity(sensor.shift, 's')}"]
        if sensor.offset is not None:
            words.append(f"offset: {exact_quantity(sensor.offset, signals[name].unit)}")
        lines.append(f"    {name}: {{{', '.join(words)}}}")
    lines += ["  clocks:"] if accuracy.clocks else []
    for name, clock in accuracy.clocks.items():
        lines.append(f"    {name}: {{channels: [{', '.join(clock.names)}], shift: {exact_quantity(clock.shift, 's')}}}")
    return lines


def campaign_text(campaign: Campaign) -> str:
    """The text of the `campaign.yaml` of a campaign."""
    machine = campaign.machine
    lines = [f"name: {yaml_text(campaign.name)}", f"rig: {machine.name}"]
    present = {effect.id for effect in machine.effects}
    without = [effect.id for effect in machine.usual_effects if effect.id not in present]
    lines += [f"without: [{', '.join(without)}]"] if without else []
    more = [yaml_text(effect_spec(type(e))) for e in machine.effects if type(e) not in USUAL_EFFECTS]
    lines += [f"effects: [{', '.join(more)}]"] if more else []
    rows = list_parameters(machine)
    names = short_names(machine)
    changed = [(p, value, path) for p, value, path in rows if float(value) != p.default]
    lines += ["parameters:"] if changed else []
    for p, value, path in changed:
        lines.append(f"  {names[path, p.name]}: {exact_quantity(value, p.unit)}")
    lines += ["uncertain:   # standard deviation, relative or with a unit"] if campaign.uncertain else []
    lines += [f"  {name}: {_spread_text(machine, name, spread)}" for name, spread in campaign.uncertain.items()]
    lines.append("signals:   # unit in the files, standard deviation of the noise in that unit")
    for name, channel in campaign.channels.items():
        noise = from_si(channel.noise, campaign.machine.signals[name].unit, channel.unit)
        stated = f", noise: {noise:.6g}" if math.isfinite(noise) else ""
        lines.append(f"  {name}: {{unit: {channel.unit}{stated}}}")
    lines += accuracy_lines(campaign.stated_accuracy, machine.signals)
    lines.append("runs:")
    files: dict[str, list[str]] = {}
    for run in campaign.runs:
        files.setdefault(run.whole, []).append(yaml_text(run.name + ".csv"))
    for run in (run for run in campaign.runs if not run.part_of):
        of_run = files[run.name]
        words = [f"file: {of_run[0]}" if len(of_run) == 1 else f"files: [{', '.join(of_run)}]", f"use: {run.use.value}"]
        words += ["start: 0 s"] if run.time[0] > START_TOLERANCE * run.interval else []
        words += [f"keep: [{', '.join(sorted(run.keep))}]"] if run.keep else []
        for name, value in run.conditions.items():
            words.append(f"{name}: {exact_quantity(value, find_parameter(machine, name)[0].unit)}")
        own = [f"{name}: {_spread_text(machine, name, spread)}" for name, spread in run.uncertain.items()]
        words += [f"uncertain: {{{', '.join(own)}}}"] if own else []
        lines.append(f"  - {{{', '.join(words)}}}")
    return "\n".join([*lines, ""])
