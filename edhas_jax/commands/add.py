"""The command `edhas add`."""

import math
from pathlib import Path

from edhas_jax.commands.arguments import add_output_file, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, table


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("add", help="fit a campaign's model with one more effect and write its configuration")
    parser.add_argument("effect", help="id of an effect, or FILE.py:Class")
    parser.add_argument("--campaign", type=Path, required=True, help="folder of the campaign")
    add_output_file(parser, "configuration to write (default: NAME_EFFECT.yaml)")
    add_own_code(parser, effects=False)
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
    out = console()
    with out.status("fitting") as status:
        try:
            before, after = add_effect(campaign, effect, lambda sentence: status.update(sentence))
        except FitError as error:
            raise CampaignError(str(error)) from None
    rate = 1.0 / min(run.interval for run in campaign.runs)
    comment = f"# {one_line(campaign.name)} with {effect.id}, fitted; without the conditions of any run\n"
    with report_write_errors(path):
        path.write_text(comment + dump_config(after.fit.machine, Simulation(sample_rate=rate)), encoding="utf-8")
    rows = table("residual over noise", "model", "fitted runs", "held-out runs")
    for name, evaluated in (("calibrated", before), (f"with {effect.id}", after)):
        rms = [evaluated.rms_over_noise(use) for use in (Use.FIT, Use.HOLDOUT)]
        rows.add_row(name, *(f"{value:.3f}" if math.isfinite(value) else "none is held out" for value in rms))
    out.print(rows)
    units = {u.name: u.unit for u in after.fit.problem.unknowns}
    for name, value in after.fit.values.items():
        if name.startswith(f"{effect.id}."):
            size, error = (format_quantity(v, units[name]) for v in (value, after.fit.standard_errors[name]))
            out.print(f"{name}: {size} ± {error}")
    out.print(f"written: {path}; compare it with `edhas compare {options.campaign} --model {path}`", soft_wrap=True)
