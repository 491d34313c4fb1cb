"""LLVM assembly of a time loop around a scalar program, for blocks of lanes with the carry in registers."""

from collections.abc import Sequence

from edhas_jax.compiler.llvm_ops import Processor, VectorCode
from edhas_jax.compiler.program_code import InputSource, ProgramCode, step_loop
from edhas_jax.compiler.scalar_ir import Dependence, Program

_MODULE = (
    """{declarations}
define void @run(ptr %carry, ptr %lane, ptr %uniform, ptr %sample_inputs, ptr %carry_samples,
                 i64 %first, i64 %steps_per_sample, i64 %samples, i64 %blocks) #0 {{
entry:
  %last = sub i64 %samples, 1
  br label %block_loop
block_loop:
  %block = phi i64 [ 0, %entry ], [ %next_block, %block_end ]
  {block_setup}
  br label %sample_loop
sample_loop:
  %sample = phi i64 [ 0, %block_loop ], [ %next_sample, %sample_end ]
  {sample_phis}
  %samples_before = mul i64 %block, %samples
  %sample_block = add i64 %samples_before, %sample
  %saves_samples = icmp ne ptr %carry_samples, null
  br i1 %saves_samples, label %save_sample, label %steps
save_sample:
  {saving}
  br label %steps
steps:
  {sample_address}
  {sample_setup}
  %steps_before = mul i64 {sample_number}, %steps_per_sample
  %begin = add i64 %first, %steps_before
  %end = add i64 %begin, %steps_per_sample
  br label %step_loop
"""
    + step_loop("i64", start="steps", first="begin", last="end", samples="samples", after="block_end")
    + """block_end:
  {block_end}
  %next_block = add i64 %block, 1
  %more_blocks = icmp slt i64 %next_block, %blocks
  br i1 %more_blocks, label %block_loop, label %exit
exit:
  ret void
}}
attributes #0 = {{ nounwind alignstack={bytes} "prefer-vector-width"="{bits}" "min-legal-vector-width"="{bits}" }}
"""
)


def loop_assembly(
    program: Program,
    processor: Processor,
    sources: Sequence[InputSource],
    carry_rows: int,
    lane_rows: int,
    sample_input_rows: int,
    backwards: bool = False,
) -> str:
    """The text of an LLVM module with the time loop around `program`.

    The module has one function, run(carry, lane, uniform, sample_inputs, carry_samples, first, steps_per_sample,
    samples, blocks). For each block of lanes it stores the carry and takes `steps_per_sample` ≥ 1 steps, `samples`
    times; the steps of sample k have the numbers from first + k · steps_per_sample. Its tables have the shapes

    - carry: (blocks, carry_rows, lanes), replaced by the final carry;
    - lane: (blocks, lane_rows, lanes), loop-invariant;
    - uniform: (rows,), loop-invariant and the same for all lanes;
    - sample_inputs: (blocks, samples, sample_input_rows, lanes), or null if there are none;
    - carry_samples: (blocks, samples, carry_rows, lanes), the carry before each sample in processing order, or null.

    Args:
        program: one step; its output k is row k of the new carry.
        processor: the vector instructions to use.
        sources: where each input of the program comes from.
        carry_rows: number of rows of the carry.
        lane_rows: number of rows of `lane`.
        sample_input_rows: number of rows of `sample_inputs`.
        backwards: whether the samples are processed from the last to the first.

    Returns:
        The LLVM assembly.
    """
    code, vectors = VectorCode(program.type, processor), range(processor.vectors)
    emitted = ProgramCode(program, code, sources)
    registers, inputs = emitted.registers, emitted.inputs

    initial = [
        [code.load(_address(code, "%carry", "%block", carry_rows, r, j)) for j in vectors] for r in range(carry_rows)
    ]
    for k, source in enumerate(sources):
        if k in inputs and source.table == "lane":
            addresses = [_address(code, "%lane", "%block", lane_rows, source.row, j) for j in vectors]
            registers[inputs[k]] = [code.load(address) for address in addresses]
        elif k in inputs and source.table == "uniform":
            address = code.assign(f"getelementptr {code.scalar}, ptr %uniform, i64 {source.row}")
            registers[inputs[k]] = [code.splat(code.load_scalar(address))] * len(vectors)
        elif k in inputs and source.table == "carry":
            registers[inputs[k]] = [f"%c{source.row}.{j}" for j in vectors]
    emitted.append_level(Dependence.INVARIANT)
    block_setup = code.take_lines()
    for r in range(carry_rows):
        for j in vectors:
            code.store(f"%s{r}.{j}", _address(code, "%carry_samples", "%sample_block", carry_rows, r, j))
    saving = code.take_lines()
    sample_number = code.assign("sub i64 %last, %sample") if backwards else "%sample"
    input_block = code.assign(f"add i64 %samples_before, {sample_number}")
    sample_address = code.take_lines()
    for k, source in enumerate(sources):
        if k in inputs and source.table == "sample_inputs":
            addresses = [
                _address(code, "%sample_inputs", input_block, sample_input_rows, source.row, j) for j in vectors
            ]
            registers[inputs[k]] = [code.load(address) for address in addresses]
    emitted.append_level(Dependence.SAMPLE)
    sample_setup = code.take_lines()
    step_number = [code.splat(code.assign(f"sitofp i64 %n to {code.scalar}"))] * len(vectors)
    registers |= {inputs[k]: step_number for k, source in enumerate(sources) if k in inputs and source.table == "step"}
    emitted.append_level(Dependence.STEP)
    emitted.append_level(Dependence.CARRY)
    step = code.take_lines()
    new = [registers[program.outputs[r]] for r in range(carry_rows)]
    for r in range(carry_rows):
        for j in vectors:
            code.store(new[r][j], _address(code, "%carry", "%block", carry_rows, r, j))
    block_end = code.take_lines()

    def phis(prefix: str, entry_value, entry: str, loop: str) -> list[str]:
        """The carry at the head of a loop: `entry_value` from the block `entry`, the new carry from `loop`."""
        return [
            f"%{prefix}{r}.{j} = phi {code.vector} [ {entry_value(r, j)}, %{entry} ], [ {new[r][j]}, %{loop} ]"
            for r in range(carry_rows)
            for j in vectors
        ]

    parts = {
        "block_setup": block_setup,
        "sample_phis": phis("s", lambda r, j: initial[r][j], "block_loop", "sample_end"),
        "saving": saving,
        "sample_address": sample_address,
        "sample_setup": sample_setup,
        "step_phis": phis("c", lambda r, j: f"%s{r}.{j}", "steps", "step_loop"),
        "step": step,
        "block_end": block_end,
    }
    text = {n: "\n  ".join(lines) for n, lines in parts.items()}
    # without `alignstack` the stack is aligned to 16 bytes only, and a spilled vector may cross a cache line
    size = {"bytes": processor.vector_bytes, "bits": 8 * processor.vector_bytes}
    return _MODULE.format(sample_number=sample_number, declarations="\n".join(code.declarations()), **size, **text)


def _address(code: VectorCode, table: str, block: str, rows: int, row: int, j: int) -> str:
    """The address of vector j in a row of a block."""
    lanes = code.processor.vectors * code.width
    block_offset = code.assign(f"mul i64 {block}, {rows * lanes}")
    offset = code.assign(f"add i64 {block_offset}, {row * lanes + j * code.width}")
    return code.assign(f"getelementptr {code.scalar}, ptr {table}, i64 {offset}")
