"""Lay out the earlier program that answers as `previous`, with the cases of today.

    python -m studies.hidden_effects.previous DIR
    cd DIR && python -m studies.hidden_effects --split judging --cases 340 --methods previous --out OUT

DIR gets the package of commit `COMMIT` and the studies of today, which draw the same cases with it. They use two
functions that this package does not have; these are added to it.

The last line: `commit=…`.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

COMMIT = "c996737"
PROJECT = Path(__file__).parents[2]
ADDED = {
    "machine/parameters.py": '''

def has_parameter(machine, name):
    try:
        find_parameter(machine, name)
    except ParameterError:
        return False
    return True
''',
    "simulation/integrator.py": '''

def rates(machine, y, t, h):
    s, found = machine.evaluate(y, t, h, y)
    return found | s.record.pressure_rates, list(s.record.pressure_rates)
''',
}


def lay_out(folder: Path) -> None:
    """Write the package of `COMMIT` and the present studies into an empty or new folder."""
    folder.mkdir(parents=True)
    packed = subprocess.run(["git", "archive", COMMIT, "edhas_jax"], cwd=PROJECT, check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", folder], input=packed.stdout, check=True)
    shutil.copytree(PROJECT / "studies", folder / "studies")
    for name, text in ADDED.items():
        with (folder / "edhas_jax" / name).open("a", encoding="utf-8") as file:
            file.write(text)


def main(arguments: list[str] | None = None) -> int:
    """Run the study from the command line and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="a folder that does not exist yet")
    lay_out(parser.parse_args(arguments).folder)
    print(f"commit={COMMIT}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
