"""Where the model of a campaign stands: one state, from which header, verdict and coloured machine follow.

It is derived from the results in the folder and from what the engineer has decided, so that no two places of the page
can say different things.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

from edhas_jax.core.units import estimate_text
from edhas_jax.diagnosis.search.finished_stage import read_stages
from edhas_jax.inference.fit.evaluated_fit import MUCH_LEFT
from edhas_jax.workbench.jobs import DONE, JobList
from edhas_jax.workbench.workspace import AS_GIVEN, CALIBRATED, CALIBRATED_FIRST, DIAGNOSED, Workspace, effect_id

TITLES = {CALIBRATED: ("calibrate", "calibration"), DIAGNOSED: ("diagnose", "diagnosis")}
USES = {"holdout": "runs not used", "fit": "runs used"}
OLD = "This diagnosis was made by an earlier version; diagnose again to read its verdict."


@dataclasses.dataclass(frozen=True)
class Standing:
    """Where the model of a campaign stands.

    Attributes:
        stages: residual over noise by stage and use of the runs: as given, calibrated, after what was found or added.
        verdict: sentences, the most important first; empty before a diagnosis.
        before: what the diagnosis has said of the model before effects were added; empty where none was added.
        is_fine: whether nothing that was found is missing in the model any more.
        where: probability by part of the machine that something is missing there.
        corrected: stages whose residuals are those after correction of what the bench did.
        changed: a sentence on each result that was made from other inputs than those that are in the folder.
        models: name of the model in `Workspace.models` by stage, of the stages whose model is in the folder.
        growing: residual over noise by stage and use as far as the search that runs has come; empty where none runs.
    """

    stages: Mapping[str, Mapping[str, float]]
    verdict: tuple[str, ...] = ()
    before: tuple[str, ...] = ()
    is_fine: bool = False
    where: Mapping[str, float] = dataclasses.field(default_factory=dict)
    corrected: frozenset[str] = frozenset()
    changed: tuple[str, ...] = ()
    models: Mapping[str, str] = dataclasses.field(default_factory=dict)
    growing: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)

    @property
    def last_models(self) -> dict[str, str]:
        """The models of the first stages, as given and calibrated, and that of the last stage."""
        names = list(self.models)
        return {name: self.models[name] for name in dict.fromkeys([*names[:2], *names[-1:]])}

    def judged(self, stage: str) -> float | None:
        """Residual over noise of a stage on the runs that were not used; on those used where there are no others."""
        row = self.stages.get(stage, {})
        return row.get("fit") if row.get("holdout") is None else row["holdout"]

    @property
    def use(self) -> str:
        """The use of the runs by which all stages are judged, "holdout" or "fit"."""
        return "holdout" if any(row.get("holdout") is not None for row in self.stages.values()) else "fit"


def standing(workspace: Workspace, jobs: JobList) -> Standing:
    """The present state of a workspace.

    Args:
        workspace: the folder.
        jobs: its jobs, which know from what they were made.
    """
    diagnosis, fit = workspace.result(DIAGNOSED), workspace.result(CALIBRATED)
    added, tried = workspace.decisions().added, workspace.tried()
    chain = [tried[name] for name in _chain_names(added) if name in tried]
    stages, corrected = _stages(diagnosis, fit, chain)
    found = Standing(
        stages, corrected=corrected, changed=tuple(_changed(workspace, jobs, chain)),
        models=_models(workspace, added, stages), growing=_growing(jobs, stages),
    )  # fmt: skip
    if diagnosis is None:
        return found
    said = tuple(diagnosis.get("conclusions") or [OLD])
    is_adequate = diagnosis.get("verdict") == "adequate"
    where = {} if is_adequate else {str(row["slot"]): float(row["probability"]) for row in diagnosis.get("where", [])}
    if not added:
        return dataclasses.replace(found, verdict=said, is_fine=is_adequate, where=where)
    found = dataclasses.replace(found, before=said)
    sizes = chain[-1]["parameters"] if chain else {}
    return dataclasses.replace(found, **_after_adding(diagnosis, found, [*map(effect_id, added)], sizes, where))


def is_of_present_inputs(workspace: Workspace, row: Mapping[str, Any]) -> bool:
    """Whether a model that was tried was fitted to the campaign as it is now."""
    return not row.get("made_from") or not workspace.changed_inputs(row["made_from"])


def sizes_text(parameters: Mapping[str, Any], effect: str = "") -> str:
    """Sizes (SI) with their standard errors as text: of one effect, or of all."""
    return ", ".join(
        f"{name.rpartition('.')[2]} {estimate_text(row['value'], row.get('std'), row['unit'], row.get('limit'))}"
        for name, row in parameters.items()
        if not effect or name.startswith(f"{effect}.")
    )


def _chain_names(added: tuple[str, ...]) -> list[str]:
    """The names of the models after each effect that was added."""
    return ["+".join(map(effect_id, added[: k + 1])) for k in range(len(added))]


def _stages(
    diagnosis: Mapping[str, Any] | None, fit: Mapping[str, Any] | None, chain: list[dict[str, Any]]
) -> tuple[dict[str, dict[str, float]], frozenset[str]]:
    """Residual over noise by stage and use, and the stages in which the bench is corrected.

    Without a run that is held out, a diagnosis holds out a part of each, but a trial fits all of it: then only the
    calibration, which does so too, has errors to set beside those of trials.
    """
    if chain and chain[-1]["error"].get("holdout") is None:
        diagnosis = None
    errors = (diagnosis or fit or {}).get("error", {})
    rows = {AS_GIVEN: errors.get("before"), "calibrated": errors.get("calibrated")}
    stages = {name: {use: v.get("overall") for use, v in row.items()} for name, row in rows.items() if row}
    corrected = {"calibrated"} if (diagnosis or {}).get("bench_corrected") else set()
    if chain and "calibrated" not in stages:
        stages["calibrated"] = chain[0]["before"]["error"]
        corrected |= {"calibrated"} if chain[0]["before"].get("bench_corrected") else set()
    for row in chain:
        name = f"+ {row['effects'][-1]}"
        stages[name] = row["error"]
        corrected |= {name} if row.get("bench_corrected") else set()
    if not chain and diagnosis is not None and any(c.get("accepted") for c in diagnosis.get("candidates", [])):
        stages[DIAGNOSED] = {use: v.get("overall") for use, v in errors.get("after", {}).items()}
        corrected |= {DIAGNOSED} if diagnosis.get("bench_corrected") else set()
    return stages, frozenset(corrected)


def _models(workspace: Workspace, added: tuple[str, ...], stages: Mapping[str, Any]) -> dict[str, str]:
    """The names of the models by stage; the model as given is there before its errors are."""
    there = workspace.models() if workspace.has_campaign else {}
    of_stages = {AS_GIVEN: AS_GIVEN, CALIBRATED: CALIBRATED_FIRST if CALIBRATED_FIRST in there else CALIBRATED}
    if added:
        of_stages |= {f"+ {effect_id(n)}": f"with {m}" for n, m in zip(added, _chain_names(added), strict=True)}
    elif DIAGNOSED in stages:
        of_stages[DIAGNOSED] = DIAGNOSED
    return {stage: model for stage, model in of_stages.items() if model in there}


def _growing(jobs: JobList, stages: Mapping[str, Mapping[str, float]]) -> dict[str, Mapping[str, float]]:
    """The stages of a diagnosis that runs, after the model as given where its error is known."""
    job = jobs.running()
    if job is None or job.title != TITLES[DIAGNOSED][0]:
        return {}
    return {n: row for n, row in stages.items() if n == AS_GIVEN} | read_stages(r["what"] for r in jobs.progress(job))


def _after_adding(
    diagnosis: Mapping[str, Any], found: Standing, added: list[str], sizes: Mapping[str, Any],
    where: Mapping[str, float],
) -> dict[str, Any]:  # fmt: skip
    """Verdict, whether it is fine, and where something is still missing, once effects are in the model."""
    answered = {effect for group in diagnosis.get("groups", []) if set(group) & set(added) for effect in group}
    answered |= set(added)
    named = [str(effect) for effect in diagnosis.get("effects", [])]
    missing = [effect for effect in named if effect not in answered]
    is_named = diagnosis.get("verdict") in ("missing_effect", "ambiguous")
    error = found.judged(list(found.stages)[-1]) if found.stages else None
    names = [f"{name} ({text})" if (text := sizes_text(sizes, name)) else name for name in added]
    verdict = [f"{' and '.join(names)} {'is' if len(added) == 1 else 'are'} in the model."]
    if missing:
        verdict[0] += f" {' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} still missing."
    elif is_named:
        verdict[0] += " Nothing else is missing that the diagnosis has named."
    calibrated = found.judged("calibrated")
    if error is not None and calibrated is not None:
        verdict.append(f"Residual over noise on the {USES[found.use]}: {calibrated:.2f} calibrated, {error:.2f} now.")
    if error is not None and error > MUCH_LEFT:
        verdict.append(f"{error:.3g} times the noise is still left.")
    if is_named:
        slots = {c["slot"] for c in diagnosis.get("candidates", []) if c.get("effect") in missing}
        where = {part: p for part, p in where.items() if part in slots}
    is_fine = is_named and not missing and error is not None and error <= MUCH_LEFT
    return {"verdict": tuple(verdict), "is_fine": is_fine, "where": where}


def _changed(workspace: Workspace, jobs: JobList, chain: list[dict[str, Any]]) -> list[str]:
    """A sentence on each result that was made from other inputs."""
    out = []
    for name, (title, what) in TITLES.items():
        written = workspace.result_time(name)
        if written is None:
            continue
        job = jobs.last(title)
        of_job = job is not None and job.status == DONE and job.began <= written <= (job.ended or written)
        files = workspace.changed_inputs(job.inputs) if of_job and job.inputs else workspace.inputs_after(written)
        if files:
            out.append(f"The {what} was made before {_listed(files)} changed: {title} again.")
    for row in chain:
        files = workspace.changed_inputs(row.get("made_from") or {})
        if files:
            name = " and ".join(row["effects"])
            out.append(f"The model with {name} was fitted before {_listed(files)} changed: try it again.")
    return out


def _listed(files: list[str]) -> str:
    return files[0] if len(files) == 1 else f"{files[0]} and {len(files) - 1} more of its files"
