"""A process that runs commands of `edhas` one after the other, so that a crash or a hang is seen from outside.

`python -m tests.fuzz.worker` reads one request a line from its standard input and answers with one line of JSON.
"""

import contextlib
import hashlib
import io
import json
import os
import select
import subprocess
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MEMORY_LIMIT = 8 * 2**30  # bytes of address space; a larger request of memory fails inside the command
TIME_LIMIT = 10.0  # s for one command
REOPEN, READ = "reopen", "read"  # no commands: the calls of Python that read a result folder and a campaign
START_LIMIT = 120.0  # s to import and compile


@dataclass(frozen=True)
class Outcome:
    """What one command did: exit status (None: the process died or hung), what it printed, an uncaught exception."""

    status: int | None
    output: str = ""
    message: str = ""
    uncaught: str = ""


class Worker:
    """The process of commands, started when first needed and again after a crash."""

    def __init__(self, environment: dict[str, str]):
        self._environment, self._process = environment, None

    def run(self, arguments: list[str], folder: Path, time_limit: float = TIME_LIMIT) -> Outcome:
        """Run one command in a folder; kill the process where it takes longer than the limit [s]."""
        if self._process is None:
            self._start()
        return self._ask(arguments, folder, time_limit)

    def stop(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process.stdin.close()
            self._process.stdout.close()
            self._process = None

    def _start(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.fuzz.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=ROOT,
            env={**os.environ, **self._environment},
        )
        ready = self._ask(["--version"], ROOT, START_LIMIT)
        assert ready.status == 0, ready

    def _ask(self, arguments: list[str], folder: Path, time_limit: float) -> Outcome:
        request = json.dumps({"arguments": arguments, "folder": str(folder)}) + "\n"
        self._process.stdin.write(request.encode())
        self._process.stdin.flush()
        answered, _, _ = select.select([self._process.stdout], [], [], time_limit)
        if not answered:
            self.stop()
            return Outcome(None, uncaught=f"no answer within {time_limit:g} s")
        line = self._process.stdout.readline()
        if not line:
            code = self._process.wait()
            self.stop()
            return Outcome(None, uncaught=f"the process died with {code}")
        return Outcome(**json.loads(line))


def _reopen(folder: str) -> int:
    """Read a folder as `edhas_jax.open_result` does for its callers; print what it holds."""
    import edhas_jax

    run = edhas_jax.open_result(folder)
    if isinstance(run, edhas_jax.Run):
        print(run.machine, run.status, run.reason, run.step)
        for values in (run.signals, run.energy, run.volume):
            print({name: hashlib.sha256(value.tobytes()).hexdigest() for name, value in values.items()})
    else:
        print(run.summary().as_json(), run.machine)
    return 0


def _read() -> int:
    """Read the campaign of the present folder as `edhas_jax.read_campaign` does; print the samples of its first run."""
    import edhas_jax

    run = edhas_jax.read_campaign(".", trust=["rig.py"]).runs[0]
    columns = {"time": run.time, **run.signals, **{name: drive.values for name, drive in run.drives.items()}}
    print(json.dumps({name: [float(x) for x in values] for name, values in columns.items()}))
    return 0


def _python(arguments: list[str]) -> int:
    """A call of Python in place of a command; the status as that of a command."""
    from edhas_jax.commands.cli import user_errors

    try:
        return _reopen(arguments[1]) if arguments[0] == REOPEN else _read()
    except user_errors() as error:
        print(f"edhas: {error}", file=sys.stderr)
        return 2


def _run(arguments: list[str]) -> Outcome:
    from edhas_jax.commands.cli import main

    output, message = io.StringIO(), io.StringIO()
    status, uncaught = None, ""
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(message):
        try:
            status = _python(arguments) if arguments[0] in (REOPEN, READ) else main(arguments)
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 2
        except BaseException:
            uncaught = traceback.format_exc()
    return Outcome(status, output.getvalue(), message.getvalue(), uncaught)


def serve() -> None:
    """Answer requests until the standard input ends."""
    import resource

    answers = os.fdopen(os.dup(1), "w", buffering=1)  # commands cannot write into the answers
    os.dup2(2, 1)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    sys.path.insert(0, os.getcwd())
    for line in sys.stdin:
        request = json.loads(line)
        os.chdir(request["folder"])
        answers.write(json.dumps(_run(request["arguments"]).__dict__) + "\n")


if __name__ == "__main__":
    serve()
