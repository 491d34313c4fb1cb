"""The command line: `edhas simulate | sweep | plot | parameters | effects | schema`."""

import argparse
import sys
from pathlib import Path

import edhas_jax
from edhas_jax.commands.campaign import check_campaign, new_campaign
from edhas_jax.commands.compare import compare
from edhas_jax.commands.diagnose import add, diagnose
from edhas_jax.commands.export import export
from edhas_jax.commands.fit import fit
from edhas_jax.commands.lists import effects, parameters, schema
from edhas_jax.commands.plan import plan
from edhas_jax.commands.sensitivity import sensitivity
from edhas_jax.commands.simulate import simulate
from edhas_jax.commands.size import size
from edhas_jax.commands.sweep import plot_sweep, sweep

USER_ERROR = 2


def main(arguments: list[str] | None = None) -> int:
    """Run one command; the exit status is 0, or 2 with one clear message when the input is at fault."""
    options = _parser().parse_args(arguments)
    # one line for bad input, wherever it was found; anything else is a defect and keeps its traceback
    from edhas_jax.config.machine_config import ConfigError
    from edhas_jax.config.run_folder import StoreError
    from edhas_jax.core.units import UnitError
    from edhas_jax.export.fmu_inputs import FmuError
    from edhas_jax.machine.effects import EffectError
    from edhas_jax.machine.parameters import ParameterError
    from edhas_jax.measurements.campaign import CampaignError
    from edhas_jax.simulation.run import SimulationError

    user_errors = (
        CampaignError, ConfigError, EffectError, FmuError, ParameterError, SimulationError, StoreError, UnitError,
    )  # fmt: skip
    try:
        return options.command(options) or 0
    except user_errors as error:
        print(f"edhas: {error}", file=sys.stderr)
        return USER_ERROR
    except BrokenPipeError:
        sys.stderr.close()
    except KeyboardInterrupt:
        print("edhas: interrupted before anything was finished; nothing was written", file=sys.stderr)
        return 130
    return 0


def _folder(command: argparse.ArgumentParser, default: str) -> None:
    """Where a command leaves its folder, by default in `default`."""
    command.add_argument("--out", type=Path, help=f"folder to write (default: {default}/NAME, numbered if it exists)")
    command.add_argument("--overwrite", action="store_true", help="write into the folder of --out if it exists")


