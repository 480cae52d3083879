"""The registry of outputs: every one that a sweep can report, what kernels keep for it, and how values are compared.

Kernels, planner, cube, command line and documentation read it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, lru_cache, partial, reduce
from operator import add
from typing import Any

import numpy as np

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.base.files import read_data
from pounding_sweep.kernel import hysteresis, links, rest
from pounding_sweep.kernel.group import Contact, Group, Storey
from pounding_sweep.kernel.peaks import Motion
from pounding_sweep.kernel.spec import KernelSpec, Slots, result_slots
from pounding_sweep.lanes import maximum, where
from pounding_sweep.model.meeting import column_shares
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.storeys import Sampled
from pounding_sweep.model.variants import ELASTIC, Variants

#: Dimensions inside a scenario.
INNER_DIMS = ("building", "pair", "storey")
#: What there may be several of in a scenario, and where each stands in a cube.
DIMS = {
    "floor": ("building", "storey"),
    "contact": ("pair", "storey"),
    "link": ("pair", "storey"),
    "building": ("building",),
    "base": ("building",),
    "pair": ("pair",),
    "scenario": (),
}
#: Classes of outputs whose errors were measured together (the largest among them): a choice of steps reads them.
ERROR_CLASSES = ("motions", "contacts", "energies")
#: Time (s) before which the onset of floors without a gap is the start itself: they part by more than rounding first.
ONSET_ROUNDING = 1e-4
#: Stored in integer variables where there is no value.
INTEGER_FILL = -1


def _places(scene: Scene, per: str) -> list[int]:
    """Return where floors, contacts, ... stand among the values of their dimensions, in one row."""
    n = scene.n_storeys
    if per == "floor":
        return [i * n + storey for i, building in enumerate(scene.buildings) for storey in range(building.n_storeys)]
    if per in ("contact", "link"):
        ends: Sequence[Any] = scene.contacts if per == "contact" else scene.linked_floors
        return [end.place * n + end.storey - 1 for end in ends]
    return list(scene.foundations if per == "base" else range(math.prod(_inner_sizes(scene, DIMS[per]))))


def _inner_sizes(scene: Scene, dims: Iterable[str]) -> tuple[int, ...]:
    sizes = {"building": len(scene.buildings), "pair": len(scene.pair_labels), "storey": scene.n_storeys}
    return tuple(sizes[dim] for dim in dims)


def scatter(values: Any, scene: Scene, per: str) -> np.ndarray:
    """Put a value for each floor, contact, ... where it belongs in a cube; no copy if there is one for every place."""
    values, places = np.asarray(values), _places(scene, per)
    inner = _inner_sizes(scene, DIMS[per])
    if places == list(range(math.prod(inner))):
        return values.reshape(*values.shape[:-1], *inner)
    missing = INTEGER_FILL if np.issubdtype(values.dtype, np.integer) else np.nan
    # in memory scenarios lie side by side, so that what goes over all is fast
    lying = np.full((math.prod(inner), *values.shape[:-1]), missing, values.dtype)
    lying[places] = np.moveaxis(values, -1, 0)
    return np.moveaxis(lying, 0, -1).reshape(*values.shape[:-1], *inner)


scatter_dof, scatter_contact = partial(scatter, per="floor"), partial(scatter, per="contact")


@dataclass(frozen=True)
class KernelResults:
    """What a kernel returned, by the names of its slots, shape (scenarios, slots), and what the scenarios were."""

    scene: Scene
    slots: Mapping[str, np.ndarray]
    variants: Variants
    step: float  # time step (s)
    initial_velocity: Sequence[float] | None = None  # of every floor (m/s), None at rest

    def __len__(self) -> int:
        return len(self.slots["flags"])

    def get(self, slot: str, per: str, missing: float = 0.0) -> np.ndarray:
        """Return a slot's values; `missing` where the kernel did not keep them: nothing can touch."""
        if slot in self.slots:
            return self.slots[slot]
        return np.full((len(self), len(_places(self.scene, per))), missing)

    @cached_property
    def steps_by_law(self) -> np.ndarray:
        """Time steps in the shortest contact of each law, NaN where none touched, shape (scenarios, laws)."""
        if "shortest" not in self.slots:
            return np.full((len(self), 1), np.nan)
        lasted = self.slots["shortest"] / self.step
        return np.where(lasted < 1e30, lasted, np.nan)


