"""Strategies that damage a valid input: bytes, texts, trees of YAML, cells of a table."""

import copy

import yaml
from hypothesis import strategies as st

NUMBERS = (
    "0", "-0", "-1", "1", "3.7", "1e-308", "1e308", "-1e308", "1e999", "nan", "inf", "-inf", "9" * 400, "0x10",
    "1_000", "1,5", "٣", "1e-9", "1e9", "0.5", "2", "7", "99999999999999999999",
)  # fmt: skip
QUANTITIES = (
    "1 um", "12 mm", "5 parsec", "1 kg", "-3 MPa", "20 um*9**9**9", "3 mm^99999", "1 mm ± 2", "10 %", "0 Hz", "1 Hz",
    "2 kHz", "1 THz", "1 mm mm", "mm", "1 mm/0", "1e400 mm", "1 degC", "-300 degC", "5 dB",
    "__import__('os').system('true')", "1 μm", "3 µm²",
)  # fmt: skip
TEXTS = (
    "", " ", "~", "x", "true", "no", "a [/b]", "[red]", "$x^$", "../../../x", "/etc/passwd", "\x00", "\x1b[31m",
    "a\rb", "*/ int x; /*", "]]>", "%s%n", "ü" * 300, "\u202e", "evil.py:Evil", "notes.py:X", "evil.py", ":",
    "os:system", "evil:Evil", "lugre_friction", "piston_leakage", "sine", "position", "cascade", "actuator_bench",
    "pump_bench", "actuator_system", "signal", "open_loop", "run0.csv",
)  # fmt: skip
OTHERS = (
    None, True, False, [], {}, [[]], {"kind": []}, {"kind": None}, {"kind": {}}, ["a", "a"], [1, 2, 3], {"a": 1}, 0,
    -1, 3.7, 1e300, float("nan"), float("inf"), 10**400, {"from": 1, "to": 0}, {"value": "1 mm"}, {1: 2},
    {None: None},
)  # fmt: skip

TIMES = st.sampled_from((1, 1, 1, 2, 4))  # much damage is found at its first place: little reaches further

leaves = st.one_of(
    st.sampled_from(NUMBERS), st.sampled_from(QUANTITIES), st.sampled_from(TEXTS), st.sampled_from(OTHERS),
    st.text(max_size=12), st.integers(), st.floats(),
)  # fmt: skip


def _places(tree, path=()):
    """The paths of all nodes below the root of a tree of mappings and lists."""
    children = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, child in children:
        yield (*path, key)
        yield from _places(child, (*path, key))


@st.composite
def damaged_trees(draw, tree, names=()):
    """A tree with some nodes replaced, removed, renamed, moved or added; `names` are keys worth trying."""
    tree = copy.deepcopy(tree)
    for _ in range(draw(TIMES)):
        places = list(_places(tree))
        if not places:
            break
        *parents, key = draw(st.sampled_from(places))
        node = tree
        for parent in parents:
            node = node[parent]
        what = draw(st.sampled_from(("replace", "replace", "replace", "remove", "rename", "add", "wrap", "copy")))
        if what == "replace":
            node[key] = copy.deepcopy(draw(leaves))
        elif what == "remove":
            del node[key]
        elif what == "wrap":
            node[key] = draw(st.sampled_from(([node[key]], {"kind": node[key]}, [node[key]] * 3)))
        elif what == "copy":
            *from_parents, from_key = draw(st.sampled_from(places))
            other = tree
            for parent in from_parents:
                other = other[parent] if isinstance(other, dict | list) and _has(other, parent) else {}
            node[key] = (
                copy.deepcopy(other[from_key]) if isinstance(other, dict | list) and _has(other, from_key) else None
            )
        elif isinstance(node, dict):
            new = draw(st.sampled_from((*names, "", "x", 1, None, "name", "kind")))
            node[new] = node.pop(key) if what == "rename" else copy.deepcopy(draw(leaves))
        else:
            node.insert(key, copy.deepcopy(draw(leaves)))
    return tree


def _has(node, key) -> bool:
    return key in node if isinstance(node, dict) else isinstance(key, int) and 0 <= key < len(node)


