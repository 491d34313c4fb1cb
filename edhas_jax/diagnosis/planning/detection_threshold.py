"""The products of signatures over runs, and what is left of them beyond what known parameters can imitate.

A suspect at coordinates x of its own parameters changes the signals by s, in units of noise. With J the slopes of the
signals by what is uncertain, continued by the prior, what no other value of the known parameters explains is

    E = s − J (JᵀJ + P)⁻¹ Jᵀ s,   |E|² = sᵀs − sᵀJ (JᵀJ + P)⁻¹ Jᵀs,   P = diag(1 where there is a prior)

It needs only products of columns, which add up over runs, so that a run more or less costs no simulation.
"""


import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.diagnosis.search.candidates import Suspect, problem_of, unknowns_of
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_chain import Instruments
from edhas_jax.measurements.predicted_signals import Case, Model
from edhas_jax.measurements.prior import Law, Unknown

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



SEEN = math.sqrt(30.0)  # length in noise from which a signature stands out among forty suspects
LADDER = {Law.FACTOR: (-2.0, -1.0, 0.0, 1.0, 2.0), Law.SHIFT: (0.02, 0.1, 0.4, 1.0, 2.0)}
FURTHEST = 100.0  # times the strongest that was simulated: nothing is said beyond


@dataclasses.dataclass(frozen=True)
class Visible:
    """From what size a suspect would be seen.

    Its first parameter, `unknown`, is taken as its size: the effect is `absent` at that value (SI; inf where it fades
    as the parameter grows) and seen from `size` on, NaN where even the strongest plausible effect stays unseen.
    `share` is the smallest strength that is seen over the strongest plausible one, above 1 extrapolated. `x` are the
    coordinates, of those simulated, nearest to the threshold and above it, or the strongest ones.
    """

    suspect: Suspect
    unknown: Unknown | None
    absent: float
    size: float
    share: float
    x: np.ndarray

    @property
    def seen(self) -> bool:
        """Whether it is seen within its plausible range."""
        return self.share <= 1.0

    @property
    def parameter(self) -> str:
        """The name of the parameter that is its size."""
        return "" if self.unknown is None else self.unknown.name.removeprefix(self.suspect.prefix)

    def threshold(self) -> str:
        """The size from which it is seen, as text with its unit."""
        if self.unknown is None or not math.isfinite(self.size):
            return ""
        if math.isinf(self.absent):
            return f"≤ {format_quantity(float(f'{self.size:.2g}'), self.unit)}"
        away = format_quantity(float(f"{self.size - self.absent:.2g}"), self.unit)
        return f"≥ {away}" if self.absent == 0.0 else f"± {away} of {format_quantity(self.absent, self.unit)}"

    def plausible(self) -> str:
        """The plausible range of the parameter, as text with units."""
        if self.unknown is None:
            return ""
        return " … ".join(format_quantity(float(f"{self.unknown.value(x):.2g}"), self.unit) for x in (-2.0, 2.0))

    @property
    def unit(self) -> str:
        """The SI unit of the parameter; an offset has that of its signal."""
        offset = self.suspect.signal is not None and self.parameter == "offset"
        return SIGNALS[self.suspect.signal].unit if offset else self.unknown.unit


def ladder(unknowns: list[Unknown]) -> np.ndarray:
    """Coordinates (points, n) from weak to strong along the first parameter, the others as they typically are."""
    if not unknowns:
        return np.zeros((1, 0))
    rows = np.zeros((len(LADDER[unknowns[0].law]), len(unknowns)))
    rows[:, 0] = LADDER[unknowns[0].law]
    return rows


def visible_from(look: Look, length: np.ndarray, campaign: Campaign) -> Visible:
    """Where along its ladder a suspect becomes visible; `length` (points,) of its signatures, NaN where one failed."""
    unknowns = unknowns_of(look.suspect, campaign)
    if not unknowns:
        share = SEEN / length[0] if length[0] > 0.0 else math.inf
        return Visible(look.suspect, None, 0.0, math.nan, float(share), look.points[0])
    u = unknowns[0]
    values = np.asarray(u.value(look.points[:, 0]))
    absent = _absent(u, values, length)
    fades = math.isinf(absent)
    ok = np.isfinite(length) & (length > 0.0) & (fades | (values > absent))
    if ok.sum() < 2:
        return Visible(look.suspect, u, 0.0, math.nan, math.inf, look.points[0])
    strength = -np.log(values) if fades else np.log(np.where(ok, values - absent, 1.0))
    order = np.flatnonzero(ok)[np.argsort(strength[ok])]
    at, seen = strength[order], np.log(np.maximum.accumulate(length[order]))
    wanted = math.log(SEEN)
    if wanted < seen[0]:  # weaker than what was simulated: a small effect goes with its size
        threshold = at[0] - (seen[0] - wanted)
    elif wanted > seen[-1]:
        threshold = at[-1] + (wanted - seen[-1])
    else:
        threshold = float(np.interp(wanted, seen, at))
    share = math.exp(threshold - at[-1]) if threshold - at[-1] < math.log(FURTHEST) else math.inf
    above = order[np.searchsorted(at, threshold)] if share < 1.0 else order[-1]
    if share > 1.0:
        return Visible(look.suspect, u, absent, math.nan, share, look.points[above])
    size = math.exp(-threshold) if fades else math.exp(threshold) + absent
    return Visible(look.suspect, u, absent, size, share, look.points[above])


def _absent(u: Unknown, values: np.ndarray, length: np.ndarray) -> float:
    """The value at which an effect is absent; infinite where it fades as the value grows."""
    if u.law is Law.SHIFT:
        return u.centre
    known = length[np.isfinite(length)]
    if len(known) > 2 and known.argmin() not in (0, len(known) - 1):  # absent inside the range, such as a gain of 1
        return 0.5 * float(values[0] + values[-1])
    return math.inf if len(known) and known[-1] < known[0] else 0.0
