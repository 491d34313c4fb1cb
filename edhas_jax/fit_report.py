"""The report of a calibration: one page with its findings, tables and pictures."""

from edhas_jax import page
from edhas_jax.calibration import Calibration
from edhas_jax.campaign import Use
from edhas_jax.fit_figures import draw_correlations, draw_drift, draw_estimates, draw_profiles
from edhas_jax.misfit import level
from edhas_jax.misfit_matrix import draw_matrix, notes_of
from edhas_jax.units import format_quantity


def fit_report(calibration: Calibration) -> str:
    """The page as HTML."""
    fit, campaign = calibration.fit, calibration.fit.problem.campaign
    step = min(run.interval for run in campaign.runs) / fit.resolution.fine
    parts = [
        page.heading(f"{campaign.name}: calibration", 1),
        page.paragraph(
            f"{fit.problem.machine.name}; {len(fit.x)} unknowns from {len(campaign.runs_for(Use.FIT))} runs, "
            f"{len(campaign.runs_for(Use.HOLDOUT))} held out; step {format_quantity(step, 's')}, error of the solver "
            f"{fit.resolution.error:.2f} of the noise at most; {calibration.seconds:.0f} s."
        ),
        page.listing(calibration.findings()),
        page.heading("Residual over noise"),
        page.picture(draw_before_after(calibration), "residual over noise by run and signal, before and after"),
        page.heading("What was believed, and what was found"),
        page.picture(draw_estimates(calibration), "estimates in standard deviations of the prior"),
        estimates(calibration),
    ]
    drift, profiles = draw_drift(calibration), draw_profiles(calibration)
    if drift is not None:
        parts += [page.heading("Each run alone"), page.picture(drift, "distance of each run's estimate")]
    parts += [page.heading("Correlations"), page.picture(draw_correlations(calibration), "correlations")]
    if profiles is not None:
        parts += [page.heading("Profiles"), page.picture(profiles, "rise of χ² along an unknown")]
    if campaign.remarks:
        parts += [page.heading("What the reader noticed"), page.listing([str(remark) for remark in campaign.remarks])]
    return page.page(f"{campaign.name}: calibration", *parts)


def draw_before_after(calibration: Calibration):
    """The matrices runs × signals before and after, as a matplotlib figure."""
    panels = {
        title: {run: {n: level([v]) for n, v in signals.items()} for run, signals in residuals.items()}
        for title, residuals in (("before", calibration.before), ("calibrated", calibration.after))
    }
    return draw_matrix(panels, notes_of(calibration.fit.problem.campaign))


def estimates(calibration: Calibration) -> str:
    """The unknowns as an HTML table."""
    fit = calibration.fit
    marks = {
        "not identified": calibration.unseen(), "hard to believe": calibration.implausible(),
        "drifts from run to run": calibration.drifting(),
    }  # fmt: skip
    body = []
    for u, x, std in zip(fit.problem.unknowns, fit.x, fit.std, strict=True):
        low, high = (format_quantity(v, u.unit) for v in fit.interval(u.name))
        body.append([
            u.name, format_quantity(u.centre, u.unit), format_quantity(fit.values[u.name], u.unit),
            f"{low} … {high}", f"{x:+.2f}", f"{std:.3f}",
            ", ".join(mark for mark, names in marks.items() if u.name in names),
        ])  # fmt: skip
    header = ("unknown", "believed", "found", "95 % interval", "pull, σ", "error / prior σ", "")
    return page.rows(header, body)
