"""The causes of the fall as `edhas diagnose` sees them, from runs at 10 Hz alone and with more.

The bench measures what the paper measured: piston position, outlet pressure and flow. The engineer's model is the
machine in which nothing falls. Of its valves only the order of magnitude is known, so late valves are a matter of
calibration; a narrow suction line is an effect that it lacks.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from edhas_jax.core.units import format_with_error
from edhas_jax.diagnosis.planning.detectability_plan import DetectabilityPlan, plan_detectability
from edhas_jax.diagnosis.search.forward_selection import diagnose
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
from edhas_jax.measurements.synthetic_campaign import PlannedRun, draw_parameters, planned_campaign, synthesise
from studies.flow_drop.causes import Sized
from studies.hidden_effects.cases import CHANNELS
from studies.hidden_effects.cases import UNCERTAIN as USUAL
from studies.paper.readings import mean_flows

LIBRARY = (ValveAdhesion, SuctionLineResistance, SuctionLineInertance, SupplySag, ValveFlowForce)
UNCERTAIN = USUAL | {
    "valve_spring_rate": 0.7, "valve_mass": 0.7, "valve_preload": 0.1, "accumulator_pressure": 0.05
}  # fmt: skip
TRUE_SPREAD = 0.05  # of the valves that are really there
AS_THE_PAPER = {n: CHANNELS[n] for n in ("piston_position", "outlet_pressure", "outlet_flow")}
AND_CHAMBER = AS_THE_PAPER | {"chamber_pressure_a": Channel("MPa", 5e3)}
INTERVAL, CYCLES, RUN_IN = 2e-4, 4.0, 0.12  # s
DAMPING = ("mover_damping", "pump_damping")
TOLD_AT = 35.0  # Hz, where a diagnosed model has to tell the mean flow


def a_run(use: Use, frequency: float, amplitude: float, load: float) -> PlannedRun:
    """A run of some cycles, SI."""
    conditions = {"frequency": frequency, "amplitude": amplitude, "load_orifice_area": load}
    return PlannedRun(use, RUN_IN + CYCLES / frequency, conditions)


TEN_HZ = (
    a_run(Use.FIT, 10.0, 3.5e-3, 4.142e-6), a_run(Use.FIT, 10.0, 3.5e-3, 1.5e-6),
    a_run(Use.FIT, 10.0, 2.5e-3, 4.142e-6), a_run(Use.HOLDOUT, 10.0, 3.0e-3, 2.5e-6),
)  # fmt: skip
TWENTY_HZ = (a_run(Use.FIT, 20.0, 3.5e-3, 4.142e-6), a_run(Use.HOLDOUT, 20.0, 3.0e-3, 4.142e-6))
THIRTY_FIVE_HZ = a_run(Use.FIT, 35.0, 3.5e-3, 4.142e-6)


class Stage(NamedTuple):
    """What is measured: a name, the runs, the signals with their noise."""

    told: str
    runs: tuple[PlannedRun, ...]
    channels: dict[str, Channel]


class Answer(NamedTuple):
    """What a diagnosis said of a cause.

    `found` names what was accepted, with sizes. Of the model that comes of it, and of the bench: `damping` is what
    brakes mover and plungers [N·s/m], `flow` the mean flow [L/min] at `TOLD_AT`.
    """

    cause: str
    stage: str
    found: str
    damping: tuple[float, float]
    flow: tuple[float, float]
    diagnosis: Diagnosis


def before_any_test(base: PumpBench, channels: dict[str, Channel] = AS_THE_PAPER) -> DetectabilityPlan:
    """What the runs at 10 Hz could reveal, and the next run that `plan` names."""
    return plan_detectability(planned_campaign("fall", base, UNCERTAIN, channels, TEN_HZ[:-1], INTERVAL), LIBRARY)


def stages(first: DetectabilityPlan) -> tuple[Stage, ...]:
    """10 Hz alone, with the run that `plan` names, with a run at 20 or 35 Hz, and with a chamber pressure."""
    named = first.next.run.conditions
    more = a_run(Use.FIT, named["frequency"], named["amplitude"], named["load_orifice_area"])
    return (
        Stage("10 Hz, as the paper", TEN_HZ, AS_THE_PAPER),
        Stage("and the run that plan names", (*TEN_HZ, more), AS_THE_PAPER),
        Stage("or a run at 20 Hz", (*TEN_HZ, *TWENTY_HZ), AS_THE_PAPER),
        Stage("or a run at 35 Hz", (*TEN_HZ, THIRTY_FIVE_HZ), AS_THE_PAPER),
        Stage("or chamber pressure at 10 Hz", TEN_HZ, AND_CHAMBER),
    )


def measured(base: PumpBench, sized: Sized, stage: Stage, seed: int) -> tuple[Campaign, PumpBench]:
    """A campaign on a bench with the cause, its other parameters drawn; and that bench."""
    made = planned_campaign("fall", base, UNCERTAIN, stage.channels, stage.runs, INTERVAL)
    rng = np.random.default_rng([20221011, seed])
    spreads = {n: min(s, TRUE_SPREAD) if n.startswith("valve") else s for n, s in UNCERTAIN.items()}
    truth = draw_parameters(dataclasses.replace(made, uncertain=spreads), sized.cause.at(base, sized.size), rng)
    return synthesise(made, truth, rng), truth


def ask(
    base: PumpBench, sized: Sized, stage: Stage, seed: int = 1, say: Callable[[str], None] = lambda sentence: None
) -> Answer:
    """Diagnose a bench that has the cause, and let the model that comes of it tell the mean flow at `TOLD_AT`."""
    campaign, truth = measured(base, sized, stage, seed)
    title = sized.cause.title
    diagnosis = diagnose(campaign, LIBRARY, on_progress=lambda s: say(f"{title}, {stage.told}: {s}"))
    fit = diagnosis.final
    both, column = (fit.machine, truth), {"amplitude": np.array([3.5e-3])}
    flow = tuple(float(mean_flows(m, column, (TOLD_AT,))[0, 0]) for m in both)
    damping = tuple(sum(float(get_parameter(m, n)) for n in DAMPING) for m in both)
    sizes = {t.candidate.name: t.candidate.own_unknowns(fit.problem.unknowns).values() for t in diagnosis.accepted}
    told = [f"{n} {' '.join(format_with_error(fit.values[u.name], fit.standard_errors[u.name], u.unit) for u in own)}"
            for n, own in sizes.items()]  # fmt: skip
    return Answer(title, stage.told, ", ".join(told) or "nothing", damping, flow, diagnosis)
