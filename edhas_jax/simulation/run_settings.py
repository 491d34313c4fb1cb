"""Settings of a run: duration, step or accuracy, sample rate, precision."""

import dataclasses
import enum

from edhas_jax.machine.rig_base import Rig


class Precision(enum.Enum):
    """The floating-point type of a run."""

    FLOAT64 = "float64"
    FLOAT32 = "float32"


@dataclasses.dataclass(frozen=True)
class Simulation:
    """Settings of a run, in SI.

    Give `step`, or give `accuracy` to have every signal resolved. With neither the step is 20 µs, or halved until half
    of it changes flow, power and stroke by less than 1 %.

    Attributes:
        duration: simulated time [s]; None is 0.5 s on a bench and 0.6 s for the system.
        step: largest time step [s]; the step taken divides the sample interval.
        accuracy: largest estimated error of any signal, as a share of its range.
        sample_rate: samples per second [Hz]; None is one sample for ten of the steps with which a run begins, 5 kHz.
        precision: floating-point type.
    """

    duration: float | None = None
    step: float | None = None
    accuracy: float | None = None
    sample_rate: float | None = None
    precision: Precision = Precision.FLOAT64

    def rate(self, machine: Rig) -> float:
        """The sample rate [Hz] for this machine."""
        return 0.1 / machine.time_step if self.sample_rate is None else self.sample_rate

    def length(self, machine: Rig) -> float:
        """The duration [s] for this machine."""
        if self.duration is not None:
            return self.duration
        return machine.duration
