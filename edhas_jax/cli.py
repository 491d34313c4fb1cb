"""The command line: `edhas simulate | sweep | plot | parameters | effects | schema`."""

import argparse
import sys
from pathlib import Path

import edhas_jax
from edhas_jax.commands.lists import effects, parameters, schema
from edhas_jax.commands.simulate import simulate
from edhas_jax.commands.sweep import plot_sweep, sweep

USER_ERROR = 2


def main(arguments: list[str] | None = None) -> int:
    """Run one command; the exit status is 0, or 2 with one clear message when the input is at fault."""
    options = _parser().parse_args(arguments)
    # one line for bad input, wherever it was found; anything else is a defect and keeps its traceback
    from edhas_jax.config import ConfigError
    from edhas_jax.effects import EffectError
    from edhas_jax.parameters import ParameterError
    from edhas_jax.run import SimulationError
    from edhas_jax.store import StoreError
    from edhas_jax.units import UnitError

    try:
        return options.command(options) or 0
    except (ConfigError, EffectError, ParameterError, SimulationError, StoreError, UnitError) as error:
        print(f"edhas: {error}", file=sys.stderr)
        return USER_ERROR
    except BrokenPipeError:
        sys.stderr.close()
    except KeyboardInterrupt:
        print("edhas: interrupted before anything was finished; nothing was written", file=sys.stderr)
        return 130
    return 0


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
    simulate_.add_argument("--out", type=Path, help="folder to write (default: runs/NAME, numbered if it exists)")
    simulate_.add_argument("--overwrite", action="store_true", help="replace the run folder given with --out")
    simulate_.add_argument("--no-figure", action="store_true", help="write no picture")
    simulate_.set_defaults(command=simulate)

    sweep_ = commands.add_parser("sweep", help="run many designs of a machine; the same command resumes")
    sweep_.add_argument("config", type=Path, help="configuration of the sweep, YAML")
    sweep_.add_argument("--out", type=Path, help="folder of the result (default: runs/NAME)")
    sweep_.add_argument(
        "--cluster", metavar="WHERE", help="hand chunks to Dask: local:2 for processes here, tcp://host:8786"
    )
    sweep_.set_defaults(command=sweep)

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
    effects_.add_argument("--config", type=Path, help="list the effects of this configuration, a user's own included")
    effects_.set_defaults(command=effects)

    schema_ = commands.add_parser("schema", help="the JSON schema of configurations, for completion in editors")
    schema_.set_defaults(command=schema)
    return parser


if __name__ == "__main__":
    sys.exit(main())
