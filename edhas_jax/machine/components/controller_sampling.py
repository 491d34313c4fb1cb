"""Execution of a controller: continuous, or sampled with a zero-order hold as on a computer."""

from typing import Any

import jax.numpy as jnp

from edhas_jax.core import structs
from edhas_jax.core.structs import par, struct
from edhas_jax.machine.interface.controller_base import Controller
from edhas_jax.machine.interface.signals import Signals


@struct
class Continuous:
    """The controller acts at every instant; its states are states of the machine like any other."""

    def initial(self, controller: Controller) -> dict[str, Any]:
        """The states of the controller at the start of a run."""
        return controller.initial()

    def command(self, controller: Controller, y: dict[str, Any], s: Signals):
        """The command u_c [V] before the supply limit."""
        return controller.command(y, s)

    def rates(self, controller: Controller, y: dict[str, Any], s: Signals) -> dict[str, Any]:
        """The rates of the states of the controller."""
        return controller.rates(y, s)

    def advance(self, machine, y: dict[str, Any], k: dict[str, Any], t, h) -> dict[str, Any]:
        """The state of the machine after a step that changes it by `k`."""
        return {n: y[n] + k[n] for n in y}


@struct
class Sampled:
    """The controller runs once every sample time T_s; its command acts after a delay and is held (zero-order hold).

    At an instant n T_s it reads the signals, computes a command and advances its states by T_s × their rates (explicit
    Euler). The step need not divide the sample time: a sample is taken in the middle of the step in which its instant
    falls, and a command acts from the end of the step in which its instant (sample plus delay) falls. Remainders are
    carried over, so that the mean sample time is exact.

    Limits: with a sample time below the step there is one sample per step, and a delay above the sample time counts as
    one sample time, because only one command can be pending. Instants are whole numbers of steps, so metrics have no
    derivative with respect to either time.
    """

    sample_time: float = par(
        2e-4, "s", (1e-6, 1.0), "time from sample to sample of the controller", at_least="computation_delay"
    )
    computation_delay: float = par(0.0, "s", (0.0, 1.0), "time from a sample to its command, one sample at most")

    def initial(self, controller: Controller) -> dict[str, Any]:
        """The states of the controller, the held and the pending voltage [V], and the times to the next events [s].

        The times count from the middle of the next step.
        """
        sampling_states = ("held_voltage", "pending_voltage", "time_to_sample", "time_to_command")
        return controller.initial() | dict.fromkeys(sampling_states, 0.0)

    def command(self, controller: Controller, y: dict[str, Any], s: Signals):
        """The held voltage [V]."""
        return y["held_voltage"]

    def rates(self, controller: Controller, y: dict[str, Any], s: Signals) -> dict[str, Any]:
        """Zero: these states change only between steps."""
        return dict.fromkeys(self.initial(controller), jnp.zeros_like(s.voltage))

    def advance(self, machine, y: dict[str, Any], k: dict[str, Any], t, h) -> dict[str, Any]:
        """The state of the machine after a step that changes it by `k`, with the sample and the command due in it."""
        continuous = structs.replace(machine, sampling=Continuous())
        s, rates = continuous.evaluate({n: y[n] + 0.5 * k[n] for n in y}, t + 0.5 * h, h, y)
        interval = jnp.maximum(self.sample_time, h)
        delay = jnp.minimum(self.computation_delay, interval)
        sampled = y["time_to_sample"] < 0.5 * h
        held = jnp.where(y["time_to_command"] < 0.5 * h, y["pending_voltage"], y["held_voltage"])
        to_command = jnp.where(sampled, y["time_to_sample"] + delay, y["time_to_command"])
        pending = jnp.where(sampled, s.unlimited_voltage, y["pending_voltage"])
        new = {
            "held_voltage": jnp.where(sampled & (to_command < 0.5 * h), pending, held),
            "pending_voltage": pending,
            "time_to_sample": y["time_to_sample"] + jnp.where(sampled, interval, 0.0) - h,
            # a command that acts already may be applied again without effect
            "time_to_command": to_command - h,
        }
        own = machine.controller.initial()
        controller_states = {n: y[n] + jnp.where(sampled, interval * rates[n], 0.0) for n in own}
        return {n: y[n] + k[n] for n in y} | controller_states | new
