"""A fit and what came of it: the error before and after on all runs, what is suspicious, and a folder that keeps it."""

import dataclasses
from pathlib import Path

import numpy as np

from edhas_jax.config.run_folder import plain, write_json
from edhas_jax.config.writer import dump_config
from edhas_jax.core.units import format_quantity
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.uncertainty import Drift, Profile
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.measurement_chain import Instruments
from edhas_jax.measurements.predicted_signals import Case, Model, Outcome, levels, whitened
from edhas_jax.simulation.integrator import LARGEST_STEP
from edhas_jax.simulation.run import Simulation

UNSEEN = 0.8  # a standard error above this share of the prior's: the estimate is the prior's
ENTANGLED = 0.95  # correlation above which two unknowns cannot be told apart
FAR = 2.5  # distance from the prior's centre, in its standard deviations, that is hard to believe
DRIFTED = 3.5  # score of a run's own estimate that chance does not give among some hundred
CONFIG, RESULT = "config.yaml", "fit.json"


@dataclasses.dataclass(frozen=True)
class Calibration:
    """A fit, each run's own fit, profiles that were asked for, and the residuals of all runs before and after.

    `before` and `after`: (measured − model)/noise by run and signal. `seconds` is what it took.
    """

    fit: Fit
    drift: Drift | None
    profiles: tuple[Profile, ...]
    before: dict[str, dict[str, np.ndarray]]
    after: dict[str, dict[str, np.ndarray]]
    seconds: float

    def errors(self) -> dict[str, dict[str, dict[str, float]]]:
        """Residual over noise: {before, calibrated} × {fit, holdout} × {overall, each signal}."""
        campaign = self.fit.problem.campaign
        states = {"before": self.before, "calibrated": self.after}
        return {
            state: {use.value: levels(campaign, residuals, use) for use in Use} for state, residuals in states.items()
        }

    def unseen(self) -> list[str]:
        """The unknowns of which the measurements say next to nothing."""
        return [
            u.name for u, std in zip(self.fit.problem.unknowns, self.fit.std, strict=True) if u.prior and std > UNSEEN
        ]

    def entangled(self) -> list[tuple[str, str, float]]:
        """Pairs of unknowns that the measurements do not tell apart, with the correlation of their estimates."""
        names, table = [u.name for u in self.fit.problem.unknowns], self.fit.correlation
        rows, columns = np.nonzero(np.triu(np.abs(table) > ENTANGLED, 1))
        return [(names[i], names[j], float(table[i, j])) for i, j in zip(rows, columns, strict=True)]

    def implausible(self) -> list[str]:
        """The unknowns that were pushed to the edge of what was believed of them."""
        return [
            u.name for u, x in zip(self.fit.problem.unknowns, self.fit.x, strict=True) if u.prior and abs(x) > FAR
        ]

    def drifting(self) -> list[str]:
        """The unknowns that come out differently from run to run, the worst first."""
        if self.drift is None:
            return []
        worst = np.abs(self.drift.score).max(axis=0)
        order = [int(k) for k in np.argsort(-worst) if worst[k] > DRIFTED]
        return [self.fit.problem.unknowns[k].name for k in order]

    def findings(self) -> list[str]:
        """What an engineer should know of this fit, in sentences, the most important first."""
        errors, out = self.errors()["calibrated"], []
        judged = Use.HOLDOUT if errors["holdout"] else Use.FIT
        overall = errors[judged.value]["overall"]
        runs = "held-out runs" if judged is Use.HOLDOUT else "runs it was fitted to (none is held out)"
        worst = max((n for n in errors[judged.value] if n != "overall"), key=errors[judged.value].__getitem__)
        signal = f"worst signal {worst}, {errors[judged.value][worst]:.2f}"
        out.append(f"Residual over noise on the {runs}: {overall:.2f}; {signal}.")
        if not self.fit.converged:
            out.append("The fit has not converged: the values below are where it stopped.")
        if far := self.implausible():
            pulls = dict(zip((u.name for u in self.fit.problem.unknowns), self.fit.x, strict=True))
            told = ", ".join(f"{name} ({pulls[name]:+.1f} σ)" for name in sorted(far, key=lambda n: -abs(pulls[n])))
            out.append(
                f"Pushed far from what was believed: {told}. They may stand in for something that the model lacks."
            )
        for name in self.drifting()[:3]:
            out.append(self._drift_sentence(name))
        for name in self.unseen():
            out.append(f"These runs say next to nothing of {name}: its value is what was believed before.")
        for one, other, value in self.entangled():
            what = f"{one} and {other} cannot be told apart (correlation {value:+.3f})"
            out.append(f"{what}: a combination of them is known well, each alone less so.")
        return out

    def _drift_sentence(self, name: str) -> str:
        k = [u.name for u in self.fit.problem.unknowns].index(name)
        u, drift = self.fit.problem.unknowns[k], self.drift
        low, high = int(np.argmin(drift.score[:, k])), int(np.argmax(drift.score[:, k]))
        first, last = (
            f"{format_quantity(float(u.value(drift.x[r, k])), u.unit)} in {drift.runs[r]}" for r in (low, high)
        )
        score = np.abs(drift.score[:, k]).max()
        return (
            f"{name} drifts from run to run when each is fitted alone: {first}, {last} "
            f"({score:.0f} standard deviations apart from the common value): a sign of missing physics."
        )


