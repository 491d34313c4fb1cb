"""Many designs of one machine: each to its periodic state, metrics reduced inside the time loop."""

import dataclasses
import enum
import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from edhas_jax import tree
from edhas_jax.components.reference import CyclicSine
from edhas_jax.integrate import DEFAULT_STEP, watched_step
from edhas_jax.parameters import get_parameter, set_parameters
from edhas_jax.run import Precision
from edhas_jax.system import ActuatorBench, ActuatorSystem, Rig, Sine

# Arrays of this many designs: enough to keep vector units busy, little enough to stay in the first-level cache.
LANES = {Precision.FLOAT32: 128, Precision.FLOAT64: 64}
BLOCKS_PER_CHUNK = 4


class Status(enum.IntEnum):
    """What became of a design; anything but OK says why its metrics are not to be trusted."""

    OK = 0
    NOT_PERIODIC = 1
    STALLED = 2
    HIT_STOPS = 3
    OUT_OF_RANGE = 4
    NOT_FINITE = 5


REASONS = {
    Status.OK: "periodic, within the model's validity",
    Status.NOT_PERIODIC: "still changing from cycle to cycle when the cycles ran out",
    Status.STALLED: "the piston follows less than half of its set point",
    Status.HIT_STOPS: "the piston ran onto an end stop",
    Status.OUT_OF_RANGE: "a valve, a pressure or the piston left the range that the model describes",
    Status.NOT_FINITE: "the run is not finite",
}


@dataclasses.dataclass(frozen=True)
class BatchSettings:
    """How a batch is run.

    `step` [s] is the largest time step: each design takes equal steps per cycle, as many as keep below it. A design is
    periodic when flow, electrical power and stroke change by less than `tolerance` from one cycle to the next.
    """

    step: float = DEFAULT_STEP
    tolerance: float = 1e-4
    max_cycles: int = 16
    precision: Precision = Precision.FLOAT64


@dataclasses.dataclass(frozen=True)
class Chunk:
    """The designs that are run together: their rows in the table, and the steps that each takes per cycle."""

    rows: np.ndarray
    steps_per_cycle: int


class BatchError(ValueError):
    """These designs cannot be run as a batch."""


def plan_chunks(machine: Rig, values: Mapping[str, np.ndarray], settings: BatchSettings) -> list[Chunk]:
    """Cut a table of designs into chunks, the same for the same table wherever it is run.

    Designs that take the same number of steps per cycle go together, so that a slow frequency keeps no other waiting.

    Raises:
        BatchError: the machine is not driven by a sine on a bench.
    """
    if isinstance(machine, ActuatorSystem) or not isinstance(machine.reference, Sine):
        raise BatchError(f"a batch needs a bench that is driven by a sine; this is {machine.name}")
    count = len(next(iter(values.values())))
    frequency = np.asarray(values.get("frequency", get_parameter(machine, "frequency")), float)
    frequency = np.broadcast_to(frequency, (count,))
    steps = np.array([steps_per_cycle(f, settings.step) for f in frequency])
    size = LANES[settings.precision] * BLOCKS_PER_CHUNK
    chunks = []
    for n in np.unique(steps):
        rows = np.flatnonzero(steps == n)
        chunks += [Chunk(rows[i : i + size], int(n)) for i in range(0, len(rows), size)]
    return chunks


def steps_per_cycle(frequency: float, step: float) -> int:
    """Steps of at most `step` [s] in a cycle, rounded up on a ladder of √2 so that designs share their count."""
    least = max(1.0 / (frequency * step), 64.0)
    return int(round(64 * 2.0 ** (math.ceil(2 * math.log2(least / 64.0) - 1e-9) / 2)))


