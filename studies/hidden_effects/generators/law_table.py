"""The table of the laws of the generators with their sources, as on the page `docs/hidden_laws.md`.

    from studies.hidden_effects.generators.law_table import markdown

`markdown()` is the table as text; a test compares the page with it.
"""

import inspect

from edhas_jax.machine.effects import LIBRARY
from studies.hidden_effects.generators.content import CONTENT
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.generators.laws import Law


def markdown() -> str:
    """All laws but the varied ones: mechanism, split, law, formula and source."""
    rows = ["| mechanism | split | law | what acts | source |", "| --- | --- | --- | --- | --- |"]
    for mechanism in LIBRARY:
        for split in (Split.TUNING, Split.PRACTICE, Split.EARLIER, Split.JUDGING):  # varied ones have one formula
            rows += [_row(f"`{mechanism.id}`", split, law) for law in CONTENT[split].laws if law.mechanism is mechanism]
    for split in (Split.TUNING, Split.EARLIER, Split.JUDGING):  # the practice and varied ones are those for tuning
        rows += [_row("none", split, law) for law in CONTENT[split].unlisted]
    return "\n".join(rows)


def _row(mechanism: str, split: Split, law: Law) -> str:
    text, source = inspect.getdoc(law.kind).split("Source: ")
    cells = (mechanism, split.value, f"`{law.id}`", _one_line(text), _one_line(source))
    return f"| {' | '.join(cells)} |"


def _one_line(text: str) -> str:
    """A text whose paragraphs are sentences of one line, without its final stop, as a cell of a table."""
    paragraphs = (" ".join(paragraph.split()).rstrip(".") for paragraph in text.strip().split("\n\n"))
    return ". ".join(paragraphs).replace("|", "\\|")
