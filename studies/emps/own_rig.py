"""Discovery of the friction of a linear drive that is described as a machine of one's own.

    python -m studies.emps.own_rig FOLDER

FOLDER holds `run1.csv` of the EMPS data set with the columns time, reference position, piston position and voltage. The
record contains two strokes; the first is fitted, the second held out, each from the position and speed at its
beginning. The model is a mass alone (`studies.emps.rig`), the candidates are those effects of the library that have a
slot there. `studies.emps.discovery` does the same with a rig of the package; as there, two of these effects were fitted
to this drive when they were added to the library.

Force error: 100 ‖F − F_model‖/‖F‖ of the simulated closed loop, both low-pass filtered at 20 Hz.
"""

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import edhas_jax as edhas
from edhas_jax.config.recorded_signal import recorded_from_samples
from edhas_jax.diagnosis.report.report import parameter_texts
from edhas_jax.measurements.accuracy import BenchAccuracy
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from studies.emps.discovery import force_errors, return_to_start
from studies.emps.published_comparison import EVALUATION_START
from studies.emps.rig import LinearDrive

NOISE = {"piston_position": ("m", 2e-6), "voltage": ("V", 0.03)}
SPEED_SAMPLES = 20  # from which the speed at the start is taken


def campaign_of(file: Path) -> Campaign:
    """The campaign of one record: its first stroke is fitted, its second held out."""
    time, target, position, voltage = np.genfromtxt(file, delimiter=",", skip_header=1).T
    cut = return_to_start(time, position)
    runs = []
    for use, part in ((Use.FIT, slice(None, cut)), (Use.HOLDOUT, slice(cut, None))):
        own = time[part] - time[part][0]
        slope, start = np.polyfit(own[:SPEED_SAMPLES], position[part][:SPEED_SAMPLES], 1)
        conditions = {"start_position": float(start), "start_speed": float(slope)}
        rows = {"piston_position": position[part], "voltage": voltage[part]}
        signals = {name: np.where(own < EVALUATION_START, np.nan, values) for name, values in rows.items()}
        drives = {"target": recorded_from_samples(file, own, target[part])}
        lines = np.arange(len(time))[part] + 2
        runs.append(BenchRun(use.value, file, use, conditions, own, signals, lines, None, drives))
    channels = {name: Channel(unit, noise) for name, (unit, noise) in NOISE.items()}
    exact = BenchAccuracy(settings={"start_position": 0.0, "start_speed": 0.0})
    return Campaign("emps", file.parent, LinearDrive(), {"moved_mass": 0.1}, channels, tuple(runs), (),
                    stated_accuracy=exact)  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Print the models in the order in which the diagnosis found them, and the headline figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder of the EMPS record")
    campaign = campaign_of(parser.parse_args(arguments).folder / "run1.csv")
    console = Console(highlight=False, width=150)
    with console.status("") as status:
        found = edhas.diagnose(campaign, on_progress=status.update)
    table = Table("model", "residual over noise", "held out", "force error", "held out", "new parameters")
    rows = [("mass alone", found.calibrated, "")]
    for of in found.growth()[1:]:
        texts = [text for c in of.members for text in parameter_texts(c, of.evaluated.fit)]
        rows.append((str(of), of.evaluated, ", ".join(texts)))
    for name, evaluated, new in rows:
        errors = force_errors(evaluated)
        residuals = (f"{evaluated.rms_over_noise(use):.2f}" for use in Use)
        table.add_row(name, *residuals, *(f"{errors[use]:.2f} %" for use in Use), new)
    console.print(table)
    console.print(f"verdict: {found.verdict.value}")
    names = [candidate.id for candidate in found.named] + ["none"] * 3
    errors = force_errors(found.after)
    print(f"first={names[0]} second={names[1]} third={names[2]} candidates={found.weighing.named} "
          f"mass_alone={force_errors(found.calibrated)[Use.HOLDOUT]:.2f} fitted={errors[Use.FIT]:.2f} "
          f"heldout={errors[Use.HOLDOUT]:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