def parts_of(scene: Scene) -> dict[str, bool]:
    """Say what a row has that some outputs and reducers are of."""
    return {
        "": True,
        "columns": any(contact.struck >= 0 for contact in scene.contacts),  # that are struck
        "neighbours": bool(scene.contacts),  # floors that are equally high
        "yields": any(scene.yields),
        "shears": any(scene.yields) or any("k" in building.letters for building in scene.buildings),
        "falls": any(scene.falls),
        "fails": any(spring.law.can_fail for spring in scene.springs),
        "links": bool(scene.links),
        "foundations": bool(scene.foundations),
    }


@dataclass(eq=False)
class Variable:
    """One output of a sweep, an entry of ``data/outputs.toml``."""

    name: str  # name in cubes and in ``outputs``
    units: str  # in UDUNITS spelling
    long_name: str  # for axes and tables
    definition: str  # what exactly is reported
    source: str = ""  # slot of the kernel that holds its values, if they are not made by a function of `SOURCES`
    per: str = "scenario"  # what there is a value for, a key of `DIMS`
    needs: Collection[str] = ()  # reducers of the compiled loop that it is made from, beside that of its slot
    #: one of `ERROR_CLASSES`, or "unmeasured", which has no say in the choice of steps; "" for one that says how a run
    #: went and not what it found
    error: str = ""
    #: products of outputs to whose largest its error is relative as well as to its own: it is a difference of larger
    #: ones, or one end of a range
    relative_to: Sequence[tuple[str, ...]] = ()
    #: what its error is relative to at least: a touch at rest is found within rounding of the record's first point
    least: float = 0.0
    of_force: bool = False  # missing where floors touched under a law without a force (velocities jump)
    of_yielding: bool = False  # it says nothing of a row whose storeys are all elastic
    unbounded: bool = False  # comparisons take it for beyond every level where the building falls
    only: str = ""  # it exists where a row has these, out of `parts_of`
    dtype: str = "f8"  # stored type, "f8", "i4" or "i1"
    default: bool = False  # it is reported where no ``outputs`` are given
    always: bool = False  # it is in every cube, asked for or not
    of_cube: bool = False  # it says where a result is from, which is known when all scenarios have run
    flag_meanings: str = ""  # of a status variable: what its values from 0 mean, separated by blanks

    def __post_init__(self) -> None:
        self.needs = frozenset([*self.needs, REDUCER_OF[self.source]] if self.source else self.needs)
        #: CF flags of a status variable.
        self.flag_values = tuple(range(len(self.flag_meanings.split())))
        #: Dimensions inside a scenario, out of `INNER_DIMS`; () for one value per scenario.
        self.dims = DIMS[self.per]
        #: What stands where there is no value: NaN, `INTEGER_FILL`, or None for a variable that is never missing.
        missing = float("nan") if self.dtype == "f8" else INTEGER_FILL
        self.fill = None if self.flag_values or self.of_cube else missing

    def exists_in(self, scene: Scene) -> bool:
        """Whether a scene has what it describes: pairs of neighbours, columns that are struck, links, foundations."""
        return parts_of(scene)[self.only] and ("pair" not in self.dims or bool(scene.pair_names))

    def read(self, results: KernelResults) -> np.ndarray:
        """Return its values, shape (scenarios, dimensions)."""
        if self.name in SOURCES:
            values = SOURCES[self.name](results)
        elif not self.source:  # worked out after the run
            return np.zeros(len(results))
        else:
            values = results.get(self.source, self.per)
        values = values.astype(np.int32) if self.dtype == "i4" else values
        return values if self.per == "scenario" else scatter(values, results.scene, self.per)


