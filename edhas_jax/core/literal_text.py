"""Text as data of another language: names that users give never become commands of what they are written into.

One function for each target. HTML has `html.escape` and `html_page.json_element`.
"""

import json
import re
import unicodedata

MAX_FILE_NAME = 100  # bytes; suffixes and numbers are added to it
_INVISIBLE = ("Cc", "Cs", "Zl", "Zp")  # control characters, surrogates, separators of lines and paragraphs
_BIDI = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")  # reorder what is shown
_NONCHARACTERS = frozenset("\ufffe\uffff")
_PLAIN_YAML = re.compile(r"[A-Za-z_][\w./-]*", re.ASCII)
_YAML_WORDS = frozenset(("true", "false", "yes", "no", "on", "off", "null", "y", "n"))


def one_line(text: str) -> str:
    """A text for a line of a comment, of a message or of a table: without line breaks and control characters."""
    return "".join(" " if _is_invisible(c) else c for c in text)


def terminal_text(text: str) -> str:
    """A text for a terminal: line breaks and tabs stay, everything else that a terminal would obey does not."""
    return "".join(c if c in "\n\t" or not _is_invisible(c) else "\ufffd" for c in text)


def c_comment(text: str) -> str:
    """A text within a comment /* … */ of C."""
    return one_line(text).replace("*/", "* /").replace("/*", "/ *").replace("\\", "\\ ")


def c_string(text: str) -> str:
    """A string literal of C in UTF-8."""

    def escaped(c: str, before: str) -> str:
        if c in '"\\':
            return "\\" + c
        if _is_invisible(c) or c == before == "?":  # two question marks may begin a trigraph
            return "".join(f"\\{byte:03o}" for byte in c.encode("utf-8", "replace"))
        return c

    return '"' + "".join(escaped(c, b) for c, b in zip(text, " " + text, strict=False)) + '"'


def xml_text(text: str) -> str:
    """A text for an attribute or element of XML, of which a library escapes the markup: characters that XML has."""
    return "".join("\ufffd" if c in _NONCHARACTERS else c for c in one_line(text))


def yaml_text(text: str) -> str:
    """A text as a scalar of YAML that is read as the same text; quoted unless it is a plain word."""
    if _PLAIN_YAML.fullmatch(text) and text.lower() not in _YAML_WORDS:
        return text
    quoted = json.dumps(text, ensure_ascii=False)
    return "".join(f"\\u{ord(c):04x}" if _is_invisible(c) or c in _NONCHARACTERS | {"\ufeff"} else c for c in quoted)


def csv_text(text: str) -> str:
    """A text for a cell of a table in CSV: after an apostrophe where a spreadsheet would take it for a formula."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text


def file_name(text: str) -> str:
    """A name for a file or folder: letters, digits, spaces and "_-.+="; no path, not hidden, not too long."""
    name = "".join(c if c.isalnum() or c in "_-.+= " else "_" for c in one_line(text)).strip(" .")
    while len(name.encode()) > MAX_FILE_NAME:
        name = name[:-1]
    return name.strip(" .") or "unnamed"


def figure_text(text: str) -> str:
    """A text for matplotlib: a dollar sign is one, and begins no formula."""
    return text.replace("$", r"\$")


def _is_invisible(c: str) -> bool:
    return unicodedata.category(c) in _INVISIBLE or c in _BIDI
