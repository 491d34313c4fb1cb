# %% [markdown]
# # A sweep on several computers
#
# Designs are independent of each other, so that a sweep spreads over as many processes as there are. Dask connects
# them: here two on this computer, `"local:2"`; on a cluster the address of its scheduler, such as
# `"tcp://login:8786"`.
#
# In a folder every finished part is kept. If the computer or the cluster fails, the same call goes on where it ended.

# %%
import edhas_jax as edhas

edhas.copy_examples()
ranges = dict(piston_clearance=("5 um", "40 um"), piston_diameter=("8 mm", "16 mm"), frequency=("5 Hz", "30 Hz"))
swept = edhas.sweep("examples/paper.yaml", samples=4000, folder="many_pumps", cluster="local:2", **ranges)
swept.summary()

# %% [markdown]
# The folder opens again at any time, also while others compute.

# %%
edhas.open_result("many_pumps").plot_parallel("volumetric_efficiency")

# %% [markdown]
# Whether one computer or many did the work does not show in the results: they are the same to the last bit on
# processors of the same kind. A job script for SLURM is in [sweeps on clusters](../clusters.md).
