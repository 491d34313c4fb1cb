"""Questions asked of the package, a folder each; `studies/README.md` lists them."""

from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)  # for what studies compute by themselves

ROOT = Path(__file__).resolve().parent.parent
CONFIGS = ROOT / "configs"
