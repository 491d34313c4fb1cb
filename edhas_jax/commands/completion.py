"""The command `edhas completion`."""

SHELLS = ("bash", "zsh", "tcsh")


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser(
        "completion", help="print what makes a shell complete commands and options",
        epilog='bash: eval "$(edhas completion bash)" in ~/.bashrc; zsh: the output as _edhas in a folder of $fpath',
    )  # fmt: skip
    parser.add_argument("shell", choices=SHELLS)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Print the completion of a shell."""
    import shtab

    from edhas_jax.commands.cli import make_parser

    print(shtab.complete(make_parser(), shell=options.shell))
