"""The command `edhas examples`."""

from pathlib import Path

from edhas_jax.commands.arguments import add_output_options
from edhas_jax.commands.console import console, finish, quoted


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("examples", help="the examples that come with the package; list or copy them")
    parser.add_argument("names", nargs="*", metavar="NAME", help="examples to copy, with what they are based on")
    parser.add_argument("--all", action="store_true", help="copy all of them")
    parser.add_argument("--out", type=Path, default=Path("examples"), help="folder to copy to (default: examples)")
    add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """List the examples, or copy some of them.

    Raises:
        ResultFileError: there is no such example, or the folder cannot be written.
    """
    from edhas_jax.config.examples import copy_examples, list_examples
    from edhas_jax.core.summary import Summary, SummaryTable

    out, known = console(options), list_examples()
    if not options.names and not options.all:
        rows = [(e.name, e.about, f"edhas {e.command}") for e in known]
        table = SummaryTable.of("examples", ("example", "what it shows", "command"), rows)
        finish(options, out, Summary(f"examples: {len(rows)}", (table,)), next_command="examples --all")
        return
    copied = copy_examples(options.names, options.out)
    table = SummaryTable.of("copied", ("file",), [(str(path),) for path in copied])
    first = next(e for e in known if e.name == (options.names[0] if options.names else "paper.yaml"))
    task, _, name = first.command.partition(" ")
    follow = f"{task} {quoted(options.out / name)}"
    sentences = [table] if copied else ["All of them are there already; nothing was copied."]
    finish(options, out, Summary(f"examples: {len(copied)} copied to {options.out}", tuple(sentences)),
           next_command=follow)  # fmt: skip
