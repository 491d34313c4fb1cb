"""Measurement chains of the signals of a model, whose parameters can be estimated with those of the machine."""

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import numpy as np

from edhas_jax.core import runtime, structs
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.measurements.sensor_models import SensorModel, record
from edhas_jax.measurements.unknown_parameters import UnknownParameter

TRACE_LENGTH_MULTIPLE = 1024  # samples; traces are padded to a multiple of this, so that few array shapes are compiled


@dataclasses.dataclass(frozen=True)
class Instruments:
    """A measurement chain (a tuple of sensor models) by signal name.

    A parameter of a chain is called `signal.sensor_model_id.parameter`.
    """

    chains: Mapping[str, tuple[SensorModel, ...]] = dataclasses.field(default_factory=dict)

    def find(self, name: str) -> tuple[str, int, str] | None:
        """Locate a parameter by its name.

        Args:
            name: name of a parameter of the instruments or of the machine.

        Returns:
            Signal, position in its chain and field; None for a name that does not start with a signal that has a chain.

        Raises:
            ParameterError: the signal has a chain, but no such sensor model or parameter.
        """
        signal, _, tail = name.partition(".")
        if signal not in self.chains:
            return None
        sensor_id, _, field = tail.partition(".")
        for position, sensor in enumerate(self.chains[signal]):
            if sensor.id == sensor_id and field in (p.name for p in structs.parameters(type(sensor))):
                return signal, position, field
        raise ParameterError(f"{name}: the chain of {signal} has no such parameter")

    def record(
        self, time: np.ndarray, values: dict[str, np.ndarray], sensitivities: dict[str, np.ndarray] | None,
        unknowns: Sequence[UnknownParameter], x: np.ndarray,
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray] | None]:  # fmt: skip
        """Pass the true signals of one run through their measurement chains.

        Args:
            time: sample times (samples,) [s], increasing.
            values: true signals (samples,) by name, SI.
            sensitivities: derivatives (samples, unknowns) of the true signals by the coordinates, or None.
            unknowns: the unknown parameters; those that belong to a chain are set in it.
            x: coordinates of the unknowns (unknowns,).

        Returns:
            The recorded signals and their sensitivities, including those by the parameters of the chains.
        """
        locations = [self.find(u.name) for u in unknowns]
        values, sensitivities = dict(values), None if sensitivities is None else dict(sensitivities)
        for signal, chain in self.chains.items():
            if signal not in values:
                continue
            chain = list(chain)
            for u, location, coordinate in zip(unknowns, locations, x, strict=True):
                if location and location[0] == signal:
                    _, position, field = location
                    chain[position] = structs.replace(chain[position], **{field: float(u.value(coordinate))})
            chain = jax.tree.map(np.asarray, tuple(chain))
            n, padding = len(time), -len(time) % TRACE_LENGTH_MULTIPLE
            step = time[-1] - time[-2]
            padded_time = np.concatenate([time, time[-1] + step * np.arange(1, padding + 1)])
            trace = np.pad(values[signal], (0, padding), mode="edge")
            values[signal] = np.asarray(_record(chain, padded_time, trace))[:n]
            if sensitivities is None:
                continue
            chain_tangents = jax.tree.map(lambda leaf: np.zeros(len(x)), chain)
            for j, (u, location) in enumerate(zip(unknowns, locations, strict=True)):
                if location and location[0] == signal:
                    getattr(chain_tangents[location[1]], location[2])[j] = u.derivative(x[j])
            trace_tangents = np.pad(sensitivities[signal], ((0, padding), (0, 0)), mode="edge")
            tangents = _record_tangents(chain, padded_time, trace, chain_tangents, trace_tangents)
            sensitivities[signal] = np.asarray(tangents)[:n]
        return values, sensitivities


_record = runtime.jit(record)


@runtime.jit
def _record_tangents(chain, time, trace, chain_tangents, trace_tangents):
    """Directional derivatives (samples, directions) of the recorded trace by the chain's parameters and the trace."""

    def derivative(chain_tangent, trace_tangent):
        return jax.jvp(lambda c, v: record(c, time, v), (chain, trace), (chain_tangent, trace_tangent))[1]

    return jax.vmap(derivative, in_axes=(0, 1), out_axes=1)(chain_tangents, trace_tangents)
