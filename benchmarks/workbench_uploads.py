"""The messages of the workbench for malformed files.

    python benchmarks/workbench_uploads.py

The last line: `files=… refused=… read=…`.
"""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from edhas_jax.workbench.data_calculations import DataCalculations  # noqa: E402
from edhas_jax.workbench.workspace import Workspace, WorkspaceError  # noqa: E402
from tests.workbench.malformed_files import MALFORMED  # noqa: E402


def main() -> None:
    """Run the benchmark and print its table, then its headline figures as `key=value` pairs."""
    refused = 0
    print("| file | answer |\n| --- | --- |")
    for name, (content, _) in MALFORMED.items():
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / name).write_bytes(content)
            try:
                calculations = DataCalculations(Workspace(Path(folder)), lambda sentence: None)
                found = calculations.table(name, "actuator_bench", 9)
                answer = f"read: {found['samples']} samples of {len(found['columns'])} columns"
            except WorkspaceError as error:
                refused += 1
                answer = "refused: " + str(error).splitlines()[0].replace(f"{folder}/", "").removeprefix(f"{name}: ")
                answer = answer.replace(f"refused: {name}:1: ", "refused: line 1: ")
        print(f"| {name} | {answer.replace('|', '/').replace('<', '&lt;')} |")
    print(f"files={len(MALFORMED)} refused={refused} read={len(MALFORMED) - refused}")


if __name__ == "__main__":
    main()
