"""How exactly a test bench keeps its settings, and how exactly its sensors and its trigger are known."""

import dataclasses
from collections.abc import Iterable, Mapping

from edhas_jax.machine.parameters import ParameterError, find_parameter
from edhas_jax.machine.rigs import Rig

SETTING_ACCURACY = 0.005  # relative standard deviation of what a person or a valve sets
WARM_PARAMETERS = "coil_resistance", "force_constant"  # change as coil and magnets warm up, although no run sets them
OFFSET_OVER_RANGE = 1e-3  # default offset of a sensor over the range of its signal
COMPUTED_COMPONENTS = ("reference", "target", "controller", "sampling")  # a computer keeps their numbers exactly


@dataclasses.dataclass(frozen=True)
class SensorAccuracy:
    """Accuracy of one sensor, the same in all runs; all are standard deviations.

    Args:
        gain: of its gain (relative).
        offset: of its offset (SI); None stands for a thousandth of the range of its signal.
        shift: of its time shift against the other signals [s].
    """

    gain: float = 3e-3
    offset: float | None = None
    shift: float = 20e-6


@dataclasses.dataclass(frozen=True)
class RecorderClock:
    """A further recorder whose time differs from that of the records by a constant, another one in each run.

    Args:
        names: the measured signals and recorded drives that it has recorded.
        shift: standard deviation of its time shift [s].
    """

    names: tuple[str, ...]
    shift: float


@dataclasses.dataclass(frozen=True)
class BenchAccuracy:
    """Accuracy of a test bench; all are standard deviations.

    Args:
        trigger: of the start of the record against that of the run, for each run [s].
        recorder_filter: of the weight of an anti-alias filter that all channels may have; 0 for a recorder without one.
        settings: of the value of a parameter in each run (relative), by name.
        signals: of the sensors, by signal.
        clocks: further recorders by name, whose records are shifted so that they fit the others.
        clock_error: of the time stamps within a run [s], by an error of the recorder's clock that changes slowly; 0 for
            an exact clock. The usual one is 50 ppm of a second.
    """

    trigger: float = 2e-4
    recorder_filter: float = 1.0
    settings: Mapping[str, float] = dataclasses.field(default_factory=dict)
    signals: Mapping[str, SensorAccuracy] = dataclasses.field(default_factory=dict)
    clocks: Mapping[str, RecorderClock] = dataclasses.field(default_factory=dict)
    clock_error: float = 5e-5


def with_defaults(
    stated: BenchAccuracy, machine: Rig, conditions: Iterable[str], offsets: Mapping[str, float]
) -> BenchAccuracy:
    """Complete the stated accuracy of a bench by the usual one.

    Args:
        stated: what the campaign states.
        machine: the machine of the campaign.
        conditions: names of the parameters that runs set.
        offsets: usual standard deviation of the offset of each measured signal (SI).

    Returns:
        The accuracy with an entry for every setting and every signal. Numbers that a computer sets, such as a
        frequency or the gain of a controller, are exact (0).
    """
    settings = {name: _usual_setting_accuracy(machine, name) for name in (*conditions, *WARM_PARAMETERS)}
    sensors = {}
    for name, usual in offsets.items():
        sensor = stated.signals.get(name, SensorAccuracy())
        sensors[name] = dataclasses.replace(sensor, offset=usual if sensor.offset is None else sensor.offset)
    return dataclasses.replace(stated, settings=settings | dict(stated.settings), signals=sensors)


def _usual_setting_accuracy(machine: Rig, name: str) -> float:
    """The usual relative standard deviation of a setting; 0 for what a computer sets, or the machine lacks."""
    try:
        _, component = find_parameter(machine, name)
    except ParameterError:
        return 0.0
    return 0.0 if component in COMPUTED_COMPONENTS else SETTING_ACCURACY
