"""The command line of `edhas`: every command with its arguments, and the function that runs it.

Nothing here imports JAX, pandas, matplotlib or SciPy, so that `edhas --help` and the completion of a shell answer at
once; the module of a command is imported when it runs.
"""

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import edhas_jax

CHECK_FAILED, WRONG_INPUT, NOT_VALID, NOT_CONVERGED = 1, 2, 3, 4  # exit status of `edhas`
EPILOG = (
    "A first run: edhas new pump, then edhas simulate my_pump.yaml. Exit status: 0 done; 1 a check found something; "
    "2 wrong input; 3 the result is not valid; 4 a fit has not converged; 130 interrupted."
)
# of `edhas new`
KINDS_OF_BEGINNINGS = ("pump", "system", "actuator", "rig", "campaign", "sweep", "size", "sensitivity")
KINDS_OF_FILES = ("machine", "sweep", "size", "sensitivity", "campaign", "law")  # of `edhas schema`
SHELLS = ("bash", "zsh", "tcsh")

Argument = tuple[tuple[str, ...], dict[str, Any]]  # what `add_argument` of argparse takes


class Command(NamedTuple):
    """A command.

    Attributes:
        name: one word, or two of a command with actions.
        help: what it does, in a line.
        run: the function that runs it, "module:function" of this package.
        arguments: in the order of the help.
        epilog: below its help.
    """

    name: str
    help: str
    run: str
    arguments: tuple[Argument, ...]
    epilog: str | None = None


def argument(*words: str, **options: Any) -> Argument:
    """An argument as of `add_argument` of argparse."""
    return words, options


def repeated(word: str, dest: str, metavar: str, description: str) -> Argument:
    """An option that may be given several times."""
    return argument(word, dest=dest, action="append", default=[], metavar=metavar, help=description)


def whole_number(low: int, high: int):
    """A type of arguments: a whole number from `low` to `high`."""

    def read(text: str) -> int:
        # a longer text has too many digits for any such number, and for `int`
        number = int(text) if text.lstrip("-").isdecimal() and len(text) < 20 else None
        if number is None or not low <= number <= high:
            raise argparse.ArgumentTypeError(f"a whole number from {low} to {high} belongs here, not {text[:20]}")
        return number

    return read


def file(word: str, description: str, **options: Any) -> Argument:
    """A path."""
    return argument(word, type=Path, help=description, **options)


def switch(word: str, description: str) -> Argument:
    """An option without a value."""
    return argument(word, action="store_true", help=description)


def output_folder(parent: str) -> tuple[Argument, ...]:
    """`--out` and `--overwrite` of a command that writes a folder, by default a new one in `parent`."""
    return (
        file("--out", f"folder to write (default: {parent}/NAME, numbered if it exists)"),
        switch("--overwrite",
               f"replace an earlier result in the folder of --out, or in {parent}/NAME; other files there stay"),
    )  # fmt: skip


def own_parts(*kinds: str) -> tuple[Argument, ...]:
    """`--effect`, `--controller` and `--rig` for files of one's own that a configuration or campaign names."""
    said = "let this {} of your own run if a file names it (`edhas trust FILE.py` allows it for good)"
    return tuple(repeated(f"--{kind}", f"own_{kind}s", "FILE.py:CLASS", said.format(kind)) for kind in kinds)


def overrides(example: str) -> Argument:
    """`--set NAME=VALUE`."""
    said = f"override a parameter or simulation setting, with unit: --set {example}"
    return repeated("--set", "overrides", "NAME=VALUE", said)


def cluster(what: str) -> Argument:
    """`--cluster` for work that other processes do; `what` they are handed, in words."""
    return argument("--cluster", metavar="WHERE", help=f"{what}: local:2 for processes here, tcp://host:8786")


