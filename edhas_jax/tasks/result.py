"""What all results of a task have in common: a summary, a short name, a folder to be saved in and opened from."""

import abc
import dataclasses
import datetime
import functools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import edhas_jax
from edhas_jax.config.result_files import ResultFileError, ResultFiles, check_files, report_write_errors
from edhas_jax.config.run_folder import write_json
from edhas_jax.core.summary import Summary, jsonable

SUMMARY_FILE = "summary.json"
FIGURE_DPI = 130
MODEL_FILES = ("config.yaml", "sized.yaml", "sized_1.yaml", "machine.yaml")  # the machine of a result, by preference
DATA_FILES = ("fit.json", "diagnosis.json", "plan.json", "result.json")  # the numbers of a result


class Result(abc.ABC):
    """A result that says what it is: `summary()`, `save(folder)`, and a short text in place of all its numbers."""

    files: tuple[str, ...] = ()  # names of the files that `save` may write, or patterns of them

    @abc.abstractmethod
    def summary(self) -> Summary:
        """Tables and sentences; `print` it."""

    @abc.abstractmethod
    def write_files(self, folder: Path) -> Sequence[str]:
        """Write everything but the summary into an existing folder; a sentence on each part that could not be made."""

    def save(self, folder: Path | str, overwrite: bool = False) -> Path:
        """Write the result into a folder, from which `edhas_jax.open_result` reads it.

        Args:
            folder: the folder to write.
            overwrite: whether it may exist; files of others in it stay.

        Returns:
            The folder.

        Raises:
            ResultFileError: it exists and `overwrite` is false, or it cannot be written.
        """
        self.write(self.reserve(Path(folder), overwrite))
        return Path(folder)

    def write(self, files: ResultFiles) -> Sequence[str]:
        """Write the result into the folder of `files`, which `reserve` has given; a sentence on each part that failed.

        Raises:
            ResultFileError: it cannot be written.
        """
        with report_write_errors(files.folder):
            files.begin()
            failures = self.write_files(files.folder)
            self.write_summary(files.folder)
            files.finish()
        return failures

    @classmethod
    def reserve(cls, folder: Path, overwrite: bool) -> ResultFiles:
        """The files of `save`; called before a long computation, it refuses a folder that may not be written.

        Raises:
            ResultFileError: see `save`.
        """
        return ResultFiles(Path(folder), overwrite, (*cls.files, SUMMARY_FILE))

    def write_summary(self, folder: Path) -> None:
        """Write `summary.json`: the summary with the version that made it and the date."""
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        made = {"task": task_name(type(self)), "edhas_jax": edhas_jax.__version__, "date": now}
        write_json(folder / SUMMARY_FILE, made | {"summary": self.summary().as_json()})

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.summary().title}>"

    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()


def task_name(kind: type) -> str:
    """The name of the task whose result is of this class: `FitResult` → `fit`."""
    return kind.__name__.removesuffix("Result").lower()


def with_methods(kind: type, inner: Any, **more: Any):
    """`inner`, a frozen dataclass, as the subclass `kind` that adds the methods of a result."""
    fields = {f.name: getattr(inner, f.name) for f in dataclasses.fields(inner)}
    return kind(**fields, **more)


