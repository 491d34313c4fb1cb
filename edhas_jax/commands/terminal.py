"""Output on a terminal of any character set: characters that it lacks are written with those that it has."""

import codecs
import contextlib
import sys
from collections.abc import Iterator

ERRORS = "edhas_jax.plain"  # name of the handler of characters that cannot be encoded
PLAIN = {
    "µ": "u", "μ": "u", "·": "*", "×": "x", "−": "-", "–": "-", "—": "-", "…": "...", "±": "+/-", "°": "deg ",
    "²": "^2", "³": "^3", "⁴": "^4", "½": "1/2", "¼": "1/4", "χ": "chi", "σ": "sigma", "π": "pi", "Ω": "ohm",
    "Δ": "d", "∞": "inf", "≤": "<=", "≥": ">=", "→": "->", "√": "sqrt ", "∝": "~", "’": "'", "“": '"', "”": '"',
}  # fmt: skip


@contextlib.contextmanager
def plain_characters() -> Iterator[None]:
    """Within the context both streams replace what their encoding lacks, instead of ending in an error."""
    codecs.register_error(ERRORS, _plain)
    # a stream that a caller put in place may have no encoding
    streams = [(s, s.errors) for s in (sys.stdout, sys.stderr) if hasattr(s, "reconfigure")]
    for stream, _ in streams:
        stream.reconfigure(errors=ERRORS)
    try:
        yield
    finally:
        for stream, errors in streams:
            if not stream.closed:
                stream.reconfigure(errors=errors)


def _plain(error: UnicodeError) -> tuple[str, int]:
    """The replacement of characters that cannot be encoded, and where to go on."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(c, "?") for c in error.object[error.start : error.end]), error.end
