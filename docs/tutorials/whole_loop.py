# %% [markdown]
# # The whole loop in 25 lines
#
# Sweep, heat map, gradient, sizing, comparison with measurements, diagnosis, and the error after the missing effect has
# been added. Every step has a tutorial of its own.

# %%
import jax
import optax

import edhas_jax as edhas

jax.config.update("jax_enable_x64", True)
edhas.copy_examples()
swept = edhas.sweep("examples/paper.yaml", piston_clearance=("5 um", "40 um", 12), frequency=[5, 10, 15, 20, 25, 30])
swept.plot_heat("mean_leakage")

# %%
pump = edhas.model("examples/paper.yaml")
flow = lambda p: pump.metrics(p, ["mean_flow"])["mean_flow"]  # m³/s
jax.grad(flow)({"piston_diameter": 0.012, "frequency": 10.0})

# %%
point, optimiser = {"frequency": 10.0}, optax.adam(1.0)
state = optimiser.init(point)
for _ in range(30):  # the frequency that delivers 2 L/min
    slopes = jax.grad(lambda p: (flow(p) / (2e-3 / 60) - 1.0) ** 2)(point)
    change, state = optimiser.update(slopes, state)
    point = optax.apply_updates(point, change)
print(f"{point['frequency']:.2f} Hz, {flow(point) * 60e3:.3f} L/min")

# %%
edhas.compare("examples/campaign").plot()

# %%
found = edhas.diagnose("examples/campaign")
found

# %%
edhas.add("examples/campaign", [candidate.id for candidate in found.named]).plot()
