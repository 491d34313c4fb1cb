"""A program as LLVM assembly: a loop over time for blocks of lanes, with the carry in registers."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from edhas_jax.compiler.llvm_ops import Processor, VectorCode
from edhas_jax.compiler.scalar_ir import Dependence, Program


class InputSource(NamedTuple):
    """Where an input comes from: a row of `table` ("carry", "lane", "uniform", "fed"), or the number of the "step"."""

    table: str
    row: int = 0


_FRAME = """{declarations}
define void @run(ptr %carry, ptr %lane, ptr %uniform, ptr %fed, ptr %kept,
                 i64 %first, i64 %per_sample, i64 %samples, i64 %blocks) #0 {{
entry:
  %last = sub i64 %samples, 1
  br label %block_loop
block_loop:
  %block = phi i64 [ 0, %entry ], [ %next_block, %block_end ]
  {opening}
  br label %sample_loop
sample_loop:
  %sample = phi i64 [ 0, %block_loop ], [ %next_sample, %sample_end ]
  {sample_phis}
  %samples_before = mul i64 %block, %samples
  %sample_block = add i64 %samples_before, %sample
  %keeping = icmp ne ptr %kept, null
  br i1 %keeping, label %keep, label %steps
keep:
  {keep}
  br label %steps
steps:
  {order}
  {feeding}
  %done = mul i64 {at}, %per_sample
  %begin = add i64 %first, %done
  %end = add i64 %begin, %per_sample
  br label %step_loop
step_loop:
  %n = phi i64 [ %begin, %steps ], [ %next_n, %step_loop ]
  {step_phis}
  {body}
  %next_n = add i64 %n, 1
  %more_steps = icmp slt i64 %next_n, %end
  br i1 %more_steps, label %step_loop, label %sample_end
sample_end:
  %next_sample = add i64 %sample, 1
  %more_samples = icmp slt i64 %next_sample, %samples
  br i1 %more_samples, label %sample_loop, label %block_end
block_end:
  {closing}
  %next_block = add i64 %block, 1
  %more_blocks = icmp slt i64 %next_block, %blocks
  br i1 %more_blocks, label %block_loop, label %exit
