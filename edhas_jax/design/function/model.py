"""A machine as pure functions of its parameters: `metrics` in the periodic state and `trajectory` from rest."""

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.config.machine_config import Config, as_config
from edhas_jax.core.structs import Parameter
from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import UnitError, format_quantity, to_si
from edhas_jax.design.batch.batch import BatchError
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.function.computations import PeriodicMetrics, SampledTrajectory
from edhas_jax.design.function.host_function import HostFunction, require_outputs
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.machine.interface.metrics import metrics_of_batch
from edhas_jax.machine.parameters import (
    ParameterError,
    find_parameter,
    format_span,
    get_parameter,
    list_parameters,
    parse_value,
    short_names,
)
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.integrator import DEFAULT_STEP, LARGEST_STEP, signal_names
from edhas_jax.simulation.validity import Status

# as accurate as a sweep at the default step; elasticities within 0.011, see docs/gradients.md
FUNCTION_SETTINGS = GradientSettings(steps_per_cycle=4096)

Resolve = Callable[[Rig, str], tuple[Parameter, str]]  # (machine, name) → declaration and own name


class Model:
    """The functions `metrics` and `trajectory` of one machine; made by `edhas_jax.model`.

    Both are pure functions of a dictionary of parameters that `jax.jit`, `jax.vmap`, `jax.grad`, `jax.jacfwd`,
    `jax.jacrev` and optimisers such as optax take. `jax.vmap` over N sets of parameters is one batch of N lanes on the
    loop engine. Another number compiles nothing; another set of names compiles a loop, which is then kept.

    Results have the precision that JAX has been given (`jax.config.update("jax_enable_x64", True)` for double
    precision); the machine itself is always computed in double precision. Inside `jax.jit` the loops run on the
    processor, also where JAX has an accelerator. There are first derivatives only.

    Attributes:
        machine: the machine; parameters that are not given to a function have the values that they have here.
        settings: steps per cycle, tolerance and cycles of `metrics`.
        step: largest time step of `trajectory` [s].
    """

    def __init__(self, machine: Rig, settings: GradientSettings = FUNCTION_SETTINGS, step: float = DEFAULT_STEP):
        if not 0.0 < step <= LARGEST_STEP:
            raise ValueError(f"step {step * 1e6:.4g} µs: must lie above 0 and at most {LARGEST_STEP * 1e6:.0f} µs")
        self.machine, self.settings, self.step = machine, settings, step
        self._metric_function = functools.cache(lambda names: HostFunction(self._periodic(names), names))
        self._trajectory_function = functools.cache(
            lambda names: HostFunction(SampledTrajectory(machine, names, step), names)
        )

    def __repr__(self) -> str:
        return f"<Model of the {self.machine.name}: metrics(parameters), trajectory(parameters, times)>"

    @functools.cached_property
    def parameters(self) -> dict[str, float]:
        """The parameters that can be given to the functions, with their present values in SI."""
        names = short_names(self.machine)
        return {names[path, p.name]: float(value) for p, value, path in list_parameters(self.machine)}

    @functools.cached_property
    def metric_names(self) -> tuple[str, ...]:
        """The metrics of this machine."""
        return tuple(metrics_of_batch(self.machine))

    @functools.cached_property
    def signal_names(self) -> tuple[str, ...]:
        """The signals of this machine."""
        return signal_names(self.machine)

    def metrics(self, parameters: Mapping[str, Any], names: Sequence[str] | None = None) -> dict[str, jax.Array]:
        """The metrics in the periodic state.

        Args:
            parameters: by name a number in SI, such as {"piston_clearance": 15e-6, "frequency": 20.0}; also a text with
                unit, an array (all are broadcast to one shape), or names nested by owner. Values that JAX traces are
                not checked.
            names: the metrics that are wanted; None: all. Fewer make reverse mode cheaper where parameters are many.

        Returns:
            By metric its value in SI, of the shape of the parameters. NaN where the machine does not become periodic or
            leaves what the model describes (`status` says which); the derivatives of a machine that stalls are NaN.

        Raises:
            BatchError: the machine is not driven by a sine on a bench.
            ParameterError: an unknown or ambiguous name, or a value outside its span.
            ValueError: an unknown metric.
        """
        self._require_periodic()
        names = require_outputs(names, self.metric_names, "metric")
        return self._metric_function(names)(self._columns(parameters, resolve_parameter))

    def status(self, parameters: Mapping[str, Any]) -> Any:
        """How the runs of `metrics` end; `edhas_jax.simulation.validity.REASONS` has a sentence for each `Status`.

        Args:
            parameters: as for `metrics`; JAX cannot trace them here.

        Returns:
            A `Status`, or an array of them of the shape of the parameters.

        Raises:
            BatchError: as for `metrics`.
            ParameterError: as for `metrics`.
        """
        self._require_periodic()
        columns = {n: np.asarray(v, float) for n, v in self._columns(parameters, resolve_parameter).items()}
        shape = next(iter(columns.values())).shape
        found = self._periodic(()).status({n: v.ravel() for n, v in columns.items()})
        statuses = np.array([Status(int(s)) for s in found], object).reshape(shape)
        return statuses if shape else statuses[()]

    def trajectory(
        self, parameters: Mapping[str, Any], times: Any, signals: Sequence[str] | None = None
    ) -> dict[str, jax.Array]:
        """The signals at given times of a run from rest.

        The step is at most `step`, and a sample falls on every time if the times are evenly spaced and their first one
        is 0 or a multiple of the interval; otherwise signals are interpolated linearly between the steps. The step is
        not checked against a smaller one, as `edhas_jax.simulate` does.

        Args:
            parameters: as for `metrics`.
            times: of the samples [s], (times,), none negative; they have no derivative.
            signals: the names of those that are wanted; None: all of the machine.

        Returns:
            By signal its values in SI, of the shape of the parameters followed by (times,). NaN from where the run is
            no longer finite.

        Raises:
            ParameterError: an unknown or ambiguous name, or a value outside its span.
            ValueError: an unknown signal, or times that are no list of times.
        """
        names = require_outputs(signals, self.signal_names, "signal")
        times = jnp.asarray(times).astype(jnp.result_type(float))
        if times.ndim != 1 or not times.size:
            raise ValueError(f"times: a list of times [s] belongs here, not an array of shape {times.shape}")
        if not isinstance(times, jax.core.Tracer) and not (np.isfinite(times).all() and (np.asarray(times) >= 0).all()):
            raise ValueError("times: finite numbers from 0 s on belong here")
        return self._trajectory_function(names)(self._columns(parameters, _own_parameter), times)

    def _periodic(self, names: tuple[str, ...]) -> PeriodicMetrics:
        return PeriodicMetrics(self.machine, names, self.settings)

    def _columns(self, parameters: Mapping[str, Any], resolve) -> dict[str, jax.Array]:
        if columns := named_columns(self.machine, parameters, resolve):
            return columns
        # a batch needs a column: the first parameter at its present value changes nothing
        name = next(iter(self.parameters))
        return {name: jnp.asarray(float(get_parameter(self.machine, name)), jnp.result_type(float))}

    def _require_periodic(self) -> None:
        if self.machine.cycle is None:
            raise BatchError(f"metrics of a periodic state need a bench that is driven by a sine; this is "
                             f"{self.machine.name}: take `trajectory`")  # fmt: skip


