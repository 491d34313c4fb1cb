"""Header, verdict and coloured machine are derived from one state of the model; tested without a browser."""

import json
import os
import time

import pytest

from edhas_jax.diagnosis.report.conclusions import Outcome
from edhas_jax.workbench.jobs import DONE, Job, JobList
from edhas_jax.workbench.standing import standing
from edhas_jax.workbench.workspace import CALIBRATED, DIAGNOSED, RESULT_FILES, Decisions, Workspace

CAMPAIGN = "name: bench\nrig: actuator_bench\nruns:\n  - {file: run1.csv, use: fit, frequency: 10 Hz}\n"
SAID = ["inverter_dead_time (dead_time_voltage 0.80 V) is missing.", "Residual over noise on held-out runs: …"]


def errors(*values):
    return {"fit": {"overall": values[0]}, "holdout": {"overall": values[1]}}


def candidate(effect, slot, outcome, probability, accepted):
    return {"effect": effect, "slot": slot, "outcome": outcome.value, "probability": probability, "accepted": accepted}


def diagnosis(**changes):
    """What a diagnosis writes that has named a dead time, and has accepted a drag that is probably nothing."""
    return {
        "verdict": "missing_effect", "conclusions": SAID, "effects": ["inverter_dead_time"], "groups": [],
        "candidates": [candidate("inverter_dead_time", "coil", Outcome.MISSING, 0.97, True),
                       candidate("eddy_drag", "mover", Outcome.TRIED, 0.25, True)],
        "where": [{"slot": "coil", "probability": 0.97}, {"slot": "mover", "probability": 0.25}],
        "error": {"before": errors(20.0, 21.0), "calibrated": errors(8.0, 7.7), "after": errors(1.01, 0.97)},
        "bench_corrected": True,
    } | changes  # fmt: skip


def tried(*effects, error=(1.01, 0.98), before=(8.0, 7.7), made_from=None):
    return {
        "effects": list(effects), "named": list(effects), "error": dict(zip(("fit", "holdout"), error, strict=True)),
        "before": {"error": dict(zip(("fit", "holdout"), before, strict=True)), "error_by_run": {}},
        "error_by_run": {}, "bench_corrected": True, "made_from": made_from or {},
        "parameters": {f"{effects[-1]}.size": {"value": 0.8015, "std": 0.0028, "unit": "V"}},
    }  # fmt: skip


@pytest.fixture
def workspace(tmp_path):
    (tmp_path / "campaign.yaml").write_text(CAMPAIGN)
    (tmp_path / "run1.csv").write_text("time [s],current [A]\n0,1\n")
    return Workspace(tmp_path)


def write(workspace, name, data):
    path = workspace.results / name / RESULT_FILES[name]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(data))
    return path


def now(workspace):
    return standing(workspace, JobList(workspace))


def test_before_any_result_there_is_nothing_to_say(workspace):
    found = now(workspace)
    assert (found.stages, found.verdict, dict(found.where), found.changed) == ({}, (), {}, ())


def test_the_verdict_of_a_diagnosis_is_what_its_file_says(workspace):
    write(workspace, DIAGNOSED, diagnosis())
    found = now(workspace)
    assert list(found.verdict) == SAID and not found.is_fine and not found.before
    assert found.where == {"coil": 0.97, "mover": 0.25}
    assert [found.judged(stage) for stage in found.stages] == [21.0, 7.7, 0.97]
    assert found.corrected == {"calibrated", "diagnosed"}


def test_every_stage_has_its_model_where_there_is_one(workspace):
    assert now(workspace).models == {"as given": "as given"}
    folder = write(workspace, DIAGNOSED, diagnosis()).parent
    for name in ("config.yaml", "config_calibrated.yaml"):
        (folder / name).write_text("rig: actuator_bench\n")
    stages = {"as given": "as given", "calibrated": "calibrated by the diagnosis", "diagnosed": "diagnosed"}
    assert now(workspace).models == now(workspace).last_models == stages
    for effects in (["a_drag"], ["a_drag", "a_lag"]):
        workspace.save_tried("+".join(effects), tried(*effects))
        (workspace.results / "tried" / f"{'+'.join(effects)}.yaml").write_text("rig: actuator_bench\n")
    workspace.decide(Decisions(("a_drag", "a_lag")))
    of_added = {"+ a_drag": "with a_drag", "+ a_lag": "with a_drag+a_lag"}
    assert now(workspace).models == {n: stages[n] for n in ("as given", "calibrated")} | of_added
    assert list(now(workspace).last_models) == ["as given", "calibrated", "+ a_lag"]


def test_a_calibration_alone_has_no_correction_of_the_bench(workspace):
    write(workspace, CALIBRATED, {"error": {"before": errors(20.0, 21.0), "calibrated": errors(10.5, 9.99)}})
    found = now(workspace)
    assert found.judged("calibrated") == 9.99 and not found.corrected


