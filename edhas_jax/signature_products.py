"""The products of signatures over runs, and what is left of them beyond what known parameters can imitate.

A suspect at coordinates x of its own parameters changes the signals by s, in units of noise. With J the slopes of the
signals by what is uncertain, continued by the prior, what no other value of the known parameters explains is

    E = s − J (JᵀJ + P)⁻¹ Jᵀ s,   |E|² = sᵀs − sᵀJ (JᵀJ + P)⁻¹ Jᵀs,   P = diag(1 where there is a prior)

It needs only products of columns, which add up over runs, so that a run more or less costs no simulation.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.campaign import BenchRun, Campaign
from edhas_jax.instruments import Instruments
from edhas_jax.prediction import Case, Model
from edhas_jax.suspects import Suspect, problem_of, unknowns_of

SMALL = 1e-12  # share of a signature's square that is rounding


class Look(NamedTuple):
    """A suspect at some sizes: coordinates (points, n) of its own parameters."""

    suspect: Suspect
    points: np.ndarray


class Products:
    """For each run the products, over its samples, of the slopes of p known parameters and k signatures.

    `of` is (runs, p + k, p + k), in units of noise. A signature that cannot be simulated is 0 and in `failed` (k,).
    """

    def __init__(
        self, campaign: Campaign, runs: Sequence[BenchRun], looks: Sequence[Look], per_sample: int,
        on_progress: Callable[[str, float], None],
    ):  # fmt: skip
        self._campaign, self._runs, self._steps = campaign, tuple(runs), per_sample
        known = problem_of(campaign, campaign.machine, Instruments(), ()).unknowns
        self._prior = np.array([float(u.prior) for u in known])
        every = tuple(range(len(self._runs)))
        on_progress("derivatives by what is uncertain", 0.0)
        model = Model(campaign, campaign.machine, known, self._runs)
        found = model.outcomes([Case(np.zeros(len(known)), every)], per_sample, derive=bool(known))[0]
        self._base = [found[r].values for r in every]
        slopes = [found[r].slopes or {n: v[:, None][:, :0] for n, v in found[r].values.items()} for r in every]
        columns = [[self._white(r, slopes[r])] for r in every]
        for k, look in enumerate(looks):
            on_progress(look.suspect.name, k / len(looks))
            changed = self._recorded if look.suspect.signal is not None else self._simulated
            for rows in changed(look):
                for r in every:
                    change = {n: rows[r][n] - self._base[r][n] for n in rows[r]}
                    columns[r].append(self._white(r, change)[:, None])
        tables = [np.concatenate(parts, axis=1) for parts in columns]
        broken = ~np.all([np.isfinite(table).all(axis=0) for table in tables], axis=0)
        for table in tables:
            table[:, broken] = 0.0
        self.failed = broken[len(known) :]
        self.of = np.array([table.T @ table for table in tables])

    def left(self, runs: Sequence[int] | slice = slice(None)) -> np.ndarray:
        """EᵀE (k, k) of all signatures when these runs (by index) are made."""
        return self.left_of(self.of[runs].sum(axis=0))

    def left_of(self, products: np.ndarray) -> np.ndarray:
        """EᵀE (k, k) from products (p + k, p + k) summed over runs."""
        p = len(self._prior)
        own, mixed, known = products[p:, p:], products[:p, p:], products[:p, :p] + np.diag(self._prior)
        out = own - mixed.T @ np.linalg.solve(known, mixed)
        square = np.maximum(np.diag(out), SMALL * np.diag(own))
        out[np.diag_indices_from(out)] = square
        return out

    def _white(self, r: int, found: dict[str, np.ndarray]) -> np.ndarray:
        """Signals (n,) or slopes (n, p) of a run one below the other, in units of noise."""
        names = self._runs[r].signals or self._campaign.channels
        return np.concatenate([found[n] / self._campaign.channels[n].noise for n in names])

    def _simulated(self, look: Look) -> list[list[dict[str, np.ndarray]]]:
        """The signals of every run with an effect mounted, at each point."""
        problem = problem_of(self._campaign, self._campaign.machine, Instruments(), (), look.suspect)
        model = Model(self._campaign, problem.machine, problem.unknowns, self._runs, problem.instruments)
        every = tuple(range(len(self._runs)))
        nominal = np.zeros(len(problem.unknowns) - look.points.shape[1])
        cases = [Case(np.concatenate([nominal, x]), every) for x in look.points]
        found = model.outcomes(cases, self._steps, derive=False)
        return [[one[r].values for r in every] for one in found]

    def _recorded(self, look: Look) -> list[list[dict[str, np.ndarray]]]:
        """The signals of every run with a fault of one sensor, at each point."""
        suspect, out = look.suspect, []
        unknowns = unknowns_of(suspect, self._campaign)
        for x in look.points:
            values = {u.name.removeprefix(suspect.prefix): u.value(v) for u, v in zip(unknowns, x, strict=True)}
            chain = Instruments({suspect.signal: (suspect.kind(**values),)})
            rows = zip(self._runs, self._base, strict=True)
            out.append([chain.record(run.time, base, None, (), np.zeros(0))[0] for run, base in rows])
        return out


def cosines(left: np.ndarray) -> np.ndarray:
    """How alike signatures are after the known parameters have been fitted (k, k): 0 … 1, 0 where there is nothing."""
    length = np.sqrt(np.diag(left))
    safe = np.where(length > 0.0, length, np.inf)
    return np.abs(left / np.outer(safe, safe))
