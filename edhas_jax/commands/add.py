"""The command `edhas add`."""

import math
from pathlib import Path

from edhas_jax.commands.arguments import (
    add_output_file,
    add_output_options,
    add_own_code,
    own_code,
    require_own_code,
)
from edhas_jax.commands.console import console, finish, quoted
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("add", help="fit a campaign's model with one more effect and write its configuration")
    parser.add_argument("effect", help="id of an effect, or FILE.py:Class")
    parser.add_argument("--campaign", type=Path, required=True, help="folder of the campaign")
    add_output_file(parser, "configuration to write (default: NAME_EFFECT.yaml)")
    add_own_code(parser, effects=False)
    add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Fit a campaign's model with one more effect, write the new configuration, print errors and estimates.

    Raises:
        CampaignError: the fit fails.
        ResultFileError: the file exists or cannot be written.
    """
    from edhas_jax.config.run_folder import ResultFileError, report_write_errors
    from edhas_jax.config.writer import dump_config
    from edhas_jax.core.literal_text import file_name, one_line
    from edhas_jax.core.summary import Summary, SummaryTable
    from edhas_jax.core.units import format_quantity
    from edhas_jax.diagnosis.calibration.fit_problem import FitError
    from edhas_jax.diagnosis.search.forward_selection import add_effect
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.campaign import CampaignError, Use
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.simulation.run import Simulation

    campaign = read_campaign(options.campaign, own_code(options))
    require_own_code(options, campaign.machine)
    effect = load_effect(options.effect, trust=[options.effect])
    path = options.out or Path(f"{file_name(campaign.name)}_{effect.id}.yaml")
    if path.exists() and not options.overwrite:
        raise ResultFileError(f"{path}: exists already; nothing was written. Name another file or add --overwrite")
    out = console(options)
    with WorkProgress(options, "fitting") as progress:
        try:
            before, after = add_effect(campaign, effect, progress)
        except FitError as error:
            raise CampaignError(str(error)) from None
    rate = 1.0 / min(run.interval for run in campaign.runs)
    comment = f"# {one_line(campaign.name)} with {effect.id}, fitted; without the conditions of any run\n"
    with report_write_errors(path):
        path.write_text(comment + dump_config(after.fit.machine, Simulation(sample_rate=rate)), encoding="utf-8")
    rows, records = [], []
    for name, evaluated in (("calibrated", before), (f"with {effect.id}", after)):
        rms = [evaluated.rms_over_noise(use) for use in (Use.FIT, Use.HOLDOUT)]
        rows.append((name, *(f"{value:.3f}" if math.isfinite(value) else "none is held out" for value in rms)))
        records.append({"model": name, "fitted_runs": rms[0], "held_out_runs": rms[1]})
    columns = "model", "fitted runs", "held-out runs"
    errors = SummaryTable.of("residual_over_noise", columns, rows, records, "residual over noise")
    units, rows, records = {u.name: u.unit for u in after.fit.problem.unknowns}, [], []
    for name, value in after.fit.values.items():
        if name.startswith(f"{effect.id}."):
            error = after.fit.standard_errors[name]
            rows.append((name, format_quantity(value, units[name]), f"± {format_quantity(error, units[name])}"))
            records.append({"name": name, "value": value, "error": error, "unit": units[name]})
    sizes = SummaryTable.of("estimates", ("name", "value", "standard error"), rows, records)
    summary = Summary(f"{campaign.name}: fitted with {effect.id}", (errors, sizes))
    follow = f"compare {quoted(options.campaign)} --model {quoted(path)}"
    finish(options, out, summary, next_command=follow, written=str(path))
