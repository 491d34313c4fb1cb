"""Checks of a configured machine that involve several parameters or components."""

from collections.abc import Iterator, Mapping

import numpy as np

from edhas_jax.config.yaml_with_lines import KeyPath
from edhas_jax.core.source_location import is_users_code
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.components.controller_sampling import Sampled
from edhas_jax.machine.components.controllers import OpenLoop
from edhas_jax.machine.components.cylinder import Cylinder
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.effects.base import EffectError
from edhas_jax.machine.effects.tabulated_law import table_of
from edhas_jax.machine.effects.validation import check_derivatives
from edhas_jax.machine.parameters import order_problems
from edhas_jax.machine.rigs import Rig

Problem = tuple[KeyPath, str]
ORDER_CHECKED_BELOW = ("cylinder", "sampling")  # components whose order of parameters has a sentence of its own
GivenKeys = Mapping[tuple[str, str], KeyPath]


def check_machine(m: Rig, given: GivenKeys, incomplete: bool) -> list[Problem]:
    """Check what the range of a single parameter cannot express.

    Args:
        m: the machine with all parameters set.
        given: the key of every parameter that the configuration sets, by (path, name).
        incomplete: whether a component or effect is missing after an earlier problem.

    Returns:
        Key and message of every problem.
    """
    problems = [
        *_check_order(m, given), *_check_tables(m, given), *_check_cylinder(m, given), *_check_chirps(m, given),
        *_check_sampling(m, given),
    ]  # fmt: skip
    return problems if incomplete else [*problems, *_check_open_loop(m, given), *_check_derivatives(m)]


def _key(given: GivenKeys, *names: tuple[str, str]) -> KeyPath:
    """The key of the first of some parameters that the configuration sets; of the first one where it sets none."""
    return next((given[name] for name in names if name in given), names[0])


def _check_derivatives(m: Rig) -> Iterator[Problem]:
    try:
        check_derivatives(m)
    except EffectError as error:
        yield ("rig" if is_users_code(type(m)) else "effects",), str(error)


def _check_order(m: Rig, given: GivenKeys) -> Iterator[Problem]:
    for path, p, problem in order_problems(m):
        if path not in ORDER_CHECKED_BELOW:
            yield _key(given, (path, p.name), (path, p.at_least)), problem


def _check_tables(m: Rig, given: GivenKeys) -> Iterator[Problem]:
    for effect in m.effects:
        table = table_of(effect)
        for k in () if table is None else np.flatnonzero(np.diff(table.nodes) == 0.0):
            key = _key(given, (effect.id, f"node_{k + 2}"), (effect.id, f"node_{k + 1}"))
            yield key, f"node_{k + 1} and node_{k + 2} of {effect.id} coincide; nodes must increase"


def _check_cylinder(m: Rig, given: GivenKeys) -> Iterator[Problem]:
    if isinstance(getattr(m, "cylinder", None), Cylinder) and not m.cylinder.cylinder_rod < m.cylinder.cylinder_bore:
        key = given.get(("cylinder", "cylinder_rod"), _key(given, ("cylinder", "cylinder_bore")))
        rod, bore = (format_quantity(x, "m") for x in (m.cylinder.cylinder_rod, m.cylinder.cylinder_bore))
        yield key, f"the rod ({rod}) must be thinner than the bore ({bore}) of the cylinder"


def _check_chirps(m: Rig, given: GivenKeys) -> Iterator[Problem]:
    for section in dict.fromkeys((*m.drives, "reference", "target")):
        for name in ("start_frequency", "end_frequency"):
            if getattr(getattr(m, section, None), name, 1.0) <= 0.0:
                yield _key(given, (section, name)), "must be above 0 Hz for a chirp"


def _check_sampling(m: Rig, given: GivenKeys) -> Iterator[Problem]:
    sampling = getattr(m, "sampling", None)
    if isinstance(sampling, Sampled) and sampling.computation_delay > sampling.sample_time:
        key = given.get(("sampling", "computation_delay"), ("sampling", "sample_time"))
        limit = format_quantity(sampling.sample_time, "s")
        yield key, f"at most one sample time ({limit}) can pass from a sample to its command"


def _check_open_loop(m: Rig, given: GivenKeys) -> Iterator[Problem]:
    reference = getattr(m, "reference", None)
    if isinstance(getattr(m, "controller", None), OpenLoop) and not isinstance(reference, Recorded | None):
        name = "step_size" if hasattr(reference, "step_size") else "amplitude"
        if ("reference", name) not in given:
            message = "missing; with an open-loop controller the reference is the command"
            yield ("reference", name), f"{message}, write for example `{name}: 12 V`"
