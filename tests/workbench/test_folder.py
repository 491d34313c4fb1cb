"""Jobs, thinning, and answers of the calculating process, without a browser."""

import asyncio
import io
import json
import zipfile

import numpy as np
import pytest

from edhas_jax.workbench.calculator import CalculationError, Calculator
from edhas_jax.workbench.jobs import CANCELLED, DONE, FAILED, RUNNING, JobList
from edhas_jax.workbench.place import Place
from edhas_jax.workbench.thinning import thinned
from edhas_jax.workbench.workspace import Decisions, Workspace, WorkspaceError, effect_id
from tests.workbench.conftest import DEAD_TIME, wait_until


def test_a_thinned_record_keeps_every_extreme_and_the_ends():
    rng = np.random.default_rng(0)
    time = np.arange(1_000_000) * 1e-3
    values = rng.normal(size=len(time))
    values[[123_456, 777_777]] = 50.0, -50.0
    values[400_000:400_100] = np.nan
    index = thinned(time, values, -np.inf, np.inf, 500)
    assert len(index) <= 1003 and {123_456, 777_777, 0, len(time) - 1} <= set(index.tolist())
    assert (np.diff(index) > 0).all()
    inside = thinned(time, values, 100.0, 100.2, 500)
    assert np.array_equal(inside, np.arange(inside[0], inside[-1] + 1))
    assert time[inside[0]] <= 100.0 and time[inside[-1]] >= 100.2


def test_a_job_runs_the_command_reports_progress_and_outlives_its_server(campaign_folder):
    workspace = Workspace(campaign_folder)
    jobs = JobList(workspace)
    job = jobs.start("calibrate", ["fit", str(campaign_folder), "--out", str(campaign_folder / "workbench/calibrated")])
    with pytest.raises(WorkspaceError, match="one job at a time"):
        jobs.start("diagnose", ["diagnose", str(campaign_folder)])
    others = JobList(Workspace(campaign_folder))  # as after a restart
    wait_until(lambda: others.all()[-1].status != RUNNING, "the end of the calibration")
    assert others.all()[-1].status == DONE, others.output(job)
    assert len(others.progress(job)) >= 3 and "written to" in others.output(job)
    assert workspace.result("calibrated")["error"]["calibrated"]["fit"]["overall"] > 3.0
    assert list(workspace.models()) == ["as given", "calibrated"]


def test_a_cancelled_job_says_so_and_a_wrong_one_fails(campaign_folder):
    jobs = JobList(Workspace(campaign_folder))
    job = jobs.start("diagnose", ["diagnose", str(campaign_folder), "--out", str(campaign_folder / "workbench/d")])
    wait_until(lambda: jobs.progress(job), "the first report")
    jobs.cancel(jobs.all()[-1])
    wait_until(lambda: jobs.all()[-1].status != RUNNING, "the end of the cancelled job")
    assert jobs.all()[-1].status == CANCELLED
    job = jobs.start("diagnose", ["diagnose", str(campaign_folder / "nowhere")])
    wait_until(lambda: jobs.all()[-1].status != RUNNING, "the end of the wrong job")
    assert jobs.all()[-1].status == FAILED and "edhas:" in jobs.output(job)


def test_a_job_that_has_not_begun_is_cancelled(campaign_folder):
    jobs = JobList(Workspace(campaign_folder))
    job = jobs.start("diagnose", ["diagnose", str(campaign_folder), "--out", str(campaign_folder / "workbench/d")])
    assert job.pid == 0
    jobs.cancel(job)
    wait_until(lambda: jobs.all()[-1].status != RUNNING, "the end of the cancelled job")
    assert jobs.all()[-1].status == CANCELLED and not (campaign_folder / "workbench/d/diagnosis.json").exists()


def test_a_job_whose_process_is_gone_does_not_run(tmp_path):
    folder = tmp_path / "workbench" / "jobs"
    folder.mkdir(parents=True)
    record = {
        "number": 1, "title": "diagnose", "arguments": ["diagnose"], "began": 0.0, "pid": 2**22 - 1, "started": "1",
        "ended": None, "status": "running",
    }  # fmt: skip
    (folder / "1.json").write_text(json.dumps(record))
    assert JobList(Workspace(tmp_path)).running() is None


def test_decisions_are_kept_in_the_folder(tmp_path):
    Workspace(tmp_path).decide(Decisions(("coil_heating",), {"cogging_force": "no pitch"}))
    found = Workspace(tmp_path).decisions()
    assert found.added == ("coil_heating",) and found.rejected == {"cogging_force": "no pitch"}
    assert effect_id("/a/b.py:SealDrag") == "seal_drag" and effect_id("coil_heating") == "coil_heating"


