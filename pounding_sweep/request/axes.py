"""What varies in a sweep: the registry of axes, evenly spaced values, listed cases.

An axis is one entry in `AxisValues`: the argument of `build_spec` and key of sweep files that gives its values, the
dimension of the cube, how values are checked and what they are in a scenario. A listed case takes one value of it by
the field of `Case` that has the dimension's name.
"""

# ruff: noqa: RUF009 - fields of axes are made by functions
from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from itertools import zip_longest
from typing import Annotated, Any

from pydantic import Field

from pounding_sweep.base.errors import Fault, LawError, SceneError, SweepError
from pounding_sweep.model.faults import Finite, Integer, checked, number_check, one_of
from pounding_sweep.model.laws import Law, get_law, realised_validity
from pounding_sweep.model.scene import Scene
from pounding_sweep.records import Record

#: More values than this on one axis are refused.
MAX_AXIS = 1_000_000
#: Value by name of the building or pair, in the order of the row.
Factors = tuple[tuple[str, float], ...]
#: Values of an axis; None where the sweep does not have it.
Values = tuple[float, ...] | None
#: Axes by building or pair: name and values, in the order of the row.
NamedValues = tuple[tuple[str, tuple[float, ...]], ...]


@dataclass(frozen=True)
class Axis:
    """An axis that a sweep may have."""

    #: dimension of the cube and key of a listed case; of axes by name, the start of the dimension's name
    dimension: str
    column: str  # what of a scenario it sets: axes of one column for the whole row exclude each other
    noun: str  # what a value is, in messages
    bounds: Mapping[str, float]  # of its values, as `number` takes them
    meaning: str  # what its values are, for the documentation
    #: attributes of its coordinate
    long_name: str
    unit: str = "1"
    comment: str = ""
    #: value of the axis, ``scene``, and ``law`` (of stiffness) or ``record`` and ``sa_period`` (of scale) -> value
    #: of the column
    value: Callable[..., float] = lambda value, **_: value
    default: Values = None  # values of a column that no axis is given for
    #: scene, laws (of axes by name: the names), records -> faults of a sweep that has the axis
    requires: Callable[[Scene, Sequence[Any], Sequence[Record]], Iterator[Fault]] = lambda *_: iter(())
    of_buildings: bool = False  # whether it changes buildings
    by: str = ""  # what it is given for by name, "building" or "pair"; "" for the whole row
    neutral: float = math.nan  # value of an axis by name that changes nothing, which listed cases leave out
    of_pair: Callable[[Any, Any], Any] = lambda row, own: own  # value of the row, and a pair's own -> value of the pair
    #: whether a sweep with it is a list of cases: what it comes to in a scenario depends on all of that
    listed: bool = False
    finds: str = ""  # argument of the axis by name whose values it finds, and excludes

    @cached_property
    def _number(self) -> Callable[[Any], float]:
        return number_check(self.noun, **self.bounds)

    def check(self, value: Any, laws: Sequence[Law] = (), basis: str = "published") -> float:
        """Convert and check a value; a restitution is checked against the laws of the sweep as well."""
        result = self._number(value)
        realised, refused = basis == "realised", []
        for law in laws if self.dimension == "restitution" else ():
            try:
                law.check_restitution(result, basis)
            except LawError:
                refused.append(f"law {law.key!r} ({realised_validity(law) if realised else law.validity})")
        if refused:
            fault = "can't be realised by" if realised else "is outside the validity of"
            raise LawError(f"restitution {result!r} {fault} {', '.join(refused)}; change it or leave them out")
        return result


def contact_stiffness(
    scene: Scene, law: str | Law, *, stiffness: float | None = None, stiffness_factor: float | None = None
) -> float:
    """Absolute contact stiffness of a law (kN/m**exponent); 0 for a law without contact."""
    law = get_law(law)
    if law.exponent is None:
        return 0.0
    if stiffness is not None:
        return stiffness
    for _, fault in _need_references(scene, [law], ()):
        raise SweepError(fault)
    return (_reference_stiffness(scene, law) or 0.0) * (1.0 if stiffness_factor is None else stiffness_factor)


