"""LLVM assembly of a GPU kernel: a thread takes its lane through the whole time loop, with the carry in registers.

What is the same for all lanes and all steps is computed once, by a function for the processor, and handed to the kernel
among its arguments: these lie in the constant memory of the GPU, from where an instruction takes an operand without a
register for it.
"""

from collections.abc import Sequence
from typing import NamedTuple

from edhas_jax.compiler.gpu.instruction_order import order_with_few_values
from edhas_jax.compiler.gpu.thread_code import ThreadCode
from edhas_jax.compiler.llvm_ops import Processor, VectorCode
from edhas_jax.compiler.loop_engine import Untranslatable
from edhas_jax.compiler.program_code import InputSource, ProgramCode, step_loop
from edhas_jax.compiler.scalar_ir import Dependence, Program

MOST_CONSTANT_BYTES = 3840  # of the 4096 that all arguments of a kernel may take
# the arguments of the kernel after the constants, in order, with their LLVM types
ARGUMENTS = {
    "rows": "ptr addrspace(1)", "inputs": "ptr addrspace(1)", "final": "ptr addrspace(1)", "kept": "ptr addrspace(1)",
    "first": "i64", "steps_per_sample": "i64", "samples": "i64", "lanes": "i64",
    "input_row_stride": "i64", "input_sample_stride": "i64", "input_lane_stride": "i64",
}  # fmt: skip

_KERNEL = (
    """target triple = "nvptx64-nvidia-cuda"
declare i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.tid.x()
{declarations}
define ptx_kernel void @run({arguments}) {{
entry:
  %block = call i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
  %block_threads = call i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
  %thread = call i32 @llvm.nvvm.read.ptx.sreg.tid.x()
  %threads_before = mul i32 %block, %block_threads
  %number = add i32 %threads_before, %thread
  %lane = zext i32 %number to i64
  %inside = icmp slt i64 %lane, %lanes
  br i1 %inside, label %begin, label %exit
begin:
  %first_step = trunc i64 %first to i32
  %steps = trunc i64 %steps_per_sample to i32
  %sample_count = trunc i64 %samples to i32
  %last = sub i32 %sample_count, 1
  %saves_samples = icmp ne ptr addrspace(1) %kept, null
  {setup}
  br label %sample_loop
sample_loop:
  %sample = phi i32 [ 0, %begin ], [ %next_sample, %sample_end ]
  {sample_phis}
  br i1 %saves_samples, label %save_sample, label %sample_begin
save_sample:
  {saving}
  br label %sample_begin
sample_begin:
  {sample_setup}
  %steps_before = mul i32 {sample_number}, %steps
  %step_begin = add i32 %first_step, %steps_before
  %step_end = add i32 %step_begin, %steps
  br label %step_loop
"""
    + step_loop("i32", start="sample_begin", first="step_begin", last="step_end", samples="sample_count", after="end")
    + """end:
  {storing}
  br label %exit
exit:
  ret void
}}
"""
)

_CONSTANTS = """{declarations}
define void @constants(ptr %uniform, ptr %constants) {{
  {body}
  ret void
}}
"""


class KernelText(NamedTuple):
    """A time loop for a GPU.

    Attributes:
        kernel: an LLVM module with the function run(constants, ARGUMENTS…), for the GPU.
        constants: one with the function constants(uniform, constants), for the processor; it writes what the kernel
            takes as its first argument.
        count: the length of this array.
    """

    kernel: str
    constants: str
    count: int