def test_after_adding_header_verdict_and_machine_follow_together(workspace):
    write(workspace, DIAGNOSED, diagnosis())
    workspace.save_tried("inverter_dead_time", tried("inverter_dead_time"))
    workspace.decide(Decisions(added=("inverter_dead_time",)))
    found = now(workspace)
    assert list(found.stages) == ["as given", "calibrated", "+ inverter_dead_time"]
    assert found.verdict == (
        "inverter_dead_time (size 0.8015 ± 0.0028 V) is in the model. "
        "Nothing else is missing that the diagnosis has named.",
        "Residual over noise on the runs not used: 7.70 calibrated, 0.98 now.",
    )
    assert found.is_fine and found.where == {} and list(found.before) == SAID
    workspace.decide(Decisions())
    assert list(now(workspace).verdict) == SAID and now(workspace).where == {"coil": 0.97, "mover": 0.25}


def test_what_is_still_missing_stays_coloured_and_what_is_left_is_said(workspace):
    both = ["inverter_dead_time", "eddy_drag"]
    write(workspace, DIAGNOSED, diagnosis(effects=both))
    workspace.save_tried("inverter_dead_time", tried("inverter_dead_time", error=(3.0, 3.3)))
    workspace.decide(Decisions(added=("inverter_dead_time",)))
    found = now(workspace)
    assert "eddy_drag is still missing." in found.verdict[0] and not found.is_fine
    assert found.where == {"mover": 0.25} and found.verdict[-1] == "3.3 times the noise is still left."


def test_a_rival_that_the_runs_do_not_distinguish_answers_too(workspace):
    write(workspace, DIAGNOSED, diagnosis(verdict="ambiguous", groups=[["inverter_dead_time", "supply_sag"]]))
    workspace.save_tried("supply_sag", tried("supply_sag"))
    workspace.decide(Decisions(added=("supply_sag",)))
    assert now(workspace).is_fine and now(workspace).where == {}


def test_an_unknown_cause_stays_unknown_after_adding(workspace):
    write(workspace, DIAGNOSED, diagnosis(verdict="unknown_effect", effects=[]))
    workspace.save_tried("supply_sag", tried("supply_sag", error=(4.0, 4.0)))
    workspace.decide(Decisions(added=("supply_sag",)))
    assert not now(workspace).is_fine and now(workspace).where == {"coil": 0.97, "mover": 0.25}


@pytest.mark.parametrize("file", ["campaign.yaml", "run1.csv"])
def test_a_result_of_a_job_knows_what_it_was_made_from(workspace, file):
    path = write(workspace, DIAGNOSED, diagnosis())
    written = path.stat().st_mtime
    job = Job(1, "diagnose", (), written - 5.0, ended=written + 1.0, status=DONE, inputs=workspace.inputs())
    assert set(job.inputs) == {"campaign.yaml", "run1.csv"}
    jobs = only(job)
    os.utime(workspace.folder / file, (written + 9.0, written + 9.0))  # written again, with the same content
    assert not standing(workspace, jobs).changed
    content = (workspace.folder / file).read_text()
    (workspace.folder / file).write_text(content + "\n# more\n")
    assert standing(workspace, jobs).changed == (f"The diagnosis was made before {file} changed: diagnose again.",)
    (workspace.folder / file).write_text(content)
    assert not standing(workspace, jobs).changed


def only(job):
    """A list of jobs with one job."""

    class Jobs:
        def last(self, title):
            return job if job.title == title else None

        def running(self):
            return None

    return Jobs()


def test_a_result_of_a_terminal_is_older_than_what_was_written_later(workspace):
    path = write(workspace, CALIBRATED, {"error": {}})
    os.utime(path, (time.time() + 5.0,) * 2)
    assert not now(workspace).changed
    os.utime(path, (time.time() - 60.0,) * 2)
    assert now(workspace).changed == (
        "The calibration was made before campaign.yaml and 1 more of its files changed: calibrate again.",
    )


def test_an_effect_that_was_tried_on_other_inputs_says_so(workspace):
    workspace.save_tried("eddy_drag", tried("eddy_drag", made_from=workspace.inputs()))
    workspace.decide(Decisions(added=("eddy_drag",)))
    assert not now(workspace).changed
    workspace.campaign_file.write_text(CAMPAIGN.replace("10 Hz", "12 Hz"))
    assert now(workspace).changed == (
        "The model with eddy_drag was fitted before campaign.yaml changed: try it again.",
    )


def test_where_no_run_is_held_out_a_trial_is_judged_beside_a_calibration_of_the_same_samples(workspace):
    write(workspace, DIAGNOSED, diagnosis(verdict="unknown_effect", effects=[]))  # it has held out a part of each run
    of_all = {stage: {"fit": {"overall": value}} for stage, value in (("before", 25.0), ("calibrated", 11.0))}
    write(workspace, CALIBRATED, {"error": of_all})
    workspace.save_tried("supply_sag", tried("supply_sag", error=(1.7, None), before=(10.9, None)))
    workspace.decide(Decisions(added=("supply_sag",)))
    found = now(workspace)
    assert found.use == "fit" and [found.judged(stage) for stage in found.stages] == [25.0, 11.0, 1.7]
    assert "Residual over noise on the runs used: 11.00 calibrated, 1.70 now." in found.verdict
    assert found.corrected == {"+ supply_sag"}
