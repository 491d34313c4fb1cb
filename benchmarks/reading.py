"""Time and memory that reading a campaign takes, by the format of its files.

    python benchmarks/reading.py [--runs 20] [--samples 100000] [--formats csv parquet]

The last line: `csv_s=… csv_gb=… parquet_s=… parquet_gb=…`.
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


def read(folder: Path) -> tuple[float, float]:
    """Seconds and peak memory [GB] above that at the start, in this process."""
    from edhas_jax.measurements.campaign_reader import read_campaign

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.perf_counter()
    campaign = read_campaign(folder)
    seconds = time.perf_counter() - started
    assert all(len(run.signals) == len(SIGNALS) for run in campaign.runs)
    return seconds, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e6


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
    print("| format | file, MB | seconds | memory, GB |\n| --- | --- | --- | --- |")
    for ending in options.formats:
        with tempfile.TemporaryDirectory() as folder:
            write_campaign(Path(folder), ending, options.runs, options.samples)
            size = (Path(folder) / f"run0.{ending}").stat().st_size / 1e6
            command = [sys.executable, __file__, "--read", folder]
            output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            seconds, memory = map(float, output.split())
            print(f"| {ending} | {size:.1f} | {seconds:.1f} | {memory:.2f} |")
            figures.append(f"{ending}_s={seconds:.1f} {ending}_gb={memory:.2f}")
    print(*figures)


if __name__ == "__main__":
    main()