def run_chunk(
    machine: Rig, values: Mapping[str, np.ndarray], chunk: Chunk, settings: BatchSettings
) -> dict[str, np.ndarray]:
    """Run the designs of one chunk: every metric in SI, `status`, `cycles` and `residual`, one value per row.

    The result depends on the designs and settings alone, not on the number of cores or on the neighbours.
    """
    lanes, dtype = LANES[settings.precision], np.dtype(settings.precision.value)
    count = len(chunk.rows)
    padded = np.concatenate([chunk.rows, np.repeat(chunk.rows[-1:], BLOCKS_PER_CHUNK * lanes - count)])
    columns = {n: np.asarray(v)[padded].astype(dtype).reshape(BLOCKS_PER_CHUNK, lanes) for n, v in values.items()}
    base = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    tolerance = dtype.type(settings.tolerance)
    out = _runner()(base, columns, chunk.steps_per_cycle, settings.max_cycles, tolerance)
    return {n: np.asarray(v).reshape(-1)[:count].astype(float) for n, v in jax.device_get(out).items()}


def run_designs(
    machine: Rig, values: Mapping[str, np.ndarray], settings: BatchSettings = BatchSettings(), on_chunk=None
) -> dict[str, np.ndarray]:
    """Run a table of designs (columns: parameter name → SI values) and return its metrics in the same order.

    `on_chunk(done, total)` is called with the number of designs after each chunk.
    """
    count = len(next(iter(values.values())))
    table: dict[str, np.ndarray] = {}
    done = 0
    for chunk in plan_chunks(machine, values, settings):
        for name, column in run_chunk(machine, values, chunk, settings).items():
            table.setdefault(name, np.full(count, np.nan))[chunk.rows] = column
        done += len(chunk.rows)
        if on_chunk is not None:
            on_chunk(done, count)
    return table


def _runner():
    """The compiled program for a chunk: its blocks are spread over the cores, each runs its own loop."""
    devices = jax.local_devices()
    cores = max(n for n in range(1, len(devices) + 1) if BLOCKS_PER_CHUNK % n == 0)
    return _compiled(tuple(devices[:cores]))


@partial(jax.jit, static_argnums=0)
def _on_devices(devices, machine, columns, steps, max_cycles, tolerance):
    def blocks(machine, columns, steps, max_cycles, tolerance):
        return jax.lax.map(lambda block: _block(machine, block, steps, max_cycles, tolerance), columns)

    whole, split = PartitionSpec(), PartitionSpec("cores")
    return jax.shard_map(
        blocks,
        mesh=Mesh(np.array(devices), ("cores",)),
        in_specs=(whole, split, whole, whole, whole),
        out_specs=split,
        check_vma=False,
    )(machine, columns, steps, max_cycles, tolerance)


def _compiled(devices):
    return partial(_on_devices, devices)


def _block(machine: Rig, block: dict[str, Any], steps, max_cycles, tolerance) -> dict[str, Any]:
    """The designs of one block, all their cycles; columns of shape (lanes,)."""
    lanes = next(iter(block.values())).shape[0]
    dtype = jnp.result_type(tolerance)

    def design(values):
        return set_parameters(machine, values)

    def begin(values):
        m = design(values)
        y = {n: jnp.asarray(v, dtype) for n, v in m.start().items()}
        return y, _measured(m, _empty(m, dtype), jnp.ones((), dtype))

    def cycle(values, y, number):
        m = design(values)

        def one(n, carry):
            y, sums = carry
            phase = (n.astype(dtype) + 0.5) / steps.astype(dtype)
            h = 1.0 / (m.reference.frequency * steps.astype(dtype))
            reference = CyclicSine.at_phase(m.reference, phase, number == 0)
            y, seen = _take(tree.replace(m, reference=reference), y, h)
            return y, _add(m, sums, seen, phase)

        y, sums = jax.lax.fori_loop(0, steps, one, (y, _empty(m, dtype)))
        return y, _measured(m, sums, 1.0 / steps.astype(dtype))

    def going_on(carry):
        number, _, _, _, done = carry
        return (number < max_cycles) & ~done.all()

    def next_cycle(carry):
        number, y, kept, cycles, done = carry
        y, new = jax.vmap(cycle, in_axes=(0, 0, None))(block, y, number)
        residual = jnp.max(jnp.stack([_change(new[n], kept[n]) for n in PERIODIC if n in new]), axis=0)
        new["residual"] = jnp.where(number < 2, jnp.ones_like(residual), residual)
        kept = {n: jnp.where(done, kept[n], new[n]) for n in kept}
        cycles = jnp.where(done, cycles, number + 1)
        finite = jnp.isfinite(kept["mean_electrical_power"])
        return number + 1, y, kept, cycles, done | (new["residual"] <= tolerance) | ~finite

    y, first = jax.vmap(begin)(block)
    first["residual"] = jnp.ones((lanes,), dtype)
    zero = jnp.zeros((), int)
    start = (zero, y, first, jnp.zeros((lanes,), int), jnp.zeros((lanes,), bool))
    _, _, kept, cycles, done = jax.lax.while_loop(going_on, next_cycle, start)
    status = jax.vmap(lambda values, out, ok: _status(design(values), out, ok))(block, kept, done)
    shown = {n: v for n, v in kept.items() if not n.startswith("_")}
    return shown | {"cycles": cycles.astype(dtype), "status": status.astype(dtype)}


