"""Kernels compiled by NVIDIA's assembler: registers and spilled bytes, and no function that is not inlined."""

import pytest

from edhas_jax.compiler.gpu.device_kernel import MOST_SPILLED_BYTES, REGISTERS
from edhas_jax.compiler.gpu.engine import MOST_LOCAL_BYTES
from tests.compiler.test_gpu_kernel import ptx_of
from tests.support.loop_bodies import NAMES
from tests.support.ptx_assembler import MISSING, assembled, tool

pytestmark = pytest.mark.skipif(tool("ptxas") is None, reason=MISSING)

ARCHITECTURES = ("sm_80", "sm_90", "sm_100")
# registers with which no thread spills more than 64 bytes
FEWEST = {("pump", "float32"): 128, ("system", "float32"): 128}
# the most bytes that a thread stores or loads with 255 registers
SPILLED = {
    ("pump", "float32"): 0, ("system", "float32"): 0, ("pump", "float64"): 64, ("system", "float64"): 64,
}  # fmt: skip
DERIVATIVES = {"forward, 1 direction": 2_500, "forward, 8 directions": 32_000, "reverse": 7_000}


@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize(("name", "dtype"), FEWEST)
def test_registers_suffice_for_many_threads(name, dtype, architecture):
    found = assembled(ptx_of(name, dtype), architecture, FEWEST[name, dtype])
    assert found.registers <= FEWEST[name, dtype] in REGISTERS
    assert found.local_bytes <= MOST_SPILLED_BYTES


@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize(("name", "dtype"), SPILLED)
def test_every_kernel_is_compiled_and_spills_no_more_than_known(name, dtype, architecture):
    found = assembled(ptx_of(name, dtype), architecture)
    assert found.registers <= 255 and max(found.spilled) <= SPILLED[name, dtype]


@pytest.mark.parametrize("name", DERIVATIVES)
def test_kernels_of_derivatives_are_compiled(name):
    """They need so much memory that a GPU takes them only if it is asked for."""
    found = assembled(ptx_of(name, "float64"), "sm_90")
    assert found.local_bytes > MOST_LOCAL_BYTES and max(found.spilled) <= DERIVATIVES[name]


def test_every_task_is_covered():
    assert {name for name, _ in SPILLED} | set(DERIVATIVES) == set(NAMES)
