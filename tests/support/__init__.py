"""What several tests need: folders of the repository, reference runs, synthetic and spoilt campaigns."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CONFIGS = ROOT / "configs"
DATA = ROOT / "tests" / "data"
