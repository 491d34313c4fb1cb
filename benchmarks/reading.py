"""Time and memory that reading a campaign takes, by the format of its files, and that of its check.

    python benchmarks/reading.py [--runs 20] [--samples 100000] [--formats csv parquet]

Last, every run is in three files: five signals of the full rate, two of a tenth and one of a hundredth of it, of a
machine whose model is right; this campaign is checked too.

The last line: `csv_s=… csv_gb=… … rates_s=… rates_gb=… check_s=… check_gb=…`.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

INTERVAL = 1e-4  # s
SIGNALS = {
    "voltage": "V", "current": "A", "piston_position": "mm", "piston_velocity": "m/s", "outlet_pressure": "bar",
    "outlet_flow": "L/min", "chamber_pressure_a": "bar", "chamber_pressure_b": "bar",
}  # fmt: skip


def decimal_commas(frame: pd.DataFrame, path: Path) -> None:
    """Write a file as a spreadsheet with German settings does."""
    frame.to_csv(path, index=False, sep=";", decimal=",", float_format="%.6f")


# what writes a run, by the ending of its file
FORMATS: dict[str, Callable[[pd.DataFrame, Path], None]] = {
    "csv": lambda frame, path: frame.to_csv(path, index=False, float_format="%.6g"),
    "txt": decimal_commas,
    "parquet": lambda frame, path: frame.to_parquet(path, index=False),
}


def write_campaign(folder: Path, ending: str, runs: int, samples: int) -> None:
    """Write a campaign of the pump bench with eight signals of noise."""
    random = np.random.default_rng(1)
    columns = {"time [s]": INTERVAL * np.arange(samples)}
    columns |= {f"{name} [{unit}]": 1.0 + random.standard_normal(samples) for name, unit in SIGNALS.items()}
    FORMATS[ending](pd.DataFrame(columns), folder / f"run0.{ending}")
    for k in range(1, runs):
        (folder / f"run{k}.{ending}").hardlink_to(folder / f"run0.{ending}")
    signals = "".join(f"  {name}: {{unit: {unit}, noise: 1}}\n" for name, unit in SIGNALS.items())
    entries = "".join(f"  - {{file: run{k}.{ending}, use: fit, frequency: 20 Hz}}\n" for k in range(runs))
    (folder / "campaign.yaml").write_text(f"rig: pump_bench\nsignals:\n{signals}runs:\n{entries}")


RIG = '''"""A lag that eight sensors see."""
from edhas_jax import Rig, drive, par, signal, state


class Lag(Rig):
    """A lag of first order."""

    time_step, duration = 1e-3, 10.0
    command = drive("V", "command", 0.0)
    tau: float = par(0.1, "s", (1e-3, 10.0), "time constant")
    level = state("V", "level")
    seen_1 = signal("V", "a sensor")
    seen_2 = signal("V", "a sensor")
    seen_3 = signal("V", "a sensor")
    seen_4 = signal("V", "a sensor")
    seen_5 = signal("V", "a sensor")
    seen_6 = signal("V", "a sensor")
    seen_7 = signal("V", "a sensor")
    seen_8 = signal("V", "a sensor")

    def equations(self, y, s):
        s.set(**{f"seen_{k}": k * y.level for k in range(1, 9)})
        return {"level": (s.command - y.level) / self.tau}
'''
RATES = {1: range(1, 6), 10: range(6, 8), 100: range(8, 9)}  # numbers of the signals by what divides the rate


def write_rates(folder: Path, runs: int, samples: int) -> None:
    """Write a campaign whose runs have signals of three rates, each in a file of its own."""
    random = np.random.default_rng(1)
    time = INTERVAL * np.arange(samples)
    command = np.sin(3.0 * time) + np.sin(7.7 * time)
    share = INTERVAL / 0.1
    level = lfilter([0.5 * share, 0.5 * share], [1.0 + 0.5 * share, 0.5 * share - 1.0], command)
    for part, numbers in RATES.items():
        columns = {"time [s]": time[::part]} | ({"command [V]": command} if part == 1 else {})
        noise = random.standard_normal((8, len(time[::part])))
        columns |= {f"seen_{k} [V]": k * (level[::part] + 0.01 * noise[k - 1]) for k in numbers}
        FORMATS["csv"](pd.DataFrame(columns), folder / f"run0_{part}.csv")
        for k in range(1, runs):
            (folder / f"run{k}_{part}.csv").hardlink_to(folder / f"run0_{part}.csv")
    (folder / "lag.py").write_text(RIG)
    signals = "".join(f"  seen_{k}: {{unit: V}}\n" for k in range(1, 9))
    entries = "".join(
        f"  - {{files: [{', '.join(f'run{k}_{part}.csv' for part in RATES)}], use: fit}}\n" for k in range(runs)
    )
    text = f"rig: lag.py:Lag\ndrives: {{command: command}}\nsignals:\n{signals}runs:\n{entries}"
    (folder / "campaign.yaml").write_text(text)


def read(folder: Path) -> list[float]:
    """Seconds and peak memory [GB] above that at the start, in this process; the same of a check of several rates."""
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    figures, started = [], time.perf_counter()

    def note() -> None:
        memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e6
        figures.extend([time.perf_counter() - started, memory])

    campaign = read_campaign(folder, [folder / "lag.py"])
    assert sum(len(run.signals) for run in campaign.runs) == len(SIGNALS) * len({run.whole for run in campaign.runs})
    note()
    if (folder / "lag.py").exists():
        started = time.perf_counter()
        checked_campaign(campaign)
        note()
    return figures


def main() -> None:
    """Run the benchmark and print its table, then its headline figures as `key=value` pairs."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--formats", nargs="+", default=list(FORMATS), choices=list(FORMATS))
    parser.add_argument("--read", type=Path, help=argparse.SUPPRESS)  # the folder that a process of its own reads
    options = parser.parse_args()
    if options.read:
        print(*read(options.read))
        return
    figures = []
    print(f"{options.runs} runs, {len(SIGNALS)} channels of {options.samples} samples")
    print("| what | seconds | memory, GB |\n| --- | --- | --- |")
    writers = {f: lambda folder, f=f: write_campaign(folder, f, options.runs, options.samples) for f in options.formats}
    writers["rates"] = lambda folder: write_rates(folder, options.runs, options.samples)
    for name, write in writers.items():
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder))
            command = [sys.executable, __file__, "--read", folder]
            output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        found = list(map(float, output.split()))
        for what, seconds, memory in zip((name, "check"), found[::2], found[1::2], strict=False):
            print(f"| {what} | {seconds:.1f} | {memory:.2f} |", flush=True)
            figures.append(f"{what}_s={seconds:.1f} {what}_gb={memory:.2f}")
    print(*figures)


if __name__ == "__main__":
    main()