def _reference_stiffness(scene: Scene, law: Law) -> float | None:
    """Contact stiffness that factors scale: the scene's for that force exponent, else the law's own; or None."""
    reference = None if law.exponent is None else scene.contact.reference(law.exponent)
    return law.reference_stiffness if reference is None else reference


def by_exponent(laws: Iterable[Law]) -> dict[float, list[Law]]:
    """Return the laws of each force exponent."""
    groups: dict[float, list[Law]] = {}
    for law in laws:
        if law.exponent is not None:
            groups.setdefault(law.exponent, []).append(law)
    return groups


def _need_references(scene: Scene, laws: Sequence[Law], _records: Sequence[Record]) -> Iterator[Fault]:
    """Tell each reference stiffness that the scene lacks."""
    names = {1.0: "linear_stiffness", 1.5: "hertz_stiffness"}
    for exponent, group in by_exponent(laws).items():
        if lacking := [law.key for law in group if _reference_stiffness(scene, law) is None]:
            name = names.get(exponent)
            where = f"{name} of the scene's contact properties" if name else "the law's reference_stiffness"
            yield (
                ("scene", "contact"),
                f"a reference stiffness for force ~ d^{exponent:g} (kN/m^{exponent:g}) is missing: stiffness factors "
                f"of {', '.join(lacking)} scale it; give {where}, or an absolute stiffness",
            )


def _need_one_exponent(_scene: Scene, laws: Sequence[Law], _records: Sequence[Record]) -> Iterator[Fault]:
    """Tell laws of different exponents."""
    if len(of_exponent := by_exponent(laws)) > 1:
        groups = " but ".join(
            f"{', '.join(law.key for law in group)}: {group[0].stiffness_unit} (exponent {exponent:g})"
            for exponent, group in of_exponent.items()
        )
        yield (
            ("stiffnesses",),
            f"an absolute stiffness axis needs laws of one force exponent, not {groups}; use stiffness_factors, which "
            "scale the scene's reference stiffness of each exponent",
        )


def _need_motion(_scene: Scene, _laws: Sequence[Law], records: Sequence[Record]) -> Iterator[Fault]:
    """Tell records that no factor gives a peak."""
    if still := [repr(record.name) for record in records if record.pga == 0.0]:
        yield ("records",), f"no factor gives {', '.join(still)} a peak: its ground stands still; give scales instead"


def _factor_to_spectrum(value: float, record: Record, sa_period: float, **_: Any) -> float:
    """Factor on a record that gives it a spectral acceleration (m/s2) at a period (s)."""
    from pounding_sweep.engine.spectrum import spectral_acceleration

    return value / spectral_acceleration(record, sa_period)


def _need_yielding(scene: Scene, _laws: Sequence[Any], _records: Sequence[Record]) -> Iterator[Fault]:
    """Tell a row that is elastic."""
    if any(spring.law.can_fail for spring in scene.springs):
        why = "storeys lose strength at drifts of their own, so that factors on strengths do not follow from a motion's"
        yield ("ductilities",), f"{why}; give strength_factors, or leave it out"
    if not any(scene.yields):
        yield ("ductilities",), "no storey of this row yields; give its buildings yield_strengths, or leave it out"


def _need_parameters(scene: Scene, names: Sequence[str], _records: Sequence[Record], lacking: str) -> Iterator[Fault]:
    """Tell buildings of an axis of which neither they nor their storey laws have some parameters."""
    for building in scene.buildings:
        owners = building, *building.elements, *building.infill_elements
        has_some = any(getattr(owner, name, None) for owner in owners for name in lacking.split(" or "))
        if building.name in names and not has_some:
            yield (building.name,), f"building {building.name!r} has no {lacking}; give them, or leave it out"


def _need_ratios(scene: Scene, _laws: Sequence[Any], _records: Sequence[Record]) -> Iterator[Fault]:
    """Tell buildings whose damping is no matter of ratios."""
    for building in scene.buildings:
        if building.damping_matrix is not None:
            why = f"building {building.name!r} has a damping_matrix, which ratios do not change; leave one of them out"
            yield ("damping_ratios",), why


_need_strengths = partial(_need_parameters, lacking="yield_strengths")
#: Factors on a period or on masses: beyond them nothing is a building, and numbers run out of range.
_FACTOR = {"ge": 1e-3, "le": 1e3}


