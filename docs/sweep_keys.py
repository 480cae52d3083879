"""The keys of a sweep file as tables: types and defaults from its schema, meanings from what takes the values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpydoc.docscrape import NumpyDocString
from pydantic.fields import FieldInfo

from pounding_sweep.model.hertz import hertz_stiffness
from pounding_sweep.model.scene import Building, ContactProperties, Wall
from pounding_sweep.records import pulse_record, read_record, synthetic_record
from pounding_sweep.spec import toml as schema
from pounding_sweep.spec.axes import Case, Range
from pounding_sweep.spec.build import build_spec

#: Type of a key whose values the schema leaves to a later check.
_AXIS = "a number, a list of numbers, or a table of evenly spaced values"
_TYPES = {
    ("[[scene.row]], a building", "damping_ratio"): "a number, or two",
    ("Evenly spaced values", "spacing"): "a text",
}
#: Meanings that no docstring holds: of keys that only a file has.
_OWN = {
    ("[scene]", "preset"): "Named scene to start from; its row stands in place of `row`.",
    ("[scene]", "row"): "The row, left to right: buildings, and a wall at either end.",
    ("[scene]", "gaps"): "Gap (m) of each pair of neighbours, left to right; a preset's own where not given.",
    ("[scene]", "contact"): "Reference contact properties, below.",
    ("[[scene.row]], a wall", "wall"): "Says that this is a wall.",
    ("[[scene.row]], a wall", "name"): "Coordinate label in every result.",
    ("[scene.contact]", "hertz"): "What `hertz_stiffness` follows from, in its place; below.",
    ("[sweep]", "building"): "Axes over a building's properties, below.",
    ("building.NAME", "period_factor"): "Factor on all natural periods; masses kept.",
    ("building.NAME", "mass_factor"): "Factor on all masses; periods kept.",
    ("A record by name", "record"): "Name of the record, as `pounding-sweep records` lists it.",
    ("A record by name", "name"): "Label of the record in the cube; its own by default.",
    ("A record by name", "scale"): "Factor on the motion.",
    ("A record by name", "pga"): "Peak ground acceleration to scale to, in m/s2; excludes `scale`.",
    ("A pulse", "pulse"): "Shape: half_sine, sine, ricker, rectangular or triangular.",
    ("A synthetic earthquake", "synthetic"): "Seed; the same seed and parameters give the same record.",
}
#: Heading -> (table of the schema, what takes its values).
_TABLES: dict[str, tuple[type[schema.Table], Callable[..., Any] | None]] = {
    "[scene]": (schema.SceneTable, None),
    "[[scene.row]], a building": (schema.BuildingTable, Building),
    "[[scene.row]], a wall": (schema.WallTable, Wall),
    "[scene.contact]": (schema.ContactTable, ContactProperties),
    "scene.contact.hertz": (schema.HertzTable, hertz_stiffness),
    "[sweep]": (schema.SweepTable, build_spec),
    "Evenly spaced values": (schema.RangeTable, Range),
    "building.NAME": (schema.FactorTable, None),
    "A record from a file": (schema.PathRecord, read_record),
    "A record by name": (schema.NamedRecord, None),
    "A synthetic earthquake": (schema.SyntheticRecord, synthetic_record),
    "A pulse": (schema.PulseRecord, pulse_record),
    "[solver]": (schema.SolverTable, build_spec),
    "[output]": (schema.OutputTable, build_spec),
}
#: Names of parameters that a file spells otherwise.
_PARAMETERS = {"variables": "outputs"}


def _meanings(taker: Callable[..., Any] | None) -> dict[str, str]:
    """Return what a docstring says of each parameter."""
    if taker is None:
        return {}
    found = {}
    for parameter in NumpyDocString(taker.__doc__ or "")["Parameters"]:
        for name in parameter.name.split(","):
            found[name.strip()] = " ".join(line.strip() for line in parameter.desc)
    return found


def _type(heading: str, key: str, field: FieldInfo) -> str:
    return _TYPES.get((heading, key)) or field.description or _AXIS


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "needed"
    value = field.get_default(call_default_factory=True)
    if value is None:
        return "-"
    return f"`{str(value).lower() if isinstance(value, bool) else repr(value)}`".replace("'", '"')


def _line(*cells: str) -> str:
    """One line of a table, of texts written as in docstrings."""
    marked = (cell.replace("``", "`").replace("**", "^").replace("|", "\\|").replace("<", "\\<") for cell in cells)
    return "| " + " | ".join(marked) + " |"


def key_tables() -> str:
    """Return all tables as Markdown; KeyError where the schema has a key that nothing explains."""
    lines: list[str] = []
    for heading, (table, taker) in _TABLES.items():
        said = _meanings(taker)
        lines += [f"### {heading if heading[0].isupper() else f'`{heading}`'}", ""]
        lines += ["| key | value | default | meaning |", "|---|---|---|---|"]
        for key, field in table.model_fields.items():
            meaning = _OWN.get((heading, key)) or said.get(_PARAMETERS.get(key, key))
            if meaning is None:
                msg = f"nothing explains {key!r} of {heading!r}; give its parameter a docstring, or it a line in _OWN"
                raise KeyError(msg)
            lines.append(_line(f"`{key}`", _type(heading, key, field), _default(field), meaning))
        lines.append("")
    lines += ["### `[[sweep.cases]]`", "", "| key | meaning |", "|---|---|"]
    for key, meaning in _meanings(Case).items():
        if key not in ("period_factors", "mass_factors"):
            lines.append(_line(f"`{key}`", meaning))
    lines += ["| `building.NAME` | Factors on a building's properties, one number each. |", ""]
    return "\n".join(lines)