PERIODIC = ("mean_flow", "mean_electrical_power", "peak_stroke")


def _change(new, old):
    return jnp.abs(new - old) / (jnp.abs(new) + jnp.finfo(new.dtype).tiny)


def _watched(m: Rig) -> tuple[str, ...]:
    actuator = ("voltage", "coil_voltage", "current", "resistance", "piston_position", "piston_velocity", "reference")
    if isinstance(m, ActuatorBench):
        return actuator
    return (*actuator, "outlet_flow", "outlet_pressure", "accumulator_pressure", "leakage_a", "leakage_b")


def _take(m: Rig, y, h):
    y, _, seen = watched_step(m, y, 0.0, h, _watched(m))
    if not isinstance(m, ActuatorBench):
        lifts = [y[f"{kind}_lift_{side}"] for kind in ("suction", "delivery") for side in "ab"]
        seen["highest_lift"] = jnp.maximum(jnp.maximum(lifts[0], lifts[1]), jnp.maximum(lifts[2], lifts[3]))
        seen["lowest_lift"] = jnp.minimum(jnp.minimum(lifts[0], lifts[1]), jnp.minimum(lifts[2], lifts[3]))
    return y, seen


SUMS = ("power", "copper", "current²", "voltage²", "error²", "x sin", "x cos", "r sin", "r cos")
PUMP_SUMS = ("flow", "leakage", "swept", "delivered")
PEAKS = ("current", "voltage", "stroke")
PUMP_PEAKS = ("leakage", "pressure", "rise", "lift", "-pressure", "-lift")


def _empty(m: Rig, dtype) -> dict[str, Any]:
    pump = not isinstance(m, ActuatorBench)
    zeros = {n: jnp.zeros((), dtype) for n in SUMS + (PUMP_SUMS if pump else ())}
    return zeros | {f"peak {n}": jnp.full((), -jnp.inf, dtype) for n in PEAKS + (PUMP_PEAKS if pump else ())}


