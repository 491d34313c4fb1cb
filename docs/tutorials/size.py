# %% [markdown]
# # Size: designs by gradients
#
# A pump is to have a large flow and a high efficiency at three frequencies, while the coil current and the pressure
# ripple stay below limits. The gradients are computed by automatic differentiation, so the search needs few
# simulations.

# %%
import edhas_jax as edhas

edhas.copy_examples()
task = dict(
    free={"piston_diameter": ("8 mm", "16 mm"), "amplitude": ("2 mm", "4.5 mm"), "piston_clearance": ("8 um", "40 um")},
    maximise=["mean_flow", "overall_efficiency"],
    constraints={"rms_current": {"max": "6 A"}, "pressure_ripple": {"max": "2 MPa"}},
    points={"frequency": [10, 20, 30]},
)
pump = edhas.change(edhas.load("examples/paper.yaml").machine, load_orifice_area="1 mm^2")
sized = edhas.size(pump, starts=8, **task)
sized.summary()

# %%
sized.plot()

# %% [markdown]
# Which parameters matter most at the design that was found? Elasticities say by how many per cent a figure changes
# per cent of a parameter.

# %%
edhas.sensitivity(sized.best.machine, ["mean_flow", "overall_efficiency", "rms_current"]).plot()

# %% [markdown]
# The same model is a function for JAX and optax, for objectives of your own.

# %%
import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)
model = edhas.model(pump)


def loss_per_flow(parameters):
    found = model.metrics(parameters, ["copper_loss", "mean_flow"])
    return found["copper_loss"] / found["mean_flow"]


jax.value_and_grad(loss_per_flow)({"piston_diameter": jnp.array(0.012), "amplitude": jnp.array(0.003)})

# %% [markdown]
# A thousand designs at once are one call of `jax.vmap`.

# %%
diameters = jnp.linspace(0.008, 0.016, 1000)
losses = jax.vmap(lambda d: loss_per_flow({"piston_diameter": d}))(diameters)
print(f"least loss per flow at {1e3 * diameters[jnp.argmin(losses)]:.2f} mm")