@dataclass(frozen=True)
class Slot:
    """A number that a kernel keeps of each "floor", "spring", "contact", "link", "building" or "base", at first."""

    # the first value follows from the number of the floor or contact, or from the floors of the building; else it is 0

    name: str
    per: str
    first: Callable[[Group, Any], Any] | None = None

    def count(self, shape: KernelSpec) -> int:
        """How many of it a kernel has."""
        counts = {"floor": shape.n_dof, "contact": len(shape.contacts), "link": len(shape.links)}
        counts |= {"spring": len(shape.hysteretic)}
        return (counts | {"building": shape.n_buildings, "base": len(shape.foundations)})[self.per]


@dataclass(frozen=True)
class Reducer:
    """What the compiled loop keeps for outputs, in kernels of those that ask for it only."""

    # its functions write rows of the group's state; forces, works, energies and accelerations are found by kernels

    name: str  # by which outputs need it
    slots: tuple[Slot, ...]  # what it leaves for outputs
    where: str = ""  # it exists where a row has these, out of `parts_of`, or where floors can "touch"
    looks: str = ""  # out of `pounding_sweep.kernel.group.LOOKS`
    #: gives the motions whose extremes it keeps, turning points inside steps included; in one straight line of code
    #: where that is asked for and the row is short
    follows: Callable[[Group, bool], Iterable[Motion]] | None = None
    step: Callable[[Group], None] | None = None  # what it does after each located step and sub-step
    #: what it does at onsets of a contact in some lanes, of which some count as ones of their own, at a rate and a time
    touch: Callable[[Contact, Any, Any, Any, Any], None] | None = None
    #: what it does after each sub-step beside contacts, of lengths ``h``, in modes ``mode`` (0: open)
    substep: Callable[[Group], None] | None = None
    #: about a contact at the end of an unlocated step: where it is closed, its penetration, and the step's length
    plain: Callable[[Contact, Any, Any, Any], None] | None = None


#: Relative error beyond which the peaks of a scenario are wrong, where no other was asked for.
OK_CLAIM = 0.05
#: Difference to a run at half the step within which one at a given step is ok, where that is asked for: an error that
#: impacts have magnified need not shrink with the step as small ones do.
SETTLED = 0.02


#: How scenarios end, by the name of the status: what it means, and what to do.
_ENDINGS = read_data("statuses.toml")


class Status(IntEnum):
    """How a scenario ended; its value in the cube, with what ``data/statuses.toml`` says of it."""

    OK = 0
    DIVERGED = 1
    UNDER_RESOLVED_CONTACT = 2
    NEWTON_NOT_CONVERGED = 3
    BEYOND_STABILITY_LIMIT = 4
    NOT_RUN = 5
    UNDER_RESOLVED_MOTION = 6
    UNSETTLED = 7
    COLLAPSED = 8

    def __init__(self, code: int) -> None:
        self.label = self.name.lower()  # in ``flag_meanings``
        self.meaning, self.remedy = _ENDINGS[self.label].values()
        self.has_values = code not in (1, 4, 5)


#: Every status, by rising value.
STATUS: tuple[Status, ...] = tuple(Status)
#: Those of scenarios that have values.
WITH_VALUES = [status for status in STATUS if status.has_values]
#: Those of scenarios whose values are right, up to their fall if they end by one.
VALID = [Status.OK, Status.COLLAPSED]


