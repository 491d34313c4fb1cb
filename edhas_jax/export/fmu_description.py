"""modelDescription.xml of an FMU: its variables with units and meaning, and what the unit can do (FMI 2.0)."""

import functools
from collections.abc import Iterable
from xml.etree import ElementTree as Xml

import edhas_jax
from edhas_jax.core.units import from_si
from edhas_jax.export.fmu_c_sources import UNIT_FILE
from edhas_jax.export.fmu_equations import Causality, UnitProgram, Variable

_CAN = (
    "canHandleVariableCommunicationStepSize", "canGetAndSetFMUstate", "canSerializeFMUstate",
    "canNotUseMemoryManagementFunctions",
)  # fmt: skip
_BASE = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A", "[temperature]": "K"}


def model_description(
    unit: UnitProgram, title: str, identifier: str, guid: str, stop_time: float, interval: float
) -> str:
    """The text of modelDescription.xml; an importer is offered a run to `stop_time` with steps of `interval` [s]."""
    root = Xml.Element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": title, "guid": guid, "variableNamingConvention": "structured",
        "generationTool": f"edhas_jax {edhas_jax.__version__}",
    })  # fmt: skip
    kind = Xml.SubElement(root, "CoSimulation", {"modelIdentifier": identifier} | dict.fromkeys(_CAN, "true"))
    Xml.SubElement(Xml.SubElement(kind, "SourceFiles"), "File", {"name": UNIT_FILE})
    variables = [*unit.values, *unit.outputs]
    _units(Xml.SubElement(root, "UnitDefinitions"), variables)
    categories = Xml.SubElement(root, "LogCategories")
    for name in ("logStatusError", "logStatusDiscard"):
        Xml.SubElement(categories, "Category", {"name": name})
    Xml.SubElement(root, "DefaultExperiment", {
        "startTime": "0", "stopTime": repr(float(stop_time)), "stepSize": repr(float(interval)),
    })  # fmt: skip
    listed = Xml.SubElement(root, "ModelVariables")
    for k, variable in enumerate(variables):
        _variable(listed, k, variable)
    number = {v.name: k + 1 for k, v in enumerate(variables)}
    structure = Xml.SubElement(root, "ModelStructure")
    outputs = Xml.SubElement(structure, "Outputs")
    for v in unit.outputs:
        acting = [str(number[name]) for name in unit.influence[v.name]]
        Xml.SubElement(outputs, "Unknown", {"index": str(number[v.name]), "dependencies": " ".join(acting)})
    first = Xml.SubElement(structure, "InitialUnknowns")
    for v in unit.outputs:
        Xml.SubElement(first, "Unknown", {"index": str(number[v.name])})
    Xml.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{Xml.tostring(root, encoding="unicode")}\n'


def _variable(parent, reference: int, v: Variable) -> None:
    attributes = {"name": v.name, "valueReference": str(reference), "description": v.doc}
    attributes["causality"] = v.causality.value
    attributes["variability"] = "fixed" if v.causality is Causality.PARAMETER else "continuous"
    if v.causality is not Causality.INPUT:
        attributes["initial"] = "exact" if v.causality is Causality.PARAMETER else "calculated"
    real = {"unit": _name(v.unit)}
    if _display(v):
        real["displayUnit"] = v.shown
    if v.span is not None:
        real |= {"min": repr(float(v.span[0])), "max": repr(float(v.span[1]))}
    if v.start is not None:
        real["start"] = repr(float(v.start))
    Xml.SubElement(Xml.SubElement(parent, "ScalarVariable", attributes), "Real", real)


def _units(parent, variables: Iterable[Variable]) -> None:
    """Each unit in terms of the base units, with the units that its quantities are shown in."""
    shown: dict[str, set[str]] = {}
    for v in variables:
        shown.setdefault(v.unit, set()).update([v.shown] if _display(v) else [])
    for unit in sorted(shown):
        here = Xml.SubElement(parent, "Unit", {"name": _name(unit)})
        Xml.SubElement(here, "BaseUnit", {n: str(power) for n, power in _powers(unit).items()})
        for name in sorted(shown[unit]):
            Xml.SubElement(here, "DisplayUnit", {"name": name, "factor": repr(float(from_si(1.0, unit, name)))})


def _display(v: Variable) -> bool:
    return v.shown not in ("", "-", v.unit)


def _name(unit: str) -> str:
    """An SI unit as the texts of Modelica write it: m3/(s.Pa)."""
    return unit.replace("^", "").replace("*", ".").replace("ohm", "Ohm").replace("-", "1")


def _powers(unit: str) -> dict[str, int]:
    """The powers of the base units in an SI unit."""
    if unit == "rad":
        return {"rad": 1}
    of = _registry().parse_units("" if unit == "-" else unit).dimensionality
    return {_BASE[n]: int(power) for n, power in of.items()}


@functools.cache
def _registry():
    import pint  # half a second, which only an export has to spend

    return pint.UnitRegistry()
