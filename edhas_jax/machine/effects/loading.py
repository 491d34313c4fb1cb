"""Load effect classes by name, from the library, from a file of the user or from a module that is allowed to run."""

import difflib
import importlib
import importlib.util
import sys
import traceback
import types
from collections.abc import Iterable
from pathlib import Path

from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.regular_file import read_regular_file
from edhas_jax.core.source_location import PACKAGE, display_path, error_line, first_line, reraise_interrupt
from edhas_jax.core.trusted_code import MAX_CODE_BYTES, Trust, TrustedCode, content_hash, untrusted_sentence
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.effects.base import Effect, EffectError
from edhas_jax.machine.effects.validation import check_declaration
from edhas_jax.machine.interface.controller_base import ControllerError

_MODULE_PREFIX = "_edhas_effects_of_"  # of the names of modules made from files of the user
_HASH_NAME = "_edhas_content_hash"  # variable of such a module


class UntrustedCodeError(EffectError):
    """Code that is named by a file has not been allowed to run; it did not."""


def load_effect(
    spec: str, base_dir: Path | str = ".", trust: Trust = ()
) -> type[Effect]:
    """Load an effect class.

    Args:
        spec: "lugre_friction", "my_effects.py:SealDrag" or "package.module:SealDrag".
        base_dir: folder from which a relative file is looked up.
        trust: files and modules that may run, besides those that were allowed by `edhas trust`.

    Returns:
        The class; an unchanged file gives the same class again, and is not run again.

    Raises:
        UntrustedCodeError: the code was not allowed to run.
        EffectError: unknown id, missing file or class, an error in the file, or an incorrect declaration.
    """
    source, colon, name = (part.strip() for part in str(spec).rpartition(":"))
    if not colon:
        return _library_effect(name)
    cls = load_user_class(source, name, Path(base_dir), Effect, TrustedCode.of(trust))
    check_declaration(cls)
    return cls


def load_user_class(source: str, name: str, base_dir: Path, base: type, trusted: TrustedCode) -> type:
    """Load a class from a file or module of the user.

    Args:
        source: file ending in .py, or module.
        name: name of the class.
        base_dir: folder from which a relative file is looked up.
        base: the class it must be derived from.
        trusted: what may run.

    Raises:
        UntrustedCodeError: the code was not allowed to run.
        EffectError: file or class missing, an error in the file, or a class that is not derived from `base`.
    """
    option = f"--{base.__name__.lower()}"
    load = _load_file if source.endswith(".py") else _load_module
    module, shown = load(source, name, base_dir, option, trusted)
    cls = getattr(module, name, None)
    if cls is None:
        raise EffectError(f"{shown}: no class {name}; {_class_hint(module, name, base)}")
    if not (isinstance(cls, type) and issubclass(cls, base)) or cls is base:
        raise EffectError(f"{shown}: {name} is not a subclass of edhas_jax.{base.__name__}")
    return cls


def effect_spec(cls: type[Effect]) -> str:
    """The text by which `load_effect` finds this class again; files are named by their absolute path."""
    return cls.id if cls in LIBRARY else class_spec(cls)


def class_spec(cls: type) -> str:
    """The text by which a class of the user is found again; files are named by their absolute path."""
    if cls.__module__.startswith(_MODULE_PREFIX):
        return f"{sys.modules[cls.__module__].__file__}:{cls.__name__}"
    return f"{cls.__module__}:{cls.__name__}"


def content_hash_of(cls: type) -> str:
    """The hash of the content from which a class was made; empty for a class that does not come from a file."""
    module = sys.modules[cls.__module__]
    if hasattr(module, _HASH_NAME):
        return getattr(module, _HASH_NAME)
    file = getattr(module, "__file__", None)
    return content_hash(Path(file).read_bytes()) if file else ""


def trusted_as_loaded(classes: Iterable[type]) -> TrustedCode:
    """The code of these classes, with the content that has run here; another process may then run the same."""
    modules = [sys.modules[cls.__module__] for cls in classes]
    hashes = frozenset(getattr(m, _HASH_NAME) for m in modules if hasattr(m, _HASH_NAME))
    return TrustedCode(modules=frozenset(m.__name__ for m in modules), hashes=hashes, remembered=False)