def _energy_residual(results: KernelResults) -> np.ndarray:
    """|sum of transfers - sum of works of contacts and links| over the largest energy in the balance."""
    raw = results.slots
    initial: np.ndarray | float = 0.0
    if results.initial_velocity is not None:
        initial = 0.5 * (results.variants.masses * np.square(results.initial_velocity)).sum(axis=1)
    gained = raw["e_held"] + raw["e_damp"]
    if "travel" in raw:
        gained = gained + hysteretic(results)
    left = raw["e_in"].sum(axis=1) - gained.sum(axis=1) + initial
    work = raw["work"].sum(axis=1) if "work" in raw else np.zeros(len(left))
    if "link_held" in raw:
        work = work + raw["link_held"].sum(axis=1) + raw["link_lost"].sum(axis=1)
    size = np.maximum.reduce([np.abs(raw["e_in"]).sum(axis=1), gained.sum(axis=1), np.abs(work)])
    return np.abs(left - work) / np.where(size > 0, size, 1.0)


def _shear(results: KernelResults) -> np.ndarray:
    elastic = results.slots["drift"] * results.variants.elastic_stiffnesses
    if "shear" not in results.slots:
        return elastic
    sizes = np.diff(results.scene.offsets)
    dense = np.repeat(["k" in building.letters for building in results.scene.buildings], sizes)
    kept = results.slots["shear"] * np.where(dense, np.repeat(_force_factors(results), sizes, axis=1), 1.0)
    return np.where(np.array(results.scene.yields) | dense, kept, elastic)


def _force_factors(results: KernelResults) -> np.ndarray:
    """Factors on forces of displacements, of each building, missing where the period varies but not its weight."""
    leans = np.array([building.p_delta for building in results.scene.buildings])
    return np.where(leans & (results.variants.period_factor != 1.0), np.nan, results.variants.stiffness_factors)


def _residual(results: KernelResults) -> np.ndarray:
    """Drifts without force, by storey laws; none where a storey falls."""
    rest = np.zeros((len(results), results.scene.n_dof))
    constants = results.variants.spring_constants
    for e, spring in enumerate(results.scene.springs if "slip" in results.slots else ()):
        values = {name: numbers[:, e] for name, numbers in constants.items()} | {"slip": results.slots["slip"][:, e]}
        stiffness = results.variants.spring_numbers[e].stiffness
        alone = (constants["stiffness_share"][:, e] == 1.0).all()  # of several springs it is not known
        rest[:, spring.floor] = spring.law.residual(Sampled(stiffness, values)) if alone else np.nan
    if "collapse_time" in results.slots:  # where a storey falls, the row is still in motion
        rest = np.where((results.slots["collapse_time"] >= 0.0).any(axis=1, keepdims=True), np.nan, rest)
    return rest


def _strength_left(results: KernelResults) -> np.ndarray:
    """Mean of what is left of the springs of each storey, by their strengths."""
    total, left = np.zeros((2, len(results), results.scene.n_dof))
    springs = zip(results.scene.springs, results.variants.spring_numbers, strict=True)
    for e, (spring, numbers) in enumerate(springs) if "strength_left" in results.slots else ():
        own = (numbers.stiffness + numbers.geometric) * numbers.yield_drift * (numbers.yield_drift < ELASTIC)
        total[:, spring.floor] += own
        left[:, spring.floor] += own * results.slots["strength_left"][:, e]
    return np.where(total > 0.0, left / np.where(total > 0.0, total, 1.0), 1.0)


def _infill_failure(results: KernelResults) -> np.ndarray:
    times = np.full((len(results), results.scene.n_dof), np.nan)
    for e, spring in enumerate(results.scene.springs):
        if spring.is_infill and "failure_time" in results.slots:
            failed = results.slots["failure_time"][:, e]
            times[:, spring.floor] = np.where(failed >= 0.0, failed, np.nan)
    return times


def _first_fall(results: KernelResults, of_time: bool) -> np.ndarray:
    """Time at which each building falls, or the storey that does first."""
    times = scatter_dof(results.get("collapse_time", "floor", missing=-1.0), results.scene)
    times = np.where(times >= 0.0, times, np.inf)
    fallen, standing = (times.min(axis=-1), np.nan) if of_time else (1 + times.argmin(axis=-1), 0)
    return np.where(np.isfinite(times).any(axis=-1), fallen, standing)