def kernel_text(
    program: Program, processor: Processor, sources: Sequence[InputSource], carry_rows: int, backwards: bool = False
) -> KernelText:
    """The text of the kernel with the time loop around `program`.

    A thread stores the carry and takes `steps_per_sample` ≥ 1 steps, `samples` times; the steps of sample k have the
    numbers from first + k · steps_per_sample, all below 2³¹. Its arguments are

    - rows: the addresses of the rows of the initial carry and of the lane values, each (lanes,);
    - inputs: the sample inputs; that of row r for lane j in sample k is at r · input_row_stride + k ·
      input_sample_stride + j · input_lane_stride;
    - final: (carry_rows, lanes), where the final carry goes;
    - kept: (carry_rows, samples, lanes), where the carry before each sample goes in processing order, or null.

    Args:
        program: one step; its output k is row k of the new carry.
        processor: for which the constants are computed.
        sources: where each input of the program comes from.
        carry_rows: number of rows of the carry.
        backwards: whether the samples are processed from the last to the first.

    Raises:
        Untranslatable: more is the same for all lanes than the arguments of a kernel can hold.
    """
    code = ThreadCode(program.type)
    emitted = ProgramCode(program, code, sources)
    constants = _constants(emitted)
    if len(constants) * code.dtype.itemsize > MOST_CONSTANT_BYTES:
        raise Untranslatable(f"{len(constants)} numbers that are the same for all lanes; a kernel cannot take so many")
    registers, inputs = emitted.registers, emitted.inputs

    def element(base: str, *terms: tuple[str, str | int]) -> str:
        """The address of base[Σ a · b] in global memory."""
        offset = "0"
        for a, b in terms:
            offset = code.assign(f"add i64 {offset}, {code.assign(f'mul i64 {a}, {b}')}")
        return code.assign(f"getelementptr {code.scalar}, ptr addrspace(1) {base}, i64 {offset}")

    def loaded(address: str, kind: str = "") -> str:
        size = 8 if kind else _size(code)
        return code.assign(f"load {kind or code.scalar}, ptr addrspace(1) {address}, align {size}")

    def of_row(row: int) -> str:
        """The value of this lane in a row of `rows`."""
        pointer = code.assign(f"getelementptr ptr addrspace(1), ptr addrspace(1) %rows, i64 {row}")
        return loaded(element(loaded(pointer, "ptr addrspace(1)"), ("%lane", 1)))

    for k, i in enumerate(constants):
        address = code.assign(f"getelementptr {code.scalar}, ptr %constants, i64 {k}")
        number = code.load_scalar(address)
        registers[i] = [code.compare("une", number, code.number(0.0)) if program.is_boolean(i) else number]
    initial = [of_row(r) for r in range(carry_rows)]
    for k, source in enumerate(sources):
        if k in inputs and source.table == "lane":
            registers[inputs[k]] = [of_row(carry_rows + source.row)]
        elif k in inputs and source.table == "carry":
            registers[inputs[k]] = [f"%c{source.row}"]
    emitted.append_level(Dependence.INVARIANT, lambda i: emitted.varies[i] or program.constant_value(i) is not None)
    setup = code.take_lines()
    wide = code.assign("zext i32 %sample to i64")
    for r in range(carry_rows):
        row = code.assign(f"add i64 {code.assign(f'mul i64 {r}, %samples')}, {wide}")
        _store(code, f"%s{r}", element("%kept", (row, "%lanes"), ("%lane", 1)))
    saving = code.take_lines()
    sample_number = code.assign("sub i32 %last, %sample") if backwards else "%sample"
    wide = code.assign(f"zext i32 {sample_number} to i64")
    for k, source in enumerate(sources):
        if k in inputs and source.table == "sample_inputs":
            place = (source.row, "%input_row_stride"), (wide, "%input_sample_stride"), ("%lane", "%input_lane_stride")
            registers[inputs[k]] = [loaded(element("%inputs", *place))]
    emitted.append_level(Dependence.SAMPLE)
    sample_setup = code.take_lines()
    step_number = [code.assign(f"sitofp i32 %n to {code.scalar}")]
    registers |= {inputs[k]: step_number for k, source in enumerate(sources) if k in inputs and source.table == "step"}
    carry = {inputs[k] for k, source in enumerate(sources) if k in inputs and source.table == "carry"}
    results = {program.outputs[r] for r in range(carry_rows)}
    in_step = [i for i in emitted.schedule if emitted.level(i) >= Dependence.STEP and emitted.has_code(i)]
    emitted.append(order_with_few_values(in_step, emitted.operands, results, carry))
    step = code.take_lines()
    new = [registers[program.outputs[r]][0] for r in range(carry_rows)]
    for r in range(carry_rows):
        _store(code, new[r], element("%final", (r, "%lanes"), ("%lane", 1)))
    storing = code.take_lines()

    def phis(prefix: str, entry_value, entry: str, loop: str) -> list[str]:
        """The carry at the head of a loop: `entry_value` from the block `entry`, the new carry from `loop`."""
        return [
            f"%{prefix}{r} = phi {code.scalar} [ {entry_value(r)}, %{entry} ], [ {new[r]}, %{loop} ]"
            for r in range(carry_rows)
        ]

    parts = {
        "setup": setup, "sample_phis": phis("s", lambda r: initial[r], "begin", "sample_end"), "saving": saving,
        "sample_setup": sample_setup, "step_phis": phis("c", lambda r: f"%s{r}", "sample_begin", "step_loop"),
        "step": step, "storing": storing,
    }  # fmt: skip
    text = {n: "\n  ".join(lines) for n, lines in parts.items()}
    arguments = [f"ptr byval([{max(len(constants), 1)} x {code.scalar}]) align {_size(code)} %constants"]
    arguments += [f"{kind} %{name}" for name, kind in ARGUMENTS.items()]
    kernel = _KERNEL.format(
        declarations="\n".join(code.declarations()), arguments=", ".join(arguments),
        sample_number=sample_number, **text,
    )  # fmt: skip
    return KernelText(kernel, _constants_text(program, processor, sources, constants), len(constants))


