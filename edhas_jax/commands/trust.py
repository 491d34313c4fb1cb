"""The command `edhas trust`."""

from pathlib import Path

from edhas_jax.commands.console import console, table


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("trust", help="allow Python files of your own to run when a file names them")
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.py", help="file to allow; without one, list them")
    parser.add_argument("--remove", action="store_true", help="withdraw the permission of these files")
    parser.set_defaults(command=run)


def run(options) -> None:
    """Allow files, withdraw the permission, or list the files that are allowed.

    Raises:
        TrustError: a file cannot be read, is not on the list, or the list cannot be written.
    """
    from edhas_jax.core.trusted_code import distrust, remembered_files, trust

    out = console()
    for file in options.files:
        changed = (distrust if options.remove else trust)(file)
        what = "runs no more" if options.remove else "may run from now on, until its content changes"
        out.print(f"{file}: {what} (list: {changed})", soft_wrap=True)
    if options.files:
        return
    known = remembered_files()
    if not known:
        out.print("no file is allowed to run; allow one with: edhas trust FILE.py")
        return
    rows = table(None, "file", "hash of its content")
    for digest, path in known.items():
        rows.add_row(path, digest[:12])
    out.print(rows)