def yaml_text(tree) -> str:
    """A tree as YAML; long numbers as they are."""
    return yaml.safe_dump(tree, allow_unicode=True, sort_keys=False)


@st.composite
def damaged_texts(draw, text: str):
    """A text with some characters or lines inserted, removed, doubled or replaced; as bytes, not always UTF-8."""
    data = text.encode()
    for _ in range(draw(TIMES)):
        data = draw(_damaged_bytes(data))
    return data


@st.composite
def _damaged_bytes(draw, data: bytes):
    what = draw(st.sampled_from(("insert", "remove", "cut", "byte", "line twice", "no line", "swap")))
    at = draw(st.integers(0, max(len(data) - 1, 0)))
    if what == "insert":
        piece = draw(
            st.one_of(
                st.sampled_from(
                    (
                        b'"', b"'", b",", b";", b"\n", b"\r", b"\t", b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"&a [",
                        b"*a", b"- ", b": ", b"{", b"}", b"[" * 200, b"!!python/object/apply:os.system [true]",
                        b"1e999", b"nan", b"#", b"|",
                    )  # fmt: skip
                ),
                st.binary(min_size=1, max_size=6),
            )
        )
        return data[:at] + piece + data[at:]
    if what == "remove":
        return data[:at] + data[at + draw(st.integers(1, 30)) :]
    if what == "cut":
        return data[:at]
    if what == "byte":
        return data[:at] + bytes([draw(st.integers(0, 255))]) + data[at + 1 :]
    lines = data.split(b"\n")
    line = draw(st.integers(0, len(lines) - 1))
    if what == "line twice":
        lines.insert(line, lines[line])
    elif what == "no line":
        del lines[line]
    else:
        other = draw(st.integers(0, len(lines) - 1))
        lines[line], lines[other] = lines[other], lines[line]
    return b"\n".join(lines)


@st.composite
def damaged_tables(draw, rows: list[list[str]]):
    """A table in CSV with cells replaced, columns or rows changed, another separator or a decimal comma."""
    rows = [list(row) for row in rows]
    for _ in range(draw(TIMES)):
        row = draw(st.integers(0, len(rows) - 1))
        column = draw(st.integers(0, max(len(rows[row]) - 1, 0)))
        what = draw(
            st.sampled_from(
                ("cell", "cell", "cell", "heading", "column", "no column", "short row", "long row", "no rows", "header")
            )
        )
        if what == "cell" and rows[row]:
            rows[row][column] = draw(st.one_of(st.sampled_from(NUMBERS), st.sampled_from(TEXTS), st.text(max_size=8)))
        elif what == "heading" and rows[0]:
            rows[0][column % len(rows[0])] = draw(
                st.sampled_from(
                    (
                        "time", "time [s]", "time [ms]", "", "x", "voltage [V]", "current [mm]",
                        "piston_position [um*9**9**9]", "outlet_flow [°C]",
                    )  # fmt: skip
                )
            )
        elif what == "column":
            value = draw(st.sampled_from(NUMBERS))
            for one in rows[1:]:
                if column < len(one):
                    one[column] = value
        elif what == "no column":
            for one in rows:
                del one[column : column + 1]
        elif what == "short row":
            del rows[row][column:]
        elif what == "long row":
            rows[row] += draw(st.lists(st.sampled_from(NUMBERS), min_size=1, max_size=3))
        elif what == "no rows":
            del rows[1 + draw(st.integers(0, 8)) :]
        else:
            rows.insert(0, draw(st.sampled_from(([], ["Logger 3000"], ["sep=,"], ["#", "x"], ["date", "2022-10-01"]))))
        if not rows:
            break
    separator = draw(st.sampled_from((",", ",", ",", ";", "\t", " ", "|")))
    text = draw(st.sampled_from(("\n", "\n", "\r\n", "\r"))).join(separator.join(row) for row in rows)
    if draw(st.integers(0, 5)) == 0:
        text = text.replace(".", ",")
    return text.encode("utf-8", "surrogatepass") if draw(st.booleans()) else text.encode("utf-16", "surrogatepass")
