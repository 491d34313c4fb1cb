"""Where does the flow stop rising with frequency, and why: late valves, starved suction, or too little voltage?

    python -m studies.flow_drop.flow_over_frequency [--points 40] [--out FOLDER]

Each suspect is taken out in turn: balls without mass and with stiff springs, a large accumulator pressure, a supply
that is never reached. What the flow gains at the frequency where it was highest is what that suspect costs there.
"""

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console

import edhas_jax as edhas
from edhas_jax.core.plot_style import COLOURS, INK
from edhas_jax.design.batch.batch import BatchSettings, run_designs
from studies import CONFIGS

CONFIG = CONFIGS / "paper.yaml"
LPM = 6e4  # L/min per m³/s
CASES = {  # name: (changes, colour)
    "as it is": ({}, INK),
    "valves without delay": ({"valve_mass": 4e-4, "valve_damping": 0.14, "valve_spring_rate": 1500.0}, COLOURS[0]),
    "suction at 1 MPa": ({"accumulator_pressure": 1e6}, COLOURS[2]),
    "unlimited voltage": ({"supply_voltage": 480.0}, COLOURS[1]),
}


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Sweep the frequency for every case, print who is to blame, leave a picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=40, help="frequencies")
    parser.add_argument("--out", type=Path, default=Path("runs/flow_over_frequency"))
    options = parser.parse_args(arguments)
    machine = edhas.load(CONFIG).machine
    frequency = np.linspace(4.0, 60.0, options.points)
    changed = {n for changes, _ in CASES.values() for n in changes}
    table = {n: [] for n in ("frequency", *changed)}
    for changes, _ in CASES.values():
        table["frequency"].append(frequency)
        for n in changed:
            table[n].append(np.full(len(frequency), changes.get(n, float(edhas.get(machine, n)))))
    with Console().status("sweeping the frequency"):
        got = run_designs(machine, {n: np.concatenate(v) for n, v in table.items()},
                          BatchSettings(step=20e-6, tolerance=1e-3, max_cycles=40))  # fmt: skip
    shape = (len(CASES), len(frequency))
    sound = np.isin(got["status"], (0, 1)).reshape(shape)
    flow = np.where(sound, got["mean_flow"].reshape(shape) * LPM, np.nan)
    ideal = 4.0 * 3.5e-3 * np.pi * 12e-3**2 / 4.0 * frequency * LPM
    top = int(np.nanargmax(flow[0]))
    beyond = min(top + max(1, len(frequency) // 10), len(frequency) - 1)
    gains = {name: float(flow[k, beyond] / flow[0, beyond] - 1.0) for k, name in enumerate(CASES) if k}
    blame = max(gains, key=lambda n: np.nan_to_num(gains[n], nan=-1.0))
    options.out.mkdir(parents=True, exist_ok=True)
    picture(frequency, flow, ideal, top).savefig(options.out / "flow.png", dpi=130)
    for name, gain in gains.items():
        print(f"{name}: {100 * gain:+.1f} % flow at {frequency[beyond]:.0f} Hz")
    print(f"highest_at_hz={frequency[top]:.1f} flow_lpm={flow[0, top]:.3f} because_of={blame.replace(' ', '_')}")
    return {"highest_at_hz": frequency[top]} | gains


def picture(frequency, flow, ideal, top):
    """Flow over frequency, a line per case."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 4.6), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(frequency, ideal, color="#6e7781", ls=":", lw=1.2)
    axes.annotate("swept volume", (frequency[len(frequency) // 3], ideal[len(frequency) // 3]), (-6, 8),
                  textcoords="offset points", color="#6e7781", fontsize=9, ha="right")  # fmt: skip
    for (name, (_, colour)), values in zip(CASES.items(), flow, strict=True):
        axes.plot(frequency, values, color=colour, lw=2.4 if name == "as it is" else 1.5, label=name)
    axes.plot(frequency[top], flow[0, top], "o", color=INK)
    axes.annotate(f"{flow[0, top]:.2f} L/min at {frequency[top]:.0f} Hz", (frequency[top], flow[0, top]), (0, -16),
                  textcoords="offset points", ha="center", fontsize=9)  # fmt: skip
    axes.set(xlabel="frequency, Hz", ylabel="mean flow, L/min", xlim=(0, frequency[-1]),
             ylim=(0, 1.15 * np.nanmax(flow)))  # fmt: skip
    axes.legend(frameon=False, fontsize=9, loc="upper left")
    axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle("The paper's pump: flow over frequency, one suspect taken out at a time", x=0.01, ha="left",
                    fontsize=11)  # fmt: skip
    return figure


if __name__ == "__main__":
    main()
