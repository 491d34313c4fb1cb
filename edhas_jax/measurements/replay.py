"""What drives the model of a bench: its set point and controller, or a measured signal instead of a part of it."""

import enum

import numpy as np

from edhas_jax.config.recorded_signal import RecordingError, resample_uniformly
from edhas_jax.core import structs
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controller_sampling import Continuous
from edhas_jax.machine.components.controllers import OpenLoop, PositionController, Supply
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError

STIFFNESS = 1e4  # rad/s; how fast the piston is held to a replayed position: far above anything the machine does
BLOCK = 4096  # recordings are continued to a multiple of this many samples, so that few lengths are compiled
NO_LIMIT = 1e4  # V


class Replay(enum.Enum):
    """What the model is given."""

    SET_POINT = "set_point"  # the bench's own set point, through its controller
    VOLTAGE = "voltage"  # the command as measured: coil and everything behind it are judged
    CURRENT = "current"  # the coil current as measured: mover and everything behind it
    PISTON_POSITION = "piston_position"  # the piston moves as measured: the oil


# the signals that say nothing of the model because they are given, or because what made them is replaced
EXCLUDED_SIGNALS = {
    Replay.SET_POINT: (),
    Replay.VOLTAGE: ("voltage",),
    Replay.CURRENT: ("voltage", "current"),
    # the current that the motion takes hangs on its second derivative, which sensors of position do not give
    Replay.PISTON_POSITION: ("voltage", "current", "piston_position"),
}


def machine_with_replay(campaign: Campaign, run: BenchRun, machine: Rig, replay: Replay) -> Rig:
    """`machine` under the conditions of a run, driven as `replay` says.

    Raises:
        CampaignError: the run lacks the signal, or has holes in it; the rig's set point depends on its own motion.
    """
    machine = campaign.machine_of(run, machine)
    if replay is Replay.SET_POINT:
        return machine
    if isinstance(machine, ActuatorSystem):
        raise CampaignError(f"{run.file}: {machine.name} sets its pump's set point by itself; nothing can be replayed")
    if replay.value not in run.signals:
        raise CampaignError(f"{run.file}: {replay.value} was not measured, so it cannot be replayed")
    values = run.signals[replay.value]
    try:
        if replay is Replay.PISTON_POSITION:
            values = _smooth(run.time, values, campaign.channels[replay.value].noise)
        recorded = resample_uniformly(run.file, run.time, values)
    except RecordingError as error:
        raise CampaignError(f"{error}: {replay.value} cannot be replayed") from None
    held = np.pad(np.asarray(recorded.values), (0, -len(recorded.values) % BLOCK), mode="edge")
    recorded = structs.replace(recorded, values=held)
    supply, sampling = Supply(supply_voltage=NO_LIMIT), Continuous()
    machine = structs.replace(machine, reference=recorded, supply=supply, sampling=sampling)
    if replay is Replay.VOLTAGE:
        return structs.replace(machine, controller=OpenLoop())
    machine = structs.replace(machine, amplifier=CurrentAmplifier(amplifier_gain=1.0))
    if replay is Replay.CURRENT:
        return structs.replace(machine, controller=OpenLoop())
    mass = float(machine.mover.mover_mass)
    if not isinstance(machine, ActuatorBench):
        mass += float(machine.pump.plunger_mass)
    per_volt = mass / float(machine.coil.force_constant)
    holder = PositionController(
        position_gain=per_volt * STIFFNESS**2, velocity_gain=2.0 * per_volt * STIFFNESS,
        integral_gain=0.3 * per_volt * STIFFNESS**3, antiwindup_gain=0.0, emf_feedforward=0.0,
    )  # fmt: skip
    return structs.replace(machine, controller=holder)


def _smooth(time: np.ndarray, values: np.ndarray, noise: float) -> np.ndarray:
    """A position without its noise, whose second derivative is a force: the smoothest spline within the noise."""
    from scipy.interpolate import UnivariateSpline

    if not np.isfinite(values).all():
        raise RecordingError("file", f"sample {int(np.argmax(~np.isfinite(values))) + 1} is missing")
    return UnivariateSpline(time, values, w=np.full(len(time), 1.0 / noise), k=5, s=len(time))(time)
