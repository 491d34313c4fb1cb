"""The command `edhas plot sweep`."""

from pathlib import Path

from edhas_jax.commands.arguments import add_output_options
from edhas_jax.commands.console import console, save_figure


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    results = commands.add_parser("plot", help="pictures of a result").add_subparsers(
        title="results", required=True, metavar="KIND"
    )
    parser = results.add_parser("sweep", help="heat maps, parallel coordinates and Pareto front of a sweep")
    parser.add_argument("result", type=Path, help="folder of a sweep, finished or not")
    parser.add_argument("--kind", choices=("heat", "parallel", "pareto", "all"), default="all")
    parser.add_argument(
        "--metric",
        help="what the colour shows (default: mean_flow; on a heat map the first that depends on two parameters)",
    )
    parser.add_argument("--x", metavar="NAME", help="parameter to the right")
    parser.add_argument("--y", metavar="NAME", help="parameter upwards")
    parser.add_argument(
        "--slice", dest="slices", action="append", default=[], metavar="NAME=VALUE",
        help="only designs with the value nearest to this one: --slice frequency=20Hz",
    )  # fmt: skip
    parser.add_argument(
        "--average", action="store_true", help="average over the other parameters of a grid instead of slicing"
    )
    parser.add_argument(
        "--pareto", nargs=2, metavar="METRIC:DIRECTION",
        help="two metrics, each :max or :min (default: mean_flow:max mean_electrical_power:min)",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, help="PNG, PDF or SVG to write (default: in the folder of the sweep)")
    add_output_options(parser, table=False)
    parser.set_defaults(command=run_sweep_plot)


def run_sweep_plot(options) -> None:
    """Draw the pictures of a sweep's result.

    Raises:
        ResultFileError: the result does not hold what a picture needs, or a picture cannot be written.
    """
    from edhas_jax.config.run_folder import ResultFileError
    from edhas_jax.design.sweep.design_selection import FigureError
    from edhas_jax.design.sweep.figures import draw_sweep, metrics_of_figures
    from edhas_jax.design.sweep.run import open_sweep

    # a table of millions of designs is read only as far as it is drawn
    result = open_sweep(options.result, lambda names: metrics_of_figures(names, options.metric, options.pareto))
    kinds = ("heat", "parallel", "pareto") if options.kind == "all" else (options.kind,)
    out = console(options)
    for kind in kinds:
        path = options.out or options.result / f"{kind}.png"
        if options.out and len(kinds) > 1:
            path = options.out.with_name(f"{options.out.stem}_{kind}{options.out.suffix}")
        try:
            figure = draw_sweep(
                result, kind, metric=options.metric, x=options.x, y=options.y, slices=options.slices,
                average=options.average, objectives=options.pareto,
            )  # fmt: skip
        except FigureError as error:
            if options.kind != "all" or not error.missing:
                raise ResultFileError(f"{options.result}: {error}") from None
            out.print(f"no picture {kind}: {error}", soft_wrap=True)
            continue
        save_figure(figure, path)
        out.print(f"written: {path}", soft_wrap=True)
