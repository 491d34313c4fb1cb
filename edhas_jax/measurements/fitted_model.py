"""What a fit has said of its model, in the file that lies beside the configuration of that model."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

RESULT_FILES = "fit.json", "diagnosis.json", "result.json"  # beside the `config.yaml` of a fitted model
BENCH_CORRECTED = "with the bench corrected"  # of residuals without what triggers, settings and sensors did
ERROR_BY_RUN, IS_CORRECTED = "error_by_run", "bench_corrected"  # keys of a result


def results_beside(model: Path | str) -> Iterator[tuple[Path, dict[str, Any]]]:
    """The readable results that lie beside the configuration of a model, with their paths."""
    path = Path(model)
    for name in RESULT_FILES if path.name == "config.yaml" else (f"{path.stem}.json", f"{path.stem}.runs.json"):
        file = path.with_name(name)
        try:
            found = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(found, dict):
            yield file, found
