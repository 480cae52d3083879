"""What a kernel is compiled for, and where its numbers lie: `Slots` of `LANES` numbers each.

Groups of `LANES` scenarios have one scene shape, one law, one scheme and one set of reducers; a kernel advances as many
of them side by side as a vector register holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache
from itertools import accumulate, pairwise
from typing import Any

from pounding_sweep.model.storeys import StoreyLaw, law_of

#: Scenarios of a group, whose numbers lie side by side; the largest register holds as many in single precision.
LANES = 16


#: Name and compiled parameters of a storey law, which spring of a storey follows it, and whether it is infill.
Code = tuple[str, tuple[float, ...], int, bool]
#: Properties that may differ from lane to lane.
VARIED = (
    *("m", "im", "k", "alpha", "beta", "reduced", "geometric", "dashpot", "longest"),
    *("dense_k", "dense_c", "shear_soft", "moment_soft"),
)

#: How finely numbers are resolved, in double and in single precision.
_TOLERANCES = {
    "exact": (1e-15, 1e-7),  # relative width of a bracket, and distance (m), below which nothing is gained
    "swept": (1e-13, 1e-6),  # relative change of contact forces at which sweeps over the contacts end
    "unswept": (1e-9, 1e-3),  # and above which they have failed
    "same_time": (1e-12, 1e-6),  # events this close (in steps) are simultaneous
    "just_after": (1e-6, 1e-3),  # fraction of a sub-step after which a force differs from zero by more than rounding
    "at_release": (1e-9, 1e-5),  # and this close to a release, part of it
    "at_kink": (1e-6, 1e-3),  # kinks of a storey no farther (in sub-steps) from an end of a sub-step are at that end
    "at_rest": (1e-13, 1e-6),  # rates of drifts that are none, beside those of their floors
    "done": (1e-13, 1e-6),  # remainder of a step (in steps) that is none
    "far": (1e300, 1e38),
    "tiny": (1e-300, 1e-37),
    "short": (1e-4, 3e-2),  # sub-steps below this (in steps) are too short for rates from differences
    "moved": (1e-11, 2e-3),  # and those in which floors near each other by less of how far they are, by their rates
    "clear": (1e-14, 5e-7),  # penetration that is none under velocity jumps, beside how far floors are
    "released": (1e-9, 1e-3),  # relative acceleration (m/s2) that does not press there
}
TOLERANCES: dict[str, dict[str, float]] = {
    precision: {name: values[k] for name, values in _TOLERANCES.items()}
    for k, precision in enumerate(("float64", "float32"))
}
#: What a kernel is given and of what type, in whole numbers that lie one after another: of arrays address and shape.
PARAMETERS = {
    "motion": "float64[::1]",
    "length": "float64",
    "record": "int64",
    "steps": "int64",
    "substeps": "int64",
    "constants": "{real}[::1]",
    "inputs": "float64[:, ::1]",
    "results": "float64[:, ::1]",
    "history": "float64[:, ::1]",
    "track": "{real}[::1]",
    "tables": "{real}[::1]",
    "decays": "float64[::1]",
    "rows": "int64",
    "scenarios": "int64",
    "state": "{real}[::1]",
    "passing": "int64",
    "flight": "int64",
}
#: Whole numbers before the variables that it shares with its flight, and of all.
N_ARGUMENTS, FRAME = 32, 32 + 9 * 16
#: Largest product of sub-step and contact rate in located explicit schemes: stiffer ones get sub-steps.
CONTACT_CAP = 0.25
#: The same of `exact`, whose stages are of fifth order.
STAGED_CAP = 0.5

#: The same of steps by series, and the order of these: with a higher one steps are longer, but each takes longer too.
SERIES_CAP, SERIES_ORDER = 1.2, {"float64": 14, "float32": 10}
#: The same where storeys yield, whose events make steps short.
YIELDING_ORDER = {"float64": 12, "float32": 10}


#: Most degrees of freedom written as one straight line; longer rows run through loops.
FUSED_DOF = 16


@dataclass(frozen=True)
class LawShape:
    """The part of a contact law that is compiled: expressions and switches."""

    elastic: str
    elastic_slope: str
    damper: str
    damper_slope: str
    exponent: float
    approach_only: bool
    tension: bool
    per_speed: bool
    damper_exponent: float = 0.0
    impulsive: bool = False
    yields: bool = False
    rebound_only: bool = False
    is_power: bool = True
    grows: bool = True

    @property
    def one_sided(self) -> bool:
        """Whether the damper acts on approach only, or on rebound only."""
        return self.approach_only or self.rebound_only

    @property
    def polynomial(self) -> bool:
        """Whether the force is a polynomial of penetration and rate: k d, with a damper c or c d."""
        return (
            self.elastic == "k*d"
            and self.damper in ("", "c", "c*max(d, 0.0)")
            and not (self.yields or self.rebound_only)
        )

    @property
    def is_product(self) -> bool:
        """Whether the damper grows with the penetration."""
        return bool(self.damper) and self.damper_exponent == 1.0

    @property
    def clips(self) -> bool:
        """Whether the published force can turn negative and is cut at zero."""
        return bool(self.damper) and not self.approach_only and not self.tension

    def grading(self, order: int) -> tuple[float, float]:
        """Power by which sub-steps grow after a touch and shrink before a release (1: no need to)."""

        def power(exponents: list[float]) -> float:
            rough = [s for s in exponents if s != round(s) and s + 1.0 < order]
            return (order + 1.0) / (min(rough) + 1.0) if rough else 1.0

        spring = 1.0 if self.yields else self.exponent
        damper = [self.damper_exponent] if self.damper else []
        before, after = ([] if off else damper for off in (self.rebound_only, self.approach_only))
        return power([spring, *before]), power([spring, *after])


#: What stands for any law where all that counts is that there is one.
ANY_LAW = LawShape("k*d", "k", "", "", 1.0, False, False, False)


#: Ends of an element: degrees of freedom, and of each whether the stretch grows (1) or falls (-1) with it, and by which
#: share: a property of the element ("": all of it).
Ends = tuple[tuple[int, ...], tuple[tuple[int, str], ...]]


@dataclass(frozen=True)
class KernelSpec:
    """Everything that decides a kernel's code."""

    storeys: tuple[int, ...]  # storeys of each building
    #: degrees of freedom that can meet (-1: a wall) and which gap is theirs; of a side whose columns are struck, the
    #: floor above them
    contacts: tuple[tuple[int, int, int], ...]
    n_gaps: int  # gaps that differ: of pairs of neighbours, or where there are bumpers of each contact
    law: LawShape | None  # None: no contact force
    scheme: str  # time integration
    order: int  # order of the scheme, in contact
    implicit: bool  # contact forces are found together with the step that they act on
    by_series: bool  # steps are series, where forces are polynomials of the motion
    located: bool  # touches, releases and peaks are located inside the step
    reducers: frozenset[str]  # names of what is kept (see `pounding_sweep.variables`)
    history: bool = False  # lane 0 leaves its state after every step
    precision: str = "float64"  # number format of the state and of all arithmetic
    varied: bool = False  # building properties differ from lane to lane: they are inputs, not constants
    #: exact flight leaves out windows of the record: worth it where several scenarios share a row of buildings
    windows: bool = True
    #: elements of storeys that follow a storey law: degree of freedom above, name and compiled parameters of the law
    hysteretic: tuple[tuple[int, str, tuple[float, ...]], ...] = ()
    infill: tuple[int, ...] = ()  # numbers of those that are infill
    falling: tuple[int, ...] = ()  # degrees of freedom whose storeys may fall
    limited: tuple[int, ...] = ()  # those of them whose storeys fall at a drift
    tangent: bool = False  # dampers of some of them follow the tangent stiffness
    #: of each contact the side (0: left, 1: right) whose columns are struck, -1 where floors meet; () where none are
    #: struck
    struck: tuple[int, ...] = ()
    p_delta: bool = False  # shears of storeys that yield are kept, and weights push some of them
    dashpots: tuple[int, ...] = ()  # degrees of freedom whose storeys have dashpots
    links: tuple[tuple[int, int], ...] = ()  # degrees of freedom that are linked
    foundations: tuple[int, ...] = ()  # buildings on foundations: after all floors come sway and rocking of each
    #: of each building whose floors matrices connect letters: "k" stiffness, in place of its storeys', "m" damping of
    #: modes, "c" another one; "" of others; () where there are none
    dense: tuple[str, ...] = ()
    bumpers: tuple[LawShape, ...] = ()  # laws of bumpers
    bumped: tuple[int, ...] = ()  # which of `laws` each contact has; () where all have the first
    stiffness_per_contact: bool = False  # each contact has a stiffness of its own

    @property
    def laws(self) -> tuple[LawShape, ...]:
        """Laws of the contacts."""
        return () if self.law is None else (self.law, *self.bumpers)

    only_flight: bool = False  # it is no kernel but the flight of kernels under all laws, which they call

    @property
    def flight(self) -> KernelSpec | None:
        """The flight that the kernel calls; None where it has none."""
        if self.only_flight or not self.flies_exactly:
            return None
        laws = (ANY_LAW,) * len(self.laws)
        return replace(self, law=laws[0] if laws else None, bumpers=laws[1:], only_flight=True)

    @property
    def pieces(self) -> tuple[KernelSpec, ...]:
        """What is compiled by itself: the flight, and the kernel that calls it."""
        return (self,) if self.flight is None else (self.flight, self)

    @property
    def rest_is_bounded(self) -> bool:
        """Whether bounds of a free vibration about where the row rests tell when nothing that is reported changes."""
        return not (not self.follows_modes or (self.yielding and self.links) or "links" in self.reducers)

    @property
    def impulsive(self) -> bool:
        """Whether velocities jump where floors meet."""
        return self.law is not None and self.law.impulsive

    @property
    def series(self) -> int:
        """Order of the series by which contacts are stepped; 0: by the scheme's stages."""
        polynomial = all(law.polynomial for law in self.laws) if self.laws else bool(self.yielding)
        storeys = all(law_of(name, compiled).is_polynomial(compiled) for _, name, compiled in self.hysteretic)
        if not (self.by_series and polynomial and storeys):
            return 0
        return (YIELDING_ORDER if self.yielding else SERIES_ORDER)[self.precision]

    @property
    def stepless(self) -> bool:
        """Whether the time step decides no more than where records are cut: all is exact flight, or series."""
        return bool(self.series) or (self.flies_exactly and self.law is None)

    @property
    def flies_exactly(self) -> bool:
        """Whether steps without contact are exact, and as long as each lane can take them."""
        return self.by_series and self.follows_modes

    @property
    def staged(self) -> bool:
        """Whether exact flight goes on in sub-steps of the scheme's stages beside contacts."""
        return self.flies_exactly and not self.series and self.law is not None and not self.impulsive

    @property
    def blocks(self) -> bool:
        """Whether exact flight knows blocks of motions, not all their points: energies and histories ask for these."""
        # measured with either alone: tables take 4.9 times as long where 20 scenarios share a row of buildings, blocks
        # 1.2 to 1.5 times as long where thousands do
        pointwise = self.history or self.yielding or self.coupled or "energy" in self.reducers
        return self.flies_exactly and not (self.windows or pointwise)

    @property
    def coupled(self) -> bool:
        """Whether exact flight is in modes that hold both displacements and velocities."""
        damped = bool(self.dashpots) or any("c" in letters for letters in self.dense)
        return self.flies_exactly and (damped or bool(self.links or self.foundations))

    @property
    def coupled_groups(self) -> list[list[int]]:
        """Floors, then sways and rockings, of what moves as one: linked buildings, and each other one alone."""
        joined = {self.building_of[left] for left, _ in self.links}  # those with a link to the right
        groups: list[list[int]] = []
        for b in range(self.n_buildings):
            groups.append([*(groups.pop() if b - 1 in joined else ()), b])
        return [[i for i, b in enumerate(self.building_of) if b in group] for group in groups]

    @property
    def n_dof(self) -> int:
        """Floors of all buildings."""
        return sum(self.storeys)

    @property
    def n_moving(self) -> int:
        """Floors of all buildings, and sway and rocking of foundations."""
        return self.n_dof + 2 * len(self.foundations)

    @property
    def n_buildings(self) -> int:
        """Buildings in the row."""
        return len(self.storeys)

    @property
    def fused(self) -> bool:
        """Whether one step is one straight line."""
        return self.n_dof <= FUSED_DOF or bool(self.flowing or self.foundations or self.dense)

    @property
    def solves_row(self) -> bool:
        """Whether implicit steps are of the whole row: neighbours are linked, or buildings stand on foundations."""
        return bool(self.links or self.foundations or self.dense)

    @property
    def yielding(self) -> tuple[int, ...]:
        """Degrees of freedom whose storeys follow storey laws."""
        return tuple(dict.fromkeys(i for i, *_ in self.hysteretic))

    @property
    def storey_laws(self) -> list[StoreyLaw]:
        """Storey laws of the row."""
        return list(dict.fromkeys(law_of(name, compiled) for _, name, compiled in self.hysteretic))

    def of_springs(self, kind: str) -> tuple[str, ...]:
        """Names of what each spring has: its "constants", "rows" of state, or rows that are "moving" in a sub-step."""
        shares = ("stiffness_share",) if kind == "constants" and self.shares_storeys else ()
        return (*dict.fromkeys(name for law in self.storey_laws for name in getattr(law, kind)), *shares)

    @cached_property
    def springs_by_code(self) -> dict[Code, dict[int, int]]:
        """Numbers of springs by the degrees of freedom above them, of those whose code is one."""
        result: dict[Code, dict[int, int]] = {}
        for e, (floor, name, compiled) in enumerate(self.hysteretic):
            which = [other for other, *_ in self.hysteretic[:e]].count(floor)
            result.setdefault((name, compiled, which, e in self.infill), {})[floor] = e
        return result

    @cached_property
    def spring_names(self) -> frozenset[str]:
        """Rows of state and constants that each spring has."""
        moving = [f"{name}0" for name in self.of_springs("moving")]
        common = ("turn", "then", "travel", "flow", "rest", "strength_left", "failure_time")
        return frozenset((*self.of_springs("rows"), *self.of_springs("constants"), *moving, *common))

    @property
    def flowing(self) -> tuple[int, ...]:
        """Degrees of freedom whose storeys have internal variables that flow between events."""
        return tuple(dict.fromkeys(i for i, name, compiled in self.hysteretic if not law_of(name, compiled).straight))

    @property
    def shares_storeys(self) -> bool:
        """Whether a storey has several springs."""
        return len(self.yielding) < len(self.hysteretic)

    @property
    def follows_modes(self) -> bool:
        """Whether storeys that are elastic move in the modes of the row at rest."""
        return all(law.flies for law in self.storey_laws)

    def base(self, b: int) -> tuple[int, int] | None:
        """Sway and rocking of a building's foundation; None where it has none."""
        if b not in self.foundations:
            return None
        sway = self.n_dof + 2 * self.foundations.index(b)
        return sway, sway + 1

    def storey_ends(self, floor: int) -> Ends:
        """Return the ends of the storey below a floor: the floor, the one below, or the foundation, which tilts it."""
        base = self.base(self.building_of[floor]) or ()
        below, tilt = base[:1] if self.bottom[floor] else (floor - 1,), base[1:]
        return (floor, *below, *tilt), ((1, ""), *((-1, "") for _ in below), *((-1, "height") for _ in tilt))

    def contact_ends(self, j: int) -> Ends:
        """Return the ends of a contact: floors that meet, or those of a storey whose columns are struck; no wall."""
        ends: list[tuple[int, tuple[int, str]]] = []
        for side, (floor, sign) in enumerate(zip(self.contacts[j], (1, -1), strict=False)):
            struck = bool(self.struck) and self.struck[j] == side
            ends += [(floor - 1, (sign, "lower"))] if struck and not self.bottom[floor] else []
            ends += [(floor, (sign, "upper" if struck else ""))] if floor >= 0 else []
        return tuple(floor for floor, _ in ends), tuple(kind for _, kind in ends)

    @cached_property
    def floors(self) -> list[list[int]]:
        """Floors of each building, the lowest first."""
        ends = [0, *accumulate(self.storeys)]
        return [list(range(*pair)) for pair in pairwise(ends)]

    def dofs(self, b: int) -> list[int]:
        """Floors of a building, then sway and rocking of its foundation."""
        return [*self.floors[b], *(self.base(b) or ())]

    def letters(self, b: int) -> str:
        """Return what matrices connect of a building, out of "kmc"."""
        return self.dense[b] if self.dense else ""

    def dense_sizes(self, letters: str) -> list[int]:
        """Entries of a matrix of each building, of a triangle with its diagonal; 0 of those that have none."""
        sizes = [len(self.dofs(b)) for b in range(self.n_buildings)]
        return [n * (n + 1) // 2 if set(letters) & {*self.letters(b)} else 0 for b, n in enumerate(sizes)]

    @cached_property
    def building_of(self) -> list[int]:
        """Building of each degree of freedom."""
        floors = [b for b, n in enumerate(self.storeys) for _ in range(n)]
        return floors + [b for b in self.foundations for _ in range(2)]

    @cached_property
    def bottom(self) -> list[bool]:
        """Whether a degree of freedom is the lowest floor of its building."""
        return [s == 0 for n in self.storeys for s in range(n)]


def to_json(shape: KernelSpec) -> dict[str, Any]:
    """Return the shape as plain data."""
    return {**asdict(shape), "reducers": sorted(shape.reducers)}


def from_json(data: dict[str, Any]) -> KernelSpec:
    """Return the shape of `to_json`."""

    def frozen(value: Any) -> Any:
        if isinstance(value, dict):
            return LawShape(**value)
        return tuple(map(frozen, value)) if isinstance(value, list) else value

    values = {name: frozen(value) for name, value in data.items()}
    return KernelSpec(**{**values, "reducers": frozenset(data["reducers"])})


class Slots:
    """Named blocks of slots, one after another."""

    def __init__(self, count: dict[str, int]) -> None:
        self.count, self.size = count, sum(count.values())
        self.first = dict(zip(count, accumulate([0, *count.values()]), strict=False))


@lru_cache(maxsize=64)
def input_slots(shape: KernelSpec) -> Slots:
    """Layout of the values a scenario brings: record scale, intervals of rest, contact stiffness, gaps, damping."""
    count = {"scale": 1, "rests": 1}
    if shape.contacts:
        count["gap"] = shape.n_gaps
    if shape.law is not None:
        count |= {"k": len(shape.contacts) if shape.stiffness_per_contact else 1, "c": len(shape.contacts)}
    if shape.varied:
        shared = property_slots(shape).count
        count |= {"tables": 1} if shape.flies_exactly else {}
        count |= {f"p_{name}": shared[name] for name in (*VARIED, *shape.of_springs("constants")) if shared.get(name)}
    return Slots(count)


def property_slots(shape: KernelSpec) -> Slots:
    """Layout of the scene's constants, shared by all lanes (one number per slot)."""
    floors, moving, contacts = shape.n_dof, shape.n_moving, len(shape.contacts)
    count = dict.fromkeys(("m", "im", "k", "u0", "v0"), moving)
    count |= dict.fromkeys(("alpha", "beta"), shape.n_buildings) | {"reduced": contacts}
    count |= {"tangent": floors} if shape.yielding and shape.tangent else {}
    count |= {"geometric": floors} if shape.p_delta else {}
    count |= {"drift_limit": floors} if shape.limited else {}
    count |= dict.fromkeys(("cap", "newmark_beta", "newmark_gamma", "settles"), 1)
    # what the energy of a free vibration bounds displacements by, where no bounds of modes do
    count |= {} if shape.by_series else {"flexibility": floors}
    # shares of a push on columns, of the floor above and below
    count |= dict.fromkeys(("upper", "lower"), contacts) if shape.struck else {}
    for name, letters in (("dense_k", "k"), ("dense_c", "mc")) if shape.dense else ():
        count |= {name: sum(shape.dense_sizes(letters))}
    # shears, and the moment of each building, by displacements of its floors and base
    if shape.dense and "shear" in shape.reducers:
        count |= {
            "shear_weight": sum(n * len(shape.dofs(b)) for b, n in enumerate(shape.storeys)),
            "shear_soft": floors,
        }
    if "moment" in shape.reducers:
        count |= {"moment_weight": moving, "moment_soft": shape.n_buildings}
    count |= {"dashpot": moving} if shape.dashpots or shape.foundations else {}
    count |= dict.fromkeys(("link_k", "link_c"), len(shape.links)) if shape.links else {}
    # of each floor, above the floor below and above the base
    count |= dict.fromkeys(("height", "elevation"), floors) if shape.foundations else {}
    # where flight, which is one of all laws, finds it
    count |= {"longest": 1} if shape.flies_exactly and shape.law is not None else {}
    own = dict.fromkeys(shape.of_springs("constants"), len(shape.hysteretic))
    clash = own.keys() & count.keys()
    assert not clash, f"constants {clash} of a storey law have names of the kernel's own; name them otherwise"
    return Slots(count | own)


def history_slots(shape: KernelSpec) -> Slots:
    """Layout of one row of a history."""
    count = dict.fromkeys(("u", "v"), shape.n_moving)
    count |= dict.fromkeys(("kt", "ct", *(["kd"] if shape.tangent else [])), shape.n_dof) if shape.yielding else {}
    count |= dict.fromkeys(shape.of_springs("rows"), len(shape.hysteretic))
    count |= {"travel": len(shape.hysteretic)} if "hysteretic" in shape.reducers else {}
    count |= dict.fromkeys(("e_in", "e_damp"), shape.n_buildings) if "energy" in shape.reducers else {}
    count |= {"e_link": shape.n_buildings} if "links" in shape.reducers else {}
    if shape.law is not None:
        count |= dict.fromkeys(("force", *(("work",) if "work" in shape.reducers else ())), len(shape.contacts))
    return Slots(count)


def result_slots(shape: KernelSpec, reducers: Sequence[Any]) -> Slots:
    """Layout of a scenario's results: those of all kernels, then those of kernels with contacts."""
    count = {"flags": 1}  # bits `FLAG_...` of `kernel.march`
    count |= {"ended": 1} if shape.history else {}  # steps in all
    for touch in (False, True):
        if touch and shape.law is not None:
            count["shortest"] = len(shape.laws)  # shortest contact (s) of each law, by its elastic duration
        for reducer in (reducer for reducer in reducers if (reducer.where == "touch") == touch):
            count |= {slot.name: slot.count(shape) for slot in reducer.slots}
    return Slots(count)
