"""Arguments that several commands share."""

import argparse
from pathlib import Path


def add_output_folder(parser: argparse.ArgumentParser, parent: str) -> None:
    """`--out` and `--overwrite` of a command that writes a folder, by default a new one in `parent`."""
    parser.add_argument("--out", type=Path, help=f"folder to write (default: {parent}/NAME, numbered if it exists)")
    parser.add_argument("--overwrite", action="store_true", help="write into the folder of --out if it exists")


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


def add_user_effects(parser: argparse.ArgumentParser, metavar: str, description: str) -> None:
    """`--effect FILE.py:Class`, which may be given several times."""
    parser.add_argument("--effect", dest="effects", action="append", default=[], metavar=metavar, help=description)
