"""The program `edhas`: reads the command line, runs one command and reports wrong input in one message."""

import contextlib
import importlib
import os
import pkgutil
import re
import sys
import time
import warnings
from collections.abc import Iterator

import edhas_jax
from edhas_jax.commands.command_line import WRONG_INPUT, make_parser
from edhas_jax.commands.interruption import KEPT, STATUS_INTERRUPTED, Interruption
from edhas_jax.commands.terminal import plain_characters
from edhas_jax.core.literal_text import terminal_text

MAX_QUOTED = 200  # characters of a name in a message
USER_ERRORS = (  # by name, because their modules take long to import
    "compiler.engines:EngineError", "compiler.gpu.cuda_driver:CudaError", "config.machine_config:ConfigError",
    "config.result_files:ResultFileError", "core.runtime:CoresError", "core.trusted_code:TrustError",
    "core.units:UnitError", "export.fmu_inputs:FmuError", "machine.effects:EffectError",
    "machine.parameters:ParameterError", "machine.rig_base:RigError", "measurements.campaign:CampaignError",
    "simulation.run:SimulationError", "workbench.workspace:WorkspaceError",
)  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: the command line without the name of the program; by default that of the process, which then ends
            with the command.

    Returns:
        The exit status: 0, 2 after one message when the input is wrong, 130 when the user interrupted the command, or
        what the command itself returns (1 from `edhas campaign check` when a file looks wrong, 3 for a result that is
        not valid, 4 for a fit that has not converged).
    """
    interruption, sentence = Interruption(is_whole_process=arguments is None), KEPT
    with plain_characters():
        try:
            with interruption, _without_reader():
                status = 0  # of a command whose output nobody reads to its end
                status = _run(sys.argv[1:] if arguments is None else arguments, interruption)
        except BaseException as error:  # also what a library makes of an interruption
            if not interruption.asked and not isinstance(error, KeyboardInterrupt):
                raise
            status = STATUS_INTERRUPTED
            interruption.asked = True
            sentence = str(error) if isinstance(error, KeyboardInterrupt) and error.args else KEPT
        return interruption.end(status, sentence)


@contextlib.contextmanager
def _without_reader() -> Iterator[None]:
    """Within the context nothing is wrong when nobody reads the output any more, as with `| head -1`."""
    try:
        try:
            yield
        finally:
            print(end="", flush=True)
    except BrokenPipeError:
        # what is left goes nowhere; Python would complain about it at its end
        with contextlib.suppress(OSError, ValueError), open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())


def _run(arguments: list[str], interruption: Interruption) -> int:
    """Run one command; its exit status."""
    # a name that is no text in UTF-8 reaches Python with surrogates, and cannot be written into any result
    if wrong := next((text for text in arguments if re.search("[\x00\ud800-\udfff]", text)), None):
        print(f"edhas: {_shortened(wrong)!r} is no name in UTF-8; rename the file or folder", file=sys.stderr)
        return WRONG_INPUT
    began, parser = time.monotonic(), make_parser()
    if not arguments:
        parser.print_help()
        return 0
    options = parser.parse_args(arguments)
    options.began = began
    try:
        with warnings.catch_warnings():  # restores how warnings are shown, for callers within a process
            _prepare_process()
            return pkgutil.resolve_name(f"edhas_jax.commands.{options.run}")(options) or 0
    except Exception as error:
        if interruption.asked or isinstance(error, BrokenPipeError):
            raise
        return _report(error)


def _report(error: Exception) -> int:
    """Print an error of the user in one message; the exit status."""
    if isinstance(error, user_errors()):
        print(f"edhas: {terminal_text(str(error))}", file=sys.stderr)
    elif isinstance(error, OSError):  # no space, no permission, a name that is too long
        place = f"{_shortened(str(error.filename))}: " if error.filename else ""
        print(f"edhas: {terminal_text(place)}{error.strerror or error}", file=sys.stderr)
    else:
        raise error
    return WRONG_INPUT


def _shortened(text: str) -> str:
    return text if len(text) <= MAX_QUOTED else f"{text[:MAX_QUOTED]}…"


def _prepare_process() -> None:
    """Keep compiled XLA programs from one command to the next; print warnings about engines as plain sentences.

    A RuntimeWarning of NumPy on a number that is not finite is not shown: the command says what such a number means.
    """
    from edhas_jax.compiler.engines import EngineFallback
    from edhas_jax.core.runtime import drop_damaged_program, keep_xla_programs

    keep_xla_programs()
    if os.path.lexists("matplotlibrc"):
        _import_matplotlib_elsewhere()
    show = warnings.showwarning

    def show_sentence(message, category, *where, **options):
        if issubclass(category, EngineFallback):
            print(f"edhas: {message}", file=sys.stderr)
        elif category is not RuntimeWarning and not drop_damaged_program(str(message)):  # NumPy's: the result tells it
            show(message, category, *where, **options)

    warnings.showwarning = show_sentence


def _import_matplotlib_elsewhere() -> None:
    """Import matplotlib without the settings of the working folder, which may have it call other programs."""
    with contextlib.chdir(os.path.dirname(edhas_jax.__file__)):
        importlib.import_module("matplotlib")


def user_errors() -> tuple[type[Exception], ...]:
    """The errors of wrong input and of a GPU; any other one is a defect of the program and keeps its traceback."""
    return tuple(pkgutil.resolve_name(f"edhas_jax.{name}") for name in USER_ERRORS)


if __name__ == "__main__":
    sys.exit(main())
