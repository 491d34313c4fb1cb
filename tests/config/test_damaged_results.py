"""Damaged files of results: opening them says so in one sentence."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

import edhas_jax as edhas
from edhas_jax.config.result_files import LIST_FILE, ResultFileError
from tests.support import CONFIGS

CHECKSUMS = ("checksum", "files")  # keys of a manifest
CONTENTS = {"empty": b"", "a list": b"[1]", "nothing": b"null", "a mapping": b"{}", "bytes": bytes(range(256)),
            "deep": b"[" * 100_000}  # fmt: skip
DAMAGED = "unreadable or incomplete|is damaged"


@pytest.fixture(scope="module", params=["with checksums", "of a version without checksums"])
def run_folder(request, tmp_path_factory):
    config = edhas.load(CONFIGS / "actuator.yaml", ["duration=0.01 s"])
    run = edhas.simulate(config.machine, config.simulation)
    folder = edhas.save_run(run, tmp_path_factory.mktemp("results") / "run", figure=False)
    if request.param != "with checksums":
        (folder / LIST_FILE).unlink(missing_ok=True)
        manifest = json.loads((folder / "run.json").read_text())
        (folder / "run.json").write_text(json.dumps({n: v for n, v in manifest.items() if n not in CHECKSUMS}))
    assert len(edhas.open_run(folder).signals["time"]) > 2
    return folder


@pytest.mark.parametrize("content", CONTENTS.values(), ids=CONTENTS)
@pytest.mark.parametrize("name", ["run.json", "timeseries.parquet", "ledger.parquet"])
def test_a_run(run_folder, tmp_path, name, content):
    folder = shutil.copytree(run_folder, tmp_path / "run")
    (folder / name).write_bytes(content)
    with pytest.raises(ResultFileError, match=DAMAGED):
        edhas.open_run(folder)


@pytest.mark.parametrize("change", [{"step": "a"}, {"step": None}, {"format": "1"}, {"status": "fine"}, {"status": 1}])
def test_the_manifest_of_a_run(run_folder, tmp_path, change):
    folder = shutil.copytree(run_folder, tmp_path / "run")
    manifest = json.loads((folder / "run.json").read_text()) | change
    (folder / "run.json").write_text(json.dumps(manifest))
    with pytest.raises(ResultFileError, match=DAMAGED):
        edhas.open_run(folder)


SUMMARY = {"task": "size", "edhas_jax": "0", "date": "", "summary": {"title": "a sizing", "sentences": []}}


@pytest.mark.parametrize("name", ["result.json", "path.parquet", "summary.json"])
@pytest.mark.parametrize("content", CONTENTS.values(), ids=CONTENTS)
def test_numbers_and_tables_of_a_task(tmp_path, name, content):
    """Of a folder without checksums."""
    (tmp_path / "summary.json").write_text(json.dumps(SUMMARY))
    (tmp_path / "result.json").write_text("{}")
    pd.DataFrame({"start": np.arange(3)}).to_parquet(tmp_path / "path.parquet")
    opened = edhas.open_result(tmp_path)
    assert opened.numbers == {} and len(opened.table("path")) == 3
    (tmp_path / name).write_bytes(content)
    if (name, content) == ("result.json", b"{}"):
        return
    with pytest.raises(ResultFileError, match=DAMAGED):
        edhas.open_result(tmp_path).table("path")
