"""Sweeps on a Dask cluster of local processes: the same numbers, also after a worker has died."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from tests.support import CONFIGS

TEXT = f"""
base: {CONFIGS / "actuator.yaml"}
sweep:
  kind: grid
  parameters:
    frequency: [10 Hz, 20 Hz, 40 Hz, 80 Hz]
    mover_mass: [0.1 kg, 0.15 kg]
batch: {{step: 100 us, tolerance: 1 %, max_cycles: 6}}
"""


@pytest.fixture()
def workdir(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.yaml").write_text(TEXT)
    return tmp_path


def test_an_invalid_cluster_is_refused_before_anything_is_computed(workdir, capsys, monkeypatch):
    pytest.importorskip("distributed")
    from edhas_jax.design.sweep import dask_cluster

    monkeypatch.setattr(dask_cluster, "SCHEDULER_TIMEOUT", 1.0)
    for address, message in (
        ("local", "write local:2"), ("local:0", "write local:2"), ("http://x", "write local:2"),
        ("tcp://127.0.0.1:9", "no scheduler answers at tcp://127.0.0.1:9 within 1 s"),
    ):  # fmt: skip
        assert main(["sweep", "tiny.yaml", "--cluster", address]) == 2
        assert message in capsys.readouterr().err
        assert not (workdir / "runs").exists()


def test_the_message_without_dask_says_what_to_install(workdir, capsys, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "dask", None)
    assert main(["sweep", "tiny.yaml", "--cluster", "local:2"]) == 2
    assert 'pip install "edhas_jax[cluster]"' in capsys.readouterr().err


def test_a_killed_worker_changes_no_result(workdir):
    pytest.importorskip("distributed")
    from edhas_jax.design.sweep.dask_cluster import dask_executor

    sweep = edhas.load_sweep("tiny.yaml")
    edhas.run_sweep(sweep, "plain")
    killed = []
    with dask_executor("local:2") as workers:
        client = workers._client
        victim = next(iter(client.run(os.getpid).values()))

        def kill():
            # as soon as a chunk is being computed by the victim
            while not any(client.processing().values()):
                time.sleep(0.02)
            time.sleep(0.3)
            os.kill(victim, signal.SIGKILL)
            killed.append(not Path("cluster/table.parquet").exists())

        thread = threading.Thread(target=kill)
        thread.start()
        edhas.run_sweep(sweep, "cluster", workers)
        thread.join()
    assert killed == [True]  # during the sweep
    assert Path("plain/table.parquet").read_bytes() == Path("cluster/table.parquet").read_bytes()
