"""The metrics of the periodic state and their derivatives, as a computation of the host for a `HostFunction`."""

import jax
import numpy as np

from edhas_jax.design.batch.periodic_solver import BatchState, metrics_with_status
from edhas_jax.design.function.host_function import Outcome
from edhas_jax.design.gradient.fixed_point import GradientSettings, periodic_state
from edhas_jax.design.gradient.forward import MOST_TANGENTS, forward
from edhas_jax.design.gradient.reverse import reverse
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.validity import Status


def has_value(status: np.ndarray) -> np.ndarray:
    """Where the metrics are those of a periodic state within the model's validity."""
    return np.isin(status, [s for s in Status if s.is_valid and s is not Status.NOT_PERIODIC])


class PeriodicMetrics:
    """Computes metrics, and their derivatives by some parameters, of many designs at once.

    NaN stands where there is no number: values as `has_value` says, derivatives also of a machine that stalls.
    """

    def __init__(self, machine: Rig, metrics: tuple[str, ...], settings: GradientSettings):
        self._machine = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
        self._metrics, self._settings = metrics, settings

    def __call__(self, columns: dict[str, np.ndarray], fixed: None, active: tuple[str, ...]) -> Outcome:
        """See `host_function.Compute`."""
        state = periodic_state(self._machine, columns, self._settings)
        status = self.status_of(columns, state)
        values = {n: np.where(has_value(status), state.metrics[n], np.nan) for n in self._metrics}
        if not active:
            return Outcome(values, {})
        # forward mode carries a group of parameters at a time, reverse mode a metric: the fewer passes, the cheaper
        mode = forward if len(self._metrics) * MOST_TANGENTS >= len(active) else reverse
        found = mode(self._machine, columns, active, self._metrics, self._settings, state=state)
        exists = (has_value(found.status) & (found.status != Status.STALLED))[:, None]
        return Outcome(values, {n: np.where(exists, found.slopes[n], np.nan) for n in self._metrics})

    def status(self, columns: dict[str, np.ndarray]) -> np.ndarray:
        """The status (designs,) of each design, an integer of `Status`."""
        return self.status_of(columns, periodic_state(self._machine, columns, self._settings))

    def status_of(self, columns: dict[str, np.ndarray], state: BatchState) -> np.ndarray:
        """As `status`, of designs whose periodic state is known."""
        periodic = state.metrics["residual"] <= self._settings.tolerance
        return np.asarray(metrics_with_status(self._machine, columns, state.metrics, periodic)["status"])
