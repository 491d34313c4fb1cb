"""The operations of a scalar program as LLVM assembly, one level of the loop nest after the other.

Shared by the loop for the processor and by the kernel for a GPU, so that both compute the same operations in the same
order, with the same products contracted to fused multiply-adds.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from edhas_jax.compiler.llvm_ops import VectorCode
from edhas_jax.compiler.scalar_ir import Dependence, Program


class InputSource(NamedTuple):
    """Where an input of the program comes from.

    Attributes:
        table: "carry", "lane", "uniform" or "sample_inputs", the argument of the compiled loop that holds the input; or
            "step", the number of the step.
        row: the row of the table.
    """

    table: str
    row: int = 0


def step_loop(integer: str, start: str, first: str, last: str, samples: str, after: str) -> str:
    """The template of the loops over samples and their steps, with the fields `step_phis` and `step`.

    Args:
        integer: LLVM type of the counters.
        start: label of the block in which a sample starts.
        first: register with the number of the first step of the sample,
        last: and of the step after its last one.
        samples: register with the number of samples.
        after: label of the block that follows the last sample.
    """
    return f"""step_loop:
  %n = phi {integer} [ %{first}, %{start} ], [ %next_n, %step_loop ]
  {{step_phis}}
  {{step}}
  %next_n = add {integer} %n, 1
  %more_steps = icmp slt {integer} %next_n, %{last}
  br i1 %more_steps, label %step_loop, label %sample_end
sample_end:
  %next_sample = add {integer} %sample, 1
  %more_samples = icmp slt {integer} %next_sample, %{samples}
  br i1 %more_samples, label %sample_loop, label %{after}
"""


class ProgramCode:
    """Appends the operations of a program to some code.

    Attributes:
        registers: by node the names of its registers, one for each of the interleaved vectors.
        varies: by node whether its value differs from lane to lane.
        inputs: the node of each input that the program reads, by the number of the input.
    """

    def __init__(self, program: Program, code: VectorCode, sources: Sequence[InputSource]):
        self.program, self.code, self.schedule = program, code, program.schedule()
        self.vectors = range(code.processor.vectors)
        self.varies = _varies_by_lane(program, self.schedule, sources)
        self._contracted = _select_multiply_adds(program, self.schedule, self.varies)
        self._contracted_products = set(self._contracted.values())
        self.registers: dict[int, list[str]] = {}
        self.inputs = {program.nodes[i][1]: i for i in self.schedule if program.nodes[i][0] == "input"}

    def level(self, i: int) -> Dependence:
        """The level of the loop nest at which node i is computed."""
        return min(self.program.dependence[i], Dependence.CARRY)

    def append_level(self, level: Dependence, wanted: Callable[[int], bool] = lambda i: True) -> None:
        """Append the code of all nodes that are computed at one level and are `wanted`."""
        self.append(i for i in self.schedule if self.level(i) == level and self.has_code(i) and wanted(i))

    def append(self, nodes: Iterable[int]) -> None:
        """Append the code of some nodes, of which each comes after those whose registers it reads."""
        for i in nodes:
            op, *args = self.program.nodes[i]
            if op in ("const", "bool"):
                text = self.code.number(args[0]) if op == "const" else self.code.boolean(args[0])
                self.registers[i] = [text] * len(self.vectors)
            elif self.varies[i]:
                self.registers[i] = [self._operation(i, j) for j in self.vectors]
            else:
                self.registers[i] = [self._operation(i, 0)] * len(self.vectors)

    def operands(self, i: int) -> tuple[int, ...]:
        """The nodes whose registers the code of node i reads: those of a contracted product in its place."""
        product = self._contracted.get(i)
        found = self.program.operands(i)
        if product is None:
            return found
        return *(k for k in found if k != product), *self.program.operands(product)

    def is_contracted_product(self, i: int) -> bool:
        """Whether node i is a product that is part of a fused multiply-add and has no register of its own."""
        return i in self._contracted_products

    def has_code(self, i: int) -> bool:
        """Whether node i is computed by code of its own: it is no input, nor part of a fused multiply-add."""
        return self.program.nodes[i][0] != "input" and i not in self._contracted_products

    def _operation(self, i: int, j: int) -> str:
        """The code of node i for vector j of the block."""
        op, *args = self.program.nodes[i]
        code, registers = self.code, self.registers
        if i not in self._contracted:
            return code.operation(op, [registers[k][j] for k in args])
        product = self._contracted[i]
        a, b = (registers[k][j] for k in self.program.nodes[product][1:])
        addend = registers[args[1] if product == args[0] else args[0]][j]
        if op == "sub" and product == args[0]:
            addend = code.neg(addend)
        return code.multiply_add(code.neg(a) if op == "sub" and product == args[1] else a, b, addend)


def _varies_by_lane(program: Program, schedule: Sequence[int], sources: Sequence[InputSource]) -> dict[int, bool]:
    """Whether a value differs from lane to lane; one that does not is computed once for all vectors of a block."""
    varies: dict[int, bool] = {}
    for i in schedule:
        op, *args = program.nodes[i]
        if op == "input":
            varies[i] = sources[args[0]].table in ("carry", "lane", "sample_inputs")
        else:
            varies[i] = any(varies[k] for k in program.operands(i))
    return varies


def _select_multiply_adds(program: Program, schedule: Sequence[int], varies: dict[int, bool]) -> dict[int, int]:
    """{sum or difference: product that is contracted with it to a fused multiply-add}.

    A product is contracted where it has no other use. The choice is made here and not by LLVM, which would choose
    depending on the number of interleaved vectors, so that results would not be reproducible to the bit.
    """
    uses = Counter(k for i in schedule for k in program.operands(i)) + Counter(program.outputs.values())
    place = {i: (min(program.dependence[i], Dependence.CARRY), varies[i]) for i in schedule}
    contracted: dict[int, int] = {}
    for i in schedule:
        op, *args = program.nodes[i]
        if op in ("add", "sub"):
            products = [k for k in args if program.nodes[k][0] == "mul" and uses[k] == 1 and place[k] == place[i]]
            contracted.update((i, k) for k in products[:1])
    return contracted
