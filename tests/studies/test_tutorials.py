"""The tutorials run as notebooks, and the shortest one of them is short."""

from pathlib import Path

import jupytext
import pytest
from nbclient import NotebookClient

TUTORIALS = Path(__file__).parents[2] / "docs" / "tutorials"
MAX_LINES = 25  # of code, of the tutorial that goes through everything
LIMIT = 600  # s, that a cell may take at all


def notebook(name: str):
    """A tutorial as a notebook."""
    return jupytext.read(TUTORIALS / f"{name}.py")


@pytest.mark.parametrize("name", sorted(path.stem for path in TUTORIALS.glob("*.py")))
def test_a_tutorial_runs(name, tmp_path):
    found = notebook(name)
    where = {"metadata": {"path": str(tmp_path)}}
    client = NotebookClient(found, timeout=LIMIT, kernel_name="python3", resources=where)
    client.execute()
    kinds = [output.output_type for cell in found.cells for output in cell.get("outputs", ())]
    assert "error" not in kinds and ("execute_result" in kinds or "display_data" in kinds)


def test_the_whole_loop_is_short():
    code = [cell.source for cell in notebook("whole_loop").cells if cell.cell_type == "code"]
    lines = [line for source in code for line in source.splitlines() if line.strip()]
    assert len(lines) <= MAX_LINES
