# %% [markdown]
# # An effect of one's own
#
# The library has some thirty effects. One that it lacks is a class of a few lines: its parameters, its states if it
# has any, and its equation, in a method that is named after the place where it enters the model.

# %%
import dataclasses

import jax.numpy as jnp

import edhas_jax as edhas


class TightGuide(edhas.Effect):
    """Friction of a guide that is tight at one end of the stroke."""

    guide_force: float = edhas.par(3.0, "N", (0.0, 100.0), "friction where the guide is tight", plausible=(0.1, 20.0))
    guide_place: float = edhas.par(1e-3, "m", (-0.01, 0.01), "position of the edge", plausible=(-3e-3, 3e-3))

    def mover_friction(self, s, z):
        tight = 0.5 * (1.0 + jnp.tanh((s.sliding_position - self.guide_place) / 2e-4))
        return self.guide_force * tight * jnp.tanh(s.sliding_velocity / 2e-3)


# %% [markdown]
# A machine holds its effects; their parameters are then parameters of the machine.

# %%
edhas.copy_examples()
pump = edhas.load("examples/paper.yaml").machine
with_guide = dataclasses.replace(pump, effects=(*pump.effects, TightGuide()))
runs = [edhas.simulate(machine, frequency="10 Hz") for machine in (pump, with_guide)]
for run in runs:
    current, error = (run.metrics[name].value for name in ("rms_current", "tracking_error"))
    print(f"{current:.3f} A, tracking error {1e6 * error:.0f} µm")

# %%
import matplotlib.pyplot as plt

figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
for run, label in zip(runs, ("as it is", "with a tight guide"), strict=True):
    axes.plot(1e3 * run.signals["piston_position"], run.signals["current"], lw=1, label=label)
axes.set(xlabel="position of the piston [mm]", ylabel="current [A]")
axes.legend(frameon=False);

# %% [markdown]
# Like every parameter, those of the effect can be swept, sized with, and differentiated.

# %%
edhas.sweep(with_guide, guide_force=("0 N", "10 N", 11), frequency=[10, 20]).plot_heat("rms_current")

# %% [markdown]
# Is this what the pump of the campaign lacks? The fit with the effect answers.

# %%
edhas.add("examples/campaign", [TightGuide]).summary()

# %% [markdown]
# The error hardly falls: it is not. A diagnosis considers it beside the effects of the library:
# `edhas.diagnose("examples/campaign", effects=[TightGuide])`.
