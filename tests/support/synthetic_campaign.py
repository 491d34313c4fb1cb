"""Synthetic campaigns of a known machine: the actuator bench with friction, three short runs."""

import dataclasses
from pathlib import Path

import numpy as np

import edhas_jax as edhas
from edhas_jax.machine.effects import LugreFriction
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.measurements.instruments import Instruments
from studies.synthetic_campaign import synthesise

CHANNELS = {"voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6)}
UNCERTAIN = {"coil_resistance": 0.02, "force_constant": 0.02, "mover_damping": 0.25, "coulomb_friction": 0.25}
CONDITIONS = ({"frequency": 10.0, "amplitude": 3e-3}, {"frequency": 25.0, "amplitude": 2e-3},
              {"frequency": 15.0, "amplitude": 2.5e-3})  # fmt: skip
PER_SAMPLE = 8  # steps between two samples at which the residuals of a fit are evaluated


def bench():
    """The engineer's model."""
    return edhas.ActuatorBench(reference=edhas.Sine(ramp_time=0.05), effects=(LugreFriction(),))


def empty_campaign(machine=None, conditions=CONDITIONS, uncertain=None, lengths=(401, 301, 301)) -> Campaign:
    """Runs sampled at 2 kHz that have no signals yet; the last one is held out."""
    runs = tuple(
        BenchRun(
            f"run{k + 1}", Path(f"run{k + 1}.csv"), Use.HOLDOUT if k == len(conditions) - 1 else Use.FIT,
            dict(run_conditions), 5e-4 * np.arange(count), {}, np.arange(count) + 2,
        )
        for k, (run_conditions, count) in enumerate(zip(conditions, lengths, strict=False))
    )  # fmt: skip
    uncertain = UNCERTAIN if uncertain is None else uncertain
    return Campaign("synthetic", Path("synthetic"), machine or bench(), uncertain, CHANNELS, runs, ())


def measured(campaign: Campaign, truth, instruments=Instruments(), seed=0, each=None) -> Campaign:
    """The campaign with signals measured on the machine `truth`, or on another machine in `each` run.

    The trajectories come from the explicit Runge-Kutta reference, which shares no time stepping with the fitted model.
    """
    rng, faults = np.random.default_rng(seed), instruments.chains
    if each is None:
        return synthesise(campaign, truth, rng, faults)
    alone = [dataclasses.replace(campaign, runs=(run,)) for run in campaign.runs]
    runs = tuple(synthesise(one, machine, rng, faults).runs[0] for one, machine in zip(alone, each, strict=True))
    return dataclasses.replace(campaign, runs=runs)
