"""Global sensitivity: Sobol's indices of variance (SciPy) and Morris's elementary effects (SALib)."""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

CONFIDENCE = 0.95
RESAMPLES = 200
FEWEST = 16  # rows that indices can be made of

# a function of designs: shares (0 … 1) of each axis, (designs, axes), to outputs (designs, outputs); NaN if one failed
Outputs = Callable[[np.ndarray], np.ndarray]


def sobol(f: Outputs, parameters: Sequence[str], outputs: Sequence[str], samples: int, seed: int) -> pd.DataFrame:
    """First-order and total indices with their confidence intervals, a row per output and parameter.

    S_i = V[E(y | x_i)] / V(y),   S_Ti = E[V(y | x_~i)] / V(y)

    by Saltelli's estimator of 2010 on `samples` × (parameters + 2) designs of a scrambled Sobol sequence. Rows of which
    a design failed are left out, and of the rest as many as the largest power of two; column `rows` says how many.

    Raises:
        ValueError: fewer than 16 rows are left.
    """
    a, b, mixed = sobol_designs(len(parameters), samples, seed)
    values = f(np.concatenate([a, b, mixed.reshape(-1, len(parameters))]))
    return sobol_statistics(values, parameters, outputs, samples, seed)


def sobol_designs(count: int, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A and B (samples, count), and for each parameter A with its column from B: (count, samples, count)."""
    from scipy.stats import qmc

    both = qmc.Sobol(2 * count, scramble=True, seed=np.random.default_rng(seed)).random(samples)
    a, b = both[:, :count], both[:, count:]
    mixed = np.repeat(a[None], count, axis=0)
    for i in range(count):
        mixed[i, :, i] = b[:, i]
    return a, b, mixed


def sobol_statistics(values: np.ndarray, parameters, outputs, samples: int, seed: int) -> pd.DataFrame:
    """The indices from the outputs of the designs in the order A, B, mixed; see `sobol`."""
    from scipy.stats import sobol_indices

    count = len(parameters)
    tables = values.reshape(count + 2, samples, len(outputs))
    good = np.flatnonzero(np.isfinite(tables).all(axis=(0, 2)))
    if len(good) < FEWEST:
        raise ValueError(f"only {len(good)} of {samples} rows of designs ran through; narrow the ranges")
    tables = tables[:, good[: 2 ** int(np.log2(len(good)))]]
    n = tables.shape[1]
    rows = []
    for k, output in enumerate(outputs):
        y = tables[:, :, k]
        if np.ptp(y) <= 1e-12 * np.abs(y).max():
            rows += [{"output": output, "parameter": p, "first": 0.0, "total": 0.0, "rows": n} for p in parameters]
            continue
        y = (y - y[:2].mean()) / y[:2].std()
        found = sobol_indices(func={"f_A": y[None, 0], "f_B": y[None, 1], "f_AB": y[2:, None]}, n=n,
                              rng=np.random.default_rng(seed))  # fmt: skip
        spread = found.bootstrap(confidence_level=CONFIDENCE, n_resamples=RESAMPLES)
        for i, p in enumerate(parameters):
            rows.append({
                "output": output, "parameter": p, "rows": n,
                "first": found.first_order[i], "first_low": spread.first_order.confidence_interval.low[i],
                "first_high": spread.first_order.confidence_interval.high[i],
                "total": found.total_order[i], "total_low": spread.total_order.confidence_interval.low[i],
                "total_high": spread.total_order.confidence_interval.high[i],
            })  # fmt: skip
    return pd.DataFrame(rows)


def morris(f: Outputs, parameters: Sequence[str], outputs: Sequence[str], trajectories: int, seed: int) -> pd.DataFrame:
    """Elementary effects: `mu` their mean, `mu_star` the mean of their size with its confidence, `sigma` their spread.

    A row per output and parameter; an effect is the change of the output over the whole range of the parameter, as a
    share of the output's mean. Trajectories with a failed design are left out.
    """
    from SALib.analyze import morris as analysis
    from SALib.sample import morris as sampling

    count = len(parameters)
    problem = {"num_vars": count, "names": list(parameters), "bounds": [[0.0, 1.0]] * count}
    designs = sampling.sample(problem, trajectories, num_levels=4, seed=seed)
    values = f(designs)
    good = np.isfinite(values).all(axis=1).reshape(-1, count + 1).all(axis=1)
    if good.sum() < 2:
        raise ValueError(f"only {good.sum()} of {trajectories} trajectories ran through; narrow the ranges")
    designs, values = designs[np.repeat(good, count + 1)], values[np.repeat(good, count + 1)]
    rows = []
    for k, output in enumerate(outputs):
        y = values[:, k] / np.abs(values[:, k]).mean()
        found = analysis.analyze(problem, designs, y, num_levels=4, seed=seed)
        for i, p in enumerate(parameters):
            rows.append({"output": output, "parameter": p, "mu": found["mu"][i], "mu_star": found["mu_star"][i],
                         "mu_star_conf": found["mu_star_conf"][i], "sigma": found["sigma"][i],
                         "trajectories": int(good.sum())})  # fmt: skip
    return pd.DataFrame(rows)

