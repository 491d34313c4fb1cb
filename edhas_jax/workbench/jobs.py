"""Jobs: commands of `edhas` that take long, in processes of their own that outlive the workbench.

Each job has a record, a file of progress and a file of what it printed, in the folder of the workspace. A job that was
cancelled keeps what is finished; the same command goes on from there.
"""

import dataclasses
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.workbench.workspace import JOBS, RESULTS, Workspace, WorkspaceError

RUNNING, DONE, FAILED, CANCELLED = "running", "done", "failed", "cancelled"
STATUS_NOT_CONVERGED, STATUS_INTERRUPTED = 4, 130  # exit statuses of commands that have written their results
LONGEST_START = 60.0  # s, until the process of a job has written its number into the record
MAX_OUTPUT = 20_000  # characters of what a job printed that are shown


@dataclasses.dataclass(frozen=True)
class Job:
    """One job.

    Attributes:
        number: its number in the folder.
        title: what it does, such as "calibrate".
        arguments: of the command line, without `edhas`.
        began: when it was started [s since 1970].
        pid: of the process that watches it; 0 until it has begun.
        started: when that process was started, as the system says; another process may get its number later.
        ended: when it ended [s since 1970]; None while it runs.
        status: running, done, failed or cancelled.
        inputs: the files of the campaign when it was started, with a hash of each.
    """

    number: int
    title: str
    arguments: tuple[str, ...]
    began: float
    pid: int = 0
    started: str = ""
    ended: float | None = None
    status: str = RUNNING
    inputs: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def command(self) -> str:
        """The command as one types it."""
        return shlex.join(["edhas", *self.arguments])

    @property
    def seconds(self) -> float:
        """How long it has run [s]."""
        return (self.ended or time.time()) - self.began


class JobList:
    """The jobs of a workspace."""

    def __init__(self, workspace: Workspace):
        self._workspace = workspace
        self._started: list[subprocess.Popen] = []

    def all(self) -> list[Job]:
        """All jobs, the first one first; one whose process is gone counts as cancelled."""
        for process in self._started:
            process.poll()  # so that the system forgets those that have ended
        jobs = []
        for path in self._folder().glob("*.json"):
            try:
                job = _load(path)
            except (OSError, ValueError, TypeError, KeyError):
                continue
            if job.status == RUNNING and _is_gone(job):
                job = dataclasses.replace(job, status=CANCELLED, ended=path.stat().st_mtime)
            jobs.append(job)
        return sorted(jobs, key=lambda job: job.number)

    def running(self) -> Job | None:
        """The job that runs."""
        return next((job for job in self.all() if job.status == RUNNING), None)

    def last(self, title: str) -> Job | None:
        """The last job of this kind."""
        return next((job for job in reversed(self.all()) if job.title == title), None)

    def start(self, title: str, arguments: list[str]) -> Job:
        """Start a job.

        Raises:
            WorkspaceError: another job runs.
        """
        jobs = self.all()
        if (other := next((job for job in jobs if job.status == RUNNING), None)) is not None:
            raise WorkspaceError(f"“{other.title}” runs; one job at a time. Cancel it, or wait until it is done")
        number, inputs = max((job.number for job in jobs), default=0) + 1, self._workspace.inputs()
        job = Job(number, title, tuple(arguments), time.time(), inputs=inputs)
        path = self._folder() / f"{job.number}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        _save(job, path)
        with (path.parent / f"{job.number}.txt").open("wb") as output:
            self._started.append(subprocess.Popen(
                [sys.executable, "-m", "edhas_jax.workbench.jobs", str(path)],
                stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True,
            ))  # fmt: skip
        return job

    def cancel(self, job: Job) -> None:
        """Interrupt a job as Ctrl-C does; what is finished is kept. The job may have changed since it was looked up."""
        job = next((now for now in self.all() if now.number == job.number), job)
        if job.status != RUNNING:
            return
        if not job.pid:  # its process has not begun yet, and will end when it reads this
            _save(dataclasses.replace(job, status=CANCELLED, ended=time.time()), self._folder() / f"{job.number}.json")
        elif process_start(job.pid) == job.started:
            os.kill(job.pid, signal.SIGTERM)

    def progress(self, job: Job) -> list[dict]:
        """What a job has reported: `at` [s since 1970], `what`, and perhaps `share` done."""
        rows = []
        for line in self._text(job, "progress").splitlines():
            try:
                rows.append(json.loads(line))
            except ValueError:
                continue  # half-written
        return [row for row in rows if isinstance(row, dict) and "what" in row]

    def output(self, job: Job) -> str:
        """What a job has printed."""
        return self._text(job, "txt")[-MAX_OUTPUT:]

    def _text(self, job: Job, suffix: str) -> str:
        try:
            return (self._folder() / f"{job.number}.{suffix}").read_text(encoding="utf-8", errors="replace")
        except OSError:
            return ""

    def _folder(self) -> Path:
        return self._workspace.inside(Path(RESULTS, JOBS))


def process_start(pid: int) -> str:
    """When a process was started, as the system says; empty where there is none, "unknown" where it does not say."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return "" if fields[0] == "Z" else fields[19]
    except OSError:
        pass
    if Path("/proc/self/stat").exists():
        return ""
    try:
        os.kill(pid, 0)
    except OSError:
        return ""
    return "unknown"


def _is_gone(job: Job) -> bool:
    """Whether the process of a job that has not ended exists no more."""
    if not job.pid:
        return time.time() > job.began + LONGEST_START
    return process_start(job.pid) != job.started


def _load(path: Path) -> Job:
    data = json.loads(path.read_text(encoding="utf-8"))
    return Job(**data | {"arguments": tuple(data["arguments"])})


def _save(job: Job, path: Path) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(dataclasses.asdict(job), indent=1), encoding="utf-8")


def watch(path: Path) -> None:
    """Run the command of a job, hand on an interruption, and write how it ended into its record."""
    job = _load(path)
    if job.status != RUNNING:
        return
    job = dataclasses.replace(job, pid=os.getpid(), started=process_start(os.getpid()))
    cancelled = False
    environment = os.environ | {"EDHAS_PROGRESS": str(path.with_suffix(".progress")), "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-m", "edhas_jax.commands.cli", *job.arguments]
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell may have started the workbench with interruptions ignored
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, env=environment)

    def interrupt(number, frame):
        nonlocal cancelled
        # the second time at once: what is finished is kept all the same
        process.send_signal(signal.SIGKILL if cancelled else signal.SIGINT)
        cancelled = True

    signal.signal(signal.SIGTERM, interrupt)
    _save(job, path)
    status = process.wait()
    names = {0: DONE, STATUS_NOT_CONVERGED: DONE, STATUS_INTERRUPTED: CANCELLED}
    ended = CANCELLED if cancelled and status else names.get(status, FAILED)
    _save(dataclasses.replace(job, status=ended, ended=time.time()), path)


if __name__ == "__main__":
    watch(Path(sys.argv[1]))
