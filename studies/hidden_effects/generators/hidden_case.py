"""A case: a synthetic campaign, and what is hidden in it."""

import dataclasses
import enum

from edhas_jax.machine.effects import Effect
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign


class Split(enum.Enum):
    """What a case may be used for."""

    TUNING = "tuning"  # to choose thresholds and methods
    PRACTICE = "practice"  # the same with further laws, to see what a method does with laws that it is not tuned to
    VARIED = "varied"  # the same with laws, disturbances, chains and benches drawn at random
    EARLIER = "earlier"  # judged the method of commit a73dad3; used to develop the method since
    JUDGING = "judging"  # to count right answers; nothing may be changed because of one of them


class Family(enum.Enum):
    """What makes a case difficult."""

    LIBRARY_LAWS = "library laws"  # everything as in the library: the cases of `studies.hidden_effects.cases`
    OTHER_LAWS = "other laws"  # a mechanism of the library acts by another law
    DISTURBANCES = "small disturbances"  # effects that are not in the library, with or without one of the library
    SENSOR_CHAINS = "sensor chains"  # recorder and sensors are not ideal, with or without an effect of the library
    SETTINGS = "settings"  # settings and parameters are off, with or without an effect of the library
    SMALL_CAMPAIGNS = "small campaigns"  # few runs, few sensors, short records
    SEVERAL = "several"  # two or three effects, and one of the difficulties above
    WITHHELD = "withheld"  # the diagnosis may not use the mechanism, or the library has none


@dataclasses.dataclass(frozen=True)
class Hidden:
    """One hidden effect or sensor fault.

    Args:
        candidate: name that a right answer has: the id of the mechanism, with the signal for a sensor fault; empty
            where the library has no such mechanism.
        locations: components of the machine on which it acts.
        law: id of the law; that of the mechanism for the law of the library.
        values: parameters of the law (SI).
        visible: χ² in the fitted runs that neither the uncertain parameters nor the usual errors of a bench explain.
    """

    candidate: str
    locations: tuple[str, ...]
    law: str
    values: dict[str, float]
    visible: float


@dataclasses.dataclass(frozen=True)
class HiddenCase:
    """A synthetic campaign and the truth about it.

    Args:
        family: what makes it difficult.
        split: what it may be used for.
        number: with family and split it determines the case.
        campaign: what the diagnosis gets.
        hidden: what is missing in the campaign's model; nothing for a null.
        withheld: effects of the library that the diagnosis may not use.
        bench: name of the bench.
        disturbances: size of each small disturbance by name.
        disturbances_visible: the same as `Hidden.visible` for all disturbances together.
        chain: links of the sensor chain, with their parameters.
        settings: what is off from run to run, and the sheet of parameters.
        disturbed_signals: signals that the chain delays, so that a lag of their sensors is no wrong answer.
        true_noise: standard deviation of the noise by signal (SI).
        machine: the machine that made the data, with what is hidden mounted last; None in family (a).
    """

    family: Family
    split: Split
    number: int
    campaign: Campaign
    hidden: tuple[Hidden, ...]
    withheld: tuple[type[Effect], ...] = ()
    bench: str = ""
    disturbances: dict[str, float] = dataclasses.field(default_factory=dict)
    disturbances_visible: float = 0.0
    chain: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    disturbed_signals: tuple[str, ...] = ()
    true_noise: dict[str, float] = dataclasses.field(default_factory=dict)
    machine: Rig | None = None

    @property
    def description(self) -> str:
        """What really acts, in one line."""
        parts = [
            f"{h.law}{f' (a law of {h.candidate})' if h.candidate not in ('', h.law) else ''}" for h in self.hidden
        ]
        text = " + ".join(parts) or "nothing"
        for what, items in (("disturbances", self.disturbances), ("chain", self.chain), ("settings", self.settings)):
            text += f"; {what}: {', '.join(items)}" if items else ""
        if self.withheld:
            text += f"; withheld: {', '.join(kind.id for kind in self.withheld)}"
        return text
