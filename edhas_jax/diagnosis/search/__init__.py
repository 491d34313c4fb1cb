"""Search for effects that a machine model lacks: forward selection by score test and refit, and a backward pass.

Four scales measure how much a candidate explains. Names and docstrings state which one is meant:

* chi-square: predicted fall of χ² = Σ(residual/noise)², from the score test (`screening.Score.chi_square_fall`);
* log-evidence: log of the marginal likelihood of one fit, by Laplace's method (`evaluated_fit.EvaluatedFit`);
* log-evidence gain: difference of two log-evidences, in nats (`trial.Trial.log_evidence_gain`);
* probability: of a name, of nothing and of an unknown cause, relative to what is left unexplained (`answer.Answer`).

Half a fall of χ² is comparable with a log-evidence gain before the gain is charged for the added parameters.
"""
