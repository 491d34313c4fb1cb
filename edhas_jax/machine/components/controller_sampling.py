"""Whether a controller acts continuously, or as the program of a computer that samples and holds."""

from typing import Any

import jax.numpy as jnp

from edhas_jax.core import structs
from edhas_jax.core.structs import par, struct
from edhas_jax.machine.interface.controller_base import Controller
from edhas_jax.machine.interface.signals import Signals


@struct
class Continuous:
    """The controller acts at every instant: its states are states of the machine like any other."""

    def initial(self, controller: Controller) -> dict[str, Any]:
        """The states of the controller at the start of a run."""
        return controller.initial()

    def command(self, controller: Controller, y: dict[str, Any], s: Signals):
        """u_c [V], before the limit."""
        return controller.command(y, s)

    def rates(self, controller: Controller, y: dict[str, Any], s: Signals) -> dict[str, Any]:
        """The rates of the states of the controller."""
        return controller.rates(y, s)

    def advance(self, machine, y: dict[str, Any], k: dict[str, Any], t, h) -> dict[str, Any]:
        """The state of the machine after a step that changes it by `k`."""
        return {n: y[n] + k[n] for n in y}


@struct
class Sampled:
    """The controller runs once every sample time T_s; its command comes a delay later and is held (zero-order hold).

    At an instant n T_s it sees the machine, gives a command, and moves its states by T_s × their rates (explicit
    Euler). A step is shorter than a sample time as a rule, but need not divide it: a sample is taken in the middle of
    the step in which its instant falls, and a command acts from the end of the step in which its own falls (the sample
    plus the delay). The remainder is carried on, so that the mean sample time is exact. What falls short: a sample time
    below the step is one sample each step, and a delay above the sample time counts as one sample time, because one
    command is on its way at a time. Instants are whole numbers of steps, so metrics have no derivative by either time.
    """

    sample_time: float = par(2e-4, "s", (1e-6, 1.0), "time from sample to sample of the controller")
    computation_delay: float = par(0.0, "s", (0.0, 1.0), "time from a sample to its command, one sample at most")

    def initial(self, controller: Controller) -> dict[str, Any]:
        """The states of the controller, the voltages held and coming [V], and the times to wait for both [s].

        The times count from the middle of the next step.
        """
        waiting = ("held_voltage", "coming_voltage", "time_to_sample", "time_to_command")
        return controller.initial() | dict.fromkeys(waiting, 0.0)

    def command(self, controller: Controller, y: dict[str, Any], s: Signals):
        """The voltage that is held [V]."""
        return y["held_voltage"]

    def rates(self, controller: Controller, y: dict[str, Any], s: Signals) -> dict[str, Any]:
        """Nothing moves within a step."""
        return dict.fromkeys(self.initial(controller), jnp.zeros_like(s.voltage))

    def advance(self, machine, y: dict[str, Any], k: dict[str, Any], t, h) -> dict[str, Any]:
        """The state of the machine after a step that changes it by `k`, with the sample and the command due in it."""
        now = structs.replace(machine, sampling=Continuous())
        s, rates = now.evaluate({n: y[n] + 0.5 * k[n] for n in y}, t + 0.5 * h, h, y)
        interval = jnp.maximum(self.sample_time, h)
        delay = jnp.minimum(self.computation_delay, interval)
        sampled = y["time_to_sample"] < 0.5 * h
        held = jnp.where(y["time_to_command"] < 0.5 * h, y["coming_voltage"], y["held_voltage"])
        to_command = jnp.where(sampled, y["time_to_sample"] + delay, y["time_to_command"])
        coming = jnp.where(sampled, s.unlimited_voltage, y["coming_voltage"])
        new = {
            "held_voltage": jnp.where(sampled & (to_command < 0.5 * h), coming, held),
            "coming_voltage": coming,
            "time_to_sample": y["time_to_sample"] + jnp.where(sampled, interval, 0.0) - h,
            # a command that is out may come out again, to no effect
            "time_to_command": to_command - h,
        }
        moved = {n: y[n] + jnp.where(sampled, interval * rates[n], 0.0) for n in machine.controller.initial()}
        return {n: y[n] + k[n] for n in y} | moved | new
