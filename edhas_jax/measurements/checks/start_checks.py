"""Find runs that do not begin where the model does: the machine was not at rest, or a state started elsewhere.

A fit cannot tell that from a slower or faster machine, unless the start of the state is uncertain.
"""

from collections.abc import Iterator

import numpy as np

from edhas_jax.core.remark import Remark
from edhas_jax.core.units import format_quantity
from edhas_jax.measurements.campaign import BenchRun, Campaign, SignalsByRun

FIRST = 3  # samples of which the first that is there shows where a signal begins
MIN_OVER_NOISE = 10.0  # difference at the start over the noise of the signal
MIN_OVER_RANGE = 0.2  # and over the range of the model: less may be an error of the model, or of the sensor's zero
MIN_DECAY = 3.0  # difference at the start over its rms in the second half: the model comes close to the signal


def check_start(campaign: Campaign, run: BenchRun, models: SignalsByRun) -> Iterator[Remark]:
    """Compare the first samples of the states of a rig of one's own with where the model starts.

    Args:
        campaign: gives the machine, the noise and what is uncertain.
        run: the run.
        models: signals of the model (samples,) at the time stamps, by run and signal, SI.

    Yields:
        A warning on each state that begins elsewhere, and is near the model later.
    """
    model, states = models.get(run.name), campaign.machine.states
    if model is None or run.time[0] > FIRST * run.interval:
        return
    for name in (n for n in run.signals if n in states):
        initial = states[name].initial
        if initial in campaign.uncertain or initial in run.uncertain:
            continue
        difference = run.signals[name] - model[name]
        there, half = np.flatnonzero(np.isfinite(difference[:FIRST])), difference[len(difference) // 2 :]
        if not len(there) or not np.isfinite(half).any():
            continue
        k = int(there[0])
        first, later = abs(float(difference[k])), float(np.sqrt(np.nanmean(np.square(half))))
        most = MIN_OVER_NOISE * campaign.channels[name].noise, MIN_OVER_RANGE * np.ptp(model[name]), MIN_DECAY * later
        if first > max(most):
            unit, start = campaign.machine.signals[name].unit, "the model"
            begins, modelled = (format_quantity(float(v[k]), unit) for v in (run.signals[name], model[name]))
            remedy = "let a parameter of the rig say where that state starts"
            if isinstance(initial, str):
                start, remedy = f"the model, by {initial},", f"state {initial} in the run, or under `uncertain`"
            yield run.warning(f"{name} begins at {begins}, {start} at {modelled}, and is near it later; {remedy}", k)