def _shears(group: Group, straight: bool) -> Iterator[Motion]:
    for storey in group.iter_storeys(group.spec.yielding, straight or bool(group.spec.flowing)):
        i, of, soft = storey.index, partial(hysteresis.borne, storey), partial(_softness, storey, True)
        flows = isinstance(i, int) and i in group.spec.flowing
        # a shear that is a straight line turns with the drift, which is asked for too
        yield Motion(("shear", i), None, True, soft, of, **({} if flows else {"shear": i, "alone": False}))

    for b, floors in enumerate(group.spec.floors):
        for s, i in enumerate(floors) if "k" in group.spec.letters(b) else ():
            first = sum(n * len(group.spec.dofs(k)) for k, n in enumerate(group.spec.storeys[:b]))
            of = partial(_weighted, group, "shear_weight", first + s * len(group.spec.dofs(b)), group.spec.dofs(b))
            yield Motion(("shear", i), None, True, partial(group.prop, "shear_soft", i), of)


def _moments(group: Group, straight: bool) -> Iterator[Motion]:
    for b in range(group.spec.n_buildings):
        if not {*group.spec.floors[b]} & {*group.spec.yielding}:
            first = sum(len(group.spec.dofs(k)) for k in range(b))
            of = partial(_weighted, group, "moment_weight", first, group.spec.dofs(b))
            yield Motion(("moment", b), None, True, partial(group.prop, "moment_soft", b), of)


def _weighted(group: Group, weights: str, first: int, dofs: Sequence[int], x: Any = "u") -> Any:
    """Sum of displacements, or of their rates, by weights that are properties of the scene."""
    return reduce(add, [group.prop(weights, first + k) * group.floor(x, i) for k, i in enumerate(dofs)])


def _softness(storey: Storey, of_shear: bool = False) -> Any:
    """Square of the largest elastic drift, or shear with what the weights push, over twice the energy."""
    k = storey.group.full(storey.stiffness)
    borne = k + storey.geometric if storey.group.spec.p_delta else k
    return borne * borne / k if of_shear else 1.0 / k


def _column_shear(results: KernelResults, end: int) -> np.ndarray:
    """Return the largest shear at the lower (0) or upper (1) end of struck columns, missing between floors."""
    shares = [column_shares(c.xi)[end] if c.struck >= 0 else np.nan for c in results.scene.contacts]
    return results.get("fmax", "contact") * np.array(shares)


def _first_time(results: KernelResults) -> np.ndarray:
    times = results.get("tfirst", "contact", missing=-1.0)
    if "tfirst" in results.slots:
        times = np.where((results.slots["gap"] <= 0.0) & (np.abs(times) < ONSET_ROUNDING), 0.0, times)
    return np.where(times < 0, np.nan, times)


def _closed_substep(group: Group) -> None:
    for contact in group.iter_contacts():
        contact.tclosed += where(~(contact.mode == 0.0), group.state["h"], 0.0)


def _work(results: KernelResults) -> np.ndarray:
    """Sum of the works of a pair's contacts."""
    works, taken = np.zeros((len(results), len(results.scene.pair_labels))), results.get("work", "contact")
    for j, contact in enumerate(results.scene.contacts):
        works[:, contact.place] += taken[:, j]
    return works


def hysteretic(results: KernelResults) -> np.ndarray:
    """Energy that springs lose by their ``travel``, by building."""
    lost, row = np.zeros((len(results), results.scene.n_dof)), results.variants
    for e, (spring, numbers) in enumerate(zip(results.scene.springs, row.spring_numbers, strict=True)):
        lost[:, spring.floor] += spring.law.loss(numbers) * results.slots["travel"][:, e]
    return np.add.reduceat(lost, results.scene.offsets[:-1], axis=1)


