"""The sensor chain of the generator: what a recorder and its sensors make of the true signals.

Links act in three places: on the true signals on a fine grid of time, on the times at which samples are taken, and on
the samples. Nothing here is shared with the sensor models of the package.
"""

import dataclasses
import enum
from collections.abc import Callable, Sequence

import numpy as np

NOISE_SAMPLES = 50000  # from which the correlation of a link's noise is taken


class Place(enum.Enum):
    """Where a link acts."""

    SIGNAL = "signal"  # (interval, trace, parameter) → trace on the fine grid
    CLOCK = "clock"  # (times, parameter) → times of the machine at which samples are taken
    NOISE = "noise"  # (rng, count, parameter) → noise of unit standard deviation
    SAMPLES = "samples"  # (rng, samples, noise, parameter) → samples
    STATEMENT = "statement"  # (rng, parameter) → stated noise over true noise, or None where it is not stated


@dataclasses.dataclass(frozen=True)
class Link:
    """One kind of link of a sensor chain.

    Args:
        id: its name.
        place: where it acts, which also says how `act` is called.
        act: what it does.
        plausible: range of its parameter, drawn log-uniformly for each campaign.
        everywhere: whether all signals have it; otherwise some.
    """

    id: str
    place: Place
    act: Callable
    plausible: tuple[float, float]
    everywhere: bool = True


@dataclasses.dataclass(frozen=True)
class DrawnLink:
    """A link with its parameter, and the signals that have it."""

    link: Link
    value: float
    signals: tuple[str, ...]

    @property
    def id(self) -> str:
        """Name, parameter and signals."""
        where = "" if self.link.everywhere else f" on {', '.join(self.signals)}"
        return f"{self.link.id} {self.value:.3g}{where}"


def draw_links(links: Sequence[Link], signals: Sequence[str], rng: np.random.Generator) -> tuple[DrawnLink, ...]:
    """Draw one to three links that act in different places."""
    wanted, chosen = rng.integers(1, 4), []
    for k in rng.permutation(len(links)):
        if len(chosen) < wanted and all(links[k].place is not c.link.place for c in chosen):
            low, high = np.log(links[k].plausible)
            some = [n for n in signals if rng.uniform() < 0.6] or [str(rng.choice(list(signals)))]
            value = float(np.exp(rng.uniform(low, high)))
            chosen.append(DrawnLink(links[k], value, tuple(signals) if links[k].everywhere else tuple(some)))
    return tuple(chosen)


def typical_noise(chain: Sequence[DrawnLink]) -> np.ndarray | None:
    """A long record of the noise of a chain, of unit standard deviation; None where it is white."""
    of_noise = [link for link in chain if link.link.place is Place.NOISE]
    return of_noise[0].link.act(np.random.default_rng(0), NOISE_SAMPLES, of_noise[0].value) if of_noise else None
