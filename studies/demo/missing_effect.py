"""Why does this bench not behave like the model? A campaign with something hidden in it is diagnosed.

    python -m studies.demo.missing_effect [--out DIR]

The measurements in `studies/demo/campaign` were made on a simulated bench that holds one effect that the model lacks,
with parameters that differ from what its engineer believes, and with noise. The last line sums up what was found.
"""

import argparse
import json
import sys
from pathlib import Path

from edhas_jax.commands.cli import main as edhas

HERE = Path(__file__).parent


def main(arguments: list[str] | None = None) -> int:
    """Diagnose the campaign and print what was found; the report stays in the folder."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("runs/missing_effect"))
    options = parser.parse_args(arguments)
    print(f"edhas diagnose {HERE / 'campaign'} --out {options.out} --overwrite\n", flush=True)
    status = edhas(["diagnose", str(HERE / "campaign"), "--out", str(options.out), "--overwrite"])
    if status:
        return status
    found = json.loads((options.out / "diagnosis.json").read_text(encoding="utf-8"))
    errors = {state: found["error"][state]["holdout"]["overall"] for state in ("before", "calibrated", "after")}
    print(f"\nopen {options.out / 'report.html'} in a browser\n")
    print(
        f"verdict={found['verdict']} effects={','.join(found['effects']) or 'none'} "
        + " ".join(f"{state}={error:.4g}" for state, error in errors.items())
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
