"""What a fitted set of effects leaves, to second order around its fit, and what further columns would take of that.

Around a fit the measurements are a linear Gaussian model of independent noise of unit variance,

    r = J x + B b + D d + τ G g + ν e,    all of x, b, d, g, e standard normal

with r the whitened residual, J the sensitivities to the unknowns (x with the priors of these), B the deviations of the
bench, D those of the laws from the library's, and G the background: all that could act anywhere (`signature_table`).
Products of these columns are taken once; every size τ and noise ν, and every further column, then costs the factor of a
small matrix.
"""

import copy
import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.inference.fit.evaluated_fit import remaining
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.likelihood.run_equations import run_columns
from edhas_jax.inference.likelihood.symmetric_matrices import inverse_factor, regularised_inverse


@dataclasses.dataclass(frozen=True)
class Floor:
    """What a model is allowed to leave when the effect of further columns is predicted.

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

    Attributes:
        laws: the place of these deviations among the columns.
    """

    def __init__(self, fit: Fit, deviations: Sequence[Mapping[str, np.ndarray]] | None, background: np.ndarray):
        problem, blocks, residuals = fit.problem, [], []
        unknowns, runs, own = len(problem.unknowns), problem.model().runs, len(problem.bench.of_runs)
        of_laws = 0 if deviations is None else next(iter(deviations[0].values())).shape[1]
        self.laws = slice(unknowns + problem.bench.count, unknowns + problem.bench.count + of_laws)
        for r, (run, outcome) in enumerate(zip(runs, fit.outcomes, strict=True)):
            further = None if deviations is None else deviations[r]
            rows, _ = run_columns(problem.campaign, run, outcome, problem.unknowns, problem.bench, further)
            of_run = np.zeros((len(rows), own * len(runs)))  # the deviations of a run have rows of their own
            of_run[:, own * r : own * (r + 1)] = rows[:, :own]
            blocks.append(np.concatenate([rows[:, own:-1], of_run], axis=1))
            residuals.append(rows[:, -1])
        self.columns = np.concatenate([np.concatenate(blocks), background], axis=1)
        self.residual = np.concatenate(residuals)
        self.first_of_background = self.columns.shape[1] - background.shape[1]
        self.prior = np.ones(self.columns.shape[1])
        self.prior[:unknowns] = [float(u.has_prior) for u in problem.unknowns]
        self.pull = np.zeros(self.columns.shape[1])
        self.pull[:unknowns] = -self.prior[:unknowns] * fit.x
        self.x, self.penalty = fit.x, float(self.prior[:unknowns] @ np.square(fit.x))
        self.gram, self.right = self.columns.T @ self.columns, self.columns.T @ self.residual
        self.square = float(self.residual @ self.residual)

    def with_prior(self, places: np.ndarray, mean: np.ndarray, spread: np.ndarray) -> "LinearModel":
        """The model with other priors of some unknowns of the fit.

        Args:
            places: their places (k,) among the unknowns.
            mean: means (k,) of the new priors, as coordinates.
            spread: their standard deviations (k,), in those of the former priors.
        """
        other, former = copy.copy(self), self.prior[places] * np.square(self.x[places])
        other.prior, other.pull = self.prior.copy(), self.pull.copy()
        other.prior[places] = 1.0 / np.square(spread)
        other.pull[places] = -other.prior[places] * (self.x[places] - mean)
        other.penalty += float(np.sum(other.prior[places] * np.square(self.x[places] - mean)) - np.sum(former))
        return other

    @property
    def samples(self) -> int:
        """Number of whitened samples."""
        return len(self.residual)

    @property
    def is_finite(self) -> bool:
        """Whether the model and its derivatives are finite at every measured sample."""
        return bool(np.isfinite(self.gram).all() and np.isfinite(self.square))

    def products(self, rows: np.ndarray) -> np.ndarray:
        """The products (k, q + 1) of further columns, given as rows (k, m), with all columns and with the residual."""
        columns = np.concatenate([self.columns, self.residual[:, None]], axis=1)
        return (rows @ columns.astype(rows.dtype)).astype(float)

    def at(self, floor: Floor) -> "FlooredModel":
        """The model with a floor; each call factors the information of all coefficients anew."""
        return FlooredModel(self, floor)


