"""The script of the interactive plot, executed by Node.js: the labels of the axes after zooming."""

import dataclasses
import json
import shutil
import subprocess

import numpy as np
import pytest

from edhas_jax.diagnosis.report.trace_viewer import render_trace_viewer
from tests.support import ROOT
from tests.support.synthetic_campaign import empty_campaign

PAGE_SCRIPT = ROOT / "tests" / "support" / "trace_viewer_page.js"
NODE = shutil.which("node") or shutil.which("nodejs")
pytestmark = pytest.mark.skipif(NODE is None, reason="Node.js, which executes the script, is not installed")
LARGEST_RESIDUALS = (2.0, 4.0, 7.4, 40.0, 4.4e4)


def labels_after(tmp_path, signal, residuals, drags):
    """The labels of the axes on the page of one run at first and after each drag."""
    campaign = empty_campaign(lengths=(401,))
    runs = tuple(dataclasses.replace(run, signals={"current": signal}) for run in campaign.runs[:1])
    states = {"calibrated": {runs[0].name: {"current": residuals}}}
    page = tmp_path / "page.html"
    page.write_text(render_trace_viewer(dataclasses.replace(campaign, runs=runs), states), encoding="utf-8")
    command = [NODE, str(PAGE_SCRIPT), str(page), json.dumps(drags)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)["labels"]


@pytest.mark.parametrize("largest", LARGEST_RESIDUALS)
def test_every_axis_has_labels_at_several_values_after_zooming(tmp_path, largest):
    """The residuals grow with time; each drag keeps the first seven tenths of what is shown."""
    share = np.linspace(0.0, 1.0, 401)
    residuals = largest * share * np.cos(200.0 * share)
    drags = [[0.7, 0.0]] * 6
    for shown in labels_after(tmp_path, 2.0 * np.sin(20.0 * share), residuals, drags):
        for axis, texts in shown.items():
            numbers = [float(text) for text in texts]
            assert len(set(numbers)) == len(numbers) >= 3 and numbers == sorted(numbers), (axis, texts)
            assert not any(text.startswith("-0") and float(text) == 0.0 for text in texts), (axis, texts)
            steps = np.diff(numbers)
            assert np.allclose(steps, steps[0]), (axis, texts)
        assert 0.0 in [float(text) for text in shown["residual"]]


def test_a_gap_in_the_record_has_a_picture_without_numbers_that_are_not_there(tmp_path):
    signal = np.sin(np.linspace(0.0, 20.0, 401))
    signal[100:300] = np.nan
    first, zoomed = labels_after(tmp_path, signal, np.where(np.isfinite(signal), 1.0, np.nan), [[0.4, 0.6]])
    assert not any("NaN" in text or "Infinity" in text for texts in zoomed.values() for text in texts)
    assert len(zoomed["time"]) >= 3