def _library_effect(name: str) -> type[Effect]:
    """The effect of the library with this id."""
    by_id = {cls.id: cls for cls in LIBRARY}
    if name.endswith(".py"):
        raise EffectError(f"{name} names no class; write {name}:ClassName")
    if name.endswith((".yaml", ".yml")):
        raise EffectError(f"{name} is no effect class; a tabulated law belongs into `effects:` of a configuration")
    if name not in by_id:
        close = difflib.get_close_matches(name, by_id, n=3, cutoff=0.6)
        hint = f"nearest: {', '.join(close)}" if close else "`edhas effects` lists them"
        raise EffectError(f"no effect `{name}` in the library; {hint}; your own: file.py:ClassName")
    return by_id[name]


def _load_file(
    source: str, name: str, base_dir: Path, option: str, trusted: TrustedCode
) -> tuple[types.ModuleType, str]:
    """The module made from a file, and its path for messages; what is run is what was compared with `trusted`."""
    path = base_dir / source
    shown = display_path(path)
    try:
        content = read_regular_file(path, MAX_CODE_BYTES)
    except FileNotFoundError:
        raise EffectError(f"{shown}: no such file") from None
    except OSError as error:
        raise EffectError(f"{shown}: {error.strerror or error}") from None
    resolved = str(path.resolve())
    module_name = f"{_MODULE_PREFIX}{path.stem}_{content_hash(resolved.encode() + content)[:16]}"
    if module_name in sys.modules:  # the same content has run before
        return sys.modules[module_name], shown
    if not trusted.allows_file(path, content):
        raise UntrustedCodeError(untrusted_sentence(path, name, option))
    return _run_file(resolved, content, module_name), shown


def _run_file(path: str, content: bytes, module_name: str) -> types.ModuleType:
    """Run the content of a file as a module."""
    shown = display_path(Path(path))
    module = types.ModuleType(module_name)
    module.__file__ = path
    setattr(module, _HASH_NAME, content_hash(content))
    try:
        code = compile(content, path, "exec")
    except SyntaxError as error:
        raise EffectError(f"{shown}:{error.lineno or 1}: syntax error: {error.msg}") from None
    except ValueError as error:
        raise EffectError(f"{shown}: is not a file of Python code: {first_line(error)}") from None
    sys.modules[module.__name__] = module  # dataclasses look up the module of a class there
    try:
        exec(code, module.__dict__)
    except BaseException as error:  # also what ends a program, such as sys.exit
        del sys.modules[module.__name__]
        reraise_interrupt(error)
        is_own_error = isinstance(error, EffectError | ControllerError)
        what = "" if is_own_error else f"{type(error).__name__} while the file is read: "
        raise EffectError(f"{shown}:{error_line(error, path) or 1}: {what}{first_line(error)}".rstrip(": ")) from error
    return module


def _load_module(
    source: str, name: str, base_dir: Path, option: str, trusted: TrustedCode
) -> tuple[types.ModuleType, str]:
    """An imported module, and its name for messages; one that is not imported yet is only if it is trusted."""
    package = source.partition(".")[0]
    hint = f"; did you mean {source}.py?" if (base_dir / f"{source}.py").is_file() else ""
    if source not in sys.modules and package != PACKAGE and not trusted.allows_module(source):
        if not package.isidentifier() or importlib.util.find_spec(package) is None:  # which imports nothing
            raise EffectError(f"no module `{source}`{hint}")
        raise UntrustedCodeError(
            f"{source}: is a Python module that was not allowed to run; add `{option} {source}:{name}` to the command "
            f"(in Python: import it first, or trust=[\"{source}\"]){hint}"
        )
    try:
        return importlib.import_module(source), source
    except BaseException as error:
        reraise_interrupt(error)
        if isinstance(error, ModuleNotFoundError) and error.name and (source + ".").startswith(error.name + "."):
            raise EffectError(f"no module `{source}`{hint}") from None
        frames = [f for f in traceback.extract_tb(error.__traceback__) if "importlib" not in f.filename]
        at = f"{display_path(Path(frames[-1].filename))}:{frames[-1].lineno}" if frames else source
        raise EffectError(f"{at}: {type(error).__name__} while {source} is read: {first_line(error)}") from error


def _class_hint(module: types.ModuleType, name: str, base: type) -> str:
    """The classes of a module that may have been meant, for a message."""
    own = [n for n, v in vars(module).items() if isinstance(v, type) and issubclass(v, base) and v is not base]
    return suggest(name, own) if own else f"there is no {base.__name__.lower()} in it"
