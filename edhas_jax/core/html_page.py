"""Elements of an HTML report that is one self-contained file, with its figures embedded."""

import base64
import datetime
import html
import io
import json
from collections.abc import Sequence
from typing import Any

import edhas_jax

SHOWN_DPI, SHARPNESS = 110, 1.5  # of pictures: pixels per inch of the page, and samples of the picture for each of them
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1b1f24; max-width: 1180px; margin: 2em auto; padding: 0 1.5em }
h1 { font-size: 1.6em; margin-bottom: 0.2em } h2 { font-size: 1.2em; margin-top: 2em }
table { border-collapse: collapse } td, th { padding: 0.25em 0.9em 0.25em 0; text-align: left; vertical-align: top }
th { border-bottom: 1px solid #6e7781; font-weight: 600 } td.number { text-align: right; white-space: nowrap }
figure { margin: 1em 0 } figcaption { color: #57606a; font-size: 0.9em }
a:focus-visible, button:focus-visible, summary:focus-visible, [tabindex]:focus-visible { outline: 3px solid #0b62c4 }
@media (max-width: 700px) { body { padding: 0 0.6em } table { display: block; overflow-x: auto } }
footer { color: #57606a; font-size: 0.85em; margin-top: 3em; border-top: 1px solid #d8dee4; padding-top: 0.5em }
img { max-width: 100% } .quiet { color: #6e7781 } li { margin: 0.3em 0 }
:root { color-scheme: light dark }
@media (prefers-color-scheme: dark) {
  body { background: #121212; color: #e6edf3 } .quiet, figcaption, footer { color: #9aa4af } a { color: #7ab7ff }
  img, svg, .drawn { filter: invert(0.93) hue-rotate(180deg) }
  .drawn { color-scheme: light; color: #1b1f24 } .drawn :is(img, svg) { filter: none }
}
"""


def page(title: str, *parts: str) -> str:
    """A complete HTML file with a title and the elements of its body."""
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f'<title>{html.escape(title)}</title><style>{STYLE}</style>'
    body = "\n".join((*parts, _footer()))
    return f"<!doctype html><html lang=en><head>{head}</head><body>\n{body}\n</body></html>\n"


def _footer() -> str:
    """What made the page and when, in one line."""
    date = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    return f"<footer>edhas_jax {edhas_jax.__version__}, {date}</footer>"


def heading(text: str, depth: int = 2) -> str:
    """A heading of level `depth`."""
    return f"<h{depth}>{html.escape(text)}</h{depth}>"


def paragraph(text: str) -> str:
    """A paragraph in grey, for explanations."""
    return f'<p class="quiet">{html.escape(text)}</p>'


def numbered_list(sentences: Sequence[str]) -> str:
    """A numbered list of sentences."""
    return "<ol>" + "".join(f"<li>{html.escape(s)}</li>" for s in sentences) + "</ol>"


def table(header: Sequence[str], body: Sequence[Sequence[str]], quiet: Sequence[bool] = ()) -> str:
    """A table; all columns but the first and the last are aligned as numbers; rows that are `quiet` are grey."""

    def cell(column: int, text: str) -> str:
        number = ' class="number"' if 0 < column < len(header) - 1 else ""
        return f"<td{number}>{html.escape(text)}</td>"

    head = "".join(f"<th>{html.escape(text)}</th>" for text in header)
    kinds = [' class="quiet"' if grey else "" for grey in quiet] or [""] * len(body)
    rows = zip(kinds, body, strict=True)
    lines = "".join(f"<tr{kind}>" + "".join(cell(k, t) for k, t in enumerate(row)) + "</tr>" for kind, row in rows)
    return f"<table><tr>{head}</tr>{lines}</table>"


def json_element(data: Any, identifier: str) -> str:
    """Data for a script of the page; no text in them can end the element."""
    text = json.dumps(data, allow_nan=False)
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return f'<script type="application/json" id="{html.escape(identifier)}">{text}</script>'


def image(figure, caption: str) -> str:
    """A matplotlib figure embedded as PNG; `caption` says what it shows, below it and as text for screen readers."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=SHARPNESS * SHOWN_DPI)
    data = base64.b64encode(buffer.getvalue()).decode()
    shown = f"{caption[:1].upper()}{caption[1:]}"
    width = round(SHOWN_DPI * figure.get_figwidth())
    picture = f'<img alt="{html.escape(caption)}" width="{width}" src="data:image/png;base64,{data}">'
    return f"<figure>{picture}<figcaption>{html.escape(shown)}</figcaption></figure>"