#: What makes the values of outputs that no slot of the kernel holds.
SOURCES: dict[str, Callable[[KernelResults], np.ndarray]] = {
    "drift_ratio_max": lambda results: results.slots["drift"] / results.variants.storey_heights,
    "roof_drift_ratio_max": lambda results: (
        np.maximum(results.slots["umax"], -results.slots["umin"])[:, np.subtract(results.scene.offsets[1:], 1)]
        / [building.elevations[-1] for building in results.scene.buildings]
    ),
    "storey_shear_max": _shear,
    "overturning_moment_max": lambda results: np.where(
        [any(building.yields) for building in results.scene.buildings],
        np.nan,
        results.slots["moment"] * _force_factors(results),
    ),
    "ductility_max": lambda results: (
        results.slots["drift"] / np.where(np.isfinite(dy := results.variants.yield_drifts), dy, np.nan)
    ),
    "residual_drift": _residual,
    "strength_left": _strength_left,
    "infill_failure_time": _infill_failure,
    "first_impact_time": _first_time,
    "column_shear_bottom_max": partial(_column_shear, end=0),
    "column_shear_top_max": partial(_column_shear, end=1),
    "hysteretic_energy": hysteretic,
    "contact_work": _work,
    "collapse_time": partial(_first_fall, of_time=True),
    "collapsed_storey": partial(_first_fall, of_time=False),
    "time_step": lambda results: np.full(len(results), results.step),
    "energy_residual": _energy_residual,
    "steps_per_contact": lambda results: np.fmin.reduce(results.steps_by_law, axis=1),
}

