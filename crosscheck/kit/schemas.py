"""JSON Schemas of all files: kits and answers, and ``mechanism.toml`` and ``cases.toml``, so that editors complete keys.

They are generated from the tables that read the files.  Tables whose kind decides their keys (links, joints, sections, closures,
motions of joints) are alternatives.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from pydantic import BaseModel
from pydantic.json_schema import JsonSchemaValue, models_json_schema

from crosscheck.kit.tables import CaseFile, CertificateFile, MetaFile
from flexinv.files.case_schema import MOVES, STARTS, CasesTable, CaseTable
from flexinv.files.closures import (
    CLOSURE_TABLES,
    CouplingTable,
    ForceTable,
    GasSpringTable,
    LinearSpringTable,
    TableSpringTable,
)
from flexinv.files.joints import DRIVES, JOINT_TABLES, MOTORS
from flexinv.files.parts import InterfaceTable, MeshLinkTable, OverlayMeshTable, SolidTable
from flexinv.files.schema import BeamLinkTable, MechanismTable, OverlayLinkTable, RigidLinkTable
from flexinv.files.sections import MATRICES, SECTION_SHAPES, MatrixSectionTable, StiffnessSectionTable

FOLDER = Path(__file__).with_name("schema")
DRAFT = "https://json-schema.org/draft/2020-12/schema"
Alternatives = Mapping[str, type[BaseModel]]  # value of the key that decides -> table; "" : whatever it is
KIT: dict[str, type[BaseModel]] = {"case": CaseFile, "certificate": CertificateFile, "meta": MetaFile}
# Tables whose entries are read later: (table, key of the entries, key that decides) -> what they may be.
Places = Mapping[tuple[str, str, str], Alternatives]
MECHANISM: Places = {
    ("MechanismTable", "sections", "shape"): {
        "": StiffnessSectionTable,
        **SECTION_SHAPES,
        MATRICES: MatrixSectionTable,
    },
    ("MechanismTable", "links", "kind"): {"": RigidLinkTable, "beam": BeamLinkTable, "mesh": MeshLinkTable},
    ("MechanismTable", "joints", "kind"): JOINT_TABLES,
    ("MechanismTable", "closures", "kind"): {**CLOSURE_TABLES, "coupling": CouplingTable},
    ("MechanismTable", "springs", "law"): {"": LinearSpringTable, "gas": GasSpringTable, "table": TableSpringTable},
    ("MechanismTable", "forces", ""): {"": ForceTable},
    ("MeshLinkTable", "materials", ""): {"": SolidTable},
    ("MeshLinkTable", "interfaces", ""): {"": InterfaceTable},
    ("OverlayMeshTable", "materials", ""): {"": SolidTable},
    ("OverlayMeshTable", "interfaces", ""): {"": InterfaceTable},
    ("OverlayTable", "links", ""): {"": OverlayLinkTable},
    ("OverlayTable", "joints", ""): DRIVES,
}
CASES: Places = {
    ("CasesTable", "cases", ""): {"": CaseTable},
    ("MotionTable", "joints", ""): {" ".join(units): table for units, (table, _, _) in MOVES.items()},
    ("CaseTable", "start", ""): {" ".join(units): table for units, (table, _, _) in STARTS.items()},
}
OURS: dict[str, tuple[type[BaseModel], Places]] = {
    "mechanism": (MechanismTable, MECHANISM),
    "cases": (CasesTable, CASES),
}
NAMES = (*KIT, *OURS)


def schema(name: str) -> JsonSchemaValue:
    """Return the JSON Schema of one of ``NAMES``."""
    root, places = (KIT[name], {}) if name in KIT else OURS[name]
    entries = [table for kinds in places.values() for table in kinds.values()]
    definitions = described([root, *entries, *MOTORS.values(), OverlayMeshTable])
    for (table, key, decides), kinds in places.items():
        definitions[table]["properties"][key]["additionalProperties"] = _build_alternatives(decides, kinds)
    if name == "mechanism":
        for drive in DRIVES.values():  # laid over a URDF they may have a motor
            motors = [{"$ref": f"#/$defs/{motor.__name__}"} for motor in dict.fromkeys(MOTORS.values())]
            definitions[drive.__name__]["properties"]["drive"] = {"anyOf": motors}
        mesh = definitions["OverlayLinkTable"]["properties"]["mesh"]
        definitions["OverlayLinkTable"]["properties"]["mesh"] = {
            "description": mesh["description"], "$ref": f"#/$defs/{OverlayMeshTable.__name__}"
        }  # fmt: skip
    whole = {"$schema": DRAFT, "title": f"{name} ({root.__name__})", "$ref": f"#/$defs/{root.__name__}"}
    return {**whole, "$defs": _collect_definitions(root.__name__, definitions)}


def described(tables: Iterable[type[BaseModel]]) -> dict[str, JsonSchemaValue]:
    """Return the JSON Schemas of tables and of what they hold: name -> schema, with what to write in the descriptions."""
    models = dict.fromkeys(tables)
    _, made = models_json_schema([(model, "validation") for model in models], ref_template="#/$defs/{model}")
    definitions: dict[str, JsonSchemaValue] = copy.deepcopy(made["$defs"])
    for part in _list_objects(definitions):
        if isinstance(examples := part.get("examples"), list) and len(examples) == 1 and isinstance(examples[0], str):
            part["description"] = f"{part.get('description', '')}; write {examples[0]}".removeprefix("; ")
            del part["examples"]  # a line of TOML is no value of the key
    return definitions


def _build_alternatives(decides: str, kinds: Alternatives) -> JsonSchemaValue:
    """Return the schema of one entry: a table, or one of several, which a key may decide between."""
    refs: list[JsonSchemaValue] = []
    for kind, table in kinds.items():
        one: JsonSchemaValue = {"$ref": f"#/$defs/{table.__name__}"}
        if decides and kind:
            one |= {"properties": {decides: {"const": kind}}, "required": [decides]}
        refs += [one] if one not in refs else []
    return refs[0] if len(refs) == 1 else {"anyOf": refs}


def _collect_definitions(root: str, definitions: Mapping[str, JsonSchemaValue]) -> dict[str, JsonSchemaValue]:
    """Return the definitions that a schema uses."""
    found = {root}
    ahead = [root]
    while ahead:
        refs = {part["$ref"].rsplit("/", 1)[-1] for part in _list_objects(definitions[ahead.pop()]) if "$ref" in part}
        ahead += refs - found
        found |= refs
    return {name: definitions[name] for name in sorted(found)}


def _list_objects(value: object) -> Iterator[JsonSchemaValue]:
    """Yield every object in a tree of JSON."""
    if isinstance(value, dict):
        yield value
        for one in list(value.values()):
            yield from _list_objects(one)
    elif isinstance(value, list):
        for one in value:
            yield from _list_objects(one)


def write_schema(name: str) -> str:
    """Return the file of a schema, as it is shipped."""
    return json.dumps(schema(name), indent=1) + "\n"


def read_schema(name: str) -> str:
    """Return the schema that this version ships, as text; nothing is generated."""
    return (FOLDER / f"{name}.schema.json").read_text(encoding="utf-8")