exit:
  ret void
}}
attributes #0 = {{ nounwind alignstack={bytes} "prefer-vector-width"="{bits}" "min-legal-vector-width"="{bits}" }}
"""


def loop_assembly(
    program: Program, processor: Processor, sources: Sequence[InputSource], rows: int, lane_rows: int, fed_rows: int,
    backwards: bool = False,
) -> str:  # fmt: skip
    """The text of a module with the function

    run(carry, lane, uniform, fed, kept, first, per_sample, samples, blocks): `samples` times, the carry is kept and
    `per_sample` ≥ 1 steps are taken, the first of which has the number `first`. For each block of lanes there are
    `rows` rows of carry, `lane_rows` rows that stay as they are, `samples` × `fed_rows` rows of which each sample has
    its own, and `samples` × `rows` rows to keep the carry in (none if `kept` is null). Output k of the program is row k
    of the new carry. If `backwards`, the samples are gone through from the last to the first.
    """
    code, across = VectorCode(program.type, processor), range(processor.vectors)
    order = program.schedule()
    apart = _lane_by_lane(program, order, sources)
    joined = _joined(program, order, apart)
    within = set(joined.values())
    names: dict[int, list[str]] = {}
    inputs = {program.nodes[i][1]: i for i in order if program.nodes[i][0] == "input"}

    def computed(i: int, j: int) -> str:
        op, *args = program.nodes[i]
        if i not in joined:
            return code.operation(op, [names[k][j] for k in args])
        a, b = (names[k][j] for k in program.nodes[joined[i]][1:])
        rest = names[args[1] if joined[i] == args[0] else args[0]][j]
        if op == "sub" and joined[i] == args[0]:
            rest = code.negative(rest)
        return code.multiply_add(code.negative(a) if op == "sub" and joined[i] == args[1] else a, b, rest)

    def compute(level: Dependence) -> None:
        for i in order:
            op, *args = program.nodes[i]
            if min(program.dependence[i], Dependence.CARRY) != level or op == "input" or i in within:
                continue
            if op in ("const", "bool"):
                names[i] = [code.number(args[0]) if op == "const" else code.truth(args[0])] * len(across)
            else:
                each = [computed(i, j) for j in (across if apart[i] else (0,))]
                names[i] = each if apart[i] else each * len(across)

    start = [[code.load(_at(code, "%carry", "%block", rows, r, j)) for j in across] for r in range(rows)]
    for k, source in enumerate(sources):
        if k in inputs and source.table == "lane":
            spots = [_at(code, "%lane", "%block", lane_rows, source.row, j) for j in across]
            names[inputs[k]] = [code.load(spot) for spot in spots]
        elif k in inputs and source.table == "uniform":
            spot = code.line(f"getelementptr {code.scalar}, ptr %uniform, i64 {source.row}")
            names[inputs[k]] = [code.splat(code.load_scalar(spot))] * len(across)
        elif k in inputs and source.table == "carry":
            names[inputs[k]] = [f"%c{source.row}.{j}" for j in across]
    compute(Dependence.INVARIANT)
    opening = code.taken()
    for r in range(rows):
        for j in across:
            code.store(f"%s{r}.{j}", _at(code, "%kept", "%sample_block", rows, r, j))
    keep = code.taken()
    at = code.line("sub i64 %last, %sample") if backwards else "%sample"
    feed_block = code.line(f"add i64 %samples_before, {at}")
    order_of_samples = code.taken()
    for k, source in enumerate(sources):
        if k in inputs and source.table == "fed":
            spots = [_at(code, "%fed", feed_block, fed_rows, source.row, j) for j in across]
            names[inputs[k]] = [code.load(spot) for spot in spots]
    compute(Dependence.SAMPLE)
    feeding = code.taken()
    number = [code.splat(code.line(f"sitofp i64 %n to {code.scalar}"))] * len(across)
    names |= {inputs[k]: number for k, source in enumerate(sources) if k in inputs and source.table == "step"}
    compute(Dependence.STEP)
    compute(Dependence.CARRY)
    body = code.taken()
    new = [names[program.outputs[r]] for r in range(rows)]
    for r in range(rows):
        for j in across:
            code.store(new[r][j], _at(code, "%carry", "%block", rows, r, j))
    closing = code.taken()

    def phis(name: str, first, before: str, then: str) -> list[str]:
        return [
            f"%{name}{r}.{j} = phi {code.vector} [ {first(r, j)}, %{before} ], [ {new[r][j]}, %{then} ]"
            for r in range(rows)
            for j in across
        ]

    parts = {
        "opening": opening,
        "sample_phis": phis("s", lambda r, j: start[r][j], "block_loop", "sample_end"),
        "keep": keep,
        "order": order_of_samples,
        "feeding": feeding,
        "step_phis": phis("c", lambda r, j: f"%s{r}.{j}", "steps", "step_loop"),
        "body": body,
        "closing": closing,
    }
    text = {n: "\n  ".join(lines) for n, lines in parts.items()}
    # without `alignstack` the stack stays at 16 bytes, and a vector that is put there lies across two cache lines
    size = {"bytes": processor.vector_bytes, "bits": 8 * processor.vector_bytes}
    return _FRAME.format(at=at, declarations="\n".join(code.declarations()), **size, **text)


def _at(code: VectorCode, table: str, block: str, rows: int, row: int, j: int) -> str:
    """The address of vector j of a row of a block."""
    wide = code.processor.vectors * code.width
    before = code.line(f"mul i64 {block}, {rows * wide}")
    spot = code.line(f"add i64 {before}, {row * wide + j * code.width}")
    return code.line(f"getelementptr {code.scalar}, ptr {table}, i64 {spot}")


def _lane_by_lane(program: Program, order: Sequence[int], sources: Sequence[InputSource]) -> dict[int, bool]:
    """Whether a value differs from lane to lane; what does not is computed once for all vectors of a block."""
    apart: dict[int, bool] = {}
    for i in order:
        op, *args = program.nodes[i]
        if op == "input":
            apart[i] = sources[args[0]].table in ("carry", "lane", "fed")
        else:
            apart[i] = any(apart[k] for k in program.operands(i))
    return apart


def _joined(program: Program, order: Sequence[int], apart: dict[int, bool]) -> dict[int, int]:
    """For sums and differences the product that becomes one operation with them: one that nothing else uses.

    It is chosen here and not by the compiler, whose choice would depend on how many vectors are side by side.
    """
    uses = Counter(k for i in order for k in program.operands(i)) + Counter(program.outputs.values())
    where = {i: (min(program.dependence[i], Dependence.CARRY), apart[i]) for i in order}
    out: dict[int, int] = {}
    for i in order:
        op, *args = program.nodes[i]
        if op in ("add", "sub"):
            products = [k for k in args if program.nodes[k][0] == "mul" and uses[k] == 1 and where[k] == where[i]]
            out.update((i, k) for k in products[:1])
    return out
