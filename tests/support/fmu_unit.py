"""A written FMU, stepped through FMPy."""

from pathlib import Path

import numpy as np
import pytest

from edhas_jax.export.fmu import export_fmu

fmpy = pytest.importorskip("fmpy")

INTERVAL = 5e-4  # s between communication points


class Unit:
    """A written unit, with its description and its instances in FMPy."""

    def __init__(self, path: Path, config, inputs=()):
        self.path, self.config = path, config
        self.fmu = export_fmu(config, path, inputs)
        self.description = fmpy.read_model_description(str(path))
        self.folder = fmpy.extract(str(path), str(path.with_suffix("")))
        self.outputs = [v.name for v in self.fmu.program.outputs]
        self.number = {v.name: v.valueReference for v in self.description.modelVariables}

    def instance(self, **values):
        """An initialised instance, with parameters or inputs set to `values`."""
        from fmpy.fmi2 import FMU2Slave

        identifier = self.description.coSimulation.modelIdentifier
        instance = FMU2Slave(
            guid=self.description.guid, unzipDirectory=self.folder, modelIdentifier=identifier
        )
        instance.instantiate()
        instance.setupExperiment()
        instance.enterInitializationMode()
        self.set_values(instance, **values)
        instance.exitInitializationMode()
        return instance

    def set_values(self, instance, **values) -> None:
        """Set inputs or parameters."""
        instance.setReal([self.number[n] for n in values], list(values.values()))

    def read_outputs(self, instance) -> list[float]:
        """All outputs."""
        return instance.getReal([self.number[n] for n in self.outputs])

    def run(self, instance, count: int, first: int = 0, interval: float = INTERVAL, before=lambda t: {}) -> dict:
        """The outputs at `count` communication points, a step after each; `before(t)` gives the inputs at time t."""
        rows = []
        for k in range(first, first + count):
            self.set_values(instance, **before(k * interval))
            rows.append(self.read_outputs(instance))
            instance.doStep(k * interval, interval)
        return dict(zip(self.outputs, np.array(rows).T, strict=True))


def difference(columns, signals) -> float:
    """The largest difference of any signal, as a share of its range."""

    def share(got, expected):
        # a constant signal differs by the rounding error of its value
        span = max(np.ptp(expected), 1e-9 * np.abs(expected).max()) or 1.0
        return np.abs(got - expected[: len(got)]).max() / span

    return max(share(v, np.asarray(signals[n])) for n, v in columns.items())
