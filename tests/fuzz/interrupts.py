"""Interrupt the command line at random moments: `python -m tests.fuzz.interrupts --count 60`.

Every command runs in a process of its own and gets SIGINT after a random time, some of them a second one soon after.
"""

import argparse
import functools
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.support import CONFIGS

RIG = """
from edhas_jax import Rig, drive, par, state

class Lag(Rig):
    \"\"\"A proportional valve: the pressure follows the command with a lag.\"\"\"
    time_step, duration = 1e-3, 1.0
    command = drive("V", "command of the valve", 1.0)
    gain: float = par(2e6, "Pa/V", (1e4, 1e8), "pressure per voltage")
    tau: float = par(0.08, "s", (1e-3, 10.0), "time constant")
    first: float = par(1e5, "Pa", (0.0, 1e8), "pressure at the first")
    pressure = state("Pa", "pressure at the outlet", "first")

    def equations(self, y, s):
        return {"pressure": (self.gain * s.command - y.pressure) / self.tau}
"""
CAMPAIGN = """
name: lag
rig: rig.py:Lag
uncertain: {gain: 0.1, tau: 0.5}
drives: {command: {column: u, unit: V}}
signals: {pressure: {column: p, unit: bar, noise: 0.05}}
runs: [{file: run.csv, use: fit, first: 1 bar}]
"""
SWEEP = f"""
base: {CONFIGS / "actuator.yaml"}
sweep: {{kind: grid, parameters: {{frequency: {{from: 10 Hz, to: 40 Hz, count: 400}}}}}}
batch: {{step: 100 us, tolerance: 1 %, max_cycles: 8}}
"""
OWN = ("--rig", "rig.py:Lag")
COMMANDS = {
    "simulate": ("simulate", str(CONFIGS / "actuator.yaml"), "--out", "out"),
    "sweep": ("sweep", "sweep.yaml", "--out", "out"),
    "fit": ("fit", ".", *OWN, "--out", "out"),
    "compare": ("compare", ".", *OWN, "--out", "out"),
    "diagnose": ("diagnose", ".", *OWN, "--out", "out"),
    "cluster": ("sweep", "sweep.yaml", "--out", "out", "--cluster", "local:1"),
}  # fmt: skip
USUAL = ("simulate", "sweep", "fit", "compare")
PATIENCE = 60.0  # s, after which an interrupted command counts as hanging
SECOND_SHARE, SECOND_WITHIN = 0.25, 0.5  # of the commands get a second interrupt, within so many seconds


def prepare(folder: Path) -> None:
    """Write the rig, the record and the files of the commands."""
    t = 0.01 * np.arange(101)
    u = 1.0 + 0.3 * np.sin(2.0 * np.pi * 3.0 * t)
    p, rows = 1.0, []
    for time_, volt in zip(t, u, strict=True):
        rows.append(f"{time_:.2f},{volt:.4f},{p:.4f}\n")
        p += 0.01 * (20.0 * volt - p) / 0.1
    (folder / "rig.py").write_text(RIG)
    (folder / "campaign.yaml").write_text(CAMPAIGN)
    (folder / "sweep.yaml").write_text(SWEEP)
    (folder / "run.csv").write_text("time [s],u [V],p [bar]\n" + "".join(rows))


def interrupted(command: str, folder: Path, moment: float | None, second: float | None = None):
    """Run one command and send SIGINT after `moment` [s], and again `second` [s] later.

    Returns:
        Its exit status, None where it hung; what it wrote on its standard error; whether it was still running when the
        interrupt was sent; the seconds it ran.
    """
    shutil.rmtree(folder / "out", ignore_errors=True)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a shell; processes would inherit it
        signal.signal(signal.SIGINT, signal.default_int_handler)
    began = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "edhas_jax.commands.cli", *COMMANDS[command]], cwd=folder, stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    deadline = began + PATIENCE
    while moment is not None and process.poll() is None and not _is_ready(process) and time.monotonic() < deadline:
        time.sleep(0.002)
    sent = False
    try:
        for wait in (moment, second):
            if wait is not None:
                try:
                    process.wait(wait)
                except subprocess.TimeoutExpired:
                    process.send_signal(signal.SIGINT)
                    sent = True
        _, message = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        _, message = process.communicate()
        return None, message, True, time.monotonic() - began
    return process.returncode, message, sent, time.monotonic() - began


def _is_ready(process) -> bool:
    """Whether the process is past the start of Python: it has a handler of SIGTERM."""
    try:
        caught = next(line for line in Path(f"/proc/{process.pid}/status").read_text().splitlines() if "SigCgt" in line)
    except (OSError, StopIteration):
        return False
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def fault(status: int | None, message: str) -> str:
    """What is wrong with the end of an interrupted command; empty where it is right."""
    sentences = [line for line in message.splitlines() if line.startswith("edhas: interrupted")]
    others = [line for line in message.splitlines() if not line.startswith("edhas: ")]
    if status is None:
        return "hangs"
    if status != 130:
        return f"status {status}"
    if len(sentences) != 1:
        return f"{len(sentences)} sentences"
    return "other text" if others or re.search("Traceback|Error", message) else ""


def attack(count: int, seed: int, names=USUAL, longest: float | None = None) -> list[str]:
    """Interrupt the commands in turn at `count` moments within `longest` [s], or within the time they take.

    Returns:
        The faults found.
    """
    chance, faults, late = random.Random(seed), [], 0
    say = functools.partial(print, flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        usual = dict.fromkeys(names, longest)
        for command in names if longest is None else ():
            status, message, _, usual[command] = interrupted(command, folder, None)
            assert status in (0, 4), f"{command}: status {status} {message}"
        for k in range(count):
            command = names[k % len(names)]
            moment = chance.uniform(0.0, usual[command])
            second = chance.uniform(0.0, SECOND_WITHIN) if chance.random() < SECOND_SHARE else None
            status, message, sent, seconds = interrupted(command, folder, moment, second)
            found = fault(status, message) if sent else ""
            late += not sent
            again = "" if second is None else f" and {second:.2f} s later"
            outcome = found or "right" if sent else "ended before"
            say(f"{command} at {moment:.2f} s{again}: {outcome}, status {status}, {seconds:.1f} s")
            if found:
                say(message)
                faults.append(f"{command} at {moment:.2f} s: {found}")
    say(f"interrupts={count - late} faults={len(faults)}")
    return faults


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=USUAL)
    options = parser.parse_args()
    return 1 if attack(options.count, options.seed, options.commands) else 0


if __name__ == "__main__":
    sys.exit(main())