#: Every reducer by name, in the order in which their slots lie.
REDUCERS: dict[str, Reducer] = {
    reducer.name: reducer
    for reducer in (
        Reducer(
            "displacement",
            tuple(Slot(name, "floor", lambda group, i: group.state["u", i]) for name in ("umax", "umin")),
            follows=lambda group, straight: (
                Motion(
                    ("umax", i), ("umin", i), False, partial(group.prop, "flexibility", i), partial(group.floor, i=i)
                )
                for i in group.indices(group.spec.n_dof, straight)
            ),
        ),
        Reducer(
            "drift",
            (Slot("drift", "floor"),),
            follows=lambda group, straight: (
                Motion(("drift", storey.index), None, True, partial(_softness, storey), storey.drift)
                for storey in group.iter_storeys(range(group.spec.n_dof), straight or not group.spec.series)
            ),
        ),
        Reducer("shear", (Slot("shear", "floor"),), where="shears", follows=_shears),
        Reducer("moment", (Slot("moment", "building"),), follows=_moments),
        Reducer("residual", (Slot("slip", "spring"),), where="yields"),
        Reducer("collapse", (Slot("collapse_time", "floor", lambda group, i: -1.0),), where="falls"),
        Reducer("strength", (Slot("strength_left", "spring"),), where="fails"),
        Reducer("failure", (Slot("failure_time", "spring", lambda group, e: -1.0),), where="fails"),
        Reducer("acceleration", (Slot("acc", "floor"),), looks="ends"),
        Reducer(
            "link_force",
            (Slot("link_force", "link"),),
            where="links",
            follows=lambda group, _: (
                Motion(
                    ("link_force", link.index),
                    None,
                    True,
                    partial(rest.of_link, link),
                    partial(links.motion, link),
                    pulls=True,
                )
                for link in group.iter_links()
            ),
            step=links.sample,
        ),
        Reducer(
            "foundation",
            (Slot("sway", "base"), Slot("rotation", "base")),
            where="foundations",
            follows=lambda group, _: (
                Motion((name, q), None, True, partial(_softness, Storey(group, i, ())), partial(group.floor, i=i))
                for q, b in enumerate(group.spec.foundations)
                for name, i in zip(("sway", "rotation"), group.spec.base(b) or (), strict=True)
            ),
        ),
        Reducer(
            "closing",
            (Slot("closing", "contact"),),
            where="neighbours",
            follows=lambda group, straight: (
                Motion(("closing", contact.index), None, False, partial(rest.between, contact), contact.between)
                for contact in group.iter_contacts(straight, touching=False)
            ),
        ),
        Reducer("force", (Slot("fmax", "contact"),), where="touch", looks="force"),
        Reducer(
            "count",
            (Slot("count", "contact"),),
            where="touch",
            touch=lambda contact, lanes, fresh, *_: contact.put(None, count=contact.count + where(fresh, 1.0, 0.0)),
        ),
        Reducer(
            "penetration",
            (Slot("dmax", "contact"),),
            where="touch",
            looks="depth",
            plain=lambda contact, closed, d, _: contact.put(None, dmax=maximum(contact.dmax, d)),
        ),
        Reducer("impulse", (Slot("impulse", "contact"),), where="touch"),
        Reducer(
            "first_time",
            (Slot("tfirst", "contact", lambda group, j: -1.0),),
            where="touch",
            touch=lambda contact, lanes, _, speed, time: contact.put(lanes & (contact.tfirst < 0.0), tfirst=time),
        ),
        Reducer(
            "approach_speed",
            (Slot("vmax", "contact"),),
            where="touch",
            touch=lambda contact, lanes, _, speed, time: contact.put(lanes, vmax=maximum(contact.vmax, speed)),
        ),
        Reducer(
            "time",
            (Slot("tclosed", "contact"),),
            where="touch",
            substep=_closed_substep,
            plain=lambda contact, closed, _, h: contact.put(None, tclosed=contact.tclosed + where(closed, h, 0.0)),
        ),
        Reducer("energy", tuple(Slot(name, "building") for name in ("e_in", "e_damp", "e_kin", "e_strain", "e_held"))),
        Reducer("hysteretic", (Slot("travel", "spring"),), where="yields"),
        Reducer(
            "links", (Slot("e_link", "building"), Slot("link_lost", "link"), Slot("link_held", "link")), where="links"
        ),
        Reducer("work", (Slot("work", "contact"),), where="touch"),
        Reducer("transfer", (Slot("tmax", "building"), Slot("tmin", "building")), where="touch", looks="ends"),
    )
}
#: Name of the reducer that has a slot.
REDUCER_OF: dict[Any, str] = {slot.name: reducer.name for reducer in REDUCERS.values() for slot in reducer.slots}
_OUTPUTS = read_data("outputs.toml")
#: Names by the value of ``unsettled_output``.
OUTPUT_NAMES = ("none", *_OUTPUTS)
_OUTPUTS["status"]["flag_meanings"] = " ".join(status.label for status in Status)
_OUTPUTS["unsettled_output"]["flag_meanings"] = " ".join(OUTPUT_NAMES)
#: Every output by name, in the order in which cubes and tables list them.
VARIABLES: dict[str, Variable] = {name: Variable(name, **about) for name, about in _OUTPUTS.items()}
#: Where the result of a scenario is from, by the value of ``origin``.
ORIGINS = tuple(VARIABLES["origin"].flag_meanings.split())
COPY, NEVER_TOUCHES, NOT_RUN = 1, 2, 3

#: What a sweep reports where its ``outputs`` are not given.
DEFAULT_OUTPUTS: tuple[str, ...] = tuple(name for name, variable in VARIABLES.items() if variable.default)

#: Outputs that have one measured error together: the largest among them.
CLASSES: dict[str, tuple[str, ...]] = {
    kind: tuple(name for name, variable in VARIABLES.items() if variable.error == kind) for kind in ERROR_CLASSES
}
#: Outputs that decide whether floors that rest on each other settle; the first impact is at once.
AT_REST = {*CLASSES["motions"], *CLASSES["contacts"]} - {"first_impact_time"}


def get_variable(name: str) -> Variable:
    """Return the declared output of that name."""
    try:
        return VARIABLES[name]
    except (KeyError, TypeError):
        raise InputError(unknown("output", name, VARIABLES)) from None


