"""modelDescription.xml of an FMU: its variables with units and meaning, and its capabilities (FMI 2.0)."""

import functools
from collections.abc import Iterable, Mapping
from xml.etree import ElementTree as Xml

import edhas_jax
from edhas_jax.core.literal_text import xml_text
from edhas_jax.core.units import from_si
from edhas_jax.export.fmu_c_sources import UNIT_FILE
from edhas_jax.export.fmu_program import Causality, UnitProgram, Variable

# capability flags of FMI 2.0 that are true for every unit
_CAPABILITIES = (
    "canHandleVariableCommunicationStepSize", "canGetAndSetFMUstate", "canSerializeFMUstate",
    "canNotUseMemoryManagementFunctions", "providesDirectionalDerivative",
)  # fmt: skip
# {dimension of pint: base unit of FMI}
_BASE_UNITS = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A", "[temperature]": "K"}


def model_description(
    unit: UnitProgram, title: str, identifier: str, guid: str, stop_time: float, interval: float
) -> str:
    """The text of modelDescription.xml.

    Args:
        unit: the model.
        title: name of the model.
        identifier: its name as a C identifier.
        guid: the GUID of its C sources.
        stop_time: end of the default experiment [s].
        interval: communication step of the default experiment [s].

    Returns:
        The XML text.
    """
    root = Xml.Element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": xml_text(title), "guid": guid, "variableNamingConvention": "structured",
        "generationTool": f"edhas_jax {edhas_jax.__version__}",
    })  # fmt: skip
    capabilities = dict.fromkeys(_CAPABILITIES, "true")
    co_simulation = Xml.SubElement(root, "CoSimulation", {"modelIdentifier": identifier} | capabilities)
    Xml.SubElement(Xml.SubElement(co_simulation, "SourceFiles"), "File", {"name": UNIT_FILE})
    variables = [*unit.values, *unit.outputs, *unit.locals]
    _add_units(Xml.SubElement(root, "UnitDefinitions"), variables)
    categories = Xml.SubElement(root, "LogCategories")
    for name in ("logStatusError", "logStatusDiscard"):
        Xml.SubElement(categories, "Category", {"name": name})
    Xml.SubElement(root, "DefaultExperiment", {
        "startTime": "0", "stopTime": repr(float(stop_time)), "stepSize": repr(float(interval)),
    })  # fmt: skip
    model_variables = Xml.SubElement(root, "ModelVariables")
    index = {v.name: k + 1 for k, v in enumerate(variables)}
    for k, variable in enumerate(variables):
        _add_variable(model_variables, k, variable, index)
    structure = Xml.SubElement(root, "ModelStructure")
    derivatives = [v for v in unit.locals if v.derivative_of]
    for element, unknowns in (("Outputs", unit.outputs), ("Derivatives", derivatives)):
        parent = Xml.SubElement(structure, element)
        for v in unknowns:
            dependencies = sorted(index[name] for name in unit.dependencies[v.name])
            texts = {"index": str(index[v.name]), "dependencies": " ".join(map(str, dependencies))}
            Xml.SubElement(parent, "Unknown", texts)
    initial = Xml.SubElement(structure, "InitialUnknowns")
    for v in (*unit.outputs, *unit.locals):
        Xml.SubElement(initial, "Unknown", {"index": str(index[v.name])})
    Xml.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{Xml.tostring(root, encoding="unicode")}\n'


def _add_variable(parent, reference: int, v: Variable, index: Mapping[str, int]) -> None:
    """Append a variable with its value reference; `index` has the number of each variable."""
    attributes = {"name": v.name, "valueReference": str(reference), "description": xml_text(v.doc)}
    attributes["causality"] = v.causality.value
    attributes["variability"] = "fixed" if v.causality is Causality.PARAMETER else "continuous"
    if v.causality is not Causality.INPUT:
        attributes["initial"] = "exact" if v.causality is Causality.PARAMETER else "calculated"
    real = {"unit": _fmi_unit(v.unit)} if v.unit else {}
    if _has_display_unit(v):
        real["displayUnit"] = v.display_unit
    if v.span is not None:
        real |= {"min": repr(float(v.span[0])), "max": repr(float(v.span[1]))}
    if v.start is not None:
        real["start"] = repr(float(v.start))
    if v.derivative_of:
        real["derivative"] = str(index[v.derivative_of])
    Xml.SubElement(Xml.SubElement(parent, "ScalarVariable", attributes), "Real", real)


def _add_units(parent, variables: Iterable[Variable]) -> None:
    """Append each unit in terms of the base units, with the display units of its quantities."""
    display_units: dict[str, set[str]] = {}
    for v in (v for v in variables if v.unit):
        display_units.setdefault(v.unit, set()).update([v.display_unit] if _has_display_unit(v) else [])
    for unit in sorted(display_units):
        element = Xml.SubElement(parent, "Unit", {"name": _fmi_unit(unit)})
        Xml.SubElement(element, "BaseUnit", {n: str(power) for n, power in _base_unit_powers(unit).items()})
        for name in sorted(display_units[unit]):
            Xml.SubElement(element, "DisplayUnit", {"name": name, "factor": repr(float(from_si(1.0, unit, name)))})


def _has_display_unit(v: Variable) -> bool:
    """Whether a variable is displayed in another unit than its SI unit."""
    return v.display_unit not in ("", "-", v.unit)


def _fmi_unit(unit: str) -> str:
    """An SI unit in the notation of Modelica, for example m3/(s.Pa)."""
    return unit.replace("^", "").replace("*", ".").replace("ohm", "Ohm").replace("-", "1")


def _base_unit_powers(unit: str) -> dict[str, int]:
    """{base unit: its exponent in an SI unit}."""
    if unit == "rad":
        return {"rad": 1}
    dimensions = _unit_registry().parse_units("" if unit == "-" else unit).dimensionality
    return {_BASE_UNITS[n]: int(power) for n, power in dimensions.items()}


@functools.cache
def _unit_registry():
    import pint  # takes half a second to import

    return pint.UnitRegistry()
