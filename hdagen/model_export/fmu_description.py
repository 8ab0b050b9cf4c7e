"""The XML of an FMU: modelDescription.xml in FMI 2.0 and 3.0, and buildDescription.xml of the sources."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree

from hdagen.model_export.fmu_units import find_base_powers
from hdagen.model_export.fmu_variables import FmuVariable
from hdagen.support.version import __version__

COMPILER_OPTIONS = "-O2 -ffp-contract=off"  # as the portable profile is compiled
CAPABILITIES = {
    "canHandleVariableCommunicationStepSize": "true",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "needsExecutionTool": "false",
}
STATE_CAPABILITIES = {  # of both versions, which spell them differently
    "2.0": {
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "canNotUseMemoryManagementFunctions": "true",
    },
    "3.0": {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"},
}


def describe_model(
    version: str,
    identifier: str,
    name: str,
    token: str,
    period: float,
    variables: Sequence[FmuVariable],
    sources: Sequence[str],
) -> bytes:
    """Write modelDescription.xml.

    Args:
        version: "2.0" or "3.0".
        identifier: The name of the library, without its ending.
        name: The robot's name.
        token: The token that the library compares.
        period: The communication step that is proposed, s.
        variables: The variables, by number.
        sources: Names of the C sources.

    Returns:
        The XML in UTF-8.

    """
    token_name = {"2.0": "guid", "3.0": "instantiationToken"}[version]
    root = ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": name,
            token_name: token,
            "description": f"{name}: compiled arm for co-simulation",
            "generationTool": f"hdagen {__version__}",
            "variableNamingConvention": "flat",
        },
    )
    traits = {"modelIdentifier": identifier, **CAPABILITIES, **STATE_CAPABILITIES[version]}
    simulation = ElementTree.SubElement(root, "CoSimulation", traits)
    if version == "2.0":
        _add_source_files(ElementTree.SubElement(simulation, "SourceFiles"), "File", sources)
    _add_units(root, variables)
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(categories, "Category", {"name": "logStatusError"})
    ElementTree.SubElement(root, "DefaultExperiment", {"startTime": "0", "stepSize": repr(period)})
    _add_variables(root, version, variables)
    _add_structure(root, version, variables)
    return _print_xml(root)


def describe_sources(identifier: str, sources: Sequence[str]) -> bytes:
    """Write buildDescription.xml of FMI 3.0.

    Args:
        identifier: The name of the library, without its ending.
        sources: Names of the C sources.

    Returns:
        The XML in UTF-8.

    """
    root = ElementTree.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = ElementTree.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier})
    options = {"language": "C99", "compilerOptions": COMPILER_OPTIONS}
    _add_source_files(ElementTree.SubElement(configuration, "SourceFileSet", options), "SourceFile", sources)
    return _print_xml(root)


def _add_source_files(parent: ElementTree.Element, tag: str, sources: Iterable[str]) -> None:
    for source in sources:
        ElementTree.SubElement(parent, tag, {"name": source})


def _add_units(root: ElementTree.Element, variables: Sequence[FmuVariable]) -> None:
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for unit in sorted({variable.unit for variable in variables if variable.unit}):
        element = ElementTree.SubElement(definitions, "Unit", {"name": unit})
        powers = find_base_powers(unit)
        if powers is not None:
            ElementTree.SubElement(element, "BaseUnit", {base: str(power) for base, power in powers.items()})


def _add_variables(root: ElementTree.Element, version: str, variables: Sequence[FmuVariable]) -> None:
    parent = ElementTree.SubElement(root, "ModelVariables")
    for variable in variables:
        traits = {
            "name": variable.name,
            "valueReference": str(variable.reference),
            "description": variable.description,
            "causality": variable.causality,
            "variability": variable.variability,
        }
        if variable.causality == "output":
            traits["initial"] = "calculated"
        elif variable.causality == "parameter" and version == "2.0":
            traits["initial"] = "exact"
        numbers = {"min": variable.low, "max": variable.high, "start": variable.start}
        values = {key: repr(float(v)) for key, v in numbers.items() if v is not None and math.isfinite(v)}
        if variable.unit:
            values["unit"] = variable.unit
        if version == "2.0":
            ElementTree.SubElement(ElementTree.SubElement(parent, "ScalarVariable", traits), "Real", values)
        else:
            ElementTree.SubElement(parent, "Float64", traits | values)


def _add_structure(root: ElementTree.Element, version: str, variables: Sequence[FmuVariable]) -> None:
    """All outputs, each of which may depend on everything."""
    structure = ElementTree.SubElement(root, "ModelStructure")
    outputs = [variable.reference for variable in variables if variable.causality == "output"]
    if version == "2.0":
        for tag in ("Outputs", "InitialUnknowns"):
            parent = ElementTree.SubElement(structure, tag)
            for reference in outputs:  # an index counts from 1
                ElementTree.SubElement(parent, "Unknown", {"index": str(reference + 1)})
        return
    for tag in ("Output", "InitialUnknown"):
        for reference in outputs:
            ElementTree.SubElement(structure, tag, {"valueReference": str(reference)})


def _print_xml(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"
