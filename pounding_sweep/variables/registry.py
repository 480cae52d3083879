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
#: The class of an output whose errors were not measured yet: it has no say in the choice of steps, and is compared
#: with a run at half the step like any other.
UNMEASURED = "unmeasured"
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


@dataclass(eq=False)
class Variable:
    """One output of a sweep."""

    name: str  # name in cubes and in ``outputs``
    units: str  # in UDUNITS spelling
    long_name: str  # for axes and tables
    #: slot of the kernel that holds its values, or what makes them of what a kernel returned; None: they are worked out
    #: after the run, zeros until then (of scenarios only)
    source: str | Callable[[KernelResults], np.ndarray] | None = None
    per: str = "scenario"  # what there is a value for, a key of `DIMS`
    needs: Collection[str] = ()  # reducers of the compiled loop that it is made from, beside that of its slot
    #: one of `ERROR_CLASSES`, or `UNMEASURED`; "" for one that says how a run went and not what it found
    error: str = ""
    #: products of outputs to whose largest its error is relative as well as to its own: it is a difference of larger
    #: ones, or one end of a range
    relative_to: Sequence[tuple[str, ...]] = ()
    #: what its error is relative to at least: a touch at rest is found within rounding of the record's first point
    least: float = 0.0
    of_force: bool = False  # missing where floors touched under a law without a force (velocities jump)
    of_yielding: bool = False  # it says nothing of a row whose storeys are all elastic
    unbounded: bool = False  # comparisons take it for beyond every level where the building falls
    #: it exists where a row has "columns" that are struck, "links", "foundations", storeys that may fall, "falls", or
    #: springs that may lose their strength, "fails"
    only: str = ""
    dtype: str = "f8"  # stored type, "f8", "i4" or "i1"
    default: bool = False  # it is reported where no ``outputs`` are given
    always: bool = False  # it is in every cube, asked for or not
    of_cube: bool = False  # it says where a result is from, which is known when all scenarios have run
    flag_meanings: str = ""  # of a status variable: what its values from 0 mean, separated by blanks

    def __post_init__(self) -> None:
        #: What exactly is reported.
        self.definition = DEFINITIONS[self.name]
        of_slot = [REDUCER_OF[self.source]] if self.source in REDUCER_OF else []
        self.needs = frozenset([*self.needs, *of_slot])
        #: CF flags of a status variable.
        self.flag_values = tuple(range(len(self.flag_meanings.split())))
        #: Dimensions inside a scenario, out of `INNER_DIMS`; () for one value per scenario.
        self.dims = DIMS[self.per]
        #: What stands where there is no value: NaN, `INTEGER_FILL`, or None for a variable that is never missing.
        missing = float("nan") if self.dtype == "f8" else INTEGER_FILL
        self.fill = None if self.flag_values or self.of_cube else missing

    def exists_in(self, scene: Scene) -> bool:
        """Whether a scene has what it describes: pairs of neighbours, columns that are struck, links, foundations."""
        struck = any(contact.struck >= 0 for contact in scene.contacts)
        has = {"": True, "columns": struck, "links": bool(scene.links), "foundations": bool(scene.foundations)}
        has |= {"falls": any(scene.falls), "fails": any(spring.law.can_fail for spring in scene.springs)}
        return has[self.only] and ("pair" not in self.dims or bool(scene.pair_names))

    def read(self, results: KernelResults) -> np.ndarray:
        """Return its values, shape (scenarios, dimensions)."""
        if self.source is None:
            return np.zeros(len(results))
        values = results.get(self.source, self.per) if isinstance(self.source, str) else self.source(results)
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

    # its functions write rows of the group's state, lane by lane. What presses, moves or heats a row (forces, works,
    # energies, accelerations) is found by the kernel's own parts, where a kernel `asked` for it

    name: str  # by which outputs need it
    slots: tuple[Slot, ...]  # what it leaves for outputs
    #: "": it exists in all kernels; else where storeys yield, "yields", may fall, "falls", springs may lose their
    #: strength, "fails", neighbours are linked, "linked", buildings stand on foundations, "founded",
    #: floors of neighbours are equally high, "neighbours", or can
    #: touch, "touch"
    where: str = ""
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


