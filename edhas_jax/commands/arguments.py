"""Arguments that several commands share."""

import argparse
import shlex
from pathlib import Path


def whole_number(low: int, high: int):
    """A type of arguments: a whole number from `low` to `high`."""

    def read(text: str) -> int:
        # a longer text has too many digits for any such number, and for `int`
        number = int(text) if text.lstrip("-").isdecimal() and len(text) < 20 else None
        if number is None or not low <= number <= high:
            raise argparse.ArgumentTypeError(f"a whole number from {low} to {high} belongs here, not {text[:20]}")
        return number

    return read


def add_output_folder(parser: argparse.ArgumentParser, parent: str) -> None:
    """`--out` and `--overwrite` of a command that writes a folder, by default a new one in `parent`."""
    parser.add_argument("--out", type=Path, help=f"folder to write (default: {parent}/NAME, numbered if it exists)")
    parser.add_argument(
        "--overwrite", action="store_true",
        help=f"replace an earlier result in the folder of --out, or in {parent}/NAME; other files there stay",
    )  # fmt: skip


def output_folder(options, parent: str, name: str) -> Path:
    """The folder that a command writes: that of `--out`, else `parent/name`, numbered unless it may be overwritten."""
    from edhas_jax.config.run_folder import named_folder, unused_folder

    return options.out or (named_folder if options.overwrite else unused_folder)(Path(parent), name)


def add_output_file(parser: argparse.ArgumentParser, description: str) -> None:
    """`--out` and `--overwrite` of a command that writes one file."""
    parser.add_argument("--out", type=Path, help=description)
    parser.add_argument("--overwrite", action="store_true", help="replace the file if it exists")


def add_campaign_folder(parser: argparse.ArgumentParser, description: str = "folder of the campaign") -> None:
    """The campaign that a command works on."""
    parser.add_argument("campaign", type=Path, help=description)


def add_overrides(parser: argparse.ArgumentParser, example: str) -> None:
    """`--set NAME=VALUE`, which may be given several times."""
    parser.add_argument(
        "--set", dest="overrides", action="append", default=[], metavar="NAME=VALUE",
        help=f"override a parameter or simulation setting, with unit: --set {example}",
    )  # fmt: skip


def add_cluster(parser: argparse.ArgumentParser, what: str) -> None:
    """`--cluster` for work that other processes do; `what` they are handed, in words."""
    parser.add_argument("--cluster", metavar="WHERE", help=f"{what}: local:2 for processes here, tcp://host:8786")


def add_own_code(parser: argparse.ArgumentParser, effects: bool = True) -> None:
    """`--effect`, `--controller` and `--rig` for files of one's own that a configuration or campaign names."""
    for option in ("effect", "controller", "rig") if effects else ("controller", "rig"):
        parser.add_argument(
            f"--{option}", dest=f"own_{option}s", action="append", default=[], metavar="FILE.py:CLASS",
            help=f"let this {option} of your own run if a file names it (`edhas trust FILE.py` allows it for good)",
        )  # fmt: skip


def own_code(options) -> list[str]:
    """The files of the user's own that the command line names."""
    names = ("own_effects", "own_controllers", "own_rigs", "effects")
    return [spec for name in names for spec in getattr(options, name, [])]


def own_words(options) -> str:
    """The options by which the next command may run the rig and controllers that this one was allowed to run."""
    names = ("rig", "controller")
    return "".join(f" --{name} {shlex.quote(spec)}" for name in names for spec in getattr(options, f"own_{name}s", []))


def require_own_code(options, *machines) -> None:
    """Refuse an effect or controller of the command line that no file names: it would have no influence.

    Raises:
        EffectError: the first such option.
    """
    from edhas_jax.core.trusted_code import TrustedCode
    from edhas_jax.machine.effects import EffectError
    from edhas_jax.machine.effects.loading import class_spec

    present = TrustedCode.of(class_spec(type(p)) for m in machines for p in m.replaceable_parts())
    for option in ("effect", "controller", "rig"):
        for spec in getattr(options, f"own_{option}s", []):
            named = TrustedCode.of([spec])
            if not (named.files <= present.files and named.modules <= present.modules):
                raise EffectError(f"--{option} {spec}: no file that was read names it; write it there to use it")


def add_user_effects(parser: argparse.ArgumentParser, metavar: str, description: str) -> None:
    """`--effect FILE.py:Class`, which may be given several times."""
    parser.add_argument("--effect", dest="effects", action="append", default=[], metavar=metavar, help=description)


def add_output_options(parser: argparse.ArgumentParser, table: bool = True) -> None:
    """`--quiet`, and `--json` of a command that prints a table."""
    if table:
        parser.add_argument("--json", action="store_true", help="print JSON, numbers in SI, instead of text")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
