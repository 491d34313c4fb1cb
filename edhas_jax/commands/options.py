"""What commands take from the options of the command line: the folder to write, and the user's own code."""

import shlex
from pathlib import Path

from edhas_jax.core.trusted_code import TrustedCode
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.loading import class_spec


def output_folder(options, parent: str, name: str) -> Path:
    """The folder that a command writes: that of `--out`, else `parent/name`, numbered unless it may be overwritten."""
    from edhas_jax.config.run_folder import named_folder, unused_folder

    return options.out or (named_folder if options.overwrite else unused_folder)(Path(parent), name)


def own_code(options) -> list[str]:
    """The effects, controllers and rigs of the user's own that the command line names, `FILE.py:CLASS` each."""
    return [s for n in ("own_effects", "own_controllers", "own_rigs", "effects") for s in getattr(options, n, [])]


def own_words(options) -> str:
    """The options by which the next command may run the rig and controllers that this one was allowed to run."""
    parts = [(n, spec) for n in ("rig", "controller") for spec in getattr(options, f"own_{n}s", [])]
    return "".join(f" --{n} {shlex.quote(spec)}" for n, spec in parts)


def require_own_code(options, *machines) -> None:
    """Refuse an effect or controller of the command line that no file names: it would have no influence.

    Raises:
        EffectError: the first such option.
    """
    present = TrustedCode.of(class_spec(type(p)) for m in machines for p in m.replaceable_parts())
    for option in ("effect", "controller", "rig"):
        for spec in getattr(options, f"own_{option}s", []):
            named = TrustedCode.of([spec])
            if not (named.files <= present.files and named.modules <= present.modules):
                raise EffectError(f"--{option} {spec}: no file that was read names it; write it there to use it")
