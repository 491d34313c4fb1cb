"""Results of the tasks: summaries in every form, short texts, folders that open again, tasks in plain Python."""

import io
import json

import matplotlib.figure
import matplotlib.pyplot as plt
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.config.examples import FOLDER
from edhas_jax.config.machine_config import ConfigError
from edhas_jax.config.result_files import ResultFileError
from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
from edhas_jax.design.sizing.config import load_sizing
from edhas_jax.simulation.validity import Status
from edhas_jax.tasks.result import SavedResult
from studies.campaign_writer import write_campaign
from tests.support.synthetic_campaign import bench, empty_campaign, measured

BENCH = edhas.ActuatorBench()


def test_a_summary_in_every_form():
    rows = [("a <b>", Toned("1 mm", Tone.BAD))]
    table = SummaryTable.of("sizes", ("name", "size"), rows, [{"name": "a", "size": 1e-3}])
    summary = Summary("title: <x>", (table, "A sentence.", Toned("A warning.", Tone.CAUTION)))
    assert str(summary).splitlines()[0] == "title: <x>" and "1 mm" in str(summary) and "A warning." in str(summary)
    page = summary._repr_html_()
    assert "&lt;b&gt;" in page and "<b>a" not in page and "&lt;x&gt;" in page
    data = summary.as_json()
    assert data == {"title": "title: <x>", "sentences": ["A sentence.", "A warning."], "sizes": table.as_json()}
    assert Summary.from_json(json.loads(json.dumps(data))).as_json() == data
    infinite = SummaryTable.of("t", ("a",), [("",)], [{"a": np.float64("nan"), "b": np.array([1.0, np.inf])}])
    assert infinite.as_json() == [{"a": None, "b": [1.0, None]}]
    with pytest.raises(ValueError, match="not the summary"):
        Summary.from_json({"title": "x", "sentences": 3})


def test_a_run_says_what_it_is(tmp_path):
    run = edhas.simulate(BENCH, edhas.Simulation(duration=0.35, step=1e-4, sample_rate=2000.0), frequency="12 Hz")
    assert edhas.get(run.machine, "frequency") == 12.0
    assert len(repr(run)) < 120 and "actuator_bench" in repr(run)
    assert "rms_current" in str(run.summary()) and "<table" in run._repr_html_()
    assert str(run.status) == f"{run.status}" == "ok" and str(Status.STEP_TOO_LARGE) == "step_too_large"
    again = edhas.open_result(run.save(tmp_path / "run", figure=False))
    assert again.summary().as_json()["metrics"] == run.summary().as_json()["metrics"]


def test_a_notebook_draws_the_figure_of_a_run():
    """IPython asks the last value of a cell for its picture; without `pyplot` a figure of matplotlib has none."""
    run = edhas.simulate(BENCH, edhas.Simulation(duration=0.35, step=1e-4, sample_rate=2000.0))
    figure = run.plot()
    assert isinstance(figure, matplotlib.figure.Figure)
    picture = plt.imread(io.BytesIO(figure._repr_png_()), format="png")
    width, height = figure.get_size_inches() * figure.dpi
    assert picture.shape[:2] == pytest.approx((height, width), abs=1) and picture[..., :3].std() > 0.05


def test_a_campaign_and_its_runs_fit_a_line():
    campaign = edhas.read_campaign(FOLDER / "campaign")
    text = repr(campaign)
    assert len(text) < 120 and "demo_bench" in text and "pump_bench" in text and "4 runs (3 fit, 1 holdout)" in text
    text = repr(campaign.runs[-1])
    assert len(text) < 120 and "run8, holdout, 1,201 samples" in text and "outlet_pressure" in text