def _axis(*about: Any, values: Any = None, **more: Any) -> Any:
    """Make the field of an axis, with the values of a sweep without it."""
    return field(default=values, metadata={"axis": Axis(*about, **more)})


def _by_building(*about: Any, neutral: float = 1.0, **more: Any) -> Any:
    """Make the field of an axis that is given for each building by name."""
    return _axis(*about, values=(), of_buildings=True, by="building", neutral=neutral, **more)


#: Makes the field of an axis that is given for each pair by name.
_by_pair = partial(_axis, values=(), by="pair")


@dataclass(frozen=True, kw_only=True)
class AxisValues:
    """The axes: one field for each."""

    # fmt: off
    gaps: Values = _axis(
        "gap", "gap", "gap in m", {"ge": 0.0},
        "Gaps (m), each for every pair; by default the scene's own.",
        "gap of every pair", "m",
    )
    stiffnesses: Values = _axis(
        "stiffness", "stiffness", "contact stiffness in kN/m**exponent", {"gt": 0.0},
        "Contact stiffnesses (kN/m**exponent); only where all laws share one exponent.",
        "contact stiffness", requires=_need_one_exponent,
        value=lambda value, scene, law: contact_stiffness(scene, law, stiffness=value),
    )
    stiffness_factors: Values = _axis(
        "stiffness_factor", "stiffness", "stiffness factor", {"gt": 0.0},
        "Factors on the scene's reference stiffnesses; 1 where neither axis is given.",
        "factor on the scene's reference contact stiffness", default=(1.0,), requires=_need_references,
        value=lambda value, scene, law: contact_stiffness(scene, law, stiffness_factor=value),
    )
    restitutions: tuple[float, ...] = _axis(
        "restitution", "restitution", "coefficient of restitution", {"ge": 0.0, "le": 1.0},
        "Coefficients of restitution; by default the scene's.",
        "nominal coefficient of restitution", values=(),
    )
    scales: tuple[float, ...] = _axis(
        "scale", "scale", "record scale", {},
        "Factors on the records; 1 by default.",
        "factor on the record", values=(), default=(1.0,),
    )
    pgas: Values = _axis(
        "pga", "scale", "peak ground acceleration in m/s2", {"gt": 0.0},
        "Peak ground accelerations (m/s2) that every record is scaled to, in place of `scales`.",
        "peak ground acceleration", "m s-2", "the coordinate scale has the factor on each record",
        value=lambda value, record, **_: value / record.pga, requires=_need_motion,
    )
    sas: Values = _axis(
        "sa", "scale", "spectral acceleration in m/s2", {"gt": 0.0},
        "Spectral accelerations (m/s2; pseudo-acceleration, 5 % damping) at the period `sa_period` that every record "
        "is scaled to, in place of `scales`.",
        "spectral acceleration (pseudo-acceleration, 5 % damping)", "m s-2",
        "at the period of the attribute sa_period; the coordinate scale has the factor on each record",
        value=_factor_to_spectrum, requires=_need_motion,
    )
    period_factors: NamedValues = _by_building(
        "period_factor", "period_factor", "factor on periods", _FACTOR,
        "Factors on all natural periods of a building, by its name, one axis each: "
        "stiffnesses are divided by the square, masses kept.",
        "factor on all periods", comment="stiffnesses are divided by its square, masses kept",
    )
    mass_factors: NamedValues = _by_building(
        "mass_factor", "mass_factor", "factor on masses", _FACTOR,
        "Factors on all masses of a building, by its name, one axis each: stiffnesses "
        "take the same factor, so that periods are kept.",
        "factor on all masses", comment="stiffnesses take it too, so that periods are kept",
    )
    damping_ratios: Values = _axis(
        "damping_ratio", "damping_ratio", "damping ratio", {"ge": 0.0, "lt": 1.0},
        "Damping ratios of all buildings, in [0, 1): Rayleigh's of the first two modes, or of all modes where a "
        "building has modal_damping; by default each building's own.",
        "damping ratio of the first two modes of all buildings", of_buildings=True, requires=_need_ratios,
    )
    strength_factors: NamedValues = _by_building(
        "strength_factor", "strength_factor", "factor on yield strengths", {"ge": 1e-9, "le": 1e9},
        "Factors on all yield strengths of a building, by its name, one axis each; 1 over a strength reduction.",
        "factor on all yield strengths", requires=_need_strengths,
    )
    hardenings: NamedValues = _by_building(
        "hardening", "hardening", "hardening", {"ge": 0.0, "lt": 1.0},
        "Stiffness of a building's storeys that yield over their elastic one, by its name, in [0, 1), one axis each. "
        "One number for all storeys, in place of the building's own, which may differ by storey.",
        "stiffness of yielding storeys over their elastic one", requires=_need_strengths, neutral=math.nan,
    )
    ductility_capacity_factors: NamedValues = _by_building(
        "ductility_capacity_factor", "ductility_capacity_factor", "factor on ductility capacities", _FACTOR,
        "Factors on the drifts at which a building's springs, infill among them, lose strength, its cap and ultimate "
        "drifts, by its name, one axis each.",
        "factor on cap and ultimate drifts", requires=partial(_need_parameters, lacking="cap_drift or ultimate_drift"),
    )
    deterioration_factors: NamedValues = _by_building(
        "deterioration_factor", "deterioration_factor", "factor on deterioration", _FACTOR,
        "Factors on the reference drifts by which a building's springs deteriorate with cycles, infill among them, by "
        "its name, one axis each: the larger, the less they do.",
        "factor on reference drifts of deterioration", requires=partial(_need_parameters, lacking="deterioration"),
    )
    ductilities: Values = _axis(
        "ductility", "ductility", "ductility", {"ge": 1.0},
        "Largest storey ductilities, at least 1: each building gets the factor on its yield strengths at which it "
        "alone reaches it without pounding, under the record and scale of each scenario. The cube lists its scenarios.",
        "largest storey ductility without pounding",
        comment="the coordinate strength_factor has the factor on the yield strengths of each building",
        requires=_need_yielding, of_buildings=True, listed=True, finds="strength_factors",
    )
    pair_gaps: NamedValues = _by_pair(
        "gap", "gap", "gap in m", {"ge": 0.0},
        "Gaps (m) of a pair, by its name, one axis each; other pairs have those of `gaps`, or the scene's own.",
        "gap", "m",
    )
    pair_stiffness_factors: NamedValues = _by_pair(
        "stiffness_factor", "stiffness", "stiffness factor", {"gt": 0.0},
        "Factors on the contact stiffness of a pair, by its name, one axis each, beside those of all pairs.",
        "factor on the contact stiffness", neutral=1.0, of_pair=operator.mul,
    )
    pair_restitutions: NamedValues = _by_pair(
        "restitution", "restitution", "coefficient of restitution", {"ge": 0.0, "le": 1.0},
        "Coefficients of restitution of a pair, by its name, one axis each; other pairs have those of `restitutions`.",
        "nominal coefficient of restitution",
    )
    # fmt: on

    def along(self, laws: Sequence[str], records: Sequence[str]) -> dict[str, Sequence[Any]]:
        """Return values by dimension, in the order of the cube."""
        by_dimension: dict[str, Sequence[Any]] = {"law": laws}
        for column in COLUMNS:
            if column == "scale":
                by_dimension["record"] = records
            axis = self.axis(column)
            by_dimension |= {axis[0].dimension: axis[1]} if axis else {column: (None,) if column == "gap" else ()}
            by_dimension |= {axis.dimension: axis.values for axis in self.named_axes("pair") if axis.kind == column}
        return by_dimension | {axis.dimension: axis.values for axis in self.named_axes("building")}

    def named_axes(self, *of: str) -> tuple[NamedAxis, ...]:
        """Return the axes over properties of each "building" or "pair", in the order of the cube."""
        axes: dict[str, NamedAxis] = {}
        for argument, axis in AXES.items():
            values = getattr(self, argument)
            if axis.by:
                for name, numbers in values:
                    dimension = plain_name(f"{axis.dimension}_{name}", axes)
                    axes[dimension] = NamedAxis(axis, axis.column, name, numbers, dimension)
            elif axis.of_buildings and values is not None:
                axes[axis.dimension] = NamedAxis(axis, axis.column, None, values, axis.dimension)
        return tuple(axis for axis in axes.values() if (axis.axis.by or "building") in of)

    def needed_axis(self, column: str) -> tuple[Axis, tuple[float, ...]]:
        """Return the axis of a column that every product of axes has one of, with its values."""
        return self.axis(column) or (next(axis for axis in AXES.values() if axis.column == column), ())

    def axis(self, column: str) -> tuple[Axis, tuple[float, ...]] | None:
        """Return the axis that the sweep has of a column, with its values; None without."""
        for name, axis in AXES.items():
            if axis.column == column and not axis.by and getattr(self, name):
                return axis, getattr(self, name)
        return None


