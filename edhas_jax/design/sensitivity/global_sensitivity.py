"""Global sensitivity of any model: Sobol indices of variance (SciPy) and Morris elementary effects (SALib)."""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

CONFIDENCE = 0.95
BOOTSTRAP_RESAMPLES = 200
MIN_ROWS = 16  # of a Sobol sample, for indices
MIN_TRAJECTORIES = 2
MORRIS_LEVELS = 4  # grid levels of a parameter
MIN_RELATIVE_RANGE = 1e-12  # of an output; below it the output is constant

# outputs (designs, outputs) of designs given as fractions 0 … 1 of their ranges (designs, parameters); NaN if failed
Model = Callable[[np.ndarray], np.ndarray]


def sobol_indices(
    model: Model, parameters: Sequence[str], outputs: Sequence[str], samples: int, seed: int
) -> pd.DataFrame:
    """First-order and total Sobol indices with bootstrap confidence intervals.

    S_i = V[E(y | x_i)] / V(y),   S_Ti = E[V(y | x_~i)] / V(y)

    Rows with a failed design are discarded, and the largest power of two of the remaining rows is used.

    Args:
        model: evaluated at `samples` × (parameters + 2) designs of a scrambled Sobol sequence.
        parameters: names of the parameters.
        outputs: names of the outputs.
        samples: rows of the sample, a power of two.
        seed: of the sample.

    Returns:
        A row per output and parameter: `first` and `total` with the limits of their 95 % intervals, and the number of
        `rows` used.

    Raises:
        ValueError: fewer than `MIN_ROWS` rows are valid.

    Source: Saltelli's estimator of 2010.
    """
    a, b, mixed = saltelli_sample(len(parameters), samples, seed)
    values = model(np.concatenate([a, b, mixed.reshape(-1, len(parameters))]))
    return sobol_indices_of(values, parameters, outputs, samples, seed)


def saltelli_sample(count: int, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two samples A, B (samples, count), and for each parameter A with this column from B: (count, samples, count)."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(2 * count, scramble=True, seed=np.random.default_rng(seed)).random(samples)
    a, b = sequence[:, :count], sequence[:, count:]
    mixed = np.repeat(a[None], count, axis=0)
    for i in range(count):
        mixed[i, :, i] = b[:, i]
    return a, b, mixed


def sobol_indices_of(
    values: np.ndarray, parameters: Sequence[str], outputs: Sequence[str], samples: int, seed: int
) -> pd.DataFrame:
    """The indices from the outputs at the designs A, B, mixed, shape (samples × (parameters + 2), outputs)."""
    from scipy import stats

    count = len(parameters)
    tables = values.reshape(count + 2, samples, len(outputs))
    valid = np.flatnonzero(np.isfinite(tables).all(axis=(0, 2)))
    if len(valid) < MIN_ROWS:
        raise ValueError(f"only {len(valid)} of {samples} rows of designs ran through; narrow the ranges")
    tables = tables[:, valid[: 2 ** int(np.log2(len(valid)))]]
    n = tables.shape[1]
    rows = []
    for k, output in enumerate(outputs):
        y, about = tables[:, :, k], {"output": output, "parameter": list(parameters), "rows": n}
        if np.ptp(y) <= MIN_RELATIVE_RANGE * np.abs(y).max():
            rows.append(pd.DataFrame(about | {"first": 0.0, "total": 0.0}))
            continue
        y = (y - y[:2].mean()) / y[:2].std()
        found = stats.sobol_indices(func={"f_A": y[None, 0], "f_B": y[None, 1], "f_AB": y[2:, None]}, n=n,
                                    rng=np.random.default_rng(seed))  # fmt: skip
        bootstrap = found.bootstrap(confidence_level=CONFIDENCE, n_resamples=BOOTSTRAP_RESAMPLES)
        first, total = (order.confidence_interval for order in (bootstrap.first_order, bootstrap.total_order))
        rows.append(pd.DataFrame(about | {
            "first": found.first_order, "first_low": first.low, "first_high": first.high,
            "total": found.total_order, "total_low": total.low, "total_high": total.high,
        }))  # fmt: skip
    return pd.concat(rows, ignore_index=True)


def morris_effects(
    model: Model, parameters: Sequence[str], outputs: Sequence[str], trajectories: int, seed: int
) -> pd.DataFrame:
    """Elementary effects by the method of Morris.

    An effect is the change of an output over the whole range of a parameter, as a share of the output's mean.
    Trajectories with a failed design are discarded.

    Args:
        model: evaluated at trajectories × (parameters + 1) designs.
        parameters: names of the parameters.
        outputs: names of the outputs.
        trajectories: number of trajectories.
        seed: of the sample and the confidence interval.

    Returns:
        A row per output and parameter: mean `mu` of the effects, mean `mu_star` of their magnitudes with its
        confidence, standard deviation `sigma`, and the number of `trajectories` used.

    Raises:
        ValueError: fewer than `MIN_TRAJECTORIES` trajectories are valid.
    """
    from SALib.analyze import morris as analysis
    from SALib.sample import morris as sampling

    count = len(parameters)
    problem = {"num_vars": count, "names": list(parameters), "bounds": [[0.0, 1.0]] * count}
    designs = sampling.sample(problem, trajectories, num_levels=MORRIS_LEVELS, seed=seed)
    values = model(designs)
    valid = np.isfinite(values).all(axis=1).reshape(-1, count + 1).all(axis=1)
    if valid.sum() < MIN_TRAJECTORIES:
        raise ValueError(f"only {valid.sum()} of {trajectories} trajectories ran through; narrow the ranges")
    designs, values = designs[np.repeat(valid, count + 1)], values[np.repeat(valid, count + 1)]
    rows = []
    for k, output in enumerate(outputs):
        y = values[:, k] / np.abs(values[:, k]).mean()
        found = analysis.analyze(problem, designs, y, num_levels=MORRIS_LEVELS, seed=seed)
        columns = {name: np.asarray(found[name]) for name in ("mu", "mu_star", "mu_star_conf", "sigma")}
        about = {"output": output, "parameter": list(parameters)}
        rows.append(pd.DataFrame(about | columns | {"trajectories": int(valid.sum())}))
    return pd.concat(rows, ignore_index=True)