def _own_parameter(machine: Rig, name: str) -> tuple[Parameter, str]:
    p, path = find_parameter(machine, name)
    return p, short_names(machine)[path, p.name]


def named_columns(machine: Rig, parameters: Mapping[str, Any], resolve: Resolve) -> dict[str, jax.Array]:
    """The parameters by their own names, in the order of these, broadcast to one shape.

    Args:
        machine: the machine that owns them.
        parameters: by flat name or `owner.name`, or nested by owner, a number or array in SI, or a text with unit.
            Values that JAX traces are not checked.
        resolve: finds a parameter by its name.

    Raises:
        ParameterError: an unknown, ambiguous or repeated name, a value that is no number or outside its span, or shapes
            that do not go together.
    """
    if not isinstance(parameters, Mapping):
        raise ParameterError(f"parameters by name belong here, such as {{'piston_clearance': 15e-6}}, not "
                             f"{type(parameters).__name__}")  # fmt: skip
    found: dict[str, jax.Array] = {}
    for name, value in _flat("", parameters):
        try:
            p, own = resolve(machine, name)
            if own in found:
                raise ParameterError("given twice")
            found[own] = _checked(p, value)
        except (ParameterError, UnitError) as error:
            raise ParameterError(f"{name}: {error}") from None
    try:
        shape = np.broadcast_shapes(*(v.shape for v in found.values()))
    except ValueError:
        shapes = ", ".join(f"{n} {v.shape}" for n, v in found.items())
        raise ParameterError(f"the shapes of the parameters do not go together: {shapes}") from None
    return {n: jnp.broadcast_to(found[n], shape) for n in sorted(found)}


def _flat(owner: str, parameters: Mapping[str, Any]):
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            yield from _flat(f"{owner}{name}.", value)
        else:
            yield f"{owner}{name}", value


def _checked(p: Parameter, value: Any) -> jax.Array:
    if isinstance(value, str):
        value = parse_value(p, value)
    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError):
        array = None
    if array is None or not (jnp.issubdtype(array.dtype, jnp.floating) or jnp.issubdtype(array.dtype, jnp.integer)):
        example = format_quantity(p.default, p.unit)
        raise ParameterError(f'a number, an array or a text such as "{example}" belongs here')
    array = array.astype(jnp.result_type(float))
    if not isinstance(array, jax.core.Tracer):
        numbers, (low, high) = np.asarray(array, float), p.span
        # single precision moves a value on its bound by half a unit
        margin = 0.0 if array.dtype == np.float64 else 1e-6 * max(abs(low), abs(high))
        outside = ~((numbers >= low - margin) & (numbers <= high + margin))
        if outside.any():
            got = format_quantity(float(numbers[outside].ravel()[0]), p.unit)
            raise ParameterError(f"must lie in {format_span(p)} ({p.doc}); got {got}")
    return array


def model(
    source: Rig | Config | Mapping[str, Any] | Path | str,
    settings: GradientSettings = FUNCTION_SETTINGS,
    step: float | str | None = None,
    trust: Trust = (),
) -> Model:
    """A machine as pure functions of its parameters, for `jax.jit`, `jax.vmap`, `jax.grad` and optimisers.

        pump = edhas_jax.model("configs/paper.yaml")
        flow = lambda clearance: pump.metrics({"piston_clearance": clearance})["mean_flow"]
        jax.grad(flow)(15e-6)

    Args:
        source: a machine, a configuration, its file, or a mapping with the same keys as a file.
        settings: steps per cycle, tolerance and cycles of `metrics`.
        step: largest time step of `trajectory` [s], or a text with unit; None: that of the configuration, or 20 µs.
        trust: Python files of your own that may run if the configuration names them.

    Raises:
        ConfigError: the configuration has problems; all are listed.
        UnitError: `step` is a text that is no time.
        ValueError: `step` is not above 0 and at most 100 µs.
    """
    config = as_config(source, trust)
    step = config.simulation.step if step is None else step
    step = to_si(step, "s", "20 us") if isinstance(step, str) else step
    return Model(config.machine, settings, DEFAULT_STEP if step is None else step)
