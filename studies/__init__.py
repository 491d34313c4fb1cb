"""Questions asked of the package, a folder each; `studies/README.md` lists them."""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CONFIGS = ROOT / "configs"