def check_outputs(names: Iterable[str]) -> tuple[str, ...]:
    """Check the names of outputs, drop repeated ones and put them into the order of the registry."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise InputError(f"outputs must be a list of names, not {names!r}; write [{names!r}] for a single one")
    asked = {get_variable(name).name for name in names}
    return tuple(name for name in VARIABLES if name in asked)


def cube_variables(names: Iterable[str]) -> tuple[str, ...]:
    """Return the variables of a run for those outputs: they and the ones that are in every cube."""
    asked = check_outputs(names)
    return tuple(name for name, each in VARIABLES.items() if not each.of_cube and (each.always or name in asked))


def reducers_for(names: Iterable[str]) -> frozenset[str]:
    """Return the reducers that the compiled loop must run for those outputs."""
    return frozenset().union(*(VARIABLES[name].needs for name in check_outputs(names)))


def reducers_of(shape: KernelSpec) -> list[Reducer]:
    """Return the reducers of a kernel."""
    return [reducer for name, reducer in REDUCERS.items() if name in shape.reducers]


@lru_cache(maxsize=64)
def output_slots(shape: KernelSpec) -> Slots:
    """Layout of a scenario's results: each chunk asks for it."""
    return result_slots(shape, reducers_of(shape))


def inner_shape(name: str, scene: Scene) -> tuple[int, ...]:
    """Return the shape of one scenario's values of an output."""
    return _inner_sizes(scene, VARIABLES[name].dims)


def mask_invalid(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Remove the values of scenarios that have none: diverged, refused or not run."""
    bad = ~np.isin(arrays["status"], WITH_VALUES)
    result = {name: np.asarray(values) for name, values in arrays.items()}
    for name, values in result.items() if bad.any() else ():
        if (fill := VARIABLES[name].fill) is not None:
            result[name] = values.copy()
            result[name][bad] = fill
    return result


#: Relative change of gaps, contact stiffness and ground motion that no engineer can tell: a scenario is sensitive
#: where it changes an output by more than a tolerance.
CHANGE = 1.0e-6


def comparable(outputs: Iterable[str]) -> tuple[str, ...]:
    """Return those of `outputs` that have an error, in the order of the registry."""
    return tuple(name for name in check_outputs(outputs) if VARIABLES[name].error)


def relative_error(name: str, values: np.ndarray, reference: np.ndarray, scale: np.ndarray | None = None) -> np.ndarray:
    """Largest error of each scenario over its floors, pairs or buildings, relative to its largest value or `scale`."""
    x, y = _flat(name, values), _flat(name, reference)
    size = np.maximum(_largest(name, reference) if scale is None else scale, VARIABLES[name].least)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.fmax.reduce(np.abs(x - y), axis=1, initial=0.0)
        error = np.where(off == 0.0, 0.0, np.where(size > 0.0, off / size, np.inf))
    error[(np.isnan(x) != np.isnan(y)).any(axis=1)] = np.inf
    return error


def relative_errors(
    outputs: Iterable[str], values: Mapping[str, np.ndarray], reference: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """`relative_error` of every comparable output, by name; relative to what the registry says."""
    largest = {name: _largest(name, each) for name, each in reference.items() if name in VARIABLES}
    errors = {}
    for name in comparable(outputs):
        products = [parts for parts in ((name,), *VARIABLES[name].relative_to) if largest.keys() >= {*parts}]
        scale = np.max([np.prod([largest[part] for part in parts], axis=0) for parts in products], axis=0)
        errors[name] = relative_error(name, values[name], reference[name], scale)
    return errors


def _largest(name: str, values: np.ndarray) -> np.ndarray:
    """Largest absolute value of each scenario."""
    return np.fmax.reduce(np.abs(_flat(name, values)), axis=1, initial=0.0)


def _flat(name: str, values: np.ndarray) -> np.ndarray:
    """Return all values of each scenario in one row, NaN where they are missing: integers below zero."""
    flat = np.asarray(values, float).reshape(len(values), -1)
    return flat if VARIABLES[name].dtype == "f8" else np.where(flat < 0, np.nan, flat)
