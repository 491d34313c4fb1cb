"""What a fitted set of effects leaves, to second order around its fit, and what further columns would take of that.

Around a fit the measurements are a linear Gaussian model of independent noise of unit variance,

    r = J x + B b + D d + τ G g + ν e,    all of x, b, d, g, e standard normal

with r the whitened residual, J the sensitivities to the unknowns (x with the priors of these), B the deviations of the
bench, D those of the laws from the library's, and G the background: all that could act anywhere (`signature_table`).
Products of these columns are taken once; every size τ and noise ν, and every further column, then costs the factor of a
small matrix.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.symmetric_matrices import inverse_factor
from edhas_jax.diagnosis.likelihood.run_equations import run_columns

NOISE_SIGMAS = 2.0  # scatter of a χ² of noise, in its standard deviations, that counts as none left


@dataclasses.dataclass(frozen=True)
class Floor:
    """What any model may leave.

    Args:
        size: size τ of the background, in standard deviations of the noise of all samples together.
        noise: factor ν on the noise of every sample.
    """

    size: float = 0.0
    noise: float = 1.0


class LinearModel:
    """The linear model around the fit of a set.

    Args:
        fit: the fit.
        deviations: deviations of the laws of its effects, by fitted run and signal (samples, k) in SI; None for none.
        background: columns (m, g) of the background, whitened, of all fitted runs one after another.
    """

    def __init__(self, fit: Fit, deviations: Sequence[Mapping[str, np.ndarray]] | None, background: np.ndarray):
        problem, blocks, residuals = fit.problem, [], []
        unknowns, runs, own = len(problem.unknowns), problem.model().runs, len(problem.bench.of_runs)
        for r, (run, outcome) in enumerate(zip(runs, fit.outcomes, strict=True)):
            further = None if deviations is None else deviations[r]
            rows, _ = run_columns(problem.campaign, run, outcome, problem.unknowns, problem.bench, further)
            of_run = np.zeros((len(rows), own * len(runs)))  # the deviations of a run have rows of their own
            of_run[:, own * r : own * (r + 1)] = rows[:, :own]
            blocks.append(np.concatenate([rows[:, own:-1], of_run], axis=1))
            residuals.append(rows[:, -1])
        self._columns = np.concatenate([np.concatenate(blocks), background], axis=1)
        self.residual = np.concatenate(residuals)
        self._scaled_by_size = len(self._columns.T) - background.shape[1]
        self._prior = np.ones(self._columns.shape[1])
        self._prior[:unknowns] = [float(u.has_prior) for u in problem.unknowns]
        self._pull = np.zeros(self._columns.shape[1])
        self._pull[:unknowns] = -self._prior[:unknowns] * fit.x
        self._penalty = float(self._prior[:unknowns] @ np.square(fit.x))
        self._gram, self._right = self._columns.T @ self._columns, self._columns.T @ self.residual
        self._square = float(self.residual @ self.residual)
        self._last: tuple[Floor, tuple[np.ndarray, float, np.ndarray]] | None = None

    @property
    def samples(self) -> int:
        """Number of whitened samples."""
        return len(self.residual)

    @property
    def is_finite(self) -> bool:
        """Whether the model and its derivatives are finite at every measured sample."""
        return bool(np.isfinite(self._gram).all() and np.isfinite(self._square))

    def left(self, floor: Floor) -> np.ndarray:
        """The residual (m,) without what all columns take of it, in units of the noise."""
        factor, _, half = self._solved(floor)
        return self.residual - self._columns @ (self._scale(floor) * (factor @ half))

    def misfit(self, floor: Floor) -> float:
        """What the set leaves beyond the noise, and what its numbers cost [nats]: less is better.

        ½ (Σ left² − samples), where that is more than the scatter of noise, + ½ Σ squares of all coefficients + ½ ln
        det of their information (the penalty of Laplace's method). Without a floor it is the negative log marginal
        likelihood of the set but for a constant.
        """
        _, log_information, half = self._solved(floor)
        left = self.left(floor)
        square = float(left @ left)
        numbers = self._square / floor.noise**2 + self._penalty - half @ half - square / floor.noise**2
        return 0.5 * excess(square, self.samples) + 0.5 * max(float(numbers), 0.0) + 0.5 * log_information

    def products(self, rows: np.ndarray) -> np.ndarray:
        """The products (k, q + 1) of further columns, given as rows (k, m), with all columns and with the residual."""
        columns = np.concatenate([self._columns, self.residual[:, None]], axis=1)
        return (rows @ columns.astype(rows.dtype)).astype(float)

    def reduced(self, products: np.ndarray, gram: np.ndarray, floor: Floor) -> tuple[np.ndarray, np.ndarray]:
        """Products of further columns with each other and with the residual, all present columns marginalised.

        Args:
            products: their products with the present columns, see `products`.
            gram: their products (k, k) with each other, or only the diagonal (k,) of these.
            floor: the floor.

        Returns:
            The same as `gram`, and (k,), both in units of the noise of the floor.
        """
        variance, (factor, _, right) = floor.noise**2, self._solved(floor)
        half = (products[:, :-1] * (self._scale(floor) / variance)) @ factor
        taken = np.sum(half**2, axis=1) if gram.ndim == 1 else half @ half.T
        return gram / variance - taken, products[:, -1] / variance - half @ right

    def _scale(self, floor: Floor) -> np.ndarray:
        """Factors (q,) of the columns: τ for those of the background."""
        scale = np.ones(self._columns.shape[1])
        scale[self._scaled_by_size :] = floor.size
        return scale

    def _solved(self, floor: Floor) -> tuple[np.ndarray, float, np.ndarray]:
        """With A the information of the coefficients of all columns and a its right side: W, ln det A and Wᵀa.

        W (q, q) is a factor of the inverse W Wᵀ of A. Those of the last floor are kept.
        """
        if self._last is None or self._last[0] != floor:
            scale = self._scale(floor) / floor.noise
            factor, log_information = inverse_factor(self._gram * scale[:, None] * scale + np.diag(self._prior))
            half = factor.T @ (self._right * scale / floor.noise + self._pull)
            self._last = floor, (factor, log_information, half)
        return self._last[1]


def excess(square: float, samples: int) -> float:
    """By how much a sum of squares exceeds that of noise, beyond its scatter."""
    return max(square - samples - NOISE_SIGMAS * np.sqrt(2.0 * samples), 0.0)


def effective_samples(left: np.ndarray, ends: np.ndarray) -> float:
    """How many independent samples a residual is worth: 2 (Σ S)²/Σ S² with S its periodogram.

    Args:
        left: residual (m,), its signals one after another.
        ends: where each of these ends.

    Source: the number of degrees of freedom of Satterthwaite, Biometrics Bulletin 2 (1946) 110.
    """
    parts = [part for part in np.split(left, ends[:-1]) if len(part)]
    power = np.concatenate([np.square(np.abs(np.fft.rfft(part, norm="ortho"))) for part in parts])
    # a line of the one-sided spectrum stands for two of the other one
    return float(4.0 * np.sum(power) ** 2 / np.sum(power**2))


def floor_of(model: LinearModel, ends: np.ndarray, sizes: np.ndarray) -> Floor:
    """The floor for robust fits: the size of the background with the smallest misfit, and the noise that is left then.

    Args:
        model: the model.
        ends: see `effective_samples`.
        sizes: sizes that are compared.
    """
    return min((_with_noise_left(model, ends, float(size)) for size in sizes), key=model.misfit)


def _with_noise_left(model: LinearModel, ends: np.ndarray, size: float) -> Floor:
    """The floor with a size of the background: ν² = Σ left²/effective samples."""
    noise = 1.0
    for _ in range(4):
        left = model.left(Floor(size, noise))
        new = max(1.0, float(np.sqrt(left @ left / effective_samples(left, ends))))
        if abs(np.log(new / noise)) < 0.03:
            break
        noise = new
    return Floor(size, noise)
