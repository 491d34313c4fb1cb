"""Checkpoint of a diagnosis: its finished stages on disk, which the same diagnosis goes on from.

A stage is the calibration or the fit of a set of effects: one file of arrays and JSON, written atomically and read
without running any code. The stages are used only for the same inputs, which are compared by hashes.
"""

import dataclasses
import hashlib
import json
import shutil
import sys
import time
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

from edhas_jax.config.run_folder import write_json
from edhas_jax.config.writer import dump_config
from edhas_jax.core import runtime
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.design.sweep.identity import effect_code, versions
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.inference.fit.time_correction import with_corrected_time
from edhas_jax.inference.fit.unpredictable_part import with_unpredictable_part
from edhas_jax.inference.likelihood.bench_estimate import BenchEstimate
from edhas_jax.inference.likelihood.residual_outliers import without_missing
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign, Spread
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.time_resolution import TimeResolution
from edhas_jax.simulation.run import Simulation

CHECKPOINT_FOLDER = "unfinished"  # within the output folder
IDENTITY_FILE = "identity.json"
CODE_PACKAGES = ("core", "compiler", "machine", "simulation", "config", "measurements", "inference", "diagnosis")
ARRAY = "array"  # begins the list that stands for an array, followed by its name


class Checkpoint:
    """The finished stages of one diagnosis.

    Attributes:
        folder: where the stages are; None keeps none.
        restored: the number of stages that were read from it.
        saved: the number of stages that were written into it.
        earlier_seconds: computing time [s] of the stages that were read.
        failures: a sentence where a stage could not be written; none is written after that.
    """

    def __init__(self, folder: Path | None = None, identity: Mapping[str, str] | None = None):
        """Open a checkpoint; stages of other inputs in its folder are removed as soon as a stage is saved.

        Args:
            folder: where the stages are; None keeps none.
            identity: of the inputs, from `diagnosis_identity`.
        """
        self.folder, self._identity = folder, dict(identity or {})
        self.restored, self.saved, self.earlier_seconds = 0, 0, 0.0
        self.failures: list[str] = []
        self._usable = folder is not None and stored_identity(folder) == self._identity
        self._keeps = folder is not None
        self._began = time.perf_counter()

    def calibration(
        self, name: str, campaign: Campaign, compute: Callable[[], tuple[EvaluatedFit, TimeResolution]]
    ) -> tuple[EvaluatedFit, TimeResolution]:
        """The calibrated model and its time steps: read if they are there, else computed and written.

        Args:
            name: of the file.
            campaign: the campaign of the diagnosis.
            compute: computes them.
        """
        if (found := self.recall(name)) is not None:
            plain, arrays = found
            return fit_of_plain(campaign, plain["fit"], arrays), TimeResolution(*plain["resolution"])
        evaluated, resolution = compute()
        if self._keeps:
            arrays = {}
            self.keep(name, {"fit": fit_as_plain(evaluated, arrays), "resolution": list(resolution)}, arrays)
        return evaluated, resolution

    def recall(self, name: str) -> tuple[Any, dict[str, np.ndarray]] | None:
        """What was kept under a name, plain data and arrays; None where there is nothing, or it is damaged."""
        found = self._read(name)
        if found is None:
            return None
        plain, arrays = found
        self.restored, self.earlier_seconds = self.restored + 1, plain["seconds"]
        self._began = time.perf_counter()
        return plain["value"], arrays

    def keep(self, name: str, value: Any, arrays: Mapping[str, np.ndarray]) -> None:
        """Store plain data and arrays under a name. Where that fails, as on a full disk, the diagnosis goes on."""
        if not self._keeps:
            return
        try:
            self._write(name, {"value": value, "seconds": self.seconds}, arrays)
        except OSError as error:
            reason = error.strerror or error
            self.failures.append(f"Stage {name} and later ones of the search could not be kept: {reason}.")
            self._keeps = False

    @property
    def kept(self) -> int:
        """The number of finished stages in the folder."""
        return self.restored + self.saved if self.folder is not None else 0

    @property
    def seconds(self) -> float:
        """Computing time [s], that of the stages that were read included."""
        return self.earlier_seconds + time.perf_counter() - self._began

    def remove(self) -> None:
        """Remove the stages, because the diagnosis is finished."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)

    def _read(self, name: str) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
        """Plain data and arrays of a stage; None where it is not finished, damaged, or of other inputs."""
        if not self._usable:
            return None
        try:
            with (self.folder / f"{name}.npz").open("rb") as stored, np.load(stored, allow_pickle=False) as file:
                arrays = {key: file[key] for key in file.files}
            return json.loads(str(arrays.pop("plain"))), arrays
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def _write(self, name: str, plain: dict[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        if not self._usable:
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder.mkdir(parents=True)
            write_json(self.folder / IDENTITY_FILE, self._identity)
            self._usable = True
        with atomic_write(self.folder / f"{name}.npz") as temporary, temporary.open("wb") as file:
            np.savez(file, plain=np.array(json.dumps(plain)), **arrays)
        self.saved += 1


def fit_as_plain(evaluated: EvaluatedFit, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """A fit as plain data, from which it is restored without any fit; its arrays are added to `arrays`."""
    problem = evaluated.fit.problem
    return _as_plain(
        {
            "fit": evaluated.fit, "residuals": evaluated.residuals, "bench": evaluated.bench,
            "solver_error": problem.solver_error, "time_errors": problem.time_errors,
            "tightening": problem.campaign.tightening, "unpredictable": problem.campaign.unpredictable,
        },
        arrays,
    )  # fmt: skip


def _as_plain(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if isinstance(value, np.ndarray):
        name = f"array_{len(arrays)}"
        arrays[name] = np.asarray(value, float)
        return [ARRAY, name]
    if dataclasses.is_dataclass(value):  # a fit problem follows from the campaign
        value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.name != "problem"}
    if isinstance(value, Mapping):
        return {name: _as_plain(of, arrays) for name, of in value.items()}
    return [_as_plain(of, arrays) for of in value] if isinstance(value, tuple) else value


def _from_plain(plain: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if isinstance(plain, dict):
        return {name: _from_plain(of, arrays) for name, of in plain.items()}
    if not isinstance(plain, list):
        return plain
    return arrays[plain[1]] if plain[:1] == [ARRAY] else tuple(_from_plain(of, arrays) for of in plain)


def fit_of_plain(campaign: Campaign, plain: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> EvaluatedFit:
    """A fit of the model without any candidate, from plain data.

    Args:
        campaign: the campaign of the diagnosis.
        plain: what `fit_as_plain` has returned.
        arrays: the arrays that it has added.
    """
    found = _from_plain(plain, arrays)
    errors, residuals, fit = found["time_errors"], found["residuals"], found["fit"]
    campaign = with_corrected_time(campaign, errors) if errors else campaign
    campaign = without_missing(dataclasses.replace(campaign, tightening=found["tightening"]), residuals)
    problem = calibration_problem(with_unpredictable_part(campaign, found["unpredictable"]))
    problem = dataclasses.replace(problem, solver_error=found["solver_error"], time_errors=errors)
    fit |= {
        "outcomes": tuple(PredictedSignals(*outcome) for outcome in fit["outcomes"]),
        "resolution": TimeResolution(*fit["resolution"]),
    }
    return EvaluatedFit(Fit(problem, **fit), residuals, BenchEstimate(**found["bench"]))


def stored_identity(folder: Path) -> dict[str, str] | None:
    """The identity of the inputs of the stages in a folder; None where there are none."""
    try:
        found = json.loads((folder / IDENTITY_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def diagnosis_identity(campaign: Campaign, more: Iterable[type[Effect]] = ()) -> dict[str, str]:
    """Everything that a diagnosis depends on: what it is for the user, and a hash of it.

    Args:
        campaign: measurements, model and priors.
        more: effect classes of the user.
    """
    machine = [dump_config(campaign.machine, Simulation()), *sorted(effect_code(campaign.machine).items())]
    description = [
        campaign.name, _plain_spreads(campaign.uncertain),
        [(name, channel.unit, channel.noise) for name, channel in campaign.channels.items()],
        [
            (run.name, run.use.value, sorted(run.conditions.items()), _plain_spreads(run.uncertain))
            for run in campaign.runs
        ],
    ]  # fmt: skip
    samples = hashlib.sha256()
    for run in campaign.runs:
        tables = {"time": run.time, **run.signals}
        for drive, recorded in run.recordings.items():
            tables[f"drive {drive}"] = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(recorded)])
        for name, values in tables.items():
            samples.update(f"{run.name} {name} {len(values)} ".encode())
            samples.update(np.ascontiguousarray(values, "<f8").tobytes())
    effects = [(kind.id, _source_hash(kind)) for kind in more]  # beside the whole library
    return {
        "the model": _hash(machine),
        "the campaign's description": _hash(description),
        "the measured samples": samples.hexdigest(),
        "the effects to consider": _hash([effects, None]),
        "the program": _hash(sorted(program_versions().items())),
    }


def program_versions() -> dict[str, str]:
    """The versions that determine the result of a diagnosis, with a hash of the code that it runs."""
    return versions() | {"diagnosis code": runtime.code_hash(CODE_PACKAGES)[:12]}


def _plain_spreads(spreads: Mapping[str, Spread]) -> list[tuple[str, float, bool]]:
    return [(name, spread.size, spread.is_absolute) for name, spread in sorted(spreads.items())]


def _hash(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def _source_hash(kind: type) -> str:
    """Hash of the file that defines a class; of its name where it has no file."""
    path = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return hashlib.sha256(Path(path).read_bytes() if path else kind.__qualname__.encode()).hexdigest()
