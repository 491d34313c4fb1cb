"""Schematic of the machine (SVG), each component coloured by the probability that an effect is missing there."""

import html
from collections.abc import Mapping, Sequence

from edhas_jax.core.plot_style import GREY, INK
from edhas_jax.machine.rigs import ActuatorParts, ActuatorSystem, PumpParts, Rig

ZERO_COLOUR, FULL_COLOUR = (246, 248, 250), (222, 74, 28)  # RGB at probability 0 and 1
COLOUR_EXPONENT = 0.6  # below 1: small probabilities remain visible
SIZE = 730, 340  # px
PIPE_COLOUR = "#c9d3dc"
MIN_LABELLED_PROBABILITY = 0.005  # components below it are drawn without a number
MAX_SENSOR_TEXT = 78  # characters of the list of measured signals


def draw_schematic(machine: Rig, probabilities: Mapping[str, float], measured: tuple[str, ...] = ()) -> str:
    """Draw a rig as SVG.

    Args:
        machine: the rig.
        probabilities: probability by component, all sensors being the component "sensor".
        measured: names of the measured signals.
    """
    if not isinstance(machine, ActuatorParts):
        return draw_parts(tuple(dict.fromkeys(slot.location for slot in machine.slots)), probabilities, measured)
    drawing, has_pump = _Drawing(probabilities), isinstance(machine, PumpParts)
    if has_pump:
        drawing.pump()
        drawing.cylinder() if isinstance(machine, ActuatorSystem) else drawing.load()
    drawing.actuator(alone=not has_pump)
    drawing.sensors(measured)
    return _svg(drawing, probabilities)


def draw_parts(parts: Sequence[str], probabilities: Mapping[str, float], measured: tuple[str, ...] = ()) -> str:
    """Draw the parts of a rig of one's own as SVG: a box for each place at which something can act, in rows.

    Args:
        parts: names of the parts.
        probabilities: as for `draw_schematic`.
        measured: names of the measured signals.
    """
    drawing = _Drawing(probabilities)
    drawing.boxes(parts)
    drawing.sensors(measured)
    return _svg(drawing, probabilities)


def _svg(drawing: "_Drawing", probabilities: Mapping[str, float]) -> str:
    width, height = SIZE
    labelled = {name: p for name, p in probabilities.items() if p >= MIN_LABELLED_PROBABILITY}
    text = ", ".join(f"{name.replace('_', ' ')} {p:.0%}" for name, p in labelled.items()) or "nowhere"
    return (
        f'<svg viewBox="0 0 {width} {height}" width="100%" style="max-width:{width}px" role="img" '
        f'font-family="system-ui, sans-serif" font-size="13" fill="{INK}">'
        f"<title>where something is missing: {html.escape(text)}</title>{''.join(drawing.parts)}</svg>"
    )


def probability_colour(probability: float) -> str:
    """The fill colour of a component as #rrggbb."""
    t = min(max(probability, 0.0), 1.0) ** COLOUR_EXPONENT
    return "#" + "".join(f"{round(a + t * (b - a)):02x}" for a, b in zip(ZERO_COLOUR, FULL_COLOUR, strict=True))


