"""Drive a model by the set point of a run, or by a measured signal replayed in place of a part of the model."""

import enum

import numpy as np

from edhas_jax.config.recorded_signal import RecordingError, recorded_from_samples
from edhas_jax.core import structs
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controller_sampling import Continuous
from edhas_jax.machine.components.controllers import OpenLoop, PositionController, Supply
from edhas_jax.machine.rigs import ActuatorBench, ActuatorParts, ActuatorSystem, Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError

TRACKING_BANDWIDTH = 1e4  # rad/s; bandwidth of the loop that tracks a replayed position, far above the machine's
# samples; recordings are padded to a multiple of this, so that few array shapes are compiled
RECORDING_LENGTH_MULTIPLE = 4096
UNLIMITED_SUPPLY = 1e4  # V; no replayed signal reaches it


class Replay(enum.Enum):
    """The input that drives the model."""

    SET_POINT = "set_point"  # the set point of the run, through the controller: validates the whole model
    VOLTAGE = "voltage"  # the measured command: validates the coil and everything downstream
    CURRENT = "current"  # the measured coil current: validates the mover and everything downstream
    PISTON_POSITION = "piston_position"  # the measured motion of the piston: validates the hydraulics


# signals without information about the model, because they are the input or the part that produces them is replaced
EXCLUDED_SIGNALS = {
    Replay.SET_POINT: (),
    Replay.VOLTAGE: ("voltage",),
    Replay.CURRENT: ("voltage", "current"),
    # the current depends on the acceleration, which a position sensor does not resolve
    Replay.PISTON_POSITION: ("voltage", "current", "piston_position"),
}


def machine_with_replay(campaign: Campaign, run: BenchRun, machine: Rig, replay: Replay) -> Rig:
    """A machine under the conditions of a run, driven by a given input.

    Args:
        campaign: gives the noise of the channels.
        run: gives the conditions and the measured signals.
        machine: the machine to drive.
        replay: the input.

    Returns:
        The machine; its set point is the measured signal, and its controller and amplifier pass it on unchanged.

    Raises:
        CampaignError: the run lacks the signal or has missing samples in it, or the rig generates the set point of its
            pump itself.
        ParameterError: the machine lacks a parameter that the run sets.
    """
    machine = campaign.machine_of(run, machine)
    if replay is Replay.SET_POINT:
        return machine
    if not isinstance(machine, ActuatorParts):
        raise CampaignError(f"{run.file}: the drives of {machine.name} are what its `drives` name; nothing is replayed")
    if isinstance(machine, ActuatorSystem):
        raise CampaignError(f"{run.file}: {machine.name} sets its pump's set point by itself; nothing can be replayed")
    if replay.value not in run.signals:
        raise CampaignError(f"{run.file}: {replay.value} was not measured, so it cannot be replayed")
    values = run.signals[replay.value]
    try:
        if replay is Replay.PISTON_POSITION:
            values = _smooth(run.time, values, campaign.channels[replay.value].noise)
        recorded = recorded_from_samples(run.file, run.time, values)
    except RecordingError as error:
        raise CampaignError(f"{error}: {replay.value} cannot be replayed") from None
    padded = np.pad(np.asarray(recorded.values), (0, -len(recorded.values) % RECORDING_LENGTH_MULTIPLE), mode="edge")
    recorded = structs.replace(recorded, values=padded)
    supply, sampling = Supply(supply_voltage=UNLIMITED_SUPPLY), Continuous()
    machine = structs.replace(machine, reference=recorded, supply=supply, sampling=sampling)
    if replay is Replay.VOLTAGE:
        return structs.replace(machine, controller=OpenLoop())
    machine = structs.replace(machine, amplifier=CurrentAmplifier(amplifier_gain=1.0))
    if replay is Replay.CURRENT:
        return structs.replace(machine, controller=OpenLoop())
    mass = float(machine.mover.mover_mass)
    if not isinstance(machine, ActuatorBench):
        mass += float(machine.pump.plunger_mass)
    gain = mass / float(machine.coil.force_constant)
    tracker = PositionController(
        position_gain=gain * TRACKING_BANDWIDTH**2, velocity_gain=2.0 * gain * TRACKING_BANDWIDTH,
        integral_gain=0.3 * gain * TRACKING_BANDWIDTH**3, antiwindup_gain=0.0, emf_feedforward=0.0,
    )  # fmt: skip
    return structs.replace(machine, controller=tracker)


def _smooth(time: np.ndarray, values: np.ndarray, noise: float) -> np.ndarray:
    """A position (samples,) smoothed by a quintic spline whose residual has at most the rms of the noise."""
    from scipy.interpolate import UnivariateSpline

    if not np.isfinite(values).all():
        raise RecordingError("file", f"sample {int(np.argmax(~np.isfinite(values))) + 1} is missing")
    return UnivariateSpline(time, values, w=np.full(len(time), 1.0 / noise), k=5, s=len(time))(time)