def _constants(emitted: ProgramCode) -> list[int]:
    """The nodes that are the same for all lanes and steps and that others read."""
    program = emitted.program

    def is_constant(i: int) -> bool:
        computed = program.constant_value(i) is None and not emitted.is_contracted_product(i)
        return computed and emitted.level(i) == Dependence.INVARIANT and not emitted.varies[i]

    read = {k for i in emitted.schedule if not is_constant(i) for k in emitted.operands(i)}
    return [i for i in emitted.schedule if is_constant(i) and i in read | set(program.outputs.values())]


def _constants_text(program: Program, processor: Processor, sources: Sequence[InputSource], wanted: list[int]) -> str:
    """The function for the processor that computes the nodes `wanted`."""
    code = VectorCode(program.type, Processor(processor.vector_bytes, processor.has_approximations, 1))
    emitted = ProgramCode(program, code, sources)
    for k, source in enumerate(sources):
        if k in emitted.inputs and source.table == "uniform":
            address = code.assign(f"getelementptr {code.scalar}, ptr %uniform, i64 {source.row}")
            emitted.registers[emitted.inputs[k]] = [code.splat(code.load_scalar(address))]
    emitted.append_level(Dependence.INVARIANT, lambda i: not emitted.varies[i])
    lines = code.take_lines()
    for k, i in enumerate(wanted):
        value = emitted.registers[i][0]
        if program.is_boolean(i):
            value = code.select(value, code.number(1.0), code.number(0.0))
        scalar = code.assign(f"extractelement {code.vector} {value}, i64 0")
        address = code.assign(f"getelementptr {code.scalar}, ptr %constants, i64 {k}")
        lines += [*code.take_lines(), f"store {code.scalar} {scalar}, ptr {address}, align {_size(code)}"]
    return _CONSTANTS.format(declarations="\n".join(code.declarations()), body="\n  ".join(lines))


def _size(code: VectorCode) -> int:
    return code.dtype.itemsize


def _store(code: VectorCode, value: str, address: str) -> None:
    """Write a number to global memory."""
    code.append(f"store {code.scalar} {value}, ptr addrspace(1) {address}, align {_size(code)}")
