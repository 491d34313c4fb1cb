"""Comparison of models with a campaign, and trials of effects, for the page."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.machine_config import read_config
from edhas_jax.core.literal_text import file_name
from edhas_jax.core.remark import Severity
from edhas_jax.core.units import exact_quantity, format_quantity
from edhas_jax.diagnosis.laws.curve_figure import law_chart
from edhas_jax.diagnosis.laws.curve_fit import estimate_law_curve
from edhas_jax.diagnosis.report.report import law_sentence
from edhas_jax.diagnosis.search.chosen_effects import ChosenModel, calibrated_model, save_model, with_effect
from edhas_jax.diagnosis.search.member_laws import member_law
from edhas_jax.machine.effects.loading import load_effect
from edhas_jax.machine.parameters import list_parameters, short_names
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.checks.data_summary import data_sentences
from edhas_jax.measurements.checks.noise_measurement import noise_as_json
from edhas_jax.measurements.comparison import Comparison, RunComparison, compare
from edhas_jax.measurements.comparison_report import sentences
from edhas_jax.measurements.fitted_model import bench_corrected_errors, with_values_of_runs
from edhas_jax.measurements.replay import Replay
from edhas_jax.measurements.residual_matrix import draw_residual_matrix, run_descriptions
from edhas_jax.measurements.residual_patterns import Pattern, find_patterns
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter, uncertain_unknowns
from edhas_jax.workbench.thinning import thinned
from edhas_jax.workbench.workspace import RESULTS, TRIED, Workspace, WorkspaceError

KEPT_COMPARISONS = 6
BINS, MAX_POINTS = 40, 3000  # of a residual over a variable
PICTURE_DPI = 150  # of the matrices: as sharp as on a screen of today
CYCLES_SHOWN, SHARE_SHOWN = 2.0, 0.1  # of a run, around the place that a sentence speaks of


class CampaignCalculations:
    """Keeps the checked campaign, the last comparisons and the fitted models in memory.

    Args:
        workspace: the folder.
        say: called with a sentence on the progress.
    """

    def __init__(self, workspace: Workspace, say: Callable[[str], None]):
        self._workspace, self._say = workspace, say
        self._campaign: Campaign | None = None
        self._read_as: tuple = ()
        self._inputs: dict[str, str] = {}
        self._comparisons: dict[tuple, tuple[Comparison, list[Pattern]]] = {}
        self._chosen: dict[tuple[str, ...], ChosenModel] = {}

    def open(self) -> dict[str, Any]:
        """The campaign in brief: runs, signals, noise, and what the check of the data found."""
        campaign = self.checked()
        signals, channels = campaign.machine.signals, campaign.channels.items()
        order = list(Severity)
        remarks = sorted(campaign.remarks, key=lambda remark: order.index(remark.severity))
        return {
            "name": campaign.name,
            "rig": campaign.machine.name,
            "slots": [slot._asdict() | {"rule": slot.rule.value} for slot in campaign.machine.slots],
            "effects": [effect.id for effect in campaign.machine.effects],
            "signals": {name: signals[name].display_unit for name in campaign.channels},
            "noise": {n: float(signals[n].shown_difference(c.noise)) for n, c in channels},
            "noise_table": noise_as_json(campaign),
            "runs": {
                run.name: {"use": run.use.value, "samples": len(run.time), "end": float(run.time[-1])}
                for run in campaign.runs
            },
            "conditions": run_descriptions(campaign),
            "uncertain": {u.name: _prior(u) for u in uncertain_unknowns(campaign)},
            "parameters": _other_parameters(campaign),
            "sentences": data_sentences(campaign),
            "remarks": [(r.severity.value, r.file.name, r.line, r.sentence) for r in remarks],
        }

    def compare(self, model: str, replay: str) -> dict[str, Any]:
        """Errors of a model by run and signal, and the patterns of the residuals as sentences with their places."""
        comparison, patterns = self.comparison(model, replay)
        path = self._workspace.models()[model]
        return {
            "matrix": comparison.rms_over_noise(),
            "bench_corrected": {} if path is None else bench_corrected_errors(comparison, path),
            "signals": {name: comparison.machine.signals[name].display_unit for name in comparison.signals},
            "sentences": [
                self._place(comparison, pattern) | {"text": text}
                for pattern, text in zip(patterns, sentences(patterns), strict=True)
            ],
            "remarks": [str(remark) for remark in comparison.remarks],
            "variables": ["time", *comparison.runs[0].model],
        }

    def traces(
        self, models: list[str], replay: str, panels: list[tuple[str, str]], first: float,
        last: float, width: int,
    ) -> list[dict[str, Any]]:  # fmt: skip
        """Measured and modelled signal and (measured − model)/noise of some panels, thinned to the width of the plot.

        Args:
            models: names of the models.
            replay: the input that drives them.
            panels: run and signal of each panel.
            first: first time shown [s].
            last: last time shown [s].
            width: of the plot, in pixels.
        """
        out = []
        for run, signal in panels:
            of_models = self._compared_run(models, replay, run, signal)
            if not of_models:
                continue
            compared = next(iter(of_models.values()))
            time, about, channel = compared.run.time, self.checked().machine.signals[signal], compared.run.signals

            def row(values, time=time):
                index = thinned(time, values, first, last, width)
                return {"x": time[index], "y": values[index]}

            out.append({
                "run": run, "signal": signal, "unit": about.display_unit, "samples": len(time),
                "measured": row(about.shown(channel[signal])),
                "models": {
                    model: row(about.shown(c.model[signal])) | {
                        "rms": c.rms_over_noise[signal], "residual": row(c.residuals[signal]),
                    }
                    for model, c in of_models.items()
                },
            })  # fmt: skip
        return out

    def samples(
        self, models: list[str], replay: str, run: str, signals: list[str]
    ) -> list[list[Any]]:  # fmt: skip
        """All samples of some signals of a run, measured and modelled, as rows below their head."""
        columns: dict[str, list] = {}
        for signal in signals:
            about = self.checked().machine.signals[signal]
            for model, compared in self._compared_run(models, replay, run, signal).items():
                name = f"{signal} [{about.display_unit}]"
                columns.setdefault("time [s]", compared.run.time.tolist())
                columns.setdefault(f"measured {name}", about.shown(compared.run.signals[signal]).tolist())
                columns[f"{model} {name}"] = about.shown(compared.model[signal]).tolist()
        return [list(columns), *map(list, zip(*columns.values(), strict=True))]

    def matrix_picture(self, panels: dict[str, dict[str, dict[str, float]]], suffix: str) -> bytes:
        """The matrices of several models side by side as a picture, "png" or "svg"."""
        figure = draw_residual_matrix(panels, run_descriptions(self.checked()))
        buffer = io.BytesIO()
        figure.savefig(buffer, format=suffix, dpi=PICTURE_DPI)
        return buffer.getvalue()

    def residual_over(self, model: str, replay: str, signal: str, variable: str) -> dict[str, Any]:
        """The residual of a signal over a variable: points of each run, and the mean in bins of all runs together."""
        comparison, _ = self.comparison(model, replay)
        runs = [compared for compared in comparison.runs if signal in compared.residuals]
        x = [self._variable(comparison, compared, variable) for compared in runs]
        y = [compared.residuals[signal] for compared in runs]
        step = max(1, sum(map(len, x)) // MAX_POINTS)
        all_x, all_y = np.concatenate(x), np.concatenate(y)
        valid = np.isfinite(all_x) & np.isfinite(all_y)
        edges = np.linspace(*np.quantile(all_x[valid], [0.0, 1.0]), BINS + 1) if valid.any() else np.zeros(2)
        of_bin = np.clip(np.searchsorted(edges, all_x[valid], side="right") - 1, 0, len(edges) - 2)
        count = np.bincount(of_bin, minlength=len(edges) - 1)
        mean = np.bincount(of_bin, all_y[valid], minlength=len(edges) - 1) / np.maximum(count, 1)
        used = count > 0
        unit = "s" if variable == "time" else comparison.machine.signals[variable].display_unit
        return {
            "unit": unit,
            "runs": [(c.run.name, a[::step], b[::step]) for c, a, b in zip(runs, x, y, strict=True)],
            "bins": (0.5 * (edges[1:] + edges[:-1])[used], mean[used]),
        }

    def try_effects(self, names: list[str]) -> dict[str, Any]:
        """Fit the model with effects, one after the other, write its configuration, and say what falls where.

        Args:
            names: ids of effects, or FILE.py:Class of a file of the folder, in the order in which they are added.
        """
        campaign = self.checked()
        kinds = [load_effect(name, self._workspace.folder, self._workspace.allowed) for name in names]
        chain: tuple[str, ...] = ()
        if chain not in self._chosen:
            self._chosen[chain] = calibrated_model(campaign, self._say)
        for kind, name in zip(kinds, names, strict=True):
            before, chain = self._chosen[chain], (*chain, name)
            if chain not in self._chosen:
                self._chosen[chain] = with_effect(campaign, before, kind, self._say)
        model, before = self._chosen[chain], self._chosen[chain[:-1]]
        folder = self._workspace.inside(Path(RESULTS, TRIED))
        folder.mkdir(parents=True, exist_ok=True)
        name = file_name(model.name)
        save_model(model, self._workspace.inside(Path(RESULTS, TRIED, f"{name}.yaml")))
        summary = model.as_json() | {"before": before.as_json(), "named": list(names), "made_from": self._inputs}
        self._workspace.save_tried(name, summary)
        return summary | {"name": name}

    def law_curve(self, names: list[str]) -> dict[str, Any]:
        """The law of the last of some effects as a curve estimated from the runs, in the units in which it is shown.

        Args:
            names: the effects of a model that was tried.
        """
        if tuple(names) not in self._chosen:
            self.try_effects(names)
        model = self._chosen[tuple(names)]
        self._say(f"the law of {model.effects[-1].id} as a curve")
        found = estimate_law_curve(model.evaluated.fit, model.effects[-1].id, self._say)
        if found is None:
            law = f"the law of {model.effects[-1].id}"
            raise WorkspaceError(f"{law} is no function of a signal of these runs, or its size is 0")
        sentence = None
        if found.curve.law_values is not None:
            sentence = law_sentence(found.curve, member_law(model.evaluated, model.effects[-1]))
        return {"effect": model.effects[-1].id, "sentence": sentence, "chart": law_chart(found.curve)}

    def checked(self) -> Campaign:
        """The campaign with its data checked, read again where a file of the folder has changed."""
        self._workspace.require_files_inside()
        if not self._workspace.has_campaign:
            raise WorkspaceError("There is no campaign.yaml in this folder yet: bring data first")
        files = [path for path in sorted(self._workspace.folder.iterdir()) if path.is_file()]
        read_as = tuple((path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in files)
        if self._campaign is None or read_as != self._read_as:
            self._say("reading and checking the data")
            self._inputs = self._workspace.inputs()
            self._campaign, self._read_as = checked_campaign(read_campaign(self._workspace.folder)), read_as
            self._comparisons.clear()
            self._chosen.clear()
        return self._campaign

    def comparison(self, model: str, replay: str) -> tuple[Comparison, list[Pattern]]:
        """The comparison of a model with the measurements, and the patterns of its residuals."""
        campaign, models = self.checked(), self._workspace.models()
        if model not in models:
            raise WorkspaceError(f"there is no model “{model}”; there are: {', '.join(models)}")
        path = models[model]
        key = model, replay, None if path is None else path.stat().st_mtime_ns
        if key not in self._comparisons:
            machine = None if path is None else read_config(path, trust=self._workspace.allowed).machine
            campaign = campaign if path is None else with_values_of_runs(campaign, path)
            comparison = compare(campaign, machine, replay=Replay(replay), on_progress=self._say)
            while len(self._comparisons) >= KEPT_COMPARISONS:
                self._comparisons.pop(next(iter(self._comparisons)))
            self._comparisons[key] = comparison, find_patterns(comparison)
        return self._comparisons[key]

    def _compared_run(
        self, models: list[str], replay: str, run: str, signal: str
    ) -> dict[str, RunComparison]:
        """A run as each of some models has it, where it could be simulated and has the signal."""
        of_models = {model: self.comparison(model, replay)[0].runs for model in models}
        found = {m: next((c for c in runs if c.run.name == run), None) for m, runs in of_models.items()}
        return {model: c for model, c in found.items() if c is not None and signal in c.residuals}

    def _place(self, comparison: Comparison, pattern: Pattern) -> dict[str, Any]:
        """Where a pattern is seen best: the run with the largest error of its signal, around its largest residual."""
        runs = [c for c in comparison.runs if pattern.signal in c.residuals]
        worst = max(runs, key=lambda c: np.nan_to_num(c.rms_over_noise[pattern.signal], nan=-1.0))
        time, residual = worst.run.time, np.abs(np.nan_to_num(worst.residuals[pattern.signal]))
        settled = np.where(time >= worst.ramp_time, residual, 0.0)
        at = float(time[int(np.argmax(settled))])
        length = CYCLES_SHOWN / worst.frequency if worst.frequency > 0.0 else SHARE_SHOWN * float(time[-1] - time[0])
        first = min(max(at - 0.5 * length, float(time[0])), max(float(time[-1]) - length, float(time[0])))
        axis = pattern.axis if pattern.axis in worst.model else "time"
        return {"signal": pattern.signal, "run": worst.run.name, "axis": axis, "range": [first, first + length]}

    def _variable(self, comparison: Comparison, compared: RunComparison, variable: str) -> np.ndarray:
        if variable == "time":
            return compared.run.time
        return comparison.machine.signals[variable].shown(compared.model[variable])



def _prior(unknown: UnknownParameter) -> dict[str, Any]:
    """What is known of a parameter, and between which values (SI) it is sought."""
    unit, spread = unknown.unit, unknown.spread
    known = f"{100.0 * spread:.3g} %" if unknown.scale is ParameterScale.LOGARITHMIC else exact_quantity(spread, unit)
    smallest, largest = sorted(float(unknown.value(x)) for x in unknown.bounds())
    return {
        "given": unknown.centre, "unit": unit, "smallest": smallest, "largest": largest, "known_to": f"± {known}",
    }  # fmt: skip


def _other_parameters(campaign: Campaign) -> dict[str, str]:
    """The values of the parameters of the machine that are not uncertain, as texts by name."""
    names = short_names(campaign.machine)
    known = {u.parameter for u in uncertain_unknowns(campaign)}
    rows = {names[path, p.name]: format_quantity(value, p.unit) for p, value, path in list_parameters(campaign.machine)}
    return {name: value for name, value in rows.items() if name not in known}
