"""The figures of the paper, evaluated from simulations of many machines at once, with derivatives where needed."""

import math
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.machine.metrics import SETTLING_BAND
from edhas_jax.machine.parameters import get_parameter, list_parameters
from edhas_jax.machine.rigs import ActuatorSystem, PumpBench
from edhas_jax.simulation.batch_trajectories import simulate_batch

Table = Mapping[str, np.ndarray]
SAMPLES = 1000  # per cycle
STEP = 20e-6  # s, largest time step
RUN_IN = 0.4  # s before the cycle that is evaluated, including the ramp
STEP_RATE, STEP_TIME = 2000, 1.0  # samples per second and length of a step response [s]
FREQUENCIES = tuple(np.arange(4.0, 61.0, 2.0).tolist())  # Hz
COARSE_FREQUENCIES = (10.0, 15.0, 20.0, 24.0, 28.0, 30.0, 32.0, 36.0, 40.0, 46.0, 52.0, 60.0)
LPM = 6e4  # L/min per m³/s
BENCH_SIGNALS = (
    "piston_position", "outlet_pressure", "accumulator_pressure", "outlet_flow", "leakage_a", "delivery_flow_a",
    "suction_flow_a", "piston_velocity",
)  # fmt: skip


def settled_cycle(machine: PumpBench, table: Table, frequency: float, seeds: Table | None = None):
    """One settled cycle of each row of `table` (SI) at `frequency` [Hz]: signals and derivatives, (SAMPLES, rows)."""
    cycles = math.ceil(RUN_IN * frequency)
    interval = 1.0 / (frequency * SAMPLES)
    per_sample = math.ceil(interval / STEP)
    count = len(next(iter(table.values())))
    values = {n: np.asarray(v, float) for n, v in table.items()} | {"frequency": np.full(count, float(frequency))}
    length = (cycles + 1) * SAMPLES
    found = simulate_batch(machine, values, seeds, interval / per_sample, per_sample, length, BENCH_SIGNALS)
    return tuple(part and {n: v[-SAMPLES:] for n, v in part.items()} for part in found)


def peak(values):
    """Position (in samples) and height of the maximum of periodic samples, by a parabola through three of them."""
    k = jnp.argmax(values)
    before, middle, after = (values[(k + j) % values.shape[0]] for j in (-1, 0, 1))
    curvature = before - 2.0 * middle + after
    shift = 0.5 * (before - after) / jnp.where(curvature == 0.0, 1.0, curvature)
    return k.astype(values.dtype) + shift, middle - 0.25 * (before - after) * shift


def tracking(cycle: dict, amplitude: float) -> dict:
    """The figures of a cycle at 10 Hz; the set point has its peak after a quarter of the cycle."""
    place, height = peak(cycle["piston_position"])
    rise = cycle["outlet_pressure"] - cycle["accumulator_pressure"]
    back = -jnp.minimum(cycle["delivery_flow_a"], 0.0) - jnp.minimum(cycle["suction_flow_a"], 0.0)
    return {
        "lag": 360.0 * (place / SAMPLES - 0.25),
        "loss": 100.0 * (1.0 - height / amplitude),
        "pressure": 1e-6 * peak(rise)[1],
        "leak_mean": 2.0 * LPM * jnp.mean(cycle["leakage_a"]),
        "leak_stroke": LPM * jnp.max(jnp.abs(cycle["leakage_a"])),
        "leak_spike": LPM * jnp.max(back + jnp.maximum(cycle["leakage_a"], 0.0)),
    }


_tracking = jax.jit(jax.vmap(tracking, in_axes=(1, None)))


def figures_at_10_hz(machine: PumpBench, table: Table) -> dict[str, np.ndarray]:
    """The figures of the tests at 10 Hz, one value per row of `table`."""
    cycle, _ = settled_cycle(machine, table, 10.0)
    return jax.device_get(_tracking(cycle, float(get_parameter(machine, "amplitude"))))


def mean_flows(machine: PumpBench, table: Table, frequencies) -> np.ndarray:
    """Mean flow [L/min], (frequencies, rows)."""
    return np.stack([LPM * settled_cycle(machine, table, f)[0]["outlet_flow"].mean(axis=0) for f in frequencies])


def figures_over_frequency(machine: PumpBench, table: Table, frequencies: tuple[float, ...]) -> dict[str, np.ndarray]:
    """The figures of the test over frequency; `knee` is NaN where the flow still rises at the end."""
    flow = mean_flows(machine, table, frequencies)
    at_10, at_20, at_30 = (flow[frequencies.index(f)] for f in (10.0, 20.0, 30.0))
    return {
        "proportion": at_20 / (2.0 * at_10),
        "filling": at_30 / (30.0 * swept_volume(machine)),
        "knee": np.array([_frequency_of_largest_flow(np.array(frequencies), column) for column in flow.T]),
    }


def swept_volume(machine: PumpBench) -> float:
    """Swept volume of both plungers per cycle, 4 a S_p, as flow per frequency [L/(min·Hz)]."""
    return 4.0 * float(get_parameter(machine, "amplitude")) * float(machine.pump.area()) * LPM


def _frequency_of_largest_flow(frequency: np.ndarray, flow: np.ndarray) -> float:
    """The maximum of a parabola through the largest flow and its neighbours [Hz]; NaN if it is the first or last."""
    k = int(flow.argmax())
    if k in (0, len(flow) - 1):
        return math.nan
    near = slice(k - 1, k + 2)
    curvature, slope, _ = np.polyfit(frequency[near] - frequency[k], flow[near], 2)
    return float(frequency[k] - 0.5 * slope / curvature)


def step_figures(machine: ActuatorSystem, table: Table, band: float = SETTLING_BAND) -> dict[str, np.ndarray]:
    """The figures of the 15 mm step; `response` is the time after which the cylinder stays within `band`, or NaN."""
    per_sample = math.ceil(1.0 / (STEP_RATE * STEP) - 1e-9)
    samples = int(STEP_TIME * STEP_RATE) + 1
    watch = ("cylinder_position", "target")
    found = simulate_batch(machine, table, None, 1.0 / (STEP_RATE * per_sample), per_sample, samples, watch).values
    position, target = found["cylinder_position"].T, found["target"][-1]
    return {
        "response": np.array([settling_time(x, end, band) for x, end in zip(position, target, strict=True)]),
        "steady": 1e3 * (target - position[:, -1]),
    }


def settling_time(position: np.ndarray, target: float, band: float) -> float:
    """The time [s] after which a step response stays within the relative `band` of its target; NaN if it does not."""
    error = np.abs(position / target - 1.0)
    k = int(np.flatnonzero(~(error <= band))[-1])
    if k + 1 == len(error):
        return math.nan
    return (k + (error[k] - band) / (error[k] - error[k + 1])) / STEP_RATE


def all_figures(
    bench: PumpBench, system: ActuatorSystem, table: Table, frequencies: tuple[float, ...]
) -> dict[str, np.ndarray]:
    """All figures by key, one value per row of `table`; each rig takes the parameters that it has."""
    known = [{p.name for p, _, _ in list_parameters(machine)} for machine in (bench, system)]
    on_bench, on_system = ({n: v for n, v in table.items() if n in names} for names in known)
    flow_figures = figures_over_frequency(bench, on_bench, frequencies)
    return figures_at_10_hz(bench, on_bench) | flow_figures | step_figures(system, on_system)
