"""The command `edhas trust`."""

from pathlib import Path

from edhas_jax.commands.arguments import add_output_options
from edhas_jax.commands.console import console, print_json, print_table


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("trust", help="allow Python files of your own to run when a file names them")
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.py", help="file to allow; without one, list them")
    parser.add_argument("--remove", action="store_true", help="withdraw the permission of these files")
    add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Allow files, withdraw the permission, or list the files that are allowed.

    Raises:
        TrustError: a file cannot be read, is not on the list, or the list cannot be written.
    """
    from edhas_jax.core.summary import SummaryTable
    from edhas_jax.core.trusted_code import distrust, remembered_files, trust

    out = console(options)
    for file in options.files:
        changed = (distrust if options.remove else trust)(file)
        what = "runs no more" if options.remove else "may run from now on, until its content changes"
        out.print(f"{file}: {what} (list: {changed})", soft_wrap=True)
    if options.files and not options.json:
        return
    known = remembered_files()
    if options.json:
        print_json({"files": [{"file": str(path), "sha256": digest} for digest, path in known.items()]})
        return
    if not known:
        out.print("no file is allowed to run; allow one with: edhas trust FILE.py")
        return
    rows = [(str(path), digest[:12]) for digest, path in known.items()]
    print_table(out, SummaryTable.of("files", ("file", "hash of its content"), rows))
