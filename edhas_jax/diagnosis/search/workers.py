"""Worker processes for independent fits of a diagnosis: of several candidates, or of the model without each member.

Any executor of the standard library's kind will do, of processes of this machine or of other machines. Classes that the
package generates travel as the call that generates them; those of the user as the file that they come from.
"""

import concurrent.futures
import dataclasses
import io
import pickle
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from edhas_jax.core.source_location import is_users_code
from edhas_jax.core.trusted_code import TrustedCode
from edhas_jax.inference.fit.fit_problem import FitError
from edhas_jax.machine.effects.loading import class_spec, load_user_class, trusted_as_loaded

T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class Workers:
    """Processes that make fits.

    Args:
        executor: runs calls in other processes.
        own: classes of the user that a fit may contain.
    """

    executor: concurrent.futures.Executor
    own: tuple[type, ...] = ()

    def map(self, function: Callable[..., T], jobs: Sequence[tuple]) -> list[T]:
        """The values of a function for several tuples of arguments, all computed at once.

        Args:
            function: a function of a module.
            jobs: its arguments.

        Raises:
            FitError: a worker failed, or the workers were lost.
        """
        specs, trusted = tuple(class_spec(kind) for kind in self.own), trusted_as_loaded(self.own)
        waiting = [self.executor.submit(_run, specs, trusted, _packed((function, job))) for job in jobs]
        try:
            return [pickle.loads(future.result()) for future in waiting]
        except FitError:
            raise
        except (Exception, concurrent.futures.CancelledError) as error:
            lines = str(error).splitlines() or [type(error).__name__]
            raise FitError(f"a worker failed: {lines[0]}") from error
        finally:
            for future in waiting:
                future.cancel()


def own_classes(parts: Iterable[Any]) -> tuple[type, ...]:
    """The classes of some parts of a machine, or among some classes, that do not belong to the package."""
    kinds = dict.fromkeys(part if isinstance(part, type) else type(part) for part in parts)
    return tuple(kind for kind in kinds if is_users_code(kind))


class _Pickler(pickle.Pickler):
    """Generated classes as the call that generates them."""

    def reducer_override(self, value: Any) -> Any:
        """The call, where `value` is such a class."""
        generated = vars(value).get("_generated_by") if isinstance(value, type) else None
        return NotImplemented if generated is None else generated


def _packed(value: Any) -> bytes:
    out = io.BytesIO()
    _Pickler(out, pickle.HIGHEST_PROTOCOL).dump(value)
    return out.getvalue()


def _run(specs: Sequence[str], trusted: TrustedCode, packed: bytes) -> bytes:
    """In a worker: load the classes of the user, unpack a call, and return its value."""
    for spec in specs:
        source, _, name = spec.rpartition(":")
        load_user_class(source, name, Path(), object, trusted)
    function, arguments = pickle.loads(packed)
    return _packed(function(*arguments))
