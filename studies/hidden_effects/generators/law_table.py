"""The page of laws: what acts by which formula, and where it is from.

    python -m studies.hidden_effects.generators.law_table [--judging] > build/hidden_laws.md

Laws of the split `tuning`; those that judge too with `--judging`, which nobody should read before a method is judged.
"""

import argparse
import inspect

from edhas_jax.machine.effects import LIBRARY
from studies.hidden_effects.generators.content import CONTENT, OWN_MACHINES
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.generators.laws import Law

HEAD = """# Laws of the benchmark

x and v are position and speed of the moving part, p_s is the pressure of the accumulator, Δp a pressure drop, y the
lift of a valve, Δ the deflection of the coupling, Km the force constant, th(v) = tanh(v/5 mm/s), S_p a plunger's area.
Mechanisms called "none" are not in the library. The split *varied* has the laws of the library times a factor of a
signal, see `studies/hidden_effects/generators/varied/laws.py`.
"""


def markdown(*splits: Split) -> str:
    """All laws of some splits: mechanism, split, law, formula and source."""
    rows = ["| mechanism | split | law | what acts | source |", "| --- | --- | --- | --- | --- |"]
    for mechanism in LIBRARY:
        for split in splits:
            rows += [_row(split, law) for law in CONTENT[split].laws if law.mechanism is mechanism]
    for split in splits:
        rows += [_row(split, law) for law in CONTENT[split].unlisted]
        rows += [_row(split, law) for own in OWN_MACHINES.get(split, ()) for law in (*own.laws, *own.unlisted)]
    return "\n".join(rows)


def _row(split: Split, law: Law) -> str:
    text, source = inspect.getdoc(law.kind).split("Source: ")
    mechanism = f"`{law.mechanism.id}`" if law.mechanism else "none"
    cells = mechanism, split.value, f"`{law.id}`", _one_line(text), _one_line(source)
    return f"| {' | '.join(cells)} |"


def _one_line(text: str) -> str:
    """A text without its final stop, as a cell of a table."""
    return " ".join(text.split()).rstrip(".").replace("|", "\\|")


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--judging", action="store_true", help="also the laws that judge")
    chosen = (Split.TUNING, Split.JUDGING) if options.parse_args().judging else (Split.TUNING,)
    print(f"{HEAD}\n{markdown(*chosen)}")
