# %% [markdown]
# # Compare: measurements beside the model
#
# A campaign is a folder: one CSV file for each run, and `campaign.yaml`, which says what was measured, with which
# unit, under which conditions, and which parameters of the machine are not known exactly.

# %%
from pathlib import Path

import edhas_jax as edhas

edhas.copy_examples()
print(Path("examples/campaign/campaign.yaml").read_text())

# %%
compared = edhas.compare("examples/campaign")
compared.summary()

# %% [markdown]
# The residual (measured less model) is given in units of the noise of each sensor: 1 would be a perfect model.

# %%
compared.plot()

# %% [markdown]
# Part of that may only be parameters that the sheet has a little wrong. A fit adjusts them within what is known of
# them.

# %%
fitted = edhas.fit("examples/campaign")
fitted.summary()

# %%
fitted.plot()

# %% [markdown]
# The residual is smaller, but still several times the noise: no values of these parameters explain the measurements.
# Something is missing in the model. The next tutorial finds out what.