def test_sizing_in_plain_python(tmp_path):
    """The same task as a file: the same design; the folder opens again, and its task can be run."""
    arguments = {
        "free": {"coil_resistance": (1.0, "2 ohm")}, "maximise": ["amplitude_ratio"],
        "constraints": {"rms_current": {"max": 4.0}}, "points": {"frequency": [10.0, 14.0]}, "starts": 2,
        "iterations": 5,
    }  # fmt: skip
    sized = edhas.size(BENCH, **arguments)
    assert 1.0 <= sized.best.design["coil_resistance"] <= 2.0 and len(repr(sized)) < 250
    text = str(sized.summary())
    assert "coil_resistance" in text and "limited by" in text and sized.plot().axes
    folder = sized.save(tmp_path / "sized")
    saved = edhas.open_result(folder)
    assert isinstance(saved, SavedResult) and saved.task == "size" and "edhas_jax" in saved.made_by
    assert saved.summary().sentences == sized.summary().sentences
    assert edhas.get(saved.machine, "coil_resistance") == pytest.approx(sized.best.design["coil_resistance"])
    assert saved.numbers["machines"][0]["design"] == sized.best.design and len(saved.pictures) == 1
    assert set(saved.table("path")) >= {"iteration", "coil_resistance"}
    with pytest.raises(ResultFileError, match="no table paths; there are: path"):
        saved.table("paths")
    again = load_sizing(folder / "sizing.yaml")
    assert again.variables == sized.task.variables and again.constraints == sized.task.constraints
    with pytest.raises(ResultFileError, match="exists already"):
        sized.save(folder)
    with pytest.raises(ValueError, match="no front"):
        sized.plot_front()


def test_a_wrong_task_lists_every_problem():
    with pytest.raises(ConfigError) as refused:
        edhas.size(BENCH, free={"coil_resistence": (1.0, 2.0)}, maximise=["flow"], constraints={"rms_current": "4 A"})
    message = str(refused.value)
    assert "free.coil_resistence" in message and "objective.maximise.flow" in message
    assert "constraints.rms_current" in message


def test_sensitivity_in_plain_python(tmp_path):
    found = edhas.sensitivity(BENCH, ["rms_current"], ["coil_resistance", "mover_mass"], {"frequency": [10, "20 Hz"]})
    assert len(found.points) == 2 and found.task.local == ("coil_resistance", "mover_mass")
    assert "mover_mass" in str(found.summary()) and found.plot().axes
    with pytest.raises(ValueError, match="no Sobol"):
        found.plot_sobol()
    saved = edhas.open_result(found.save(tmp_path / "s"))
    assert len(saved.table("local")) == 4 and saved.task == "sensitivity"
    assert saved.summary().tables["largest_elasticities"].as_json() == found.summary().as_json()["largest_elasticities"]


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaigns") / "bench"
    write_campaign(measured(empty_campaign(lengths=(201, 201, 201)), bench()), folder)
    return folder


def test_compare_and_fit_save_and_open(campaign, tmp_path):
    compared = edhas.compare(campaign)
    assert edhas.find_patterns(compared) == compared.patterns and compared.plot().axes
    saved = edhas.open_result(compared.save(tmp_path / "compared"))
    assert saved.report.stat().st_size > 10_000 and saved.summary().sentences == compared.summary().sentences
    with pytest.raises(ValueError, match="no signal"):
        compared.plot_signal("flow")

    kept = []
    fitted = edhas.fit(campaign, starts=1, keep=kept.append)
    assert len(kept) == 1 and kept[0].drift is None and fitted.drift is not None
    assert "residual over noise" in str(fitted.summary()) and len(repr(fitted)) < 200
    saved = edhas.open_result(fitted.save(tmp_path / "fit"))
    name = fitted.fit.problem.unknowns[0].name
    assert saved.numbers["calibrated"][name]["value"] == pytest.approx(fitted.fit.values[name])
    assert saved.numbers["converged"] is True
    assert edhas.get(saved.machine, name) == pytest.approx(fitted.fit.values[name])


def test_what_is_no_result_is_refused(tmp_path):
    with pytest.raises(ResultFileError, match="no such folder"):
        edhas.open_result(tmp_path / "nothing")
    with pytest.raises(ResultFileError, match="holds no result"):
        edhas.open_result(tmp_path)
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(ResultFileError, match="unreadable"):
        edhas.open_result(tmp_path)