#: How scenarios end, by the value of the status: what it means, and what to do.
_ENDINGS = (
    (
        "the scenario ran to the end of its record and of the rest after it, and its step resolves contacts, buildings "
        "and ground by all rules of the engine; where error_estimate is there, a run at another step agrees as well",
        "",
    ),
    (
        "the motion left the range of finite numbers, or of what the ground can bring about, or a storey fell in steps "
        "that do not resolve it; no peaks are reported",
        "use a smaller dt, the newmark scheme or a softer contact",
    ),
    (
        "the shortest contact lasted too few time steps for its peaks to be trusted",
        "use a smaller dt (see steps_per_contact)",
    ),
    (
        "the implicit equation of contacts or of smooth storeys was not solved within its tolerance in some step",
        "use a smaller dt",
    ),
    (
        "the time step is beyond the stability limit of the scheme; the scenario was refused",
        "use a smaller dt or the newmark scheme",
    ),
    (
        "the scenario has no result, for instance because its worker failed or because no merged cube has it",
        "run the sweep again, for a merged cube with --extend of it",
    ),
    (
        "the time step is too long for a building's fundamental period, or for the ground motion",
        "use a smaller dt, or the exact scheme",
    ),
    (
        "the estimated error is more than the accuracy asked for, however often the time step was halved, or, "
        f"at a given step, more than {SETTLED:.0%}",
        "use a smaller dt or, for floors that rest on each other, the exact scheme; or ask for a larger relative error "
        "(see unsettled_output, error_estimate)",
    ),
    (
        "a storey fell: with P-Delta its drift passed its height, or no strength was left; the scenario ends at "
        "that instant, and its values are those up to it: peaks and counts are lower bounds",
        "see collapse_time and collapsed_storey; comparisons count the fallen building as beyond every level",
    ),
)


class Status(IntEnum):
    """How a scenario ended; its value in the cube, with what it means and what to do."""

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
        self.meaning, self.remedy = _ENDINGS[code]
        self.has_values = code not in (1, 4, 5)
        #: Name in ``flag_meanings``.
        self.label = self.name.lower()


#: Every status, by rising value.
STATUS: tuple[Status, ...] = tuple(Status)
#: Where the result of a scenario is from, by the value of ``origin``.
ORIGINS = ("run", "equal", "never_touches", "not_run")
COPY, NEVER_TOUCHES, NOT_RUN = 1, 2, 3
#: Those of scenarios that have values.
WITH_VALUES = [int(status) for status in STATUS if status.has_values]
#: Those of scenarios whose values are right, up to their fall if they end by one.
VALID = [int(Status.OK), int(Status.COLLAPSED)]


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
    return np.asarray(np.abs(left - work) / np.where(size > 0, size, 1.0))


def _shear(results: KernelResults) -> np.ndarray:
    elastic = np.asarray(results.slots["drift"] * results.variants.elastic_stiffnesses)
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


def _moment(results: KernelResults) -> np.ndarray:
    yields = [any(building.yields) for building in results.scene.buildings]
    return np.where(yields, np.nan, results.slots["moment"] * _force_factors(results))


def _ductility(results: KernelResults) -> np.ndarray:
    limit = results.variants.yield_drifts
    return np.asarray(results.slots["drift"] / np.where(np.isfinite(limit), limit, np.nan))


def _roof_ratio(results: KernelResults) -> np.ndarray:
    """Largest absolute displacement of each building's highest floor over its height."""
    peaks = np.maximum(results.slots["umax"], -results.slots["umin"])[:, np.subtract(results.scene.offsets[1:], 1)]
    return np.asarray(peaks / [building.elevations[-1] for building in results.scene.buildings])


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


def _count(contact: Contact, lanes: Any, fresh: Any, *_: Any) -> None:
    contact.count += where(fresh, 1.0, 0.0)


def _deepest(contact: Contact, closed: Any, d: Any, *_: Any) -> None:
    contact.dmax = maximum(contact.dmax, d)


def _closed(contact: Contact, closed: Any, d: Any, h: Any) -> None:
    contact.tclosed += where(closed, h, 0.0)


def _closed_substep(group: Group) -> None:
    for contact in group.iter_contacts():
        contact.tclosed += where(~(contact.mode == 0.0), group.state["h"], 0.0)