def _file(command: argparse.ArgumentParser, what: str) -> None:
    """Where a command leaves its file."""
    command.add_argument("--out", type=Path, help=what)
    command.add_argument("--overwrite", action="store_true", help="replace the file if it exists")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="edhas", description=edhas_jax.__doc__)
    parser.add_argument("--version", action="version", version=f"edhas_jax {edhas_jax.__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    simulate_ = commands.add_parser("simulate", help="run one machine and write a run folder")
    simulate_.add_argument("config", type=Path, help="configuration, YAML")
    simulate_.add_argument(
        "--set", dest="overrides", action="append", default=[], metavar="NAME=VALUE",
        help="override a parameter or simulation setting, with unit: --set piston_clearance=15um",
    )  # fmt: skip
    _folder(simulate_, "runs")
    simulate_.add_argument("--no-figure", action="store_true", help="write no picture")
    simulate_.set_defaults(command=simulate)

    sweep_ = commands.add_parser("sweep", help="run many designs of a machine; the same command resumes")
    sweep_.add_argument("config", type=Path, help="configuration of the sweep, YAML")
    sweep_.add_argument("--out", type=Path, help="folder of the result (default: runs/NAME)")
    sweep_.add_argument(
        "--cluster", metavar="WHERE", help="hand chunks to Dask: local:2 for processes here, tcp://host:8786"
    )
    sweep_.set_defaults(command=sweep)

    compare_ = commands.add_parser("compare", help="the model beside the measurements, and where it fails")
    compare_.add_argument("campaign", type=Path, help="folder of the campaign")
    compare_.add_argument("--model", type=Path, help="configuration of the model (default: the campaign's own)")
    compare_.add_argument(
        "--replay", choices=("set_point", "voltage", "current", "piston_position"), default="set_point",
        help="drive the model with this measured signal, so that what lies behind it is judged alone",
    )  # fmt: skip
    _folder(compare_, "comparisons")
    compare_.set_defaults(command=compare)

    fit_ = commands.add_parser("fit", help="calibrate the uncertain parameters of a campaign's machine")
    fit_.add_argument("campaign", type=Path, help="folder of the campaign")
    _folder(fit_, "fits")
    fit_.add_argument("--starts", type=int, default=4, help="points to start from (default: 4)")
    fit_.add_argument(
        "--profile", action="append", default=[], metavar="NAME",
        help="also the likelihood along this parameter, all others fitted anew; may be given several times",
    )  # fmt: skip
    fit_.set_defaults(command=fit)

    plan_ = commands.add_parser("plan", help="before any test: what a campaign's runs and sensors could reveal")
    plan_.add_argument("campaign", type=Path, help="folder of the campaign; its runs need no files yet")
    plan_.add_argument("--rate", default="5 kHz", help="sampling of runs without a file (default: 5 kHz)")
    plan_.add_argument(
        "--effect", dest="effects", action="append", default=[], metavar="FILE.py:Class",
        help="suspect this effect of your own too; may be given several times",
    )  # fmt: skip
    _folder(plan_, "plans")
    plan_.set_defaults(command=plan)

    sensitivity_ = commands.add_parser("sensitivity", help="which parameters matter where: elasticities, Sobol, Morris")
    sensitivity_.add_argument("config", type=Path, help="configuration of the analysis, YAML")
    _folder(sensitivity_, "runs")
    sensitivity_.set_defaults(command=sensitivity)

    campaign = commands.add_parser("campaign", help="measurements of a bench: begin a campaign, check its files")
    of_campaign = campaign.add_subparsers(title="what to do", required=True, metavar="ACTION")
    check_ = of_campaign.add_parser("check", help="read everything, list what looks wrong; status 1 if anything does")
    check_.add_argument("campaign", type=Path, help="folder of the campaign")
    check_.set_defaults(command=check_campaign)
    new_ = of_campaign.add_parser("new", help="write a commented template that passes the check")
    new_.add_argument("campaign", type=Path, help="folder to write")
    new_.set_defaults(command=new_campaign)

    size_ = commands.add_parser("size", help="find the dimensions that make a machine best within its limits")
    size_.add_argument("config", type=Path, help="configuration of the task, YAML")
    _folder(size_, "runs")
    size_.set_defaults(command=size)

    diagnose_ = commands.add_parser("diagnose", help="what is missing in the model of a campaign's machine")
    diagnose_.add_argument("campaign", type=Path, help="folder of the campaign")
    _folder(diagnose_, "diagnoses")
    diagnose_.add_argument(
        "--effect", dest="effects", action="append", default=[], metavar="FILE.py:CLASS",
        help="suspect an effect of your own too; may be given several times",
    )  # fmt: skip
    diagnose_.set_defaults(command=diagnose)

    add_ = commands.add_parser("add", help="fit a campaign's model with one more effect and write its configuration")
    add_.add_argument("effect", help="id of an effect, or FILE.py:Class")
    add_.add_argument("--campaign", type=Path, required=True, help="folder of the campaign")
    _file(add_, "configuration to write (default: NAME_EFFECT.yaml)")
    add_.set_defaults(command=add)

    export_ = commands.add_parser("export", help="the machine as an FMU for Simulink, OpenModelica, Amesim, FMPy")
    export_.add_argument("config", type=Path, help="configuration, YAML")
    _file(export_, "file to write (default: NAME.fmu)")
    export_.add_argument(
        "--input", dest="inputs", action="append", default=[], metavar="NAME",
        help="a parameter that may change during the run, or reference, voltage, target, spool to come from outside; "
             "may be given several times",
    )  # fmt: skip
    export_.add_argument(
        "--set", dest="overrides", action="append", default=[], metavar="NAME=VALUE",
        help="override a parameter or simulation setting, with unit: --set step=10us",
    )  # fmt: skip
    export_.add_argument(
        "--compiler", dest="compilers", action="append", default=[], metavar="COMMAND",
        help="C compiler (default: $CC or cc); several, cross compilers among them, add a binary each",
    )  # fmt: skip
    export_.add_argument("--sources-only", action="store_true", help="compile nothing; the target does it")
    export_.set_defaults(command=export)

    plot = commands.add_parser("plot", help="pictures of a result")
    of_sweep = plot.add_subparsers(title="results", required=True, metavar="KIND").add_parser(
        "sweep", help="heat maps, parallel coordinates and Pareto front of a sweep"
    )
    of_sweep.add_argument("result", type=Path, help="folder of a sweep, finished or not")
    of_sweep.add_argument("--kind", choices=("heat", "parallel", "pareto", "all"), default="all")
    of_sweep.add_argument("--metric", help="what the colour shows (default: mean_flow, or the first there is)")
    of_sweep.add_argument("--x", metavar="NAME", help="parameter to the right")
    of_sweep.add_argument("--y", metavar="NAME", help="parameter upwards")
    of_sweep.add_argument(
        "--slice", dest="slices", action="append", default=[], metavar="NAME=VALUE",
        help="only designs with the value nearest to this one: --slice frequency=20Hz",
    )  # fmt: skip
    of_sweep.add_argument(
        "--average", action="store_true", help="average over the other parameters of a grid instead of slicing"
    )
    of_sweep.add_argument(
        "--pareto", nargs=2, metavar="METRIC:DIRECTION",
        help="two metrics, each :max or :min (default: mean_flow:max mean_electrical_power:min)",
    )  # fmt: skip
    of_sweep.add_argument("--out", type=Path, help="PNG, PDF or SVG to write (default: in the folder of the sweep)")
    of_sweep.set_defaults(command=plot_sweep)

    parameters_ = commands.add_parser("parameters", help="every parameter with unit, value, range, meaning, source")
    parameters_.add_argument("config", nargs="?", type=Path, help="configuration (default: all rigs and effects)")
    parameters_.set_defaults(command=parameters)

    effects_ = commands.add_parser("effects", help="the library of effects; with a name, one effect in full")
    effects_.add_argument("name", nargs="?", help="id of an effect, or FILE.py:Class")
    effects_.add_argument("--picture", type=Path, metavar="FILE", help="draw what the named effect does to the signals")
    effects_.add_argument("--config", type=Path, help="list the effects of this configuration, a user's own included")
    effects_.set_defaults(command=effects)

    schema_ = commands.add_parser("schema", help="the JSON schema of configurations, for completion in editors")
    schema_.set_defaults(command=schema)
    return parser


if __name__ == "__main__":
    sys.exit(main())
