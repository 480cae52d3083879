"""The keys of a sweep file as tables: types and defaults from its schema, meanings from what takes the values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpydoc.docscrape import NumpyDocString
from pydantic.fields import FieldInfo

from pounding_sweep.model.laws import hertz_stiffness
from pounding_sweep.model.scene import BoucWen, Building, Bumper, ContactProperties, Foundation, Link, Scene, Wall
from pounding_sweep.records import near_fault_record, pulse_record, read_record, synthetic_record
from pounding_sweep.spec import tables
from pounding_sweep.spec.axes import AXES, FACTOR_KINDS, Case, Range
from pounding_sweep.spec.build import Arguments, build_spec
from pounding_sweep.spec.design import DISTRIBUTIONS
from pounding_sweep.spec.toml import SECTIONS

#: Of a record that is there: scaled to a spectral acceleration.
_SA = {
    "sa": "Spectral acceleration (pseudo-acceleration, 5 % damping) to scale to, in m/s2; excludes `scale` and `pga`.",
    "sa_period": "Its period in s; needed with it.",
}

_DISTRIBUTIONS = {f'A distribution "{name}"': model.model_fields for name, model in DISTRIBUTIONS.items()}
_OF_DISTRIBUTIONS = {
    "distribution": "Which it is.",
    "low": "Least value; of a normal or lognormal one where it is cut off.",
    "high": "Largest value, likewise.",
    "mean": "Mean.",
    "std": "Standard deviation.",
    "median": "Median.",
    "dispersion": "Standard deviation of the logarithm.",
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
    ("[design]", "kind"): "How points are chosen; see [designs](designs).",
    ("[design]", "samples"): "Points; a power of 2 for sobol and saltelli, of which it is the points of one block.",
    ("[design]", "seed"): "Of the random numbers; the same seed gives the same points.",
    ("[design]", "inputs"): (
        "By the dimension of an axis, or under building.NAME, a table of a distribution; record is drawn from those of "
        'the sweep by `{ distribution = "any" }`.'
    ),
    **{(heading, key): text for heading in _DISTRIBUTIONS for key, text in _OF_DISTRIBUTIONS.items()},
    **{("building.NAME", kind): AXES[argument].meaning for argument, kind in FACTOR_KINDS.items()},
    ("A record by name", "record"): "Name of the record, as `pounding-sweep records` lists it.",
    ("A record by name", "name"): "Label of the record in the cube; its own by default.",
    ("A record by name", "scale"): "Factor on the motion.",
    ("A record by name", "pga"): "Peak ground acceleration to scale to, in m/s2; excludes `scale`.",
    **{(heading, key): text for heading in ("A record by name", "A record from a file") for key, text in _SA.items()},
    ("A pulse", "pulse"): "Shape: half_sine, sine, ricker, rectangular or triangular.",
    ("A near-fault pulse", "near_fault"): "Amplitude A of the velocity in m/s, of either sign.",
    ("A synthetic earthquake", "synthetic"): "Seed; the same seed and parameters give the same record.",
}


def _arguments(section: str) -> dict[str, FieldInfo]:
    """Return the keys of a table that holds arguments."""
    return {key: Arguments.model_fields[argument] for key, argument in SECTIONS[section].items()}


_PATH, _NAMED = tables.PathRecord.model_fields, tables.NamedRecord.model_fields
#: Heading -> (keys, what takes their values).
_TABLES: dict[str, tuple[dict[str, FieldInfo], Callable[..., Any] | None]] = {
    "[scene]": (tables.SceneTable.model_fields, Scene),
    "[[scene.row]], a building": (tables.BuildingTable.model_fields, Building),
    "bouc_wen of a building": (tables.BoucWenTable.model_fields, BoucWen),
    "foundation of a building": (tables.FoundationTable.model_fields, Foundation),
    "[[scene.row]], a wall": (tables.WallTable.model_fields, Wall),
    "[scene.contact]": (tables.ContactTable.model_fields, ContactProperties),
    "[[scene.links]]": (tables.LinkTable.model_fields, Link),
    "[[scene.bumpers]]": (tables.BumperTable.model_fields, Bumper),
    "scene.contact.hertz": (tables.HertzTable.model_fields, hertz_stiffness),
    "[sweep]": (_arguments("sweep"), build_spec),
    "Evenly spaced values": (tables.RangeTable.model_fields, Range),
    "building.NAME": (dict.fromkeys(FACTOR_KINDS.values(), Arguments.model_fields["gaps"]), None),
    "[design]": (tables.DesignTable.model_fields, None),
    **{heading: (keys, None) for heading, keys in _DISTRIBUTIONS.items()},
    "A record from a file": ({"path": _PATH["path"], **_PATH}, read_record),
    "A record by name": ({"record": _NAMED["record"], **_NAMED}, None),
    "A synthetic earthquake": (tables.SyntheticRecord.model_fields, synthetic_record),
    "A pulse": (tables.PulseRecord.model_fields, pulse_record),
    "A near-fault pulse": (tables.NearFaultRecord.model_fields, near_fault_record),
    "[solver]": (_arguments("solver"), build_spec),
    "[output]": (_arguments("output"), build_spec),
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
        for key, field in table.items():
            meaning = _OWN.get((heading, key)) or said.get(_PARAMETERS.get(key, key))
            if meaning is None:
                msg = f"nothing explains {key!r} of {heading!r}; give its parameter a docstring, or it a line in _OWN"
                raise KeyError(msg)
            lines.append(_line(f"`{key}`", str(field.description).partition(": ")[0], _default(field), meaning))
        lines.append("")
    lines += ["### `[[sweep.cases]]`", "", "| key | meaning |", "|---|---|"]
    for key, meaning in _meanings(Case).items():
        if key not in ("period_factors", "mass_factors"):
            lines.append(_line(f"`{key}`", meaning))
    lines += ["| `building.NAME` | Factors on a building's properties, one number each. |", ""]
    return "\n".join(lines)
