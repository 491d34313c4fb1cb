"""Export of a machine as an FMU for co-simulation (FMI 2.0) that needs neither Python nor this package.

The step is that of the package, traced and written as C; `docs/fmu.md` describes the unit for its users.
"""

import dataclasses
import io
import re
import shlex
import shutil
import subprocess
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from edhas_jax.config.machine_config import Config
from edhas_jax.config.writer import dump_config
from edhas_jax.core import runtime
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.export.fmu_c_sources import UNIT_FILE, c_sources
from edhas_jax.export.fmu_description import model_description
from edhas_jax.export.fmu_inputs import FmuError
from edhas_jax.export.fmu_program import UnitProgram, unit_program
from edhas_jax.simulation.run import simulate

COMPILER_OPTIONS = (
    "-std=c99", "-O2", "-shared", "-fvisibility=hidden", "-fno-math-errno", "-fno-trapping-math",
    "-DFMI2_OVERRIDE_FUNCTION_PREFIX",
)  # fmt: skip
# {(processor, system) of a compiler: folder of the binary in an FMU, file suffix of a library, further options}
_PLATFORMS = {
    ("x86_64", "linux"): ("linux64", "so", ["-fPIC"]),
    ("i686", "linux"): ("linux32", "so", ["-fPIC"]),
    ("aarch64", "linux"): ("aarch64-linux", "so", ["-fPIC"]),
    ("x86_64", "darwin"): ("darwin64", "dylib", ["-fPIC"]),
    ("aarch64", "darwin"): ("darwin64", "dylib", ["-fPIC"]),
    ("x86_64", "windows"): ("win64", "dll", []),
}
# {system: words that stand for it in the target triplet of a compiler}
_SYSTEM_WORDS = {"linux": ("linux",), "darwin": ("darwin", "macos"), "windows": ("mingw", "windows")}


@dataclasses.dataclass(frozen=True)
class Fmu:
    """A written unit.

    Attributes:
        path: its file.
        program: its model with the variables.
        platforms: the platforms for which it has a binary, by the folder names of FMI 2.0.
    """

    path: Path
    program: UnitProgram
    platforms: tuple[str, ...]


def export_fmu(
    config: Config, path: Path | str, inputs: Sequence[str] = (), compilers: Sequence[str] = ("cc",),
    overwrite: bool = False, on_progress: Callable[[str], None] = lambda message: None,
) -> Fmu:  # fmt: skip
    """Write the machine of a configuration as an FMU.

    The file is replaced only when the whole unit has been written. The largest internal step is that of the
    configuration.

    Args:
        config: the configuration.
        path: the file to write.
        inputs: names of parameters that may change during a run, and of what an external tool provides in place of the
            configuration: "reference", "voltage", on the system also "target" and "spool".
        compilers: command lines of C compilers; each adds the binary of its platform.
        overwrite: whether an existing file may be replaced.
        on_progress: called with a text before each stage.

    Returns:
        The written unit.

    Raises:
        FmuError: the file exists and `overwrite` is false, or cannot be written; an input does not exist; the machine
            uses an operation that cannot be written in C; a C compiler is missing or fails.
        SimulationError: the run that determines the step for a given accuracy fails.
    """
    path = Path(path)
    if path.exists() and not overwrite:
        raise FmuError(f"{path}: exists already; nothing was written. Name another file or add --overwrite")
    if path.is_dir():
        raise FmuError(f"{path}: is a folder, not a file")
    targets = [(compiler, *_platform_of(compiler)) for compiler in compilers]
    duplicates = [folder for folder, count in Counter(folder for _, folder, _, _ in targets).items() if count > 1]
    if duplicates:
        raise FmuError(f"two compilers are for {duplicates[0]}, but an FMU holds one binary per platform")
    settings = config.simulation
    step = config.machine.time_step if settings.step is None else settings.step
    if settings.accuracy is not None:
        on_progress("simulating, to find the step for the requested accuracy")
        step = simulate(config.machine, settings).step
    on_progress("tracing the step")
    with runtime.double_precision():  # the numbers of the unit are doubles whatever the process has set
        program = unit_program(config.machine, inputs, step)
    title, identifier = config.name or path.stem, _identifier(path.stem)
    texts, guid = c_sources(program, title)
    stop, interval = settings.length(config.machine), 1.0 / settings.rate(config.machine)
    parts: dict[str, str | bytes] = {
        "modelDescription.xml": model_description(program, title, identifier, guid, stop, interval),
        "resources/config.yaml": dump_config(config),
        **{f"sources/{name}": text for name, text in texts.items()},
    }
    for compiler, folder, suffix, options in targets:
        on_progress(f"compiling for {folder}")
        parts[f"binaries/{folder}/{identifier}.{suffix}"] = _compile(compiler, options, texts)
    _write_archive(path, parts)
    return Fmu(path, program, tuple(folder for _, folder, _, _ in targets))


def _platform_of(compiler: str) -> tuple[str, str, list[str]]:
    """The entry of `_PLATFORMS` for a compiler, given by its command line."""
    try:
        words = shlex.split(compiler)
    except ValueError:
        raise FmuError(f"--compiler: `{compiler}` has a quotation mark that is not closed") from None
    if not words or shutil.which(words[0]) is None:
        remedy = "install one (gcc or clang), name another with --compiler, or add --sources-only"
        raise FmuError(f"no C compiler `{compiler}` was found; {remedy} and compile sources/{UNIT_FILE} on the target")
    triplet = _run_compiler([*words, "-dumpmachine"], None, compiler)
    system = next((s for s, names in _SYSTEM_WORDS.items() if any(n in triplet for n in names)), triplet)
    processor = triplet.partition("-")[0].replace("arm64", "aarch64")
    platform = _PLATFORMS.get((processor, system))
    if platform is None:
        raise FmuError(f"`{compiler}` compiles for {triplet}, for which FMI 2.0 has no folder; add --sources-only")
    return platform


def _compile(compiler: str, options: list[str], texts: dict[str, str]) -> bytes:
    """The shared library that a compiler makes of the sources `texts`."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        command = [*shlex.split(compiler), *COMPILER_OPTIONS, *options, "-o", "unit", UNIT_FILE, "-lm"]
        _run_compiler(command, folder, compiler)
        return (Path(folder) / "unit").read_bytes()


def _run_compiler(command: list[str], folder: str | None, compiler: str) -> str:
    """Run a command in a folder and return its output; `compiler` is the name for error messages."""
    try:
        process = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
    except OSError as error:
        raise FmuError(f"the C compiler `{compiler}` cannot be run: {error.strerror}") from None
    if process.returncode:
        lines = (process.stderr.strip() or process.stdout.strip() or f"status {process.returncode}").splitlines()
        message = next((line for line in lines if "error" in line), lines[0])
        raise FmuError(f"the C compiler `{compiler}` failed: {message}")
    return process.stdout.strip()


def _write_archive(path: Path, parts: dict[str, str | bytes]) -> None:
    """Write the archive atomically; it depends on the parts only, not on the time."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in parts.items():
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.external_attr, entry.compress_type = 0o644 << 16, zipfile.ZIP_DEFLATED
            file.writestr(entry, content)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            temporary.write_bytes(archive.getvalue())
    except OSError as error:
        raise FmuError(f"{path}: cannot be written: {error.strerror}") from None


def _identifier(name: str) -> str:
    """A name as a C identifier."""
    identifier = re.sub(r"\W", "_", name, flags=re.ASCII)
    return identifier if re.match(r"[A-Za-z_]", identifier) else f"m_{identifier}"