#: Both ends of a range.
_EXTREMES = (("displacement_max",), ("displacement_min",))
#: Differences of larger energies: an undamped contact takes in no work in the end, however much passed through it.
_EXCHANGED = (("energy_transfer_max",), ("energy_transfer_min",), ("contact_work",))


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


_floor = partial(Variable, per="floor", error="motions")
_drift = partial(Variable, error="motions", unbounded=True)
_yielding = partial(Variable, per="floor", error=UNMEASURED, of_yielding=True)
_base = partial(Variable, per="base", error=UNMEASURED, only="foundations")
_failing = partial(Variable, per="floor", error=UNMEASURED, of_yielding=True, only="fails")
_collapse = partial(Variable, per="building", needs=["collapse"], error=UNMEASURED, only="falls")
_contact = partial(Variable, per="contact", error="contacts")
_energy = partial(Variable, per="building", error="energies")
_of_cube = partial(Variable, always=True, of_cube=True)
_TRANSFER = (
    "what the building has given to its contacts: the integral of their forces on it times its floors' velocities, "
    "equal to input - kinetic - damping - strain - lost in yielding - given to links"
)
#: What each output is exactly, in one sentence or two.
DEFINITIONS = {
    "displacement_max": "Largest signed displacement of the floor relative to the ground, positive to the right.",
    "displacement_min": "Smallest signed displacement of the floor relative to the ground, negative to the left.",
    "drift_max": "Largest absolute interstorey displacement |u_i - u_(i-1)|; of storey 1, relative to the ground; on "
    "a foundation relative to it, and less what its rotation gives.",
    "drift_ratio_max": "Largest absolute interstorey displacement, as of drift_max, over the storey's height.",
    "roof_drift_ratio_max": "Largest absolute displacement of the building's highest floor relative to the ground, a "
    "foundation's sway and rotation included, over the height of that floor.",
    "storey_shear_max": "Largest absolute elastic storey force k |u_i - u_(i-1)|, of a storey that yields that of its"
    " hysteresis, of a building by a stiffness matrix the sum of its forces on the floors above; dampers not included; "
    "with P-Delta what the columns bear, the push of the weights included. Missing of a building by a stiffness matrix "
    "with P-Delta whose period varies.",
    "overturning_moment_max": "Largest absolute moment at the building's base of its storey shears over the storeys' "
    "heights; missing where its storeys yield, or with P-Delta its period varies.",
    "acceleration_max": "Largest absolute total acceleration of the floor (relative + ground); where the contact "
    "force jumps at a touch, the limit just after it counts; where velocities jump, the jump itself does not.",
    "ductility_max": "Largest absolute interstorey displacement over the yield drift Vy / k (ductility demand mu); "
    "missing where a storey has no yield strength.",
    "residual_drift": "Signed interstorey displacement at which the building comes to rest after the "
    "record (RID, times the storey height): no storey shear is left. 0 where a storey has not yielded; missing where "
    "it falls under the weight above it, and of storeys whose law does not tell, or that have several elements.",
    "strength_left": "Largest shear that the storey may still bear after the run over that at first, of the direction "
    "in which less is left: what its backbone reaches beyond its largest drift, as far as cycles have lowered it. 1 "
    "where no strength was lost, 0 where all was; of several springs, infill among them, the mean by their yield "
    "strengths.",
    "infill_failure_time": "Time at which the storey's infill has lost all its strength for good; missing where it has "
    "not, or there is none.",
    "impact_force_max": "Largest contact force, pressing positive, 0 where the floors never touched; where the force "
    "jumps at a touch, the limit just after it counts. Missing where floors touched under a law without a force "
    "(velocities jump).",
    "impact_count": "Number of onsets of contact until the row is at rest, the penetration d = u_left - u_right - gap "
    "going from <= 0 to > 0.",
    "penetration_max": "Largest positive penetration d = u_left - u_right - gap, 0 where the floors never touched. "
    "Missing where floors touched under a law without a force (velocities jump).",
    "impulse": "Time integral of the contact force until the row is at rest.",
    "first_impact_time": "Time of the first onset of contact, 0 of floors without a gap that press each other from the "
    "first point of the record on; missing where there was none.",
    "approach_speed_max": "Largest rate of the penetration d at an onset of contact, 0 where the floors never touched.",
    "contact_time": "Total time in contact until the row is at rest, from each onset to the release (d > 0), 0 where "
    "the floors never touched; impulse over it is the mean contact force. Where velocities jump, the time that floors "
    "rest on each other, which is rough where they are hardly pressed.",
    "column_shear_bottom_max": "Largest shear that the contact force F brings into the struck columns between their "
    "lower end and the struck point, N1 F with N1 = 1 - 3 xi^2 + 2 xi^3; that of the storey's drift comes on top. "
    "Missing where floors meet.",
    "column_shear_top_max": "Largest shear that the contact force F brings into the struck columns between the struck"
    " point and their upper end, N2 F with N2 = 3 xi^2 - 2 xi^3; that of the storey's drift comes on top. Missing "
    "where floors meet.",
    "link_force_max": "Largest absolute force in the link of the left building's storey to its neighbour, spring and "
    "dashpot together; missing where there is none.",
    "foundation_sway_max": "Largest absolute displacement of the building's foundation relative to the ground; "
    "missing where it has none. The sway spring's largest force is K_h times it.",
    "foundation_rotation_max": "Largest absolute rotation of the building's foundation in its rocking; missing where "
    "it has none. The rocking spring's largest moment is K_theta times it.",
    "energy_input": "Energy put in by the ground until it is at rest, -int m ag v dt with v relative to the ground; "
    "its foundation included.",
    "energy_damping": "Energy lost in the building's own damping, dashpots and its foundation included, until it is at"
    " rest, int v'Cv dt.",
    "energy_kinetic": "Kinetic energy v'Mv/2 of the motion relative to the ground, at the last point of the record; "
    "foundation included.",
    "energy_held": "Energy that the building holds at the end of the run: at rest that of storeys that have yielded "
    "unevenly, 0 where all is elastic; with rest = 0 kinetic and strain energy.",
    "energy_strain": "Elastic strain energy u'Ku/2 at the last point of the record; of storeys that yield, hardening "
    "k d^2/2 + (1 - hardening) k z^2/2 of the drift d and z = d - p. With P-Delta less what weights have given, "
    "P d^2 / (2 h); springs of its foundation included.",
    "hysteretic_energy": "Energy lost in yielding of the building's storeys until it is at rest, (1 - "
    "hardening) int k z dp, z the drift less its plastic part p.",
    "energy_links": "Energy that the building has given to its links until it is at rest, negative where it "
    "has taken it; the sum over buildings is what the links' springs hold and their dashpots have lost.",
    "energy_transfer_max": f"Largest value over time of the transfer, {_TRANSFER}.",
    "energy_transfer_min": f"Smallest value over time of the transfer, {_TRANSFER}; negative where the building has "
    "taken energy through its contacts.",
    "contact_work": "Work the contacts of the pair took in until the row is at rest, int F d' dt.",
    "closing_max": "Largest u_left - u_right; in a run without pounding, the gap that would just not be touched.",
    "time_step": "Time step of the scenario; in every cube whose steps were chosen for an accuracy, scenario by "
    "scenario.",
    "error_estimate": "Largest relative difference of an output to a run at half the time step. Where an accuracy "
    "chose the step it is in every cube: three times what the order of the scheme makes of the difference to a run at"
    " twice the step, a fifth of it by the fourth order; that of a number of impacts is taken whole.",
    "amplification": "Largest relative change of an output over that of gaps, contact stiffness and ground motion, by"
    " a change of 1e-6 of each; the scenario is ill-conditioned where it is large.",
    "collapse_time": "Time at which a storey of the building falls, its drift reaching its height under P-Delta or its "
    "own springs having lost all strength, after the first point of the record; the scenario ends there. Missing where "
    "the building stands.",
    "collapsed_storey": "Storey of the building that falls first, from 1 at the bottom; 0 where the building stands.",
    "status": "How the scenario ended; never missing. Only an ok scenario's values are to be trusted.",
    "unsettled_output": "Output with the largest estimated error, where that makes the scenario unsettled. At a given "
    "step, runs of floors that rest on each other (gap 0) are compared with half of it even if no error_estimate is "
    "asked for, and their error is taken for twice the difference; exact flight needs none.",
    "origin": "Where the result is from: run, a run of this scenario; equal, the run of one that differs only in what "
    "its law ignores; never_touches, the run of the same buildings without pounding, as no gap closes in it; not_run: "
    "there is none.",
    "run": "Number of the run that answers the scenario, from 1 in the order of the cube; scenarios of one number "
    "have one result, which counts once in statistics. 0: there is none.",
    "energy_residual": "|sum of the buildings' transfers - sum of the contacts' works| at the end of the run, over the "
    "largest absolute value among the energies of the balance (input, damping, held, yielding, contact work); what "
    "links hold and lose counts as work.",
    "steps_per_contact": "Time steps in the shortest contact, by the duration of an elastic contact of its stiffness,"
    " effective mass and approach velocity; missing where nothing touched.",
}
#: Names by the value of ``unsettled_output``.
OUTPUT_NAMES = ("none", *DEFINITIONS)
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
            follows=lambda group, _: (
                Motion(("drift", storey.index), None, True, partial(_softness, storey), storey.drift)
                for storey in group.iter_storeys(range(group.spec.n_dof))
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
            where="linked",
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
            where="founded",
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
        Reducer("count", (Slot("count", "contact"),), where="touch", touch=_count),
        Reducer("penetration", (Slot("dmax", "contact"),), where="touch", looks="depth", plain=_deepest),
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
        Reducer("time", (Slot("tclosed", "contact"),), where="touch", substep=_closed_substep, plain=_closed),
        Reducer("energy", tuple(Slot(name, "building") for name in ("e_in", "e_damp", "e_kin", "e_strain", "e_held"))),
        Reducer("hysteretic", (Slot("travel", "spring"),), where="yields"),
        Reducer(
            "links", (Slot("e_link", "building"), Slot("link_lost", "link"), Slot("link_held", "link")), where="linked"
        ),
        Reducer("work", (Slot("work", "contact"),), where="touch"),
        Reducer("transfer", (Slot("tmax", "building"), Slot("tmin", "building")), where="touch", looks="ends"),
    )
}
#: Name of the reducer that has a slot.
REDUCER_OF: dict[Any, str] = {slot.name: reducer.name for reducer in REDUCERS.values() for slot in reducer.slots}
#: Every output, in the order in which cubes and tables list them.
_VARIABLES = (
    _floor("displacement_max", "m", "largest floor displacement", "umax", relative_to=_EXTREMES, default=True),
    _floor("displacement_min", "m", "smallest floor displacement", "umin", relative_to=_EXTREMES, default=True),
    _drift("drift_max", "m", "largest interstorey drift", "drift", "floor", default=True),
    _drift(
        "drift_ratio_max",
        "1",
        "largest interstorey drift ratio",
        lambda results: results.slots["drift"] / results.variants.storey_heights,
        "floor",
        ["drift"],
    ),
    _drift("roof_drift_ratio_max", "1", "largest roof drift ratio", _roof_ratio, "building", ["displacement"]),
    _floor("storey_shear_max", "kN", "largest storey shear", _shear, needs=["drift", "shear"], default=True),
    Variable(
        "overturning_moment_max",
        "kN m",
        "largest overturning moment",
        _moment,
        per="building",
        needs=["moment"],
        error="motions",
    ),
    _floor("acceleration_max", "m s-2", "largest total floor acceleration", "acc", error="contacts"),
    _yielding("ductility_max", "1", "largest storey ductility", _ductility, needs=["drift"], unbounded=True),
    _yielding(
        "residual_drift", "m", "residual interstorey drift", _residual, needs=["residual"], relative_to=[("drift_max",)]
    ),
    _failing("strength_left", "1", "strength left", _strength_left, needs=["strength"]),
    _failing("infill_failure_time", "s", "time at which infill fails", _infill_failure, needs=["failure"], least=0.01),
    _contact("impact_force_max", "kN", "largest contact force", "fmax", of_force=True, default=True),
    _contact("impact_count", "1", "number of impacts", "count", dtype="i4", default=True),
    _contact("penetration_max", "m", "largest penetration", "dmax", of_force=True, default=True),
    _contact("impulse", "kN s", "impulse of the contact force", "impulse"),
    _contact(
        "first_impact_time",
        "s",
        "time of the first impact",
        _first_time,
        needs=["first_time"],
        least=0.01,
        default=True,
    ),
    _contact("approach_speed_max", "m s-1", "largest approach speed", "vmax", least=0.0001),
    _contact("contact_time", "s", "time in contact", "tclosed", error=UNMEASURED),
    *(
        _contact(
            f"column_shear_{end}_max",
            "kN",
            f"largest shear of struck columns, {side}",
            partial(_column_shear, end=i),
            needs=["force"],
            error=UNMEASURED,
            only="columns",
        )
        for i, (end, side) in enumerate((("bottom", "below"), ("top", "above")))
    ),
    Variable("link_force_max", "kN", "largest link force", "link_force", error=UNMEASURED, only="links", per="link"),
    _base("foundation_sway_max", "m", "largest sway of the foundation", "sway"),
    _base("foundation_rotation_max", "rad", "largest rotation of the foundation", "rotation"),
    _energy("energy_input", "kN m", "energy input", "e_in"),
    _energy("energy_damping", "kN m", "energy lost in damping", "e_damp"),
    _energy("energy_kinetic", "kN m", "kinetic energy at the end of the record", "e_kin"),
    _energy("energy_strain", "kN m", "strain energy at the end of the record", "e_strain"),
    _energy("energy_held", "kN m", "energy held at the end of the run", "e_held", relative_to=[("energy_input",)]),
    _energy(
        "hysteretic_energy",
        "kN m",
        "energy lost in yielding",
        hysteretic,
        needs=["hysteretic"],
        error=UNMEASURED,
        of_yielding=True,
    ),
    _energy(
        "energy_links",
        "kN m",
        "energy given to links",
        "e_link",
        error=UNMEASURED,
        relative_to=[("energy_input",)],
        only="links",
    ),
    _energy("energy_transfer_max", "kN m", "largest energy transfer", "tmax", relative_to=_EXCHANGED),
    _energy("energy_transfer_min", "kN m", "smallest energy transfer", "tmin", relative_to=_EXCHANGED),
    _energy(
        "contact_work",
        "kN m",
        "work taken by contacts",
        _work,
        needs=["work"],
        relative_to=(*_EXCHANGED, ("impact_force_max", "penetration_max"), ("impulse", "approach_speed_max")),
        per="pair",
    ),
    _collapse("collapse_time", "s", "time at which the building falls", partial(_first_fall, of_time=True), least=0.01),
    _collapse("collapsed_storey", "1", "storey that falls", partial(_first_fall, of_time=False), dtype="i4"),
    Variable("closing_max", "m", "largest closing displacement", "closing", error="motions", per="contact"),
    Variable("time_step", "s", "time step", lambda results: np.full(len(results), results.step)),
    Variable("error_estimate", "1", "estimated relative error"),
    Variable("amplification", "1", "amplification of small changes"),
    Variable(
        "status",
        "1",
        "status of the scenario",
        dtype="i1",
        always=True,
        flag_meanings=" ".join(s.label for s in Status),
    ),
    Variable(
        "unsettled_output", "1", "unsettled output", dtype="i1", always=True, flag_meanings=" ".join(OUTPUT_NAMES)
    ),
    _of_cube("origin", "1", "origin of the result", dtype="i1", flag_meanings=" ".join(ORIGINS)),
    _of_cube("run", "1", "number of the run", dtype="i4"),
    Variable(
        "energy_residual",
        "1",
        "relative residual of the energy balance",
        _energy_residual,
        needs=["energy", "hysteretic", "links", "work"],
    ),
    Variable(
        "steps_per_contact",
        "1",
        "time steps in the shortest contact",
        lambda results: np.fmin.reduce(results.steps_by_law, axis=1),
        always=True,
    ),
)
#: Every output by name.
VARIABLES: dict[str, Variable] = {each.name: each for each in _VARIABLES}

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


#: Relative change of gaps, contact stiffness and ground motion that no engineer can tell: where it changes an output
#: by more than a tolerance, the scenario is sensitive at that tolerance. Its error is counted all the same.
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
