# %% [markdown]
# # Explore: sweeps and heat maps
#
# How do the clearance of the plungers and the frequency change what a pump delivers? A sweep simulates every
# combination at once, each until it is periodic, and keeps the figures of one cycle.

# %%
import edhas_jax as edhas

edhas.copy_examples()  # the folder `examples`
ranges = dict(piston_clearance=("5 um", "40 um", 24, "log"), frequency=("5 Hz", "30 Hz", 11))
swept = edhas.sweep("examples/paper.yaml", **ranges)
swept.summary()

# %% [markdown]
# The result is an xarray Dataset in SI units. Its pictures have the units that an engineer reads.

# %%
swept.plot_heat("volumetric_efficiency")

# %%
swept["mean_leakage"].sel(frequency=10).plot(marker="o");

# %% [markdown]
# Leakage grows with the third power of the clearance. The slope in logarithms says so:

# %%
import numpy as np

leakage = swept["mean_leakage"].sel(frequency=10)
slope = np.polyfit(np.log(leakage.piston_clearance), np.log(leakage), 1)[0]
print(f"leakage ~ clearance^{slope:.2f}")

# %% [markdown]
# Two thousand designs drawn from four ranges (a Latin hypercube) show what goes together. The pump works against a
# smaller orifice here, so that pressure matters.

# %%
drawn = edhas.sweep(
    "examples/paper.yaml",
    piston_clearance=("5 um", "40 um"), piston_diameter=("8 mm", "16 mm"), frequency=("5 Hz", "30 Hz"),
    valve_spring_rate=("50 N/m", "1 kN/m"), load_orifice_area="1 mm^2", samples=2000,
)
drawn.plot_parallel("overall_efficiency")

# %%
drawn.plot_pareto(["mean_flow:max", "overall_efficiency:max"])

# %% [markdown]
# Pandas has the rest: the ten designs of the best efficiency that deliver more than 1.5 L/min.

# %%
table = drawn.to_dataframe()
wanted = table[(table.mean_flow > 1.5e-3 / 60) & (table.status == "ok")]
wanted.nlargest(10, "overall_efficiency")[["piston_diameter", "frequency", "mean_flow", "overall_efficiency"]]

# %% [markdown]
# A sweep is saved as NetCDF and opens again with what made it.

# %%
drawn.save("drawn.nc", overwrite=True)
edhas.open_result("drawn.nc")
