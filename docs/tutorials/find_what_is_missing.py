# %% [markdown]
# # Find what is missing
#
# The model of the pump does not reproduce the measurements, whatever its parameters. Which physical effect does it
# lack?

# %%
import edhas_jax as edhas

edhas.copy_examples()
found = edhas.diagnose("examples/campaign")
found

# %% [markdown]
# Each suspect was added to the model and everything fitted again. The picture shows how much of the misfit each
# explains, where in the machine the misfit arises, and measured and modelled signals.

# %%
found.plot()

# %% [markdown]
# The engineer adds the effect and looks at the runs that were not used in the fit.

# %%
added = edhas.add("examples/campaign", [candidate.id for candidate in found.named])
added.plot()

# %%
added.summary()

# %% [markdown]
# The model with the effect is a configuration like any other: to be simulated, swept and sized with.

# %%
added.save_model("with_effect.yaml")
edhas.simulate("with_effect.yaml", frequency="15 Hz")

# %% [markdown]
# `found.save("folder")` writes the report with everything that led to the answer, as one page.
