"""Example of a diagnosis: a campaign of a bench as benches are, with one effect that the model lacks.

    python -m studies.demo.missing_effect [--out DIR]

The measurements in `studies/demo/bench` come from a simulated bench (`studies.demo.bench_as_it_is` has written them).
The missing effect acts by another law than that of the library, small disturbances act as well, parameters
differ from the prior means of the model, and the noise is not stated. The last line has the verdict, the effects that
are named, whether their laws differ from those of the library, and the residuals over noise on the held-out run, as
key=value.
"""

import argparse
import json
import sys
from pathlib import Path

from edhas_jax.commands.cli import main as edhas
from studies.demo import BENCH


def main(arguments: list[str] | None = None) -> int:
    """Diagnose the campaign and print the verdict; the report is written to the folder."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("runs/missing_effect"))
    options = parser.parse_args(arguments)
    print(f"edhas diagnose {BENCH} --out {options.out} --overwrite\n", flush=True)
    status = edhas(["diagnose", str(BENCH), "--out", str(options.out), "--overwrite"])
    if status:
        return status
    result = json.loads((options.out / "diagnosis.json").read_text(encoding="utf-8"))
    errors = {state: result["error"][state]["holdout"]["overall"] for state in ("before", "calibrated", "after")}
    named = [law["law"] for law in result["laws"] if law["effect"] in result["effects"]]
    laws = ",".join(text.replace(" ", "_") for text in named)
    print(f"\nopen {options.out / 'report.html'} in a browser\n")
    print(
        f"verdict={result['verdict']} effects={','.join(result['effects']) or 'none'} laws={laws or 'none'} "
        + " ".join(f"{state}={error:.4g}" for state, error in errors.items())
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
