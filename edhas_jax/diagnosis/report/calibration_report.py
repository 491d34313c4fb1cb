"""HTML report of a calibration: findings, tables and figures on one page."""

from edhas_jax.core import html_page
from edhas_jax.core.units import format_quantity
from edhas_jax.diagnosis.report.calibration_figures import draw_correlations, draw_drift, draw_estimates, draw_profiles
from edhas_jax.inference.fit.calibration import Calibration
from edhas_jax.measurements.campaign import Use, runs_text
from edhas_jax.measurements.residual_matrix import draw_residual_matrix, run_descriptions
from edhas_jax.measurements.residuals import rms_over_noise


def fit_report(calibration: Calibration) -> str:
    """Build the HTML page of a calibration."""
    fit, campaign = calibration.fit, calibration.fit.problem.campaign
    step = min(run.interval for run in campaign.runs) / fit.resolution.fine
    parts = [
        html_page.heading(f"{campaign.name}: calibration", 1),
        html_page.paragraph(
            f"{fit.problem.machine.name}; {len(fit.x)} unknowns from {runs_text(campaign.runs_for(Use.FIT))}, "
            f"{len(campaign.runs_for(Use.HOLDOUT))} held out; step {format_quantity(step, 's')}, discretisation error "
            f"{fit.resolution.error:.2f} of the noise at most; {calibration.seconds:.0f} s."
        ),
        html_page.numbered_list(calibration.findings()),
        html_page.heading("Residual over noise"),
        html_page.image(draw_before_after(calibration), "residual over noise by run and signal, before and after"),
        html_page.heading("Prior and estimate"),
        html_page.image(draw_estimates(calibration), "estimates in standard deviations of the prior"),
        estimates_table(calibration),
    ]
    drift, profiles = draw_drift(calibration), draw_profiles(calibration)
    if drift is not None:
        caption = "distance of each run's estimate from the common one"
        parts += [html_page.heading("Each run fitted alone"), html_page.image(drift, caption)]
    parts += [html_page.heading("Correlations"), html_page.image(draw_correlations(calibration), "correlations")]
    if profiles is not None:
        caption = "increase of χ² along an unknown"
        parts += [html_page.heading("Profile likelihoods"), html_page.image(profiles, caption)]
    if campaign.remarks:
        remarks = [str(remark) for remark in campaign.remarks]
        parts += [html_page.heading("Remarks on the data files"), html_page.numbered_list(remarks)]
    return html_page.page(f"{campaign.name}: calibration", *parts)


def draw_before_after(calibration: Calibration):
    """A matplotlib figure: residual over noise by run and signal, before and after the fit."""
    panels = {
        title: {run: {n: rms_over_noise([v]) for n, v in signals.items()} for run, signals in residuals.items()}
        for title, residuals in (("before", calibration.before), ("calibrated", calibration.after))
    }
    return draw_residual_matrix(panels, run_descriptions(calibration.fit.problem.campaign))


def estimates_table(calibration: Calibration) -> str:
    """The unknowns with prior, estimate and diagnostics as an HTML table."""
    fit = calibration.fit
    marks = {
        "not identified": calibration.unidentified(), "implausible": calibration.implausible(),
        "drifts from run to run": calibration.drifting(),
    }  # fmt: skip
    body = []
    for u, x, std in zip(fit.problem.unknowns, fit.x, fit.std, strict=True):
        body.append([
            u.name, format_quantity(u.centre, u.unit), format_quantity(fit.values[u.name], u.unit),
            fit.interval_text(u.name), f"{x:+.2f}", f"{std:.3f}",
            ", ".join(mark for mark, names in marks.items() if u.name in names),
        ])  # fmt: skip
    header = ("unknown", "prior mean", "estimate", "95 % interval", "pull, σ", "error / prior σ", "")
    return html_page.table(header, body)
