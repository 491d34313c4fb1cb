"""The GPU engine: loops of many lanes as kernels for NVIDIA GPUs, launched through their driver."""

import functools
from collections import Counter
from collections.abc import Callable

import jax
import numpy as np

from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, CudaError, Device, load_driver
from edhas_jax.compiler.gpu.rates import Rates, estimated_rates
from edhas_jax.compiler.loop_engine import AdjointLoop, Loop, LoopBody, LoopEngine, Untranslatable
from edhas_jax.compiler.native_engine import processor_problem
from edhas_jax.core import runtime

LEAST_CAPABILITY = (7, 0)
# of memory that a thread needs beside its registers; a kernel with more runs only if a GPU is asked for, because how
# much the memory slows it down has not been measured
MOST_LOCAL_BYTES = 1024


class GpuEngine(LoopEngine):
    """Compiles loops to kernels; the driver is looked for when this engine is first asked.

    Args:
        load: finds the driver.
    """

    name, for_many_lanes = "gpu", True

    def __init__(self, load: Callable[[], CudaDriver] = load_driver):
        self._load = functools.cache(load)
        self._found = functools.cache(self._look)

    def unavailable(self) -> str:
        """See `LoopEngine.unavailable`."""
        return self._found()[0]

    def outside_scope(self, body: LoopBody) -> str:
        """See `LoopEngine.outside_scope`."""
        if body.single_lane:
            return "the loop is run for one lane at a time"
        arrays = any(np.ndim(leaf) for leaf in jax.tree.leaves(body.uniform))
        return "the body reads an array, which registers cannot hold" if arrays else ""

    def compile(self, body: LoopBody) -> Loop:
        """See `LoopEngine.compile`."""
        from edhas_jax.compiler.gpu.loop import GpuLoop

        return self._loaded(lambda: GpuLoop(body, self._load(), self.devices()))

    def compile_adjoint(self, body: LoopBody) -> AdjointLoop:
        """See `LoopEngine.compile_adjoint`."""
        from edhas_jax.compiler.gpu.adjoint import GpuAdjointLoop

        return self._loaded(lambda: GpuAdjointLoop(body, self._load(), self.devices()))

    def probably_slower(self, loop: Loop | AdjointLoop) -> str:
        """See `LoopEngine.probably_slower`."""
        most = max(kernel.on(self.devices()[0]).local_bytes for kernel in loop.kernels)
        return f"{most:,} bytes of a thread do not fit its registers" if most > MOST_LOCAL_BYTES else ""

    def devices(self) -> list[Device]:
        """The GPUs that serve."""
        return self._found()[1]

    def rates(self, dtype) -> Rates:
        """What is estimated for the GPUs and the processor."""
        from edhas_jax.compiler.llvm_jit import host

        return estimated_rates(self.devices(), runtime.cores(), host().processor.vector_bytes, dtype)

    def pays(self, lanes: int, dtype) -> bool:
        """Whether so many lanes are faster here than on the processor, by the estimate."""
        least = self.rates(dtype).least_lanes()
        return least is not None and lanes >= least

    def device_names(self) -> str:
        """See `LoopEngine.device_names`."""
        names = Counter(device.name for device in self.devices())
        return ", ".join(f"{count} × {name}" for name, count in names.items())

    def description(self) -> str:
        """What this engine takes without being asked for, in words."""
        shares = []
        for dtype in ("float32", "float64"):
            least = self.rates(dtype).least_lanes()
            shares.append(f"{dtype} {'none' if least is None else f'from {least:,} designs on'}")
        return f"takes batches in {', in '.join(shares)} (estimated for {self.device_names()}, not measured)"

    def _loaded(self, make: Callable):
        """What `make` makes, once the driver has compiled its kernels."""
        try:
            loop = make()
            for kernel in loop.kernels:
                kernel.on(self.devices()[0])
        except CudaError as error:
            raise Untranslatable(str(error)) from error
        except RuntimeError as error:  # what LLVM says of code that it cannot compile
            raise Untranslatable(f"LLVM: {str(error).splitlines()[0] if str(error) else error!r}") from error
        return loop

    def _look(self) -> tuple[str, list[Device]]:
        """Why this engine cannot serve, and the devices that could."""
        try:
            devices = self._load().devices()
        except CudaError as error:
            return str(error), []
        able = [device for device in devices if device.capability >= LEAST_CAPABILITY]
        if not able:
            older = f"older than compute capability {'.'.join(map(str, LEAST_CAPABILITY))}"
            return f"all GPUs are {older}" if devices else "the driver shows no GPU", []
        problem = processor_problem()  # what is the same for all lanes is computed by machine code for the processor
        if not problem:
            from edhas_jax.compiler.gpu.ptx import ptx_problem

            problem = ptx_problem()
        return problem, able