def test_a_packed_campaign_opens_elsewhere_at_the_same_place(campaign_folder, tmp_path):
    workspace, place = Workspace(campaign_folder), Place("Compare", "run2", "current")
    workspace.decide(Decisions(("coil_heating",)))
    jobs, secret = workspace.results / "jobs", tmp_path / "secret.json"
    jobs.mkdir()
    (jobs / "1.json").write_text("{}")
    secret.write_text("{}")
    (workspace.results / "link.json").symlink_to(secret)
    with zipfile.ZipFile(io.BytesIO(workspace.packed(place.address))) as packed:
        packed.extractall(tmp_path / "elsewhere")
    found = Workspace(tmp_path / "elsewhere" / campaign_folder.name)
    assert found.inputs() == workspace.inputs() and len(found.inputs()) == 4
    assert found.decisions() == workspace.decisions() and Place.read(found.packed_place()) == place
    assert sorted(path.name for path in found.results.iterdir()) == ["decisions.json", "place.txt"]


def test_the_calculating_process_compares_and_tries(campaign_folder):
    async def ask():
        calculator = Calculator(campaign_folder)
        try:
            compared = await calculator.call("campaign.compare", "as given", "set_point")
            tried = await calculator.call("campaign.try_effects", ["inverter_dead_time"])
            again = await calculator.call("campaign.compare", "with inverter_dead_time", "set_point")
            with pytest.raises(CalculationError, match="no effect `nothing`"):
                await calculator.call("campaign.try_effects", ["nothing"])
            (campaign_folder / "campaign.yaml").write_text("rig: [")
            with pytest.raises(CalculationError, match="campaign.yaml"):
                await calculator.call("campaign.open")
        finally:
            calculator.stop()
        return compared, tried, again

    compared, tried, again = asyncio.run(ask())
    sentence = compared["sentences"][0]
    assert sentence["signal"] == "voltage" and sentence["axis"] == "current"
    assert tried["parameters"]["inverter_dead_time.dead_time_voltage"]["value"] == pytest.approx(DEAD_TIME, rel=0.05)
    assert tried["error"]["holdout"] < 1.2 < 3.0 < tried["before"]["error"]["holdout"]
    assert again["matrix"]["run3"]["voltage"] < 0.2 * compared["matrix"]["run3"]["voltage"]


def test_code_that_decisions_of_a_stranger_name_does_not_run(campaign_folder):
    (campaign_folder / "evil.py").write_text(f"open({str(campaign_folder / 'it-ran')!r}, 'w').close()\n")

    async def ask():
        calculator = Calculator(campaign_folder)
        try:
            with pytest.raises(CalculationError, match="was not allowed to run"):
                await calculator.call("campaign.try_effects", [f"{campaign_folder}/evil.py:Evil", "coil_heating"])
        finally:
            calculator.stop()

    asyncio.run(ask())
    assert not (campaign_folder / "it-ran").exists()


def test_a_figure_that_comes_after_its_place_is_gone_leaves_nothing_in_memory():
    nicegui = pytest.importorskip("nicegui", reason="no nicegui: pip install 'edhas_jax[workbench]'")
    from edhas_jax.workbench.views.plot import Plot

    async def show():
        client = nicegui.Client(nicegui.ui.page("/plot"))
        with client:
            with nicegui.ui.column() as view:
                plot = Plot("plot")
            figure = {"data": [], "layout": {"height": 100.0}}
            plot.show(figure)
            assert plot.element is not None
            view.clear()
            with view:
                late = Plot("plot")
            view.clear()
            count = len(client.elements)
            for gone in (plot, late):
                gone.show(figure)
            assert len(client.elements) == count

    asyncio.run(show())


def test_a_list_that_would_be_the_same_is_not_sent_again():
    nicegui = pytest.importorskip("nicegui", reason="no nicegui: pip install 'edhas_jax[workbench]'")
    from edhas_jax.workbench.views.elements import Choice

    async def follow():
        with nicegui.Client(nicegui.ui.page("/choice")):
            choice, sent = Choice(["a", "b"], value="a"), []
        choice.set_options = lambda options, value: sent.append((options, value))
        assert choice.follow(["a", "b"], "gone", "a") == "a" and not sent  # what is typed in it stays
        assert choice.follow(["a", "c"], "b", "c") == "c" and choice.follow(["d"], "b") is None
        assert sent == [(["a", "c"], "c"), (["d"], None)]

    asyncio.run(follow())
