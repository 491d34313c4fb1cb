"""Diagnose: calibrate and search for missing effects as jobs; suspects as cards that one tries, adds or rejects."""

import time
from typing import Any

from nicegui import ui

from edhas_jax.core.units import format_quantity, format_with_error
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.interface.slots import SLOTS
from edhas_jax.machine.rigs import RIGS
from edhas_jax.workbench.figures import waterfall_figure
from edhas_jax.workbench.jobs import CANCELLED, DONE, FAILED, RUNNING, Job
from edhas_jax.workbench.views.law_curve import show_law_curve
from edhas_jax.workbench.views.matrix import error_matrix
from edhas_jax.workbench.workspace import DIAGNOSED, effect_id

VERDICTS = {
    "adequate": "Nothing is missing that these runs show.",
    "missing_effect": "Missing in the model:",
    "ambiguous": "Missing in the model, but another effect explains the runs nearly as well:",
    "unknown_effect": "Something is missing that no effect of the library explains.",
}
JOB_TITLES = "calibrate", "diagnose"
MAX_CARDS, MAX_REPORTS = 12, 14
KINDS = {kind.id: kind for kind in LIBRARY}


class DiagnoseView:
    """Jobs, verdict, waterfall, suspects, what was tried."""

    def __init__(self, page):
        self._page = page
        self._shown_job: tuple | None = None

    async def build(self) -> None:
        """Build the view."""
        with ui.row().classes("items-center gap-3"):
            ui.button("Calibrate", on_click=self._calibrate).props("no-caps unelevated icon=straighten")
            ui.button("Diagnose", on_click=self._diagnose).props("no-caps unelevated icon=troubleshoot")
            ui.label("in a process of its own; it goes on when this page is closed").classes("wb-quiet gt-xs")
        self._job = ui.column().classes("w-full gap-1 mt-2").props("data-mark=job")
        with ui.element("div").classes("wb-two mt-3"):
            self._verdict = ui.column().classes("gap-2 w-full")
            with ui.column().classes("gap-0 w-full"):
                ui.label("Residual over noise after each stage").classes("wb-h")
                self._waterfall = ui.plotly({"data": [], "layout": {"height": 200}}).classes("w-full")
                self._waterfall.props("data-mark=waterfall")
        ui.label("Suspects").classes("wb-h mt-4")
        with ui.row().classes("items-end gap-3"):
            self._effect = ui.select({}, label="any effect of the library", with_input=True).classes("min-w-64")
            self._effect.props("dense options-dense outlined")
            ui.button("Try it", on_click=lambda: self._try(self._effect.value)).props("no-caps flat dense icon=science")
            self._own = ui.input("an effect of your own, FILE.py:Class").props("dense outlined").classes("min-w-64")
            ui.button("Try it", on_click=self._try_own).props("no-caps flat dense icon=science")
        self._cards = ui.element("div").classes("wb-cards mt-3")
        self._tried = ui.column().classes("w-full gap-1 mt-4")
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder."""
        self.show_progress()
        self._draw_waterfall()
        self._build_verdict()
        self._build_cards()
        self._build_tried()

    async def redraw(self) -> None:
        """Draw the plot again, in the colours of the page."""
        self._draw_waterfall()

    def show_progress(self) -> None:
        """Show the last job with what it has reported."""
        jobs = [job for job in self._page.session.jobs.all() if job.title in JOB_TITLES]
        if not jobs:
            return
        job = jobs[-1]
        rows = self._page.session.jobs.progress(job)
        shown = job.number, job.status, len(rows), int(job.seconds) if job.status == RUNNING else 0
        if shown == self._shown_job:
            return
        self._shown_job = shown
        self._job.clear()
        with self._job:
            self._build_job(job, rows)

    def _build_job(self, job: Job, rows: list[dict[str, Any]]) -> None:
        names = {RUNNING: "runs", DONE: "is done", FAILED: "has failed", CANCELLED: "was cancelled; finished parts are kept"}
        with ui.row().classes("items-center gap-3"):
            if job.status == RUNNING:
                ui.spinner(size="sm")
            what = f"“{job.title}” {names[job.status]} · {job.seconds:.0f} s"
            ui.label(what).props(f"data-mark=job-{job.status}")
            if job.status == RUNNING:
                ui.button("Cancel", on_click=lambda: self._page.session.jobs.cancel(job)).props("no-caps flat dense")
            elif job.status == CANCELLED:
                again = self._calibrate if job.title == "calibrate" else self._diagnose
                ui.button("Resume", on_click=again).props("no-caps flat dense icon=play_arrow")
        if rows and job.status in (RUNNING, CANCELLED):
            if "share" in rows[-1]:
                ui.linear_progress(rows[-1]["share"], show_value=False).classes("w-full")
            with ui.element("div").classes("wb-log"):
                for row in reversed(rows[-MAX_REPORTS:]):
                    ui.label(f"{max(row.get('at', 0.0) - job.began, 0.0):5.0f} s   {row['what']}")
        if job.status == FAILED:
            ui.label(self._page.session.jobs.output(job)[-3000:]).classes("wb-block")
        elif job.status == DONE:
            with ui.expansion("what the command printed").classes("w-full wb-quiet").props("dense"):
                ui.label(self._page.session.jobs.output(job)).classes("wb-block")

    def _calibrate(self) -> None:
        self._start(self._page.session.calibrate)

    def _diagnose(self) -> None:
        self._start(self._page.session.diagnose)

    def _start(self, start) -> None:
        if self._page.summary is None:
            self._page.tell("\n".join(self._page.problems) or "There is no campaign in this folder yet: bring data first.")
            return
        self._page.attempt(start)
        self._page.show_state()
        self.show_progress()

    def _draw_waterfall(self) -> None:
        stages = self._page.stages()
        diagnosis = self._page.workspace.result(DIAGNOSED)
        if diagnosis is not None and diagnosis.get("effects"):
            after = {use: row.get("overall") for use, row in diagnosis["error"]["after"].items()}
            stages["diagnosed: " + " + ".join(diagnosis["effects"])] = after
        self._waterfall.set_visibility(bool(stages))
        if stages:
            self._waterfall.update_figure(waterfall_figure(stages, self._page.dark))

    def _build_verdict(self) -> None:
        diagnosis = self._page.workspace.result(DIAGNOSED)
        self._verdict.clear()
        with self._verdict:
            ui.label("Verdict").classes("wb-h")
            if diagnosis is None:
                ui.label("A diagnosis has not been made yet. It calibrates the model, tries what the library has, and says "
                         "what is missing, where, and how certain that is.").classes("wb-quiet")  # fmt: skip
                return
            verdict = diagnosis["verdict"]
            box = ui.column().classes("gap-1 wb-verdict" + (" fine" if verdict == "adequate" else ""))
            with box.props("data-mark=verdict"):
                ui.label(VERDICTS.get(verdict, verdict))
                for row in diagnosis["candidates"]:
                    if row["accepted"]:
                        ui.label(f"{_name(row)}: {_sizes(row['parameters'])}").classes("font-semibold")
            errors = diagnosis["error"]
            use = "holdout" if errors["after"]["holdout"] else "fit"
            values = [errors[state][use]["overall"] for state in ("before", "calibrated", "after")]
            runs = "runs not used" if use == "holdout" else "runs used"
            ui.label(f"Residual over noise on the {runs}: {values[0]:.2f} as given, {values[1]:.2f} calibrated, "
                     f"{values[2]:.2f} with what was found.")  # fmt: skip
            members = [name for name in diagnosis["answer"]["set"]]
            if len(members) > 1:
                p = diagnosis["answer"]["probabilities"]
                ui.label("Not ruled out: " + ", ".join(f"{m} {p.get(m, 0.0):.2f}" for m in members))
            for key in ("holdout_split",):
                if diagnosis.get(key):
                    ui.label(diagnosis[key]).classes("wb-quiet")

    def _build_cards(self) -> None:
        diagnosis, workspace = self._page.workspace.result(DIAGNOSED) or {}, self._page.workspace
        decisions, summary = workspace.decisions(), self._page.summary
        rows = {_name(row): row for row in diagnosis.get("candidates", [])[:MAX_CARDS]}
        for name in (*decisions.added, *decisions.rejected, *self._tried_alone()):
            rows.setdefault(name, {"effect": name})
        if summary is not None:
            rig = RIGS[summary["rig"]]
            free = [k.id for k in LIBRARY if set(k.slots) <= set(rig.slots) and k.id not in summary["effects"]]
            self._effect.set_options({name: name.replace("_", " ") for name in free}, value=self._effect.value)
        self._cards.clear()
        with self._cards:
            for name, row in rows.items():
                self._card(name, row, decisions)
            if not rows:
                ui.label("None yet: diagnose, or try any effect.").classes("wb-quiet")

    def _tried_alone(self) -> list[str]:
        """The names of effects that were tried in addition to those that are in the model."""
        added = set(self._page.workspace.decisions().added)
        return [data["named"][-1] for data in self._page.workspace.tried().values() if data["named"][-1] not in added]

    def _card(self, name: str, row: dict[str, Any], decisions) -> None:
        kind = KINDS.get(row["effect"])
        is_sensor = bool(row.get("signal"))
        with ui.card().classes("wb-card").props(f"data-mark='card-{name.replace(chr(39), '')}'"):
            with ui.row().classes("items-center w-full no-wrap"):
                ui.label(name.replace("_", " ")).classes("font-semibold")
                ui.space()
                if name in decisions.added:
                    ui.label("in the model").classes("wb-chip wb-good")
                elif name in decisions.rejected:
                    ui.label("rejected").classes("wb-chip wb-bad")
                elif row.get("probability") is not None:
                    ui.label(f"probability {row['probability']:.2f}").classes("wb-chip")
            place = "sensor" if is_sensor else row.get("slot") or (kind.slots[0].location if kind else "")
            summary = f"a fault of the sensor of {row['signal'].replace('_', ' ')}" if is_sensor else _summary(kind)
            ui.label(f"{place.replace('_', ' ')} · {summary}" if place else summary).classes("wb-quiet")
            if row.get("parameters"):
                ui.label(_sizes(row["parameters"]))
            evidence = []
            if row.get("gain") is not None:
                evidence.append(f"evidence {row['gain']:+.0f} nats")
            if row.get("holdout_error") is not None:
                evidence.append(f"residual over noise with it {row['holdout_error']:.2f} on runs not used")
            if evidence:
                ui.label("; ".join(evidence))
            if kind is not None and kind.looks_like:
                ui.label(f"Looks like: {kind.looks_like}").classes("wb-quiet")
            if name in decisions.rejected:
                ui.label(f"Rejected: {decisions.rejected[name]}")
            self._tried_matrix(name, decisions)
            self._buttons(name, is_sensor, decisions)

    def _tried_matrix(self, name: str, decisions) -> None:
        """What falls where, if the effect was tried on the present model."""
        found = self._page.workspace.tried().get(self._chain_name(name, decisions))
        if found is None or self._page.summary is None:
            return
        old, new = found["before"]["error"], found["error"]
        for use, title in (("fit", "runs used"), ("holdout", "runs not used")):
            if new.get(use) is not None:
                ui.label(f"{title}: {old[use]:.2f} → {new[use]:.2f}").classes("font-semibold").props(f"data-mark=tried-{use}")
        ui.label(_sizes(found["parameters"])).classes("wb-quiet")
        notes = {run: "not used" if row["use"] == "holdout" else "used" for run, row in self._page.summary["runs"].items()}
        with ui.expansion("what falls where").classes("w-full").props("dense"):
            error_matrix(found["error_by_run"], list(self._page.summary["signals"]), notes,
                         before=found["before"]["error_by_run"])  # fmt: skip

    def _buttons(self, name: str, is_sensor: bool, decisions) -> None:
        with ui.row().classes("gap-1 mt-auto"):
            if is_sensor:
                ui.label("Not a part of the machine: correct the sensor or its column.").classes("wb-quiet")
            elif name in decisions.added:
                ui.button("Take out", on_click=lambda: self._change(self._page.session.remove, name)).props("no-caps flat dense")
                ui.button("Compare", on_click=lambda: self._compare(name)).props("no-caps flat dense icon=show_chart")
            else:
                ui.button("Try", on_click=lambda: self._try(name)).props("no-caps flat dense icon=science")
                ui.button("Add", on_click=lambda: self._add(name)).props("no-caps flat dense icon=add")
            tried = self._page.workspace.tried().get(self._chain_name(name, decisions))
            if tried is not None and not is_sensor:
                ui.button("Law", on_click=lambda: show_law_curve(self._page, tried["named"])).props("no-caps flat dense")
            if name in decisions.rejected:
                ui.button("Reconsider", on_click=lambda: self._change(self._page.session.reconsider, name)).props("no-caps flat dense")
            elif name not in decisions.added:
                ui.button("Reject", on_click=lambda: self._ask_reason(name)).props("no-caps flat dense icon=block")

    def _build_tried(self) -> None:
        """The models that were tried, side by side."""
        rows = self._page.workspace.tried()
        self._tried.clear()
        if not rows:
            return
        with self._tried:
            ui.label("What was tried, side by side").classes("wb-h")
            heads = "model", "runs used", "runs not used", "sizes"
            with ui.element("div").classes("wb-scroll"), ui.element("table").classes("wb-table"):
                with ui.element("tr"):
                    for head in heads:
                        with ui.element("th").classes("n" if head.startswith("runs") else ""):
                            ui.label(head)
                best = sorted(rows.items(), key=lambda item: item[1]["error"].get("holdout") or item[1]["error"]["fit"])
                for name, row in best:
                    with ui.element("tr"):
                        texts = [name.replace("_", " "), *(_error(row["error"].get(u)) for u in ("fit", "holdout")), _sizes(row["parameters"])]
                        for head, text in zip(heads, texts, strict=True):
                            with ui.element("td").classes("n" if head.startswith("runs") else ""):
                                ui.label(text)

    def _chain(self, name: str, decisions) -> list[str]:
        added = [n for n in decisions.added if n != name]
        if name in decisions.added:
            added = list(decisions.added[: decisions.added.index(name)])
        return [*added, name]

    def _chain_name(self, name: str, decisions) -> str:
        return "+".join(map(effect_id, self._chain(name, decisions)))

    async def _try(self, name: str | None) -> bool:
        """Fit the model with one more effect; whether that was possible."""
        if not name:
            self._page.tell("Choose an effect first.")
            return False
        if self._page.summary is None:
            self._page.tell("There is no campaign in this folder yet: bring data first.")
            return False
        chain = self._chain(name, self._page.workspace.decisions())
        began = time.perf_counter()
        found = await self._page.ask("campaign.try_effects", chain)
        if found is None:
            return False
        session = self._page.session
        self._page.did(f"try {name}", session.command_try(chain), session.python_try(chain))
        ui.notify(f"{name.replace('_', ' ')} tried in {time.perf_counter() - began:.1f} s")
        await self.refresh()
        return True

    async def _add(self, name: str) -> None:
        decisions = self._page.workspace.decisions()
        if self._chain_name(name, decisions) not in self._page.workspace.tried() and not await self._try(name):
            return
        await self._change(self._page.session.add, name)

    async def _change(self, change, *arguments) -> None:
        self._page.attempt(lambda: change(*arguments))
        self._page.show_state()
        await self.refresh()

    async def _compare(self, name: str) -> None:
        model = f"with {self._chain_name(name, self._page.workspace.decisions())}"
        self._page.show_tab("Compare")
        await self._page.view("Compare").show(model)

    def _ask_reason(self, name: str) -> None:
        with ui.dialog() as dialog, ui.card():
            ui.label(f"Why is it not {name.replace('_', ' ')}?").classes("font-semibold")
            reason = ui.input("reason, which is remembered").classes("w-80")

            async def reject() -> None:
                dialog.close()
                await self._change(self._page.session.reject, name, reason.value.strip() or "no reason given")

            with ui.row():
                ui.button("Reject", on_click=reject).props("no-caps unelevated")
                ui.button("Keep", on_click=dialog.close).props("no-caps flat")
        dialog.on("hide", dialog.delete)
        dialog.open()

    def _try_own(self) -> None:
        """Ask before code of a file runs; the click names the file."""
        spec = (self._own.value or "").strip()
        source, colon, name = spec.rpartition(":")
        if not colon or not source.endswith(".py") or not name.isidentifier():
            self._page.tell("Write the file and the class of the effect, such as my_effects.py:SealDrag; slots: " + ", ".join(SLOTS))
            return
        path = self._page.attempt(lambda: self._page.workspace.inside(source))
        if path is None:
            return
        if not path.is_file():
            self._page.tell(f"{source}: no such file in {self._page.workspace.folder.name}")
            return
        with ui.dialog() as dialog, ui.card():
            ui.label(f"{source} is Python code that will run on this computer.").classes("font-semibold")
            ui.label("Read it first. It may run until the workbench ends.").classes("wb-quiet")

            async def run() -> None:
                dialog.close()
                self._page.attempt(lambda: self._page.session.allow(spec))
                await self._try(f"{path}:{name}")

            with ui.row():
                ui.button(f"Run {source}", on_click=run).props("no-caps unelevated")
                ui.button("Do not run it", on_click=dialog.close).props("no-caps flat")
        dialog.on("hide", dialog.delete)
        dialog.open()


def _name(row: dict[str, Any]) -> str:
    return f"{row['effect']} on {row['signal']}" if row.get("signal") else str(row["effect"])


def _summary(kind) -> str:
    return "" if kind is None else (kind.__doc__ or "").strip().splitlines()[0]


def _error(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _sizes(parameters: dict[str, Any]) -> str:
    """Sizes with their standard errors."""
    parts = []
    for name, row in parameters.items():
        value, std, unit = row["value"], row.get("std"), row["unit"]
        text = format_quantity(value, unit) if std is None else format_with_error(value, std, unit)
        parts.append(f"{name.rpartition('.')[2].replace('_', ' ')} {text}")
    return ", ".join(parts)
