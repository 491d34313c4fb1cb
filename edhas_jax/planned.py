"""A campaign before its runs are made: the conditions as written, the signals those of the present model."""

import dataclasses
from pathlib import Path

import numpy as np

from edhas_jax.campaign import BenchRun, Campaign, CampaignError
from edhas_jax.campaign_reader import FILE, CampaignReader, read_campaign
from edhas_jax.menu import some_cycles
from edhas_jax.prediction import Case, Model
from edhas_jax.units import format_quantity
from edhas_jax.yaml_text import YamlError, dotted, line_of, read_yaml

STEP_LENGTH = 0.6  # s; a run without a period
FEWEST = 100  # samples of a run


class PlanReader(CampaignReader):
    """A campaign's mapping with runs that need not have been made."""

    def planned_runs(self, rate: float) -> tuple[BenchRun, ...]:
        """Runs sampled at `rate` [Hz] for some cycles of their set point, without signals."""
        if self._set_point:
            raise CampaignError(
                f"{self._folder / FILE}: `reference: {self._set_point}` is recorded with the runs, so nothing can be "
                "planned before they are made; describe the set point instead"
            )
        return tuple(self._planned(*row, rate) for row in self._runs)

    def _planned(self, name, file, use, conditions, rate: float) -> BenchRun:
        length = some_cycles(self.machine, conditions) or STEP_LENGTH
        if length * rate < FEWEST:
            what = f"has {length * rate:.0f} samples at {format_quantity(rate, 'Hz')}, at least {FEWEST} are needed"
            raise CampaignError(f"{file}: {what}; sample it faster")
        time = np.arange(round(length * rate) + 1) / rate
        return BenchRun(name, file, use, conditions, time, {}, np.arange(len(time)) + 2)


def read_planned(path: Path | str, rate: float) -> Campaign:
    """The campaign in a folder, its runs as they are planned: sampled at `rate` [Hz] where a run has no file yet.

    Raises:
        CampaignError: `campaign.yaml` is wrong (every problem, one line each), its set point is a recording, or `rate`
            leaves a run with next to no samples.
    """
    path = Path(path)
    file = path / FILE if path.is_dir() else path
    try:
        data, lines, problems = read_yaml(file.read_text(encoding="utf-8-sig"))
    except YamlError as error:
        raise CampaignError(f"{file}:{error.line}: {error}" if error.line else f"{file}: {error}") from None
    except (OSError, UnicodeDecodeError):
        return read_campaign(path)  # which says what is wrong
    reader = PlanReader(data, file.parent)
    problems += [(line_of(lines, key), f"{dotted(key)}: {what}") for key, what in reader.problems]
    if problems:
        problems.sort(key=lambda problem: problem[0])
        raise CampaignError("\n".join(dict.fromkeys(f"{file}:{line}: {what}" for line, what in problems)))
    planned = reader.planned_runs(rate)
    made = {run.name: run for run in (read_campaign(path).runs if all(r.file.exists() for r in planned) else ())}
    runs = tuple(made.get(run.name, run) for run in planned)
    return Campaign(reader.name, file.parent, reader.machine, reader.uncertain, reader.channels, runs, ())


def as_modelled(campaign: Campaign, per_sample: int) -> Campaign:
    """The campaign with the signals of its own model in place of what was measured, in every run that has them.

    A run that was not made yet has all of them.
    """
    model = Model(campaign, campaign.machine, (), campaign.runs)
    found = model.outcomes([Case(np.zeros(0), tuple(range(len(campaign.runs))))], per_sample, derive=False)[0]
    runs = tuple(
        dataclasses.replace(run, signals={n: found[r].values[n] for n in run.signals or campaign.channels})
        for r, run in enumerate(campaign.runs)
    )
    return dataclasses.replace(campaign, runs=runs)
