"""A machine as an FMU: a unit for co-simulation (FMI 2.0) that needs neither Python nor this package.

The step is the package's own, traced and written as C; see `docs/fmu.md`.
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
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.export.fmu_c_sources import UNIT_FILE, sources
from edhas_jax.export.fmu_description import model_description
from edhas_jax.export.fmu_equations import UnitProgram, unit_program
from edhas_jax.export.fmu_inputs import FmuError
from edhas_jax.simulation.integrator import DEFAULT_STEP
from edhas_jax.simulation.run import simulate

OPTIONS = (
    "-std=c99", "-O2", "-shared", "-fvisibility=hidden", "-fno-math-errno", "-fno-trapping-math",
    "-DFMI2_OVERRIDE_FUNCTION_PREFIX",
)  # fmt: skip
# by what a compiler says that it compiles for: the folder of the binary, the ending of a library, further options
_TARGETS = {
    ("x86_64", "linux"): ("linux64", "so", ["-fPIC"]),
    ("i686", "linux"): ("linux32", "so", ["-fPIC"]),
    ("aarch64", "linux"): ("aarch64-linux", "so", ["-fPIC"]),
    ("x86_64", "darwin"): ("darwin64", "dylib", ["-fPIC"]),
    ("aarch64", "darwin"): ("darwin64", "dylib", ["-fPIC"]),
    ("x86_64", "windows"): ("win64", "dll", []),
}
_SYSTEMS = {"linux": ("linux",), "darwin": ("darwin", "macos"), "windows": ("mingw", "windows")}


@dataclasses.dataclass(frozen=True)
class Fmu:
    """A unit that was written: its file, its variables, and the platforms it has a binary for."""

    path: Path
    program: UnitProgram
    platforms: tuple[str, ...]


def export_fmu(
    config: Config, path: Path | str, inputs: Sequence[str] = (), compilers: Sequence[str] = ("cc",),
    overwrite: bool = False, on_progress: Callable[[str], None] = lambda what: None,
) -> Fmu:  # fmt: skip
    """Write the machine of a configuration as the FMU `path`, with a binary by each of the C `compilers`.

    `inputs` names parameters that may change during a run, and what comes from another tool in place of what the
    configuration mounts: "reference", "voltage", on the system "target" and "spool". The step is the configuration's.
    The unit appears at once when everything is in it.

    Raises:
        FmuError: the file exists and `overwrite` is false, or cannot be written; an input does not exist; the machine
            uses an operation that cannot be written in C; a C compiler is missing or fails.
        SimulationError: the run that is to find the step fails.
    """
    path = Path(path)
    if path.exists() and not overwrite:
        raise FmuError(f"{path}: exists already; nothing was written. Name another file or add --overwrite")
    if path.is_dir():
        raise FmuError(f"{path}: is a folder, not a file")
    targets = [(compiler, *_target(compiler)) for compiler in compilers]
    twice = [folder for folder, count in Counter(folder for _, folder, _, _ in targets).items() if count > 1]
    if twice:
        raise FmuError(f"two compilers are for {twice[0]}, where FMI 2.0 has room for one binary")
    settings = config.simulation
    step = DEFAULT_STEP if settings.step is None else settings.step
    if settings.accuracy is not None:
        on_progress("simulating, to find the step of the accuracy asked")
        step = simulate(config.machine, settings).step
    on_progress("tracing the step")
    program = unit_program(config.machine, inputs, step)
    title, identifier = config.name or path.stem, _identifier(path.stem)
    texts, guid = sources(program, title)
    stop, interval = settings.length(config.machine), 1.0 / settings.sample_rate
    parts: dict[str, str | bytes] = {
        "modelDescription.xml": model_description(program, title, identifier, guid, stop, interval),
        "resources/config.yaml": dump_config(config),
        **{f"sources/{name}": text for name, text in texts.items()},
    }
    for compiler, folder, ending, options in targets:
        on_progress(f"compiling for {folder}")
        parts[f"binaries/{folder}/{identifier}.{ending}"] = _compile(compiler, options, texts)
    _write(path, parts)
    return Fmu(path, program, tuple(folder for _, folder, _, _ in targets))


def _target(compiler: str) -> tuple[str, str, list[str]]:
    """The row of `_TARGETS` for a compiler: the words of its command line, as the user gave them."""
    words = shlex.split(compiler)
    if not words or shutil.which(words[0]) is None:
        what = "install one (gcc or clang), name another with --compiler, or add --sources-only"
        raise FmuError(f"no C compiler `{compiler}` was found; {what} and compile sources/{UNIT_FILE} on the target")
    told = _ran([*words, "-dumpmachine"], None, compiler)
    system = next((s for s, names in _SYSTEMS.items() if any(n in told for n in names)), told)
    processor = told.partition("-")[0].replace("arm64", "aarch64")
    known = _TARGETS.get((processor, system))
    if known is None:
        raise FmuError(f"`{compiler}` compiles for {told}, for which FMI 2.0 has no folder; add --sources-only")
    return known


def _compile(compiler: str, options: list[str], texts: dict[str, str]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        _ran([*shlex.split(compiler), *OPTIONS, *options, "-o", "unit", UNIT_FILE, "-lm"], folder, compiler)
        return (Path(folder) / "unit").read_bytes()


def _ran(command: list[str], folder: str | None, compiler: str) -> str:
    """What a command prints."""
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
    except OSError as error:
        raise FmuError(f"the C compiler `{compiler}` cannot be run: {error.strerror}") from None
    if done.returncode:
        lines = (done.stderr.strip() or done.stdout.strip() or f"status {done.returncode}").splitlines()
        said = next((line for line in lines if "error" in line), lines[0])
        raise FmuError(f"the C compiler `{compiler}` failed: {said}")
    return done.stdout.strip()


def _write(path: Path, parts: dict[str, str | bytes]) -> None:
    """The archive, whole or not there; the same parts make the same bytes."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in parts.items():
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.external_attr, entry.compress_type = 0o644 << 16, zipfile.ZIP_DEFLATED
            file.writestr(entry, content)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as beside:
            beside.write_bytes(archive.getvalue())
    except OSError as error:
        raise FmuError(f"{path}: cannot be written: {error.strerror}") from None


def _identifier(name: str) -> str:
    """A name as an identifier of C."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return plain if re.match(r"[A-Za-z_]", plain) else f"m_{plain}"