#: Axes by argument of `build_spec`.
AXES: dict[str, Axis] = {field.name: field.metadata["axis"] for field in fields(AxisValues)}
#: Axes by building and by pair, given in tables building.NAME and pair.NAME: argument -> kind.
NAMED_KINDS = {
    by: {name: axis.dimension for name, axis in AXES.items() if axis.by == by} for by in ("building", "pair")
}
#: All of them: argument -> kind.
FACTOR_KINDS = NAMED_KINDS["building"] | NAMED_KINDS["pair"]
#: Building properties that vary -> the value that stands for the building's own.
BUILDING_DEFAULTS = {axis.column: axis.neutral for axis in AXES.values() if axis.of_buildings and not axis.listed}
#: What axes may set of a scenario beside building properties, in the order of the cube.
COLUMNS = tuple(dict.fromkeys(axis.column for axis in AXES.values() if not axis.of_buildings))
#: Dimensions by what they set of a scenario; those of axes by name begin so.
DIMENSIONS = {
    column: tuple(dict.fromkeys(axis.dimension for axis in AXES.values() if axis.column == column))
    for column in dict.fromkeys(axis.column for axis in AXES.values())
}


@checked
class Range:
    """Evenly spaced values of an axis, expanded only once the sweep's size is known.

    Values are rounded to 12 significant digits, so that 0.002 to 0.024 in 12 values holds 0.006; the ends are exact.

    Parameters
    ----------
    start, stop : float
        First and last value, in the axis' unit.
    count : int
        Number of values, from 1 to a million.
    spacing : {"linear", "log"}
        Equal differences or equal ratios.

    Examples
    --------
    >>> Range(0.0, 0.3, 4).values()
    (0.0, 0.1, 0.2, 0.3)
    """

    start: Finite
    stop: Finite
    count: Annotated[Integer, Field(ge=1, le=MAX_AXIS)]
    spacing: Annotated[str, one_of("spacing", ("linear", "log"))] = "linear"

    def __post_init__(self) -> None:
        ends = f"start {self.start!r} and stop {self.stop!r}"
        if self.count == 1 and self.start != self.stop:
            raise SceneError(f"1 value can't reach both {ends}; give at least 2", ("count",))
        if self.spacing == "log" and not (self.start > 0.0 and self.stop > 0.0):
            raise SceneError(f"log needs start and stop above 0, not {ends}", ("spacing",))

    def __len__(self) -> int:
        return self.count

    def values(self) -> tuple[float, ...]:
        """Return the values, ``count`` of them."""
        first, last, steps = self.start, self.stop, self.count - 1
        if not steps:
            return (first,)
        if self.spacing == "log":
            inner = [float(f"{first * (last / first) ** (i / steps):.12g}") for i in range(1, steps)]
        else:
            largest = max(abs(first), abs(last))
            digits = 12 - math.ceil(math.log10(largest)) if largest else 12
            inner = [round(first + (last - first) * (i / steps), digits) + 0.0 for i in range(1, steps)]
        return (first, *inner, last)


