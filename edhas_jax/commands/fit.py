"""`edhas fit`."""

import time
from pathlib import Path

from edhas_jax.commands.console import console, table


def fit(options) -> None:
    """`edhas fit`: calibrate the uncertain parameters of a campaign's machine, write a folder, print what was found."""
    from rich.markup import escape

    from edhas_jax.config.run_folder import StoreError, check_free, free_folder
    from edhas_jax.diagnosis.calibration.fit import FitError, Problem
    from edhas_jax.diagnosis.calibration.fit import fit as calibrate
    from edhas_jax.diagnosis.calibration.report import fit_report
    from edhas_jax.diagnosis.calibration.result import Calibration, residuals_of, save_calibration
    from edhas_jax.diagnosis.calibration.uncertainty import fit_each_run, profile
    from edhas_jax.measurements.campaign import CampaignError
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.measurement_chain import Instruments
    from edhas_jax.measurements.prior import uncertain_unknowns

    began = time.perf_counter()
    campaign = read_campaign(options.campaign)
    folder = options.out or free_folder(Path("fits"), campaign.name)
    check_free(folder, options.overwrite)
    unknowns = uncertain_unknowns(campaign)
    for name in options.profile:
        if name not in (u.name for u in unknowns):
            raise CampaignError(f"--profile {name}: not among what is uncertain: {', '.join(u.name for u in unknowns)}")
    out = console()
    for remark in campaign.remarks:
        out.print(escape(str(remark)), soft_wrap=True)
    with out.status("reading") as status:
        problem = Problem(campaign, campaign.machine, unknowns)
        try:
            found = calibrate(problem, starts=options.starts, on_progress=status.update)
        except FitError as error:
            raise CampaignError(str(error)) from None
        drift, profiles = None, []
        try:
            drift = fit_each_run(found, lambda step: status.update(f"each run alone, {step}"))
            for name in options.profile:
                what = f"profile of {name}, "
                profiles.append(profile(found, name, lambda step, what=what: status.update(what + step)))
        except KeyboardInterrupt:
            out.print("interrupted: what was found so far is written")
        status.update("residuals of all runs")
        fine = found.resolution.fine
        before = residuals_of(campaign, campaign.machine, Instruments(), fine)
        after = residuals_of(campaign, found.machine, found.instruments, fine)
    seconds = time.perf_counter() - began
    result = Calibration(found, drift, tuple(profiles), before, after, seconds)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "report.html").write_text(fit_report(result), encoding="utf-8")
        save_calibration(result, folder)
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror}") from None
    out.print(errors_table(result))
    out.print(estimates_table(result))
    for number, sentence in enumerate(result.findings(), 1):
        out.print(f"{number}. {escape(sentence)}", soft_wrap=True)
    out.print(f"{seconds:.0f} s; written to {folder}: " + ", ".join(sorted(p.name for p in folder.iterdir())))


def errors_table(result):
    """Residual over noise by signal, before and after, on the runs fitted and held out, as a rich table."""
    columns = [f"{state}, {use}" for use in ("fitted", "held out") for state in ("before", "calibrated")]
    listed = table("residual over noise", "signal", *columns)
    errors = result.errors()
    columns = [errors[state][use] for use in ("fit", "holdout") for state in ("before", "calibrated")]
    for name in columns[0]:
        listed.add_row(name, *(f"{column[name]:.2f}" if name in column else "" for column in columns))
    return listed


def estimates_table(result):
    """The unknowns as a rich table."""
    from edhas_jax.core.units import format_quantity

    fit = result.fit
    listed = table("unknowns", "name", "believed", "value", "95 % interval", "pull, prior σ", "error, prior σ")
    for u, x, std in zip(fit.problem.unknowns, fit.x, fit.std, strict=True):
        low, high = (format_quantity(v, u.unit) for v in fit.interval(u.name))
        listed.add_row(u.name, format_quantity(u.centre, u.unit), format_quantity(fit.values[u.name], u.unit),
                       f"{low} … {high}", f"{x:+.2f}", f"{std:.3f}")  # fmt: skip
    return listed
