"""Diagnosis of benches with a cause of the flow drop, from runs at 10 Hz alone and with more measurements.

The bench has the sensors of the paper: piston position, outlet pressure and flow. The model of the engineer is the
machine whose flow does not drop. Of its valves only the order of magnitude is known, so that late valves are a matter
of calibration; a narrow suction line is an effect that the model lacks.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from edhas_jax.core.units import format_with_error
from edhas_jax.diagnosis.planning.detectability_plan import DetectabilityPlan, plan_detectability
from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.machine.effects import (
    SuctionLineInertance,
    SuctionLineResistance,
    SupplySag,
    ValveAdhesion,
    ValveFlowForce,
)
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.campaign import Campaign, Channel, Use
from studies.flow_drop.causes import SizedCause
from studies.hidden_effects.generators.varied.benches import PUMP_CHANNELS as CHANNELS
from studies.hidden_effects.generators.varied.benches import PUMP_UNCERTAIN as USUAL
from studies.paper.readings import mean_flows
from studies.synthetic_campaign import PlannedRun, draw_parameters, planned_campaign, synthesise

LIBRARY = (ValveAdhesion, SuctionLineResistance, SuctionLineInertance, SupplySag, ValveFlowForce)
UNCERTAIN = USUAL | {
    "valve_spring_rate": 0.7, "valve_mass": 0.7, "valve_preload": 0.1, "accumulator_pressure": 0.05
}  # fmt: skip
TRUE_VALVE_SPREAD = 0.05  # relative spread of the valve parameters of the synthetic benches
PAPER_CHANNELS = {n: CHANNELS[n] for n in ("piston_position", "outlet_pressure", "outlet_flow")}
CHANNELS_WITH_CHAMBER = PAPER_CHANNELS | {"chamber_pressure_a": Channel("MPa", 5e3)}
INTERVAL, CYCLES, RUN_IN = 2e-4, 4.0, 0.12  # s
DAMPING = ("mover_damping", "pump_damping")
PREDICTED_FREQUENCY = 35.0  # Hz, at which a diagnosed model predicts the mean flow


def planned_run(use: Use, frequency: float, amplitude: float, load: float) -> PlannedRun:
    """A run of `CYCLES` cycles after the run-in, SI."""
    conditions = {"frequency": frequency, "amplitude": amplitude, "load_orifice_area": load}
    return PlannedRun(use, RUN_IN + CYCLES / frequency, conditions)


RUNS_10_HZ = (
    planned_run(Use.FIT, 10.0, 3.5e-3, 4.142e-6), planned_run(Use.FIT, 10.0, 3.5e-3, 1.5e-6),
    planned_run(Use.FIT, 10.0, 2.5e-3, 4.142e-6), planned_run(Use.HOLDOUT, 10.0, 3.0e-3, 2.5e-6),
)  # fmt: skip
RUNS_20_HZ = (planned_run(Use.FIT, 20.0, 3.5e-3, 4.142e-6), planned_run(Use.HOLDOUT, 20.0, 3.0e-3, 4.142e-6))
RUN_35_HZ = planned_run(Use.FIT, 35.0, 3.5e-3, 4.142e-6)


class Stage(NamedTuple):
    """A set of measurements: its name, the runs, the signals with their noise."""

    name: str
    runs: tuple[PlannedRun, ...]
    channels: dict[str, Channel]


class DiagnosisResult(NamedTuple):
    """The result of a diagnosis.

    Attributes:
        cause: the cause in the bench.
        stage: the name of the measurements.
        found: the effects that were found, with their sizes.
        damping: damping of mover and plungers, of the diagnosed model and of the bench [N·s/m].
        flow: mean flow at `PREDICTED_FREQUENCY`, of both [L/min].
        diagnosis: the diagnosis itself.
    """

    cause: str
    stage: str
    found: str
    damping: tuple[float, float]
    flow: tuple[float, float]
    diagnosis: Diagnosis


def plan_from_10_hz(base: PumpBench, channels: dict[str, Channel] = PAPER_CHANNELS) -> DetectabilityPlan:
    """The detectability of effects by the runs at 10 Hz, and the next run that is proposed."""
    return plan_detectability(planned_campaign("fall", base, UNCERTAIN, channels, RUNS_10_HZ[:-1], INTERVAL), LIBRARY)


def stages(first: DetectabilityPlan) -> tuple[Stage, ...]:
    """Measurements at 10 Hz alone, with the proposed run, with a run at 20 or 35 Hz, and with a chamber pressure."""
    proposed = first.next.run.conditions
    more = planned_run(Use.FIT, proposed["frequency"], proposed["amplitude"], proposed["load_orifice_area"])
    return (
        Stage("10 Hz, as the paper", RUNS_10_HZ, PAPER_CHANNELS),
        Stage("and the run that plan names", (*RUNS_10_HZ, more), PAPER_CHANNELS),
        Stage("or a run at 20 Hz", (*RUNS_10_HZ, *RUNS_20_HZ), PAPER_CHANNELS),
        Stage("or a run at 35 Hz", (*RUNS_10_HZ, RUN_35_HZ), PAPER_CHANNELS),
        Stage("or chamber pressure at 10 Hz", RUNS_10_HZ, CHANNELS_WITH_CHAMBER),
    )


def synthetic_bench(base: PumpBench, sized: SizedCause, stage: Stage, seed: int) -> tuple[Campaign, PumpBench]:
    """A campaign on a synthetic bench with the cause and randomly drawn parameters, and the machine of that bench."""
    made = planned_campaign("fall", base, UNCERTAIN, stage.channels, stage.runs, INTERVAL)
    rng = np.random.default_rng([20221011, seed])
    spreads = {n: min(s, TRUE_VALVE_SPREAD) if n.startswith("valve") else s for n, s in UNCERTAIN.items()}
    truth = draw_parameters(dataclasses.replace(made, uncertain=spreads), sized.cause.with_size(base, sized.size), rng)
    return synthesise(made, truth, rng), truth


def diagnose_bench(
    base: PumpBench,
    sized: SizedCause,
    stage: Stage,
    seed: int = 1,
    on_progress: Callable[[str], None] = lambda message: None,
) -> DiagnosisResult:
    """Diagnose a bench with the cause, and predict the mean flow at `PREDICTED_FREQUENCY` by the diagnosed model."""
    campaign, truth = synthetic_bench(base, sized, stage, seed)
    title = sized.cause.title
    diagnosis = diagnose(campaign, LIBRARY, on_progress=lambda s: on_progress(f"{title}, {stage.name}: {s}"))
    fit = diagnosis.final
    both, column = (fit.machine, truth), {"amplitude": np.array([3.5e-3])}
    flow = tuple(float(mean_flows(m, column, (PREDICTED_FREQUENCY,))[0, 0]) for m in both)
    damping = tuple(sum(float(get_parameter(m, n)) for n in DAMPING) for m in both)
    sizes = {c.name: c.own_unknowns(fit.problem.unknowns).values() for c in diagnosis.named}
    found = [f"{n} {' '.join(format_with_error(fit.values[u.name], fit.standard_errors[u.name], u.unit) for u in own)}"
            for n, own in sizes.items()]  # fmt: skip
    return DiagnosisResult(title, stage.name, ", ".join(found) or "nothing", damping, flow, diagnosis)