class _Drawing:
    """Collects the SVG elements of the schematic."""

    def __init__(self, probabilities: Mapping[str, float]):
        self.parts: list[str] = []
        self._probabilities = probabilities

    def actuator(self, alone: bool) -> None:
        """The coil in its magnet around the mover, which carries a plunger at each end."""
        self._box("coil", 200, 112, 100, 92, 6)
        for y in range(124, 200, 12):
            if not 144 < y < 172:
                self._line(212, y, 288, y, 1.1)
        self._box("mover", 160 if alone else 112, 151, 180 if alone else 276, 14, 3)
        if not alone:
            for x in (104, 384):
                self._box("mover", x, 144, 12, 28, 2)
        self._label("coil", 250, 102)
        self._label("mover", 250, 222)

    def boxes(self, parts: Sequence[str]) -> None:
        """One box per part, joined in the order of their declaration."""
        columns, width, height = 4, 130, 64
        for k, part in enumerate(parts):
            row, column = divmod(k, columns)
            x, y = 30 + 176 * column, 40 + 110 * row
            if column and k:
                self._line(x - 46, y + height / 2, x, y + height / 2, 5, PIPE_COLOUR)
            self._box(part, x, y, width, height, 6)
            self._label(part, x + width / 2, y + height / 2 + 4)

    def pump(self) -> None:
        """Two opposed chambers, four check valves, suction and delivery lines, oil."""
        for x in (80, 420):  # lines below the valves
            self._line(x, 58, x, 262, 5, PIPE_COLOUR)
        self._line(78, 60, 560, 60, 5, PIPE_COLOUR)
        self._line(78, 260, 560, 260, 5, PIPE_COLOUR)
        for x in (50, 372):
            self._box("chamber", x, 124, 78, 68, 5)
        self._label("chamber", 458, 162, "start")
        for x in (80, 420):
            for y in (94, 226):
                self._valve(x, y)
        self._label("check_valves", 440, 98, "start")
        self._box("suction", 470, 242, 76, 36, 18)
        self._label("suction", 508, 298)
        self._line(546, 260, 574, 260, 5, PIPE_COLOUR)
        self._box("oil", 574, 230, 60, 60, 30)
        self._label("oil", 604, 308)
        self._text("accumulator", 640, 256, GREY, 11, "start")

    def load(self) -> None:
        """Outlet volume and load orifice."""
        self._box("outlet", 500, 40, 84, 40, 8)
        self._label("outlet", 542, 32)
        self.parts.append(
            f'<path d="M584 60 H640 V138 M640 158 V200 L612 232" stroke="{PIPE_COLOUR}" fill="none" stroke-width="5"/>'
            f'<path d="M626 138 H654 M626 158 H654 M632 138 Q646 148 632 158 M648 138 Q634 148 648 158" '
            f'stroke="{INK}" fill="none" stroke-width="1.4"/>'
        )
        self._text("load orifice", 660, 152, GREY, 11, "start")

    def cylinder(self) -> None:
        """Outlet volume, reversing valve and cylinder."""
        self._box("outlet", 470, 40, 76, 40, 8)
        self._label("outlet", 508, 32)
        self.parts.append(
            f'<path d="M546 60 H600 V130 M634 78 V130 M617 80 V196 L610 232" stroke="{PIPE_COLOUR}" fill="none" '
            f'stroke-width="4"/><rect x="588" y="42" width="58" height="36" fill="white" stroke="{INK}"/>'
            f'<path d="M598 68 L614 52 M636 68 L620 52" stroke="{INK}" fill="none"/>'
        )
        self._text("reversing valve", 617, 34, GREY, 11)
        self._box("cylinder", 572, 124, 92, 46, 4)
        self._line(617, 124, 617, 170, 6)
        self._line(617, 147, 706, 147, 4)
        self._label("cylinder", 668, 190)

    def sensors(self, measured: tuple[str, ...]) -> None:
        """One gauge for all sensors, and the names of the measured signals."""
        self.parts.append(
            f'<circle data-part="sensor" cx="80" cy="312" r="18" fill="{self._colour("sensor")}" stroke="{INK}" '
            f'stroke-width="1.3"/>'
            f'<path d="M80 312 L90 301" stroke="{INK}" stroke-width="1.6"/>'
        )
        self._label("sensor", 108, 308, "start")
        names = ", ".join(name.replace("_", " ") for name in measured)
        shown = names if len(names) < MAX_SENSOR_TEXT else names[: MAX_SENSOR_TEXT - 3] + " …"
        self._text(shown, 108, 325, GREY, 11, "start")

    def _colour(self, component: str) -> str:
        return probability_colour(self._probabilities.get(component, 0.0))

    def _box(self, component: str, x: float, y: float, width: float, height: float, radius: float) -> None:
        self.parts.append(f'<rect data-part="{component}" x="{x}" y="{y}" width="{width}" height="{height}" '
                          f'rx="{radius}" fill="{self._colour(component)}" '
                          f'stroke="{INK}" stroke-width="1.3"/>')  # fmt: skip

    def _valve(self, x: float, y: float) -> None:
        fill = self._colour("check_valves")
        self.parts.append(f'<circle data-part="check_valves" cx="{x}" cy="{y - 4}" r="8" fill="{fill}" '
                          f'stroke="{INK}" stroke-width="1.3"/>'
                          f'<path d="M{x - 12} {y - 2} L{x - 5} {y + 10} M{x + 12} {y - 2} L{x + 5} {y + 10}" '
                          f'stroke="{INK}" stroke-width="1.6"/>')  # fmt: skip

    def _line(self, x: float, y: float, to_x: float, to_y: float, width: float, colour: str = INK) -> None:
        self.parts.append(f'<line x1="{x}" y1="{y}" x2="{to_x}" y2="{to_y}" stroke="{colour}" stroke-width="{width}"/>')

    def _label(self, component: str, x: float, y: float, anchor: str = "middle") -> None:
        p = self._probabilities.get(component, 0.0)
        number = f' <tspan font-weight="700">{p:.0%}</tspan>' if p >= MIN_LABELLED_PROBABILITY else ""
        name = component.replace("_", " ")
        self.parts.append(f'<text data-part="{component}" x="{x}" y="{y}" text-anchor="{anchor}">{name}{number}</text>')

    def _text(self, text: str, x: float, y: float, colour: str, size: int, anchor: str = "middle") -> None:
        attributes = f'text-anchor="{anchor}" fill="{colour}" font-size="{size}"'
        self.parts.append(f'<text x="{x}" y="{y}" {attributes}>{html.escape(text)}</text>')
