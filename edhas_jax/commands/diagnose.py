"""`edhas diagnose` and `edhas add`."""

from pathlib import Path

from edhas_jax.commands.console import console, table


def diagnose(options) -> None:
    """`edhas diagnose`: say what is missing in a campaign's model, write a folder, print the verdict."""
    from rich.markup import escape

    from edhas_jax.config.run_folder import StoreError, check_free, free_folder
    from edhas_jax.diagnosis.calibration.fit import FitError
    from edhas_jax.diagnosis.planning.next_experiment import next_experiment
    from edhas_jax.diagnosis.report.report import write_report
    from edhas_jax.diagnosis.report.result_file import save_diagnosis
    from edhas_jax.diagnosis.report.story_figures import draw_story
    from edhas_jax.diagnosis.search.forward_selection import diagnose as search
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.campaign import CampaignError
    from edhas_jax.measurements.campaign_reader import read_campaign

    campaign = read_campaign(options.campaign)
    folder = options.out or free_folder(Path("diagnoses"), campaign.name)
    check_free(folder, options.overwrite)
    more = [load_effect(spec) for spec in options.effects]
    out = console()
    for remark in campaign.remarks:
        out.print(escape(str(remark)), soft_wrap=True)
    with out.status("reading") as status:
        try:
            found = search(campaign, more=more, on_progress=lambda sentence: status.update(escape(sentence)))
        except FitError as error:
            raise CampaignError(str(error)) from None
        status.update("looking for the run that tells most")
        experiment = next_experiment(found)
        status.update("writing the report")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            save_diagnosis(found, folder, None if experiment is None else experiment.as_json())
            write_report(found, folder / "report.html", experiment)
            draw_story(found).savefig(folder / "diagnosis.png", dpi=130)
        except OSError as error:
            raise StoreError(f"{folder}: cannot be written: {error.strerror}") from None
    out.print(suspects_table(found))
    out.print(errors_table(found))
    for sentence in found.sentences():
        out.print(escape(sentence), soft_wrap=True)
    if experiment is not None:
        out.print(escape(experiment.sentence), soft_wrap=True)
    names = ", ".join(sorted(p.name for p in folder.iterdir() if not p.name.startswith(".")))
    out.print(f"{found.seconds:.0f} s; written to {folder}: {names}")


def add(options) -> None:
    """`edhas add`: fit a campaign's model with one more effect, and write the new configuration."""
    from rich.markup import escape

    from edhas_jax.config.run_folder import StoreError
    from edhas_jax.config.writer import dump_config
    from edhas_jax.core.units import format_quantity
    from edhas_jax.diagnosis.calibration.fit import FitError
    from edhas_jax.diagnosis.search.forward_selection import add_effect
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.campaign import CampaignError, Use
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.simulation.run import Simulation

    campaign = read_campaign(options.campaign)
    kind = load_effect(options.effect)
    target = options.out or Path(f"{campaign.name}_{kind.id}.yaml")
    if target.exists() and not options.overwrite:
        raise StoreError(f"{target} exists; give another file with --out, or --overwrite")
    out = console()
    with out.status("fitting") as status:
        try:
            before, after = add_effect(campaign, kind, lambda sentence: status.update(escape(sentence)))
        except FitError as error:
            raise CampaignError(str(error)) from None
    rate = 1.0 / min(run.interval for run in campaign.runs)
    text = f"# {campaign.name} with {kind.id}, fitted; before the conditions of any run are set\n"
    try:
        target.write_text(text + dump_config(after.fit.machine, Simulation(sample_rate=rate)), encoding="utf-8")
    except OSError as error:
        raise StoreError(f"{target}: cannot be written: {error.strerror}") from None
    listed = table("residual over noise", "model", "fitted runs", "held-out runs")
    for name, judged in (("calibrated", before), (f"with {kind.id}", after)):
        listed.add_row(name, f"{judged.level(Use.FIT):.3f}", f"{judged.level(Use.HOLDOUT):.3f}")
    out.print(listed)
    units = {u.name: u.unit for u in after.fit.problem.unknowns}
    for name, value in after.fit.values.items():
        if name.startswith(f"{kind.id}."):
            size, error = (format_quantity(v, units[name]) for v in (value, after.fit.errors[name]))
            out.print(f"{name}: {size} ± {error}")
    out.print(f"written: {target}; compare it with `edhas compare {options.campaign} --model {target}`", soft_wrap=True)


def suspects_table(diagnosis):
    """The suspects that were tried and the most promising others, as a rich table."""
    from edhas_jax.core.units import format_quantity
    from edhas_jax.measurements.campaign import Use

    listed = table("suspects", "effect", "where", "size", "probability", "new runs, residual over noise")
    for suspect, p, trial in diagnosis.candidates():
        if trial is None or trial.judged is None:
            continue
        judged = diagnosis.after if suspect in [t.suspect for t in diagnosis.accepted] else trial.judged
        own = suspect.own(judged.fit.problem.unknowns)
        sizes = [f"{name} {format_quantity(judged.fit.values[u.name], u.unit)}" for name, u in own.items()]
        listed.add_row(suspect.name, suspect.where, ", ".join(sizes), f"{p:.3f}", f"{judged.level(Use.HOLDOUT):.3f}")
    return listed


def errors_table(diagnosis):
    """Residual over noise before, calibrated and after, as a rich table."""
    errors = diagnosis.errors()
    listed = table("residual over noise", "signal", *(f"{s}, {u}" for u in ("fitted", "held out") for s in errors))
    columns = [errors[state][use] for use in ("fit", "holdout") for state in errors]
    for name in columns[0]:
        listed.add_row(name, *(f"{column[name]:.2f}" if name in column else "" for column in columns))
    return listed
