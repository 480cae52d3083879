"""The keys of a sweep file as tables: types and defaults from its schema, meanings from what takes the values."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from itertools import chain
from typing import Any

from numpydoc.docscrape import NumpyDocString

from pounding_sweep.model.building import Building, Foundation, Infill
from pounding_sweep.model.faults import Table
from pounding_sweep.model.frames import typical, typical_building
from pounding_sweep.model.laws import hertz_stiffness
from pounding_sweep.model.presets import base_isolated
from pounding_sweep.model.scene import Bumper, ContactProperties, Link, Restrainer, Scene, Wall
from pounding_sweep.model.storeys import STOREY_LAWS
from pounding_sweep.model.storeys.backbone import Deterioration
from pounding_sweep.records import near_fault_record, pulse_record, read_record, synthetic_record
from pounding_sweep.request import build
from pounding_sweep.request.axes import AXES, FACTOR_KINDS, NAMED_KINDS, Case, Range
from pounding_sweep.request.build import Arguments, build_spec
from pounding_sweep.request.design import DISTRIBUTIONS, DesignTable
from pounding_sweep.request.toml import SECTIONS

#: Of a record that is there: scaled to a spectral acceleration.
_SA = {
    "sa": "Spectral acceleration (pseudo-acceleration, 5 % damping) to scale to, in m/s2; excludes `scale` and `pga`.",
    "sa_period": "Its period in s; needed with it.",
}

_DISTRIBUTIONS = {f'A distribution "{name}"': model for name, model in DISTRIBUTIONS.items()}
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
    ("[[scene.row]], a building", "isolation"): "Isolators that the building is put on, below.",
    ("[[scene.row]], a building", "typical"): "Of which little is known: in place of masses and stiffnesses, below.",
    ("[[scene.row]], a wall", "wall"): "Says that this is a wall.",
    ("[[scene.row]], a wall", "name"): "Coordinate label in every result.",
    ("[scene.contact]", "hertz"): "What `hertz_stiffness` follows from, in its place; below.",
    ("[sweep]", "building"): "Axes over a building's properties, below.",
    ("[sweep]", "pair"): "Axes over a pair's properties, below.",
    ("[design]", "kind"): "How points are chosen; see [designs](designs).",
    ("[design]", "samples"): "Points; a power of 2 for sobol and saltelli, of which it is the points of one block.",
    ("[design]", "seed"): "Of the random numbers; the same seed gives the same points.",
    ("[design]", "inputs"): (
        "By the dimension of an axis, or under building.NAME and pair.NAME, a table of a distribution; record is drawn "
        'from those of the sweep by `{ distribution = "any" }`.'
    ),
    **{(heading, key): text for heading in _DISTRIBUTIONS for key, text in _OF_DISTRIBUTIONS.items()},
    **{
        (f"{by}.NAME", kind): AXES[argument].meaning
        for by, kinds in NAMED_KINDS.items()
        for argument, kind in kinds.items()
    },
    ("A record by name", "record"): "Name of the record, as `pounding-sweep records` lists it.",
    ("A record by name", "name"): "Label of the record in the cube; its own by default.",
    ("A record by name", "scale"): "Factor on the motion.",
    ("A record by name", "pga"): "Peak ground acceleration to scale to, in m/s2; excludes `scale`.",
    **{(heading, key): text for heading in ("A record by name", "A record from a file") for key, text in _SA.items()},
    ("A pulse", "pulse"): "Shape: half_sine, sine, ricker, rectangular or triangular.",
    ("A near-fault pulse", "near_fault"): "Amplitude A of the velocity in m/s, of either sign.",
    ("A synthetic earthquake", "synthetic"): "Seed; the same seed and parameters give the same record.",
}


#: Values of a key in words, by the annotation of its parameter.
_WORDS = {
    **dict.fromkeys(("float", "Number", "Positive", "NotNegative", "Finite"), "a number"),
    "Annotated[Positives": "a list of numbers",
    **dict.fromkeys(("OfStoreys", "OfStoreysOrZero", "Strengths"), "a number or a list of numbers"),
    "PositiveOfStoreys": "a number or a list of numbers",
    "OfDirections": "a number, a list of numbers or a table",
    **dict.fromkeys(("bool", "Flag"), "true or false"),
    **dict.fromkeys(("str", "Label", "str | os.PathLike[str]", "Annotated[str"), "a text"),
    "int": "a whole number",
    "str | int": "a text or a whole number",
    "Sequence[float]": "a list of numbers",
    "Annotated[float | Sequence[float]": "a number or a list of numbers",
    "Annotated[float": "a number",
    **dict.fromkeys(("Annotated[Number", "_Share"), "a number"),
    "ContactProperties": "a table",
    **dict.fromkeys(("Foundation", "Infill", "Deterioration"), "a table"),
    "Hysteresis": "a table",
    "Annotated[Any": "a name, or FILE.py:NAME",
    "Any": "a text or a table",
}
#: Keys of a table: value in words and default.
Keys = dict[str, tuple[str, object]]
_NEEDED = inspect.Parameter.empty


def _fields(model: type[Table], names: Iterable[str] | None = None) -> Keys:
    """Return the keys of a table that pydantic has."""
    found = {}
    for name in names or model.model_fields:
        field = model.model_fields[name]
        default = _NEEDED if field.is_required() else field.get_default(call_default_factory=True)
        found[name] = str(field.description).partition(": ")[0], default
    return found


def _parameters(taker: Callable[..., Any], *more: str, first: str = "") -> Keys:
    """Return the keys that are parameters of what takes them, and those that only files have."""
    found: Keys = {}
    kinds: dict[str, str] = {}
    for part in reversed(getattr(taker, "__mro__", [taker])):
        kinds |= inspect.get_annotations(part)
    for name, parameter in inspect.signature(taker).parameters.items():
        annotation = kinds[name].removesuffix(" | None").partition(", ")[0]
        annotation = "str" if annotation.startswith("Literal[") else annotation
        default = parameter.default
        if repr(default).startswith("<factory>") or default == ():
            default = None
        found[first if first and not found else name] = _WORDS.get(annotation, "a list"), default
    return found | {
        name: (
            "a text"
            if name == "preset"
            else "true"
            if name == "wall"
            else "a table"
            if name in ("isolation", "typical")
            else "a value",
            None,
        )
        for name in more
    }


def _arguments(section: str) -> Keys:
    """Return the keys of a table that holds arguments."""
    found = _fields(Arguments, SECTIONS[section].values())
    return {key: found[argument] for key, argument in SECTIONS[section].items()}


#: Heading -> (keys, what takes their values).
_TABLES: dict[str, tuple[Keys, Callable[..., Any] | None]] = {
    "[scene]": (_parameters(Scene, "preset"), Scene),
    "[[scene.row]], a building": (_parameters(Building, "isolation", "typical"), Building),
    **{
        f'hysteresis of a building, law = "{name}"': (_parameters(law.Parameters), law.Parameters)
        for name, law in STOREY_LAWS.items()
    },
    "deterioration of a storey law": (_parameters(Deterioration), Deterioration),
    "infill of a building": (_parameters(Infill), Infill),
    "foundation of a building": (_parameters(Foundation), Foundation),
    "isolation of a building": (
        {name: keys for name, keys in _parameters(base_isolated).items() if name != "building"},
        base_isolated,
    ),
    "typical of a building": (_parameters(typical), typical_building),
    "[[scene.row]], a wall": (_parameters(Wall, "wall"), Wall),
    "[scene.contact]": (_parameters(ContactProperties, "hertz"), ContactProperties),
    "[[scene.links]]": (_parameters(Link), Link),
    "[[scene.bumpers]]": (_parameters(Bumper), Bumper),
    "[[scene.restrainers]]": (_parameters(Restrainer), Restrainer),
    "scene.contact.hertz": (_parameters(hertz_stiffness), hertz_stiffness),
    "[sweep]": (_arguments("sweep"), build_spec),
    "Evenly spaced values": (_parameters(Range), Range),
    **{
        f"{by}.NAME": (dict.fromkeys(kinds.values(), _fields(Arguments)["gaps"]), None)
        for by, kinds in NAMED_KINDS.items()
    },
    "[design]": (_fields(DesignTable), None),
    **{heading: (_fields(model), None) for heading, model in _DISTRIBUTIONS.items()},
    "A record from a file": (_parameters(read_record, *build.SPECTRAL), read_record),
    "A record by name": (
        {
            "record": ("a text", _NEEDED),
            "name": ("a text", None),
            "scale": ("a number", 1.0),
            **dict.fromkeys(("pga", *build.SPECTRAL), ("a number", None)),
        },
        None,
    ),
    "A synthetic earthquake": (_parameters(synthetic_record, first="synthetic"), synthetic_record),
    "A pulse": (_parameters(pulse_record, first="pulse"), pulse_record),
    "A near-fault pulse": (_parameters(near_fault_record, first="near_fault"), near_fault_record),
    "[solver]": (_arguments("solver"), build_spec),
    "[output]": (_arguments("output"), build_spec),
}


#: Names of parameters that a file spells otherwise.
_PARAMETERS = {"variables": "outputs"}


def _meanings(taker: Callable[..., Any] | None) -> dict[str, str]:
    """Return what a docstring says of each parameter, or those of its bases."""
    if taker is None:
        return {}
    found = {}
    bases = [base.__doc__ for base in getattr(taker, "__mro__", ())[::-1] if base is not object]
    for parameter in chain(*(NumpyDocString(doc or "")["Parameters"] for doc in bases or [taker.__doc__])):
        for name in parameter.name.split(","):
            found[name.strip()] = " ".join(line.strip() for line in parameter.desc)
    return found


def _default(value: object) -> str:
    if value is _NEEDED:
        return "needed"
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
        said = {"law": "Which it is."} | _meanings(taker)
        lines += [f"### {heading if heading[0].isupper() else f'`{heading}`'}", ""]
        lines += ["| key | value | default | meaning |", "|---|---|---|---|"]
        for key, (words, default) in table.items():
            meaning = _OWN.get((heading, key)) or said.get(_PARAMETERS.get(key, key))
            if meaning is None:
                msg = f"nothing explains {key!r} of {heading!r}; give its parameter a docstring, or it a line in _OWN"
                raise KeyError(msg)
            lines.append(_line(f"`{key}`", words, _default(default), meaning))
        lines.append("")
    lines += ["### `[[sweep.cases]]`", "", "| key | meaning |", "|---|---|"]
    for key, meaning in _meanings(Case).items():
        if key not in FACTOR_KINDS:
            lines.append(_line(f"`{key}`", meaning))
    lines += ["| `building.NAME` | Factors on a building's properties, one number each. |"]
    lines += ["| `pair.NAME` | Properties of a pair, one number each. |", ""]
    return "\n".join(lines)