CAMPAIGN = file("campaign", "folder of the campaign")
CONFIG = file("config", "configuration, YAML")
QUIET = switch("--quiet", "print nothing but errors")
PRINTED = switch("--json", "print JSON, numbers in SI, instead of text"), QUIET
OWN_CODE = own_parts("effect", "controller", "rig")
OWN_PARTS = own_parts("controller", "rig")  # of a command whose effects are named otherwise
AFTER_A_FIT = (
    f"The exit status is {NOT_CONVERGED} if the fit has not converged. Ctrl-C ends the search and keeps the best "
    "values so far."
)
MORE_EFFECTS = "also consider this effect of your own; may be given again"
# commands that have commands of their own: help, heading of their list in the help, and word for one of them there
GROUPS = {
    "plot": ("pictures of a result", "results", "KIND"),
    "campaign": ("measurements of a bench: begin a campaign, check its files", "what to do", "ACTION"),
}
# in the order of the help
COMMANDS = (
    Command("new", "write a commented configuration, campaign or task to start from", "beginnings:new", (
        argument("kind", choices=KINDS_OF_BEGINNINGS, help="a machine, a rig of your own, a campaign, a task"),
        file("path", "file to write, or folder of a campaign (default: my_KIND)", nargs="?"),
        switch("--overwrite", "replace the file if it exists"),
        argument("--rig", metavar="FILE.py:CLASS", help="of a campaign: its rig, one of your own, which may run"),
        QUIET)),
    Command("examples", "the examples that come with the package; list or copy them", "beginnings:examples", (
        argument("names", nargs="*", metavar="NAME", help="examples to copy, with what they are based on"),
        switch("--all", "copy all of them"),
        file("--out", "folder to copy to (default: examples)", default=Path("examples")), *PRINTED)),
    Command("simulate", "run one machine and write a run folder", "configurations:simulate", (
        CONFIG, overrides("piston_clearance=15um"), *OWN_CODE, *output_folder("runs"),
        switch("--no-figure", "write no picture"), *PRINTED)),
    Command("sweep", "run many designs of a machine; the same command resumes", "configurations:sweep", (
        file("config", "configuration of the sweep, YAML"), file("--out", "folder of the result (default: runs/NAME)"),
        cluster("hand chunks to Dask"), *OWN_CODE, *PRINTED)),
    Command("plot sweep", "heat maps, parallel coordinates and Pareto front of a sweep", "configurations:plot_sweep", (
        file("result", "folder of a sweep, finished or not"),
        argument("--kind", choices=("heat", "parallel", "pareto", "all"), default="all"),
        argument("--metric", help="what the colour shows (default: mean_flow; on a heat map the first that depends on "
                                  "two parameters)"),
        argument("--x", metavar="NAME", help="parameter to the right"),
        argument("--y", metavar="NAME", help="parameter upwards"),
        repeated("--slice", "slices", "NAME=VALUE",
                 "only designs with the value nearest to this one: --slice frequency=20Hz"),
        switch("--average", "average over the other parameters of a grid instead of slicing"),
        argument("--pareto", nargs=2, metavar="METRIC:DIRECTION",
                 help="two metrics, each :max or :min (default: mean_flow:max mean_electrical_power:min)"),
        file("--out", "PNG, PDF or SVG to write (default: in the folder of the sweep)"), QUIET)),
    Command("sensitivity", "which parameters matter where: elasticities, Sobol, Morris", "configurations:sensitivity", (
        file("config", "configuration of the analysis, YAML"), *output_folder("runs"), *OWN_CODE, *PRINTED)),
    Command("size", "find the dimensions that make a machine best within its limits", "configurations:size", (
        file("config", "configuration of the task, YAML"), *output_folder("runs"), *OWN_CODE, *PRINTED)),
    Command("campaign check", "read everything, list what looks wrong; status 1 if anything does",
            "campaigns:check", (CAMPAIGN, *OWN_PARTS, *PRINTED)),
    Command("campaign new", "write a commented template that passes the check",
            "beginnings:new_campaign", (file("campaign", "folder to write"), QUIET)),
    Command("compare", "the model beside the measurements, and where it fails", "campaigns:compare", (
        CAMPAIGN, file("--model", "configuration of the model (default: the campaign's own)"),
        argument("--replay", choices=("set_point", "voltage", "current", "piston_position"), default="set_point",
                 help="drive the model with this measured signal, so that what lies behind it is judged alone"),
        *output_folder("comparisons"), *OWN_CODE, *PRINTED)),
    Command("fit", "calibrate the uncertain parameters of a campaign's machine", "campaigns:fit", (
        CAMPAIGN, *output_folder("fits"),
        argument("--starts", type=whole_number(1, 100), default=4, help="points to start from (default: 4)"),
        repeated("--profile", "profile", "NAME",
                 "also the likelihood along this parameter, all others fitted anew; may be given several times"),
        file("--choices", "free and fixed parameters, limits, priors, runs, signals and time windows, where they "
             "differ from the campaign", metavar="FILE.yaml"),
        *OWN_PARTS, *PRINTED), AFTER_A_FIT),
    Command("diagnose", "what is missing in the model of a campaign's machine", "campaigns:diagnose", (
        CAMPAIGN, *output_folder("diagnoses"), repeated("--effect", "effects", "FILE.py:CLASS", MORE_EFFECTS),
        cluster("hand fits to Dask"), *OWN_PARTS, *PRINTED)),
    Command("add", "add effects to a campaign's machine, and fit it: the campaign and the model with them",
            "campaigns:add", (
        CAMPAIGN, argument("effect", nargs="+", metavar="EFFECT", help="id of an effect, FILE.py:Class, or the folder "
                                                                       "of a diagnosis for the effects that it names"),
        *output_folder("added"), *OWN_PARTS, *PRINTED)),
    Command("plan", "before any test: what a campaign's runs and sensors could reveal", "campaigns:plan", (
        file("campaign", "folder of the campaign; its runs need no files yet"),
        argument("--rate", default="5 kHz", help="sampling of runs without a file (default: 5 kHz)"),
        repeated("--effect", "effects", "FILE.py:Class", MORE_EFFECTS),
        *output_folder("plans"), *OWN_PARTS, *PRINTED)),
    Command("export", "the machine as an FMU for Simulink, OpenModelica, Amesim, FMPy", "configurations:export", (
        CONFIG, file("--out", "file to write (default: NAME.fmu)"),
        switch("--overwrite", "replace the file if it exists"),
        repeated("--input", "inputs", "NAME", "a parameter that may change during the run, or reference, voltage, "
                 "target, spool to come from outside; may be given several times"),
        overrides("step=10us"), *OWN_CODE,
        repeated("--compiler", "compilers", "COMMAND",
                 "C compiler (default: $CC or cc); several, cross compilers among them, add a binary each"),
        switch("--sources-only", "compile nothing; the target does it"), *PRINTED)),
    Command("workbench", "the whole loop in the browser: data, comparison, diagnosis, design", "workbench:serve", (
        file("path", "folder of a campaign, an empty folder to begin one, or a configuration (default: this folder)",
             nargs="?", default=Path("."), metavar="CAMPAIGN | CONFIG"),
        argument("--port", type=whole_number(0, 65535), default=0, help="to listen on (default: any free one)"),
        switch("--no-browser", "print the address, open no browser"))),
    Command("check", "try a machine of your own against what every rig must satisfy", "own_code:check", (
        argument("rig", metavar="FILE.py:CLASS", help="the rig, which may then run; or a rig of the package"),
        *PRINTED)),
    Command("parameters", "every parameter with unit, value, range, meaning, source", "lists:parameters", (
        file("config", "configuration (default: all rigs and effects)", nargs="?"), *OWN_CODE, *PRINTED)),
    Command("effects", "the library of effects; with a name, one effect in full", "lists:effects", (
        argument("name", nargs="?", help="id of an effect, or FILE.py:Class"),
        file("--picture", "draw what the named effect does to the signals", metavar="FILE"),
        file("--config", "list the effects of this configuration, a user's own included"), *OWN_CODE, *PRINTED)),
    Command("schema", "the keys of files, as JSON schema for editors or as a table", "lists:schema", (
        argument("file", nargs="?", choices=KINDS_OF_FILES, default="machine", help="kind of file (default: machine)"),
        switch("--table", "a table in Markdown instead, with ranges and defaults"))),
    Command("device", "which engine runs the time loops here, which do not, and why", "lists:device", PRINTED),
    Command("trust", "allow Python files of your own to run when a file names them", "own_code:trust", (
        file("files", "file to allow; without one, list them", nargs="*", metavar="FILE.py"),
        switch("--remove", "withdraw the permission of these files"), *PRINTED)),
    Command("completion", "print what makes a shell complete commands and options", "command_line:completion",
            (argument("shell", choices=SHELLS),),
            'bash: eval "$(edhas completion bash)" in ~/.bashrc; zsh: the output as _edhas in a folder of $fpath'),
)  # fmt: skip


def make_parser() -> argparse.ArgumentParser:
    """The parser of the command line; in the options that it returns, `run` is the function of the command."""
    parser = argparse.ArgumentParser(prog="edhas", description=edhas_jax.__doc__, epilog=EPILOG)
    parser.add_argument("--version", action="version", version=f"edhas_jax {edhas_jax.__version__}")
    lists = {"": parser.add_subparsers(title="commands", required=True, metavar="COMMAND")}
    for command in COMMANDS:
        group, _, name = command.name.rpartition(" ")
        if group not in lists:
            said, title, metavar = GROUPS[group]
            actions = lists[""].add_parser(group, help=said)
            lists[group] = actions.add_subparsers(title=title, required=True, metavar=metavar)
        of_command = lists[group].add_parser(name, help=command.help, epilog=command.epilog)
        for words, options in command.arguments:
            of_command.add_argument(*words, **options)
        of_command.set_defaults(run=command.run)
    return parser


def completion(options) -> None:
    """Print what makes a shell complete the command line."""
    import shtab

    print(shtab.complete(make_parser(), shell=options.shell))