def residuals_of(
    campaign: Campaign, machine: Rig, instruments: Instruments, per_sample: int
) -> dict[str, dict[str, np.ndarray]]:
    """(measured − model)/noise by run and signal, for all runs of a campaign."""
    outcomes = simulate_runs(campaign, machine, instruments, per_sample)
    return {run.name: whitened(campaign, run, outcomes[run.name]) for run in campaign.runs}


def simulate_runs(
    campaign: Campaign, machine: Rig, instruments: Instruments, per_sample: int
) -> dict[str, Outcome]:
    """What the sensors would have read, by run, `per_sample` steps from sample to sample."""
    model = Model(campaign, machine, (), campaign.runs, instruments)
    found = model.outcomes([Case(np.zeros(0), tuple(range(len(campaign.runs))))], per_sample, derive=False)[0]
    return {run.name: found[r] for r, run in enumerate(campaign.runs)}


def save_calibration(calibration: Calibration, folder: Path) -> None:
    """Write `config.yaml`, which `edhas simulate` runs, and `fit.json` into a folder that exists."""
    fit = calibration.fit
    rate = 1.0 / min(run.interval for run in fit.problem.campaign.runs)
    step = min(1.0 / rate / fit.resolution.fine, LARGEST_STEP)
    head = f"# {fit.problem.campaign.name}, calibrated by `edhas fit`; before the conditions of any run are set\n"
    text = head + dump_config(fit.machine, Simulation(step=step, sample_rate=rate))
    (folder / CONFIG).write_text(text, encoding="utf-8")
    write_json(folder / RESULT, plain(as_json(calibration)))


def estimates(fit: Fit) -> dict[str, dict]:
    """Value, standard error and unit (SI) of every unknown, as plain data."""
    units = {u.name: u.unit for u in fit.problem.unknowns}
    return {n: {"value": v, "std": fit.errors[n], "unit": units[n]} for n, v in fit.values.items()}


def as_json(calibration: Calibration) -> dict:
    """The result as plain data: values and standard errors in SI."""
    fit = calibration.fit
    names = [u.name for u in fit.problem.unknowns]
    out = {
        "campaign": fit.problem.campaign.name,
        "calibrated": estimates(fit),
        "error": calibration.errors(),
        "converged": fit.converged,
        "half_chi_square": fit.cost,
        "step": min(run.interval for run in fit.problem.campaign.runs) / fit.resolution.fine,
        "step_error_over_noise": fit.resolution.error,
        "prior_pull": dict(zip(names, map(float, fit.x), strict=True)),
        "std_over_prior": dict(zip(names, map(float, fit.std), strict=True)),
        "correlation": {
            a: dict(zip(names, map(float, row), strict=True)) for a, row in zip(names, fit.correlation, strict=True)
        },
        "not_identified": calibration.unseen(),
        "not_told_apart": [[a, b, value] for a, b, value in calibration.entangled()],
        "implausible": calibration.implausible(),
        "drifting": calibration.drifting(),
        "findings": calibration.findings(),
        "seconds": calibration.seconds,
    }
    if calibration.drift is not None:
        drift = calibration.drift
        out["each_run"] = {
            name: {run: float(u.value(x)) for run, x in zip(drift.runs, drift.x[:, k], strict=True)}
            for k, (name, u) in enumerate(zip(names, fit.problem.unknowns, strict=True))
        }
    out["profile"] = {
        p.name: {"values": p.values.tolist(), "rise": p.rise.tolist(), "interval_95": p.interval()}
        for p in calibration.profiles
    }
    return out