def _add(m: Rig, sums, s, phase) -> dict[str, Any]:
    """What one step adds to the sums and peaks of a cycle."""
    i, u, x = s["current"], s["voltage"], s["piston_position"]
    sine, cosine = jnp.sin(2 * jnp.pi * phase), jnp.cos(2 * jnp.pi * phase)
    supplied = u if "current" in m.amplifier.initial() else s["coil_voltage"]
    new = {
        "power": supplied * i, "copper": s["resistance"] * i * i, "current²": i * i, "voltage²": u * u,
        "error²": (s["reference"] - x) ** 2, "x sin": x * sine, "x cos": x * cosine,
        "r sin": s["reference"] * sine, "r cos": s["reference"] * cosine,
    }  # fmt: skip
    peaks = {"current": jnp.abs(i), "voltage": jnp.abs(u), "stroke": jnp.abs(x)}
    if "outlet_flow" in s:
        rise = s["outlet_pressure"] - s["accumulator_pressure"]
        new |= {
            "flow": s["outlet_flow"], "leakage": s["leakage_a"] + s["leakage_b"],
            "swept": jnp.abs(s["piston_velocity"]), "delivered": s["outlet_flow"] * rise,
        }  # fmt: skip
        peaks |= {
            "leakage": jnp.maximum(jnp.abs(s["leakage_a"]), jnp.abs(s["leakage_b"])), "rise": rise,
            "pressure": s["outlet_pressure"], "-pressure": -s["outlet_pressure"],
            "lift": s["highest_lift"], "-lift": -s["lowest_lift"],
        }  # fmt: skip
    return {n: sums[n] + v for n, v in new.items()} | {
        f"peak {n}": jnp.maximum(sums[f"peak {n}"], v) for n, v in peaks.items()
    }


def _measured(m: Rig, sums, share) -> dict[str, Any]:
    """The metrics of a cycle from its sums; names and meanings as in `edhas_jax.metrics`."""
    mean = {n: v * share for n, v in sums.items() if not n.startswith("peak ")}
    peak = {n.removeprefix("peak "): v for n, v in sums.items() if n.startswith("peak ")}
    got, wanted = (mean["x sin"], mean["x cos"]), (mean["r sin"], mean["r cos"])
    square = wanted[0] ** 2 + wanted[1] ** 2
    out = {
        "mean_electrical_power": mean["power"], "copper_loss": mean["copper"],
        "rms_current": jnp.sqrt(mean["current²"]), "peak_current": peak["current"],
        "rms_voltage": jnp.sqrt(mean["voltage²"]), "peak_voltage": peak["voltage"],
        "peak_stroke": peak["stroke"], "tracking_error": jnp.sqrt(mean["error²"]),
        "amplitude_ratio": jnp.sqrt((got[0] ** 2 + got[1] ** 2) / square),
        "phase_lag": jnp.arctan2(
            got[0] * wanted[1] - got[1] * wanted[0], got[0] * wanted[0] + got[1] * wanted[1]
        ) * 1.0,
    }  # fmt: skip
    if "flow" in mean:
        out |= {
            "mean_flow": mean["flow"], "mean_leakage": mean["leakage"], "peak_leakage": peak["leakage"],
            "peak_outlet_pressure": peak["pressure"], "pressure_rise": peak["rise"],
            "pressure_ripple": peak["pressure"] + peak["-pressure"],
            "volumetric_efficiency": mean["flow"] / (m.pump.area() * mean["swept"]),
            "delivered_power": mean["delivered"], "overall_efficiency": mean["delivered"] / mean["power"],
            "_lift": peak["lift"], "_-lift": peak["-lift"], "_-pressure": peak["-pressure"],
        }  # fmt: skip
    return out


def _status(m: Rig, out, periodic):
    """The gravest thing that can be said of a design."""
    half = 0.5 * m.stops.pump_stroke
    status = jnp.where(periodic, Status.OK, Status.NOT_PERIODIC)
    status = jnp.where(out["amplitude_ratio"] < 0.5, Status.STALLED, status)
    status = jnp.where(out["peak_stroke"] > half, Status.HIT_STOPS, status)
    beyond = out["peak_stroke"] > 1.2 * half
    if "_lift" in out:
        give = 0.5 * m.valve.valve_seat_diameter
        beyond |= (out["_lift"] > m.valve.valve_max_lift + give) | (out["_-lift"] > give) | (out["_-pressure"] > 0.0)
    status = jnp.where(beyond, Status.OUT_OF_RANGE, status)
    finite = jnp.stack([jnp.isfinite(v) for n, v in out.items() if n != "residual"]).all()
    return jnp.where(finite, status, Status.NOT_FINITE)
