"""The campaign of the demo is the one that its generator writes."""

import numpy as np
import pandas as pd

from studies.demo import BENCH
from studies.demo.bench_as_it_is import main
from tests.support.headline import headline


def test_the_bench_of_the_demo_is_the_generated_one(tmp_path, capsys):
    assert main(["--out", str(tmp_path / "bench")]) == 0
    found = headline(capsys)
    assert found["hidden"] == "inverter_dead_time" and len(found["disturbances"].split(",")) >= 3
    assert (tmp_path / "bench/campaign.yaml").read_text() == (BENCH / "campaign.yaml").read_text()
    assert "noise" not in (BENCH / "campaign.yaml").read_text().replace("of the noise", "")
    files = sorted(path.name for path in BENCH.glob("*.csv"))
    assert len(files) == int(found["runs"])
    for name in files:
        stored, made = (pd.read_csv(folder / name) for folder in (BENCH, tmp_path / "bench"))
        assert list(stored) == list(made)
        np.testing.assert_allclose(made, stored, rtol=1e-3, atol=1e-4)
