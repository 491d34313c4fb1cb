"""Load effect classes by name, from the library, from a file of the user or from a module."""

import difflib
import functools
import importlib
import sys
import traceback
import types
from pathlib import Path

from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.source_location import display_path, error_line, first_line
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.effects.base import Effect, EffectError
from edhas_jax.machine.effects.validation import check_declaration
from edhas_jax.machine.interface.controller_base import ControllerError

_MODULE_PREFIX = "_edhas_effects_of_"  # of the names of modules made from files of the user


def load_effect(spec: str, base_dir: Path | str = ".") -> type[Effect]:
    """Load an effect class.

    Args:
        spec: "lugre_friction", "my_effects.py:SealDrag" or "package.module:SealDrag".
        base_dir: folder from which a relative file is looked up.

    Returns:
        The class; an unchanged file gives the same class again.

    Raises:
        EffectError: unknown id, missing file or class, an error in the file, or an incorrect declaration.
    """
    source, colon, name = (part.strip() for part in str(spec).rpartition(":"))
    if not colon:
        return _library_effect(name)
    cls = load_user_class(source, name, Path(base_dir), Effect, "edhas_jax.Effect")
    check_declaration(cls)
    return cls


def load_user_class(source: str, name: str, base_dir: Path, base: type, base_name: str) -> type:
    """Load a class from a file or module of the user.

    Args:
        source: file ending in .py, or module.
        name: name of the class.
        base_dir: folder from which a relative file is looked up.
        base: the class it must be derived from.
        base_name: name of `base` in messages.

    Raises:
        EffectError: file or class missing, an error in the file, or a class that is not derived from `base`.
    """
    module, shown = (_load_file if source.endswith(".py") else _load_module)(source, base_dir)
    cls = getattr(module, name, None)
    if cls is None:
        raise EffectError(f"{shown}: no class {name}; {_class_hint(module, name, base)}")
    if not (isinstance(cls, type) and issubclass(cls, base)) or cls is base:
        raise EffectError(f"{shown}: {name} is not a subclass of {base_name}")
    return cls


def effect_spec(cls: type[Effect]) -> str:
    """The text by which `load_effect` finds this class again; files are named by their absolute path."""
    return cls.id if cls in LIBRARY else class_spec(cls)


def class_spec(cls: type) -> str:
    """The text by which a class of the user is found again; files are named by their absolute path."""
    if cls.__module__.startswith(_MODULE_PREFIX):
        return f"{sys.modules[cls.__module__].__file__}:{cls.__name__}"
    return f"{cls.__module__}:{cls.__name__}"


def _library_effect(name: str) -> type[Effect]:
    """The effect of the library with this id."""
    by_id = {cls.id: cls for cls in LIBRARY}
    if name.endswith(".py"):
        raise EffectError(f"{name} names no class; write {name}:ClassName")
    if name not in by_id:
        close = difflib.get_close_matches(name, by_id, n=3, cutoff=0.6)
        hint = f"nearest: {', '.join(close)}" if close else "`edhas effects` lists them"
        raise EffectError(f"no effect `{name}` in the library; {hint}; your own: file.py:ClassName")
    return by_id[name]


def _load_file(source: str, base_dir: Path) -> tuple[types.ModuleType, str]:
    """The module made from a file, and its path for messages."""
    path = base_dir / source
    shown = display_path(path)
    try:
        stamp = path.stat().st_mtime_ns
        if path.is_dir():
            raise IsADirectoryError
    except OSError as error:
        reason = "is a folder, not a file" if isinstance(error, IsADirectoryError) else "no such file"
        raise EffectError(f"{shown}: {reason}") from None
    return _run_file(str(path.resolve()), stamp), shown


@functools.lru_cache(maxsize=256)
def _run_file(path: str, stamp: int) -> types.ModuleType:
    """Run a file as a module; `stamp` is its time of modification, so that a changed file is read again."""
    shown = display_path(Path(path))
    module = types.ModuleType(f"{_MODULE_PREFIX}{Path(path).stem}_{abs(hash((path, stamp)))}")
    module.__file__ = path
    try:
        code = compile(Path(path).read_bytes(), path, "exec")
    except SyntaxError as error:
        raise EffectError(f"{shown}:{error.lineno or 1}: syntax error: {error.msg}") from None
    except (ValueError, OSError) as error:
        raise EffectError(f"{shown}: is not a file of Python code: {first_line(error)}") from None
    sys.modules[module.__name__] = module  # dataclasses look up the module of a class there
    try:
        exec(code, module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[module.__name__]
        is_own_error = isinstance(error, EffectError | ControllerError)
        what = "" if is_own_error else f"{type(error).__name__} while the file is read: "
        raise EffectError(f"{shown}:{error_line(error, path) or 1}: {what}{first_line(error)}") from error
    return module


def _load_module(source: str, base_dir: Path) -> tuple[types.ModuleType, str]:
    """An imported module, and its name for messages."""
    try:
        return importlib.import_module(source), source
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and error.name and (source + ".").startswith(error.name + "."):
            hint = f"; did you mean {source}.py?" if (base_dir / f"{source}.py").is_file() else ""
            raise EffectError(f"no module `{source}`{hint}") from None
        frames = [f for f in traceback.extract_tb(error.__traceback__) if "importlib" not in f.filename]
        at = f"{display_path(Path(frames[-1].filename))}:{frames[-1].lineno}" if frames else source
        raise EffectError(f"{at}: {type(error).__name__} while {source} is read: {first_line(error)}") from error


def _class_hint(module: types.ModuleType, name: str, base: type) -> str:
    """The classes of a module that may have been meant, for a message."""
    own = [n for n, v in vars(module).items() if isinstance(v, type) and issubclass(v, base) and v is not base]
    return suggest(name, own) if own else f"there is no {base.__name__.lower()} in it"
