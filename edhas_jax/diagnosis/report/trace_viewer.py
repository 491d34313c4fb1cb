"""Interactive plot of measured and simulated signals, run by run, as one fragment of HTML for the report."""

import base64
import html
from collections.abc import Mapping
from importlib import resources
from typing import Any

import numpy as np

from edhas_jax.core.html_page import json_element
from edhas_jax.core.plot_style import COLOURS, GREY
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.residual_matrix import run_descriptions
from edhas_jax.measurements.residuals import rms_over_noise

MODEL_COLOURS = {"before": GREY, "calibrated": COLOURS[4], "after": COLOURS[1]}
MAX_SHOWN_SAMPLES = 6000  # of a run in the page; longer ones are thinned out
MISSING_CODE, MAX_CODE = -32768, 32000  # 16-bit codes of a missing sample, and of the largest value
INITIAL_CYCLES = 2.0  # shown at first, of a run with a sinusoidal set point
STYLE = """
#traces select { font: inherit; margin-right: 1em } #traces [data-model] { cursor: pointer; margin-right: 1.4em }
#traces [data-model].off { opacity: 0.5 } #traces .off::after { content: "(hidden)" } #traces i { color: #6e7781 }
#traces svg { width: 100%; font-size: 12px; fill: #1b1f24; cursor: crosshair; user-select: none }
#traces .reading { min-height: 1.5em; color: #6e7781; font-variant-numeric: tabular-nums }
"""


def render_trace_viewer(campaign: Campaign, states: Mapping[str, Mapping[str, Mapping[str, np.ndarray]]]) -> str:
    """Render the viewer as HTML with its data and script.

    It opens on the run and signal with the largest residual of the calibrated model, on a held-out run if there is one.

    Args:
        campaign: the measurements.
        states: (measured − model)/noise by model ("before", "calibrated", "after"), run and signal.
    """
    runs = [run for run in campaign.runs if run.signals]
    preferred = [r for r, run in enumerate(runs) if run.use is Use.HOLDOUT] or range(len(runs))
    of_state = states.get("calibrated", next(iter(states.values())))
    _, worst_run, worst_signal = max(
        ((rms_over_noise([v]), r, n) for r in preferred for n, v in of_state[runs[r].name].items()),
        default=(0.0, 0, ""),
    )
    signals = [n for n in campaign.channels if any(n in run.signals for run in runs)]
    about = campaign.machine.signals
    data = {
        "runs": [_run(campaign, run, states) for run in runs],
        "run": worst_run, "signal": worst_signal or signals[0],
        "units": {n: about[n].display_unit for n in signals},
        "noise": {n: float(about[n].shown_difference(campaign.channels[n].noise)) for n in signals},
        "models": [{"name": name, "colour": MODEL_COLOURS[name]} for name in states],
        "hidden": [name for name in states if name == "before"], "colour": COLOURS[0],
    }  # fmt: skip
    options = "".join(f'<option value="{r}">{html.escape(run.name)}</option>' for r, run in enumerate(runs))
    names = "".join(f'<option value="{n}">{n.replace("_", " ")}</option>' for n in signals)
    legend = f'<span style="color:{COLOURS[0]};margin-right:1.4em">● measured</span>' + "".join(
        f'<span data-model="{m["name"]}" style="color:{m["colour"]}">━ {m["name"]} <i></i></span>'
        for m in data["models"]
    )
    script = resources.files(__package__).joinpath("trace_viewer.js").read_text(encoding="utf-8")
    return (
        f'<style>{STYLE}</style><div id="traces" class="drawn"><p>run <select class="run">{options}</select>signal '
        f'<select class="signal">{names}</select><span class="description"></span><br>{legend}</p>'
        '<svg viewBox="0 0 1120 504"></svg><p class="reading"></p></div>'
        f"{json_element(data, 'traces-data')}"
        f"<script>{script}</script>"
    )


def _run(campaign: Campaign, run: BenchRun, states) -> dict[str, Any]:
    """One run as plain data: times in ms, signals in the units of display."""
    stride = max(1, -(-len(run.time) // MAX_SHOWN_SAMPLES))
    time = 1e3 * run.time[::stride]
    machine = campaign.machine_of(run)
    start = time[0]
    if machine.cycle is not None:
        start = max(start, time[-1] - INITIAL_CYCLES * 1e3 / float(get_parameter(machine, "frequency")))
    out = {
        "count": len(time), "first": float(time[0]), "step": float((time[-1] - time[0]) / max(1, len(time) - 1)),
        "shown": [float(start), float(time[-1])], "description": run_descriptions(campaign)[run.name],
        "signals": {}, "levels": {},
    }  # fmt: skip
    for name, measured in run.signals.items():
        residuals = {state: rows[run.name][name] for state, rows in states.items()}
        noise = campaign.channels[name].noise
        rows = {"measured": measured, **{state: measured - noise * v for state, v in residuals.items()}}
        about = machine.signals[name]
        out["signals"][name] = {state: _encode(about.shown(v[::stride])) for state, v in rows.items()}
        out["levels"][name] = {state: f"{rms_over_noise([v]):.2f} × noise" for state, v in residuals.items()}
    return out


def _encode(values: np.ndarray) -> dict[str, Any]:
    """Encode numbers as base64 of 16-bit integers: value = offset + scale · code."""
    valid = values[np.isfinite(values)]
    low, high = (float(valid.min()), float(valid.max())) if len(valid) else (0.0, 0.0)
    offset, scale = 0.5 * (low + high), max((high - low) / (2 * MAX_CODE), 1e-30)
    codes = np.where(np.isfinite(values), np.round((np.nan_to_num(values) - offset) / scale), MISSING_CODE)
    return {"offset": offset, "scale": scale, "data": base64.b64encode(codes.astype("<i2").tobytes()).decode()}