def require_picture_name(path: Path) -> None:
    """Refuse a path that no picture can be written to; call it before a long computation.

    Raises:
        ResultFileError: it is a folder, or its suffix names no format of pictures.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    formats = FigureCanvasBase.get_supported_filetypes()
    if path.is_dir():
        raise ResultFileError(f"{path}: is a folder; name the file of the picture, such as {path / 'picture.png'}")
    if path.suffix.removeprefix(".").lower() not in formats:
        raise ResultFileError(f"{path}: ends in no format of pictures; known: {', '.join(sorted(formats))}")


def save_figure(figure, path: Path) -> None:
    """Write a matplotlib figure in the format that the suffix of `path` names; its folder is made.

    Raises:
        ResultFileError: the file cannot be written, or the format is unknown.
    """
    require_picture_name(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=FIGURE_DPI)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ResultFileError(f"{path}: cannot be written: {reason}") from None


@dataclasses.dataclass(frozen=True)
class SavedResult:
    """The result of a task, read from its folder.

    Attributes:
        folder: the folder.
        task: what was done, such as "fit".
        made_by: version of the package that wrote it, and the date.
        numbers: the content of its JSON file, in SI; empty where it has none.
    """

    folder: Path
    task: str
    made_by: str
    numbers: dict[str, Any]
    _summary: Summary

    def summary(self) -> Summary:
        """Tables and sentences as they were when the result was made."""
        return self._summary

    @functools.cached_property
    def machine(self):
        """The machine of the result, such as the calibrated one.

        Raises:
            ResultFileError: the result has none, or its files were changed.
        """
        from edhas_jax.config.machine_config import read_config

        name = next((n for n in MODEL_FILES if (self.folder / n).is_file()), None)
        if name is None:
            raise ResultFileError(f"{self.folder}: holds no machine")
        check_files(self.folder)
        return read_config(self.folder / name, is_result=True).machine

    @property
    def pictures(self) -> list[Path]:
        """The pictures in the folder."""
        return sorted(self.folder.glob("*.png"))

    @property
    def report(self) -> Path | None:
        """The report, one HTML file; None without one."""
        path = self.folder / "report.html"
        return path if path.is_file() else None

    def table(self, name: str):
        """A table of the folder, such as "points", as a pandas DataFrame.

        Raises:
            ResultFileError: there is no such table, or it is damaged.
        """
        import pandas as pd
        import pyarrow as pa

        for suffix, read in ((".parquet", pd.read_parquet), (".csv", pd.read_csv)):
            if (self.folder / (name + suffix)).is_file():
                try:
                    return read(self.folder / (name + suffix))
                except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
                    raise ResultFileError(f"{self.folder}: unreadable or incomplete: {error}") from None
        there = ", ".join(sorted(p.stem for p in self.folder.iterdir() if p.suffix in (".parquet", ".csv"))) or "none"
        raise ResultFileError(f"{self.folder}: no table {name}; there are: {there}")

    def __repr__(self) -> str:
        return f"<SavedResult of {self.task} in {self.folder}: {self._summary.title}>"

    def _repr_html_(self) -> str:
        return self._summary._repr_html_()


def open_result(path: Path | str):
    """Open a result that was saved, whatever it is.

    Args:
        path: the folder of a run, a sweep or of any other task, or the file of a sweep (`.nc`).

    Returns:
        A `RunResult`, a `SweepData`, or a `SavedResult`.

    Raises:
        ResultFileError: there is no result, or it is damaged.
    """
    path = Path(path)
    if path.is_file():
        from edhas_jax.design.sweep.dataset import open_dataset

        return open_dataset(path)
    if (path / "run.json").is_file():
        from edhas_jax.config.run_folder import open_run
        from edhas_jax.tasks.simulate import RunResult

        return with_methods(RunResult, open_run(path))
    if (path / "manifest.json").is_file():
        from edhas_jax.design.sweep.dataset import to_dataset
        from edhas_jax.design.sweep.run import open_sweep

        return to_dataset(open_sweep(path))
    if not (path / SUMMARY_FILE).is_file():
        missing = "there is no such folder" if not path.exists() else "holds no result: summary.json is missing"
        raise ResultFileError(f"{path}: {missing}")
    check_files(path)
    try:
        made = json.loads((path / SUMMARY_FILE).read_text(encoding="utf-8"))
        name = next((n for n in DATA_FILES if (path / n).is_file()), None)
        numbers = {} if name is None else json.loads((path / name).read_text(encoding="utf-8"))
        if not isinstance(numbers, dict):
            raise ValueError(f"{name} holds no numbers by name")
        made_by = f"edhas_jax {made['edhas_jax']}, {made['date']}"
        return SavedResult(path, str(made["task"]), made_by, jsonable(numbers), Summary.from_json(made["summary"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ResultFileError(f"{path}: unreadable or incomplete: {error}") from None