@dataclass(frozen=True)
class NamedAxis:
    """An axis over a property of the buildings or pairs."""

    axis: Axis
    kind: str  # what it varies, such as "period_factor"
    name: str | None  # of the building or pair; None: all buildings
    values: tuple[float, ...]  # values, as the user gave them
    dimension: str  # name of the dimension in the cube: letters, digits and "_"


def names_by(scene: Scene, by: str) -> Sequence[str]:
    """Return the names of the buildings or the pairs of a row."""
    return scene.pair_names if by == "pair" else [building.name for building in scene.buildings]


def as_tuples(value: Any) -> Any:
    """Return lists of JSON, at any depth, as tuples."""
    return tuple(map(as_tuples, value)) if isinstance(value, list) else value


def axes_of(data: Mapping[str, Any]) -> AxisValues:
    """Return the axes of a sweep that JSON describes."""
    return AxisValues(**{name: as_tuples(data[name]) for name in AXES if name in data})


def case_of(data: Mapping[str, Any]) -> Case:
    """Return a listed case that JSON describes."""
    return Case(**{name: as_tuples(value) for name, value in data.items()})


def plain_name(text: str, existing: Collection[str]) -> str:
    """Return a name for a cube, letters, digits and "_" only, that is not taken."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", text)
    same = sum(re.fullmatch(rf"{plain}(_no\d+)?", name) is not None for name in existing)
    return f"{plain}_no{same + 1}" if same else plain


@dataclass(frozen=True)
class Case:
    """One listed scenario of a sweep that is no product of axes.

    Parameters
    ----------
    law : str
        Contact law.
    gap : float or tuple of float, optional
        Gap of every pair, or one per pair (m); the scene's own where not given.
    stiffness, stiffness_factor : float, optional
        Contact stiffness (kN/m**exponent of the law), or a factor on the scene's reference; the factor 1 by default.
    restitution : float, optional
        Coefficient of restitution; the scene's where not given.
    record : str, optional
        Name of one of the sweep's records; needed where it has more than one.
    scale : float
        Factor on the record.
    pga, sa : float, optional
        Peak ground acceleration, or spectral acceleration at the sweep's `sa_period` (m/s2), instead of `scale`.
    damping_ratio, ductility : float, optional
        Damping ratio of all buildings; largest storey ductility for which `strength_factors` are found.
    period_factors, mass_factors, strength_factors, hardenings : mapping of str to float
        Of buildings by name; their own for others.
    ductility_capacity_factors, deterioration_factors : mapping of str to float
        Factors on drifts at which strength is lost, and on reference drifts of deterioration, by name.
    pair_gaps, pair_restitutions, pair_stiffness_factors : mapping of str to float
        Of pairs by name: in place of `gap` (m) and `restitution`, and factors on the contact stiffness.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> cases = [Case(law="linear", record="el_centro", gap=gap) for gap in (0.01, 0.02)]
    >>> ps.Sweep("mate2015", "el_centro", cases=cases).plan().n_asked
    2
    """

    law: str
    gap: float | tuple[float, ...] | None = None
    stiffness: float | None = None
    stiffness_factor: float | None = None
    restitution: float | None = None
    record: str | None = None
    scale: float = 1.0
    period_factors: Factors | Mapping[str, float] = ()
    mass_factors: Factors | Mapping[str, float] = ()
    damping_ratio: float | None = None
    pga: float | None = None
    strength_factors: Factors | Mapping[str, float] = ()
    hardenings: Factors | Mapping[str, float] = ()
    ductility_capacity_factors: Factors | Mapping[str, float] = ()
    deterioration_factors: Factors | Mapping[str, float] = ()
    sa: float | None = None
    ductility: float | None = None
    pair_gaps: Factors | Mapping[str, float] = ()
    pair_stiffness_factors: Factors | Mapping[str, float] = ()
    pair_restitutions: Factors | Mapping[str, float] = ()

    def gaps_of(self, scene: Scene) -> tuple[float, ...]:
        """Return the gap of each pair of a row (m)."""
        gaps = scene.gaps if self.gap is None else self.gap
        gaps = gaps if isinstance(gaps, Sequence) else (gaps,) * len(scene.gaps)
        named = dict(self.pair_gaps)
        return tuple(named.get(str(name), gap) for name, gap in zip_longest(scene.pair_names[: len(gaps)], gaps))

    def axis(self, column: str) -> tuple[Axis, float] | None:
        """Return the axis that the case has of a column, with its value; None where it has none."""
        result: tuple[Axis, float] | None = None
        for axis in AXES.values():
            value = None if axis.by else getattr(self, axis.dimension)
            if axis.column == column and value is not None:  # the first has a default
                result = axis, value
        return result
