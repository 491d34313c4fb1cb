"""The measurement chains of a model's signals, with numbers of their own that a fit may look for."""

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import numpy as np

from edhas_jax.core import structs
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.measurements.prior import Unknown
from edhas_jax.measurements.sensor_models import Link, record

BLOCK = 1024  # traces are continued to a multiple of this many samples, so that few lengths are compiled


@dataclasses.dataclass(frozen=True)
class Instruments:
    """A chain of links by signal name. A parameter of a link is called `signal.link_id.parameter`."""

    chains: Mapping[str, tuple[Link, ...]] = dataclasses.field(default_factory=dict)

    def find(self, name: str) -> tuple[str, int, str] | None:
        """Signal, place in its chain and field of a parameter; None for a name that belongs to the machine.

        Raises:
            ParameterError: the signal has a chain, but no such link or parameter.
        """
        signal, _, rest = name.partition(".")
        if signal not in self.chains:
            return None
        link_id, _, field = rest.partition(".")
        for place, link in enumerate(self.chains[signal]):
            if link.id == link_id and field in (p.name for p in structs.parameters(type(link))):
                return signal, place, field
        raise ParameterError(f"{name}: the chain of {signal} has no such parameter")

    def record(
        self, time: np.ndarray, values: dict[str, np.ndarray], slopes: dict[str, np.ndarray] | None,
        unknowns: Sequence[Unknown], x: np.ndarray,
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray] | None]:  # fmt: skip
        """Signals (n,) and slopes (n, unknowns) as recorded; `x` are the coordinates of the unknowns."""
        owners = [self.find(u.name) for u in unknowns]
        values, slopes = dict(values), None if slopes is None else dict(slopes)
        for signal, chain in self.chains.items():
            if signal not in values:
                continue
            chain = list(chain)
            for u, owner, coordinate in zip(unknowns, owners, x, strict=True):
                if owner and owner[0] == signal:
                    chain[owner[1]] = structs.replace(chain[owner[1]], **{owner[2]: float(u.value(coordinate))})
            chain = jax.tree.map(np.asarray, tuple(chain))
            n, more = len(time), -len(time) % BLOCK
            step = time[-1] - time[-2]
            longer = np.concatenate([time, time[-1] + step * np.arange(1, more + 1)])
            trace = np.pad(values[signal], (0, more), mode="edge")
            values[signal] = np.asarray(_record(chain, longer, trace))[:n]
            if slopes is None:
                continue
            turns = jax.tree.map(lambda leaf: np.zeros(len(x)), chain)
            for j, (u, owner) in enumerate(zip(unknowns, owners, strict=True)):
                if owner and owner[0] == signal:
                    getattr(turns[owner[1]], owner[2])[j] = u.slope(x[j])
            bent = np.pad(slopes[signal], ((0, more), (0, 0)), mode="edge")
            slopes[signal] = np.asarray(_bend(chain, longer, trace, turns, bent))[:n]
        return values, slopes


_record = jax.jit(record)


@jax.jit
def _bend(chain, time, trace, turns, slopes):
    """The derivative of what is recorded along changes of the chain's parameters and of the trace, column by column."""

    def along(turn, slope):
        return jax.jvp(lambda c, v: record(c, time, v), (chain, trace), (turn, slope))[1]

    return jax.vmap(along, in_axes=(0, 1), out_axes=1)(turns, slopes)