class FlooredModel:
    """A linear model with a floor, its coefficients marginalised.

    Args:
        model: the model.
        floor: the floor.
    """

    def __init__(self, model: LinearModel, floor: Floor):
        self.floor, self._of = floor, model
        self._scale = np.ones(model.columns.shape[1])  # of the columns: τ for those of the background
        self._scale[model.first_of_background :] = floor.size
        scale, proper = self._scale / floor.noise, model.prior[model.prior > 0.0]
        # a factor W of the inverse W Wᵀ of the information A of the coefficients, ln det A less that of the priors, and
        # Wᵀ times its right side
        self._factor, log_determinant = inverse_factor(model.gram * scale[:, None] * scale + np.diag(model.prior))
        self._log_information = log_determinant - float(np.sum(np.log(proper)))
        self._right = self._factor.T @ (model.right * scale / floor.noise + model.pull)

    @functools.cached_property
    def left(self) -> np.ndarray:
        """The residual (m,) without what all columns take of it, in units of the noise."""
        return self._of.residual - self._of.columns @ (self._scale * (self._factor @ self._right))

    @functools.cached_property
    def excess(self) -> float:
        """½ (Σ left² − samples) [nats] beyond the scatter of noise, see `remaining`."""
        return remaining(0.5 * (float(self.left @ self.left) - self._of.samples), self._of.samples)

    @functools.cached_property
    def squares(self) -> float:
        """½ Σ squares of all coefficients [nats]: how unusual their values are."""
        explained = (self._of.square - float(self.left @ self.left)) / self.floor.noise**2
        return 0.5 * max(float(explained + self._of.penalty - self._right @ self._right), 0.0)

    @functools.cached_property
    def fall_by_laws(self) -> float:
        """The fall of ½ Σ left² and `squares` by the deviations of laws [nats]."""
        factor = self._factor[self._of.laws]
        estimate = factor @ self._right
        return 0.5 * float(estimate @ regularised_inverse(factor @ factor.T) @ estimate)

    @functools.cached_property
    def numbers(self) -> float:
        """What its numbers cost [nats]: `squares`, + ½ ln det of their information, the penalty of Laplace's method."""
        return self.squares + 0.5 * self._log_information

    @property
    def misfit(self) -> float:
        """½ Σ left² and what its numbers cost [nats]; less is better.

        Without a floor it is the negative log marginal likelihood of the set but for a constant.
        """
        return 0.5 * float(self.left @ self.left) + self.numbers

    def reduced(self, products: np.ndarray, gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Products of further columns with each other and with the residual, all present columns marginalised.

        Args:
            products: their products with the present columns, see `LinearModel.products`.
            gram: their products (k, k) with each other, or only the diagonal (k,) of these.

        Returns:
            The same as `gram`, and (k,), both in units of the noise of the floor.
        """
        variance = self.floor.noise**2
        half = (products[:, :-1] * (self._scale / variance)) @ self._factor
        taken = np.sum(half**2, axis=1) if gram.ndim == 1 else half @ half.T
        return gram / variance - taken, products[:, -1] / variance - half @ self._right


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
    """The floor for predictions: the size of the background with the smallest misfit, and the noise that is left then.

    Args:
        model: the model.
        ends: see `effective_samples`.
        sizes: sizes that are compared.
    """
    found = (_with_noise_left(model, ends, float(size)) for size in sizes)
    return min(found, key=lambda at: at.excess + at.numbers).floor


def _with_noise_left(model: LinearModel, ends: np.ndarray, size: float) -> FlooredModel:
    """The model with a size of the background, and ν² = Σ left²/effective samples."""
    found = model.at(Floor(size))
    for _ in range(4):
        noise = max(1.0, float(np.sqrt(found.left @ found.left / effective_samples(found.left, ends))))
        if abs(np.log(noise / found.floor.noise)) < 0.03:
            break
        found = model.at(Floor(size, noise))
    return found
