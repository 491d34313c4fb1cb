"""Does the diagnosis find what is hidden in campaigns whose answers are known?

    python -m studies.identification.known_answers FOLDER [--answers FILE.md] [--out FILE.csv]

FOLDER holds campaigns made by an independent solver, and FILE.md (ANSWERS.md) a table of what is hidden in each:
campaign, verdict, hidden effects, and their parameters (`name, unit = value`, or `signal: fault value unit`) or a
remark. The study prints verdict, effects, the set of possible answers, errors of the parameters and residual over noise
on held-out runs; for the first campaign also by signal, before and after calibration. The table is written after every
campaign.
The last line: `campaigns=… right_verdicts=… right_effects=… truth_in_set=… wrong_effects=… worst_size_error=…
residual_low=… residual_high=… median_s=… worst_s=…`
"""

import argparse
import re
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from rich.console import Console

from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.posterior import NOTHING, UNKNOWN
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.measurements.campaign import CampaignError
from edhas_jax.measurements.campaign_reader import read_campaign

NUMBER = r"[-+]?\d[\d.e+-]*"


class Answer(NamedTuple):
    """What is hidden in a campaign: the verdict, the names of effects or sensor faults, and their parameters (SI)."""

    verdict: str
    names: frozenset[str]
    sizes: dict[str, float]


def main(arguments: list[str] | None = None) -> None:
    """Diagnose every campaign that the table of answers names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of the campaigns and of the answers")
    parser.add_argument("--answers", default="ANSWERS.md", metavar="FILE.md", help="file of the answers in this folder")
    parser.add_argument("--out", type=Path, default=Path("runs/known_answers.csv"), help="table of the results")
    options = parser.parse_args(arguments)
    file = options.folder / options.answers
    if not file.is_file():
        parser.error(f"{file}: no such file; give the table of answers in {options.folder} with --answers")
    answers = read_answers(file.read_text(encoding="utf-8"))
    campaigns, unreadable = {}, []
    for name in answers:  # all of them before the first diagnosis, which takes minutes
        try:
            campaigns[name] = read_campaign(options.folder / name)
        except CampaignError as error:
            unreadable.append(str(error))
    if unreadable:
        parser.error("; ".join(unreadable))
    console, rows = Console(highlight=False, width=150), []
    for number, (name, answer) in enumerate(answers.items()):
        with console.status(f"{name}: {number + 1} of {len(answers)}") as status:
            report = lambda text, name=name: status.update(f"{name}: {text}")  # noqa: E731
            found = diagnose(campaigns[name], on_progress=report)
        if number == 0:
            print_calibration(found)
        rows.append({"campaign": name} | compare(found, answer))
        print("  ".join(f"{key}={value}" for key, value in rows[-1].items()), flush=True)
        options.out.parent.mkdir(parents=True, exist_ok=True)
        pd.DataFrame(rows).to_csv(options.out, index=False)
    table = pd.DataFrame(rows)
    verdicts, effects, sets = (table[name].sum() for name in ("right_verdict", "right_effects", "truth_in_set"))
    low, high, size = table.held_out.min(), table.held_out.max(), table.worst_size_error.max()
    print(f"campaigns={len(table)} right_verdicts={verdicts} right_effects={effects} truth_in_set={sets} "
          f"wrong_effects={table.wrong_effects.sum()} worst_size_error={size:.4f} residual_low={low:.3f} "
          f"residual_high={high:.3f} median_s={table.seconds.median():.0f} worst_s={table.seconds.max()}")  # fmt: skip


def read_answers(text: str) -> dict[str, Answer]:
    """The first table of a page of answers, by campaign."""
    table = re.search(r"^\| campaign \|.*?\n\|[ -|]*\n(.*?)\n(?:\n|\Z)", text + "\n", re.MULTILINE | re.DOTALL)[1]
    answers = {}
    for line in table.splitlines():
        campaign, verdict, hidden, size = (cell.strip() for cell in line.strip("|").split("|"))
        names = (
            re.findall(r"^[a-z_]+ on [a-z_]+|[a-z]+_[a-z_]+", hidden) if "not in the catalogue" not in hidden else []
        )
        sizes = {n: float(v) for n, v in re.findall(rf"([a-z_]+)(?:, [^;=]+)? = ({NUMBER})", size)}
        sizes |= {f"{fault}_time": float(v) for fault, v in re.findall(rf": (lag|delay) ({NUMBER}) s", size)}
        answers[campaign] = Answer(verdict.strip("`"), frozenset(names), sizes)
    return answers


def compare(found: Diagnosis, answer: Answer) -> dict:
    """Verdict, effects and sizes of a diagnosis beside the answer."""
    fit, errors = found.final, []
    for candidate in found.named:
        for name, value in fit.values.items():
            short = name.removeprefix(candidate.prefix)
            if name.startswith(candidate.prefix) and short in answer.sizes and candidate.name in answer.names:
                errors.append(abs(value / answer.sizes[short] - 1.0))
    names, members = frozenset(c.name for c in found.named), found.posterior.credible
    truth = answer.names or {UNKNOWN if answer.verdict == Verdict.UNKNOWN_EFFECT.value else NOTHING}
    return {
        "verdict": found.verdict.value,
        "right_verdict": found.verdict.value == answer.verdict,
        "effects": "+".join(sorted(names)) or "none",
        "right_effects": names == answer.names,
        "wrong_effects": len(names - answer.names),
        "set": "+".join(members),
        "truth_in_set": truth <= set(members),
        "worst_size_error": round(max(errors, default=0.0), 5),
        "held_out": round(found.errors()["after"]["holdout"]["overall"], 4),
        "seconds": round(found.seconds),
    }


def print_calibration(found: Diagnosis) -> None:
    """Residual over noise of each signal on the held-out runs, before and after calibration."""
    errors = found.errors()
    for state in ("before", "calibrated"):
        row = errors[state]["holdout"]
        print(f"{state:12}" + "  ".join(f"{signal} {value:.2f}" for signal, value in row.items()))


if __name__ == "__main__":
    main()
