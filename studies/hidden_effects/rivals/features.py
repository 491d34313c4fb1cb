"""Features of a case for a classifier: one row for each suspect, and one for the case.

All follow from the residual of the calibrated model and the table of signatures; none names a bench or a campaign.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from edhas_jax.machine.effects import LIBRARY
from studies.hidden_effects.answers import SENSOR_PLACE, places_of
from studies.hidden_effects.rivals.grams import Grams, grams_of
from studies.hidden_effects.signatures import SignatureTable

BANDS = (0.0, 20.0, 60.0, 200.0, 600.0, math.inf)  # Hz, of the spectra
SIGNALS = (
    "voltage", "current", "piston_position", "outlet_pressure", "outlet_flow", "head_pressure", "rod_pressure",
    "cylinder_position",
)  # fmt: skip
KINDS = tuple(kind.id for kind in LIBRARY)
SENSOR_KINDS = ("sensor_lag", "sensor_delay", "sensor_gain", "sensor_offset")
SUSPECT_FEATURES = (
    "cosine", "fall_share", "log_fall", "rank", "over_best", "over_best_elsewhere", "over_best_at_place",
    "beside_best_other", "positive_runs", "spread_of_weights", "left_out_share", "log_weight", "largest_signal_share",
    "points", "is_sensor", "kind",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Features:
    """Features of a case.

    Args:
        names: the suspects.
        suspects: their features (suspects, n).
        case: features of the case (k,), NaN where a signal is not measured.
    """

    names: tuple[str, ...]
    suspects: np.ndarray
    case: np.ndarray

    def as_json(self) -> dict[str, Any]:
        """As plain data."""
        plain = {"names": list(self.names), "suspects": self.suspects.tolist(), "case": self.case.tolist()}
        plain["case"] = [None if math.isnan(v) else v for v in plain["case"]]
        return plain

    @classmethod
    def from_json(cls, plain: dict[str, Any]) -> "Features":
        """From plain data."""
        case = [math.nan if v is None else v for v in plain["case"]]
        return cls(tuple(plain["names"]), np.array(plain["suspects"], float), np.array(case))


def features_of(table: SignatureTable, intervals: tuple[float, ...]) -> Features:
    """The features of a case.

    Args:
        table: residual and signatures.
        intervals: sample interval of each run [s].
    """
    grams = grams_of(table)
    return Features(grams.names, _of_suspects(grams), _of_case(table, intervals))


def _of_suspects(grams: Grams) -> np.ndarray:
    whole = grams.fitted_to(range(len(grams.by_run)))
    falls, square = whole.falls(), float(whole.projected[0, 0])
    best = np.array([columns[np.argmax(falls[columns])] for columns in grams.columns])
    fall = falls[best]
    places = np.array([(places_of(name) or ("",))[0] for name in grams.names])
    ranks = np.empty(len(fall))
    ranks[np.argsort(-fall)] = np.arange(len(fall))
    left_out = _falls_on_runs_left_out(grams, best)
    of_runs = [grams.fitted_to([run]).projected for run in range(len(grams.by_run))]
    rows = []
    for k, name in enumerate(grams.names):
        others = np.arange(len(fall)) != k
        same = others & (places == places[k])
        elsewhere = others & (places != places[k])
        rival = int(np.argmax(np.where(others, fall, -1.0)))
        both = whole.weights(np.array([best[rival], best[k]]))[1] if min(fall[k], fall[rival]) > 0.0 else fall[rival]
        weights = np.array([_weight(projected, int(best[k])) for projected in of_runs])
        positive = float(np.mean(weights > 0.0))
        spread = float(weights.std() / max(abs(weights.mean()), 1e-12))
        rows.append([
            math.sqrt(fall[k] / square), fall[k] / square, math.log10(1.0 + fall[k]), ranks[k],
            _ratio(fall[k], fall[others].max(initial=0.0)), _ratio(fall[k], fall[elsewhere].max(initial=0.0)),
            _ratio(fall[k], fall[same].max(initial=0.0)), (both - fall[rival]) / square, positive, min(spread, 100.0),
            left_out[k], math.log10(max(_weight(whole.projected, int(best[k])), 1e-4)),
            _largest_signal_share(grams, int(best[k])),
            float(len(grams.columns[k])), float(places[k] == SENSOR_PLACE), _kind(name),
        ])  # fmt: skip
    return np.array(rows)


def _ratio(a: float, b: float) -> float:
    """The ratio of two falls of χ², limited to 0.01 … 100."""
    return float(np.clip((a + 1.0) / (b + 1.0), 0.01, 100.0))


def _weight(projected: np.ndarray, column: int) -> float:
    """The weight of a signature alone, from projected scalar products; 0 where nothing of it remains."""
    square = projected[1 + column, 1 + column]
    return float(projected[0, 1 + column] / square) if square > 0.0 else 0.0


def _falls_on_runs_left_out(grams: Grams, best: np.ndarray) -> np.ndarray:
    """For each suspect the fall of χ² on runs left out over their χ² (suspects,)."""
    runs = range(len(grams.by_run))
    before, after = 0.0, np.zeros(len(best))
    for left_out in runs:
        rest = [r for r in runs if r != left_out]
        if not rest:
            continue
        fit = grams.fitted_to(rest)
        none = fit.error_on(left_out, np.zeros(0, int), np.zeros(0))
        before += none
        for k, column in enumerate(best):
            columns = np.array([column])
            usable = fit.projected[1 + column, 1 + column] > 0.0
            after[k] += fit.error_on(left_out, columns, fit.weights(columns)[0]) if usable else none
    return np.clip(1.0 - after / before, -1.0, 1.0) if before > 0.0 else np.zeros(len(best))


def _largest_signal_share(grams: Grams, column: int) -> float:
    """The share of the scalar product with the residual that one signal has."""
    index = 1 + grams.coordinates + column
    overlaps = np.abs(grams.blocks[:, :, 0, index].sum(axis=0))
    return float(overlaps.max() / overlaps.sum()) if overlaps.sum() > 0.0 else 1.0


def _kind(name: str) -> float:
    """The number of an effect or kind of fault."""
    kind = name.partition(" on ")[0]
    return float((KINDS + SENSOR_KINDS).index(kind)) if kind in KINDS + SENSOR_KINDS else -1.0


def _of_case(table: SignatureTable, intervals: tuple[float, ...]) -> np.ndarray:
    """Sizes of residual and of what is unexplained, by signal with spectrum and memory, and by run."""
    left = table.unexplained
    rms_of_runs = [_rms(left[table.run == r]) for r in range(len(table.run_names))]
    out = [
        math.log10(_rms(table.residual)), math.log10(_rms(left)), float(len(table.run_names)),
        float(len(table.signal_names)), math.log10(len(left)), max(rms_of_runs) / float(np.median(rms_of_runs)),
    ]  # fmt: skip
    for name in SIGNALS:
        if name not in table.signal_names:
            out += [math.nan] * (2 + len(BANDS) - 1)
            continue
        s = table.signal_names.index(name)
        parts = [(left[(table.run == r) & (table.signal == s)], intervals[r]) for r in range(len(table.run_names))]
        parts = [(part, interval) for part, interval in parts if len(part) > 2]
        whole = np.concatenate([part for part, _ in parts])
        memory = sum(float(part[1:] @ part[:-1]) for part, _ in parts) / max(float(whole @ whole), 1e-300)
        out += [math.log10(_rms(whole)), memory, *_spectrum(parts)]
    return np.array(out)


def _spectrum(parts: list[tuple[np.ndarray, float]]) -> np.ndarray:
    """The shares of the sum of squares in the bands of frequency."""
    total = np.zeros(len(BANDS) - 1)
    for part, interval in parts:
        power = np.square(np.abs(np.fft.rfft(part)))
        frequency = np.fft.rfftfreq(len(part), interval)
        total += [power[(frequency >= a) & (frequency < b)].sum() for a, b in zip(BANDS, BANDS[1:], strict=False)]
    return total / max(float(total.sum()), 1e-300)


def _rms(values: np.ndarray) -> float:
    return max(math.sqrt(float(np.mean(np.square(values)))), 1e-12) if len(values) else 1e-12
