"""Between scenes and kernels: a scene under one law and one scheme, ready to run scenarios side by side."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np

from pounding_sweep.engine.flight import flight_tables, stops_of
from pounding_sweep.engine.kernel import make_group, width
from pounding_sweep.kernel import spec
from pounding_sweep.kernel.flight import Layout
from pounding_sweep.kernel.spec import LANES, KernelSpec, LawShape
from pounding_sweep.model.laws import Law
from pounding_sweep.model.meeting import column_shares
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import ELASTIC, Variants, coupled_modes, variants_of
from pounding_sweep.records import Record
from pounding_sweep.schemes import SCHEMES, Scheme
from pounding_sweep.schemes.stability import longest_substep
from pounding_sweep.variables.registry import REDUCERS, output_slots, parts_of

#: Largest product of an exact flight step and a modal frequency, of a building's first mode, its second and all
#: others: peaks are those of a septic between the ends, which errs by (w h)**8 / `SEPTIC` of what a mode adds.
FLIGHT_STEP = (0.9, 2.0, 2.8)
#: Largest divisor of these products: their errors are below any accuracy then, however often contacts are refined.
FINEST_FLIGHT = 4.0
#: What the errors of these septics are divided by: 8! 2**8.
SEPTIC = 10321920.0
#: Power of the refinement by which sub-steps by series fall: so much that two runs differ by their rounding.
SERIES_FALL = 0.5
#: Gap (m) of floors that never touch.
FAR_GAP = 1e6
#: Most periods of the slowest mode that rest after a record lasts, and what its amplitude has decayed to where no bound
#: tells that nothing changes any more: floors without a gap go on touching.
REST_PERIODS, SMALL_MOTION = 200.0, 1e-3
#: Tables of flight handed to a kernel at a time, where buildings vary (bytes).
TABLE_BYTES = 1 << 25
#: Of each thread: tables of flight that its last call filled, and what they are of.
_MEMORY = threading.local()


@dataclass(frozen=True)
class Numerics:
    """How scenarios are integrated."""

    method: str  # name of the scheme, one of `SCHEMES`
    dt: float  # largest time step (s); a record interval is cut into equal steps no longer than it
    locate: bool = True  # locate contacts and peaks inside the step
    #: Newmark's parameters
    beta: float = 0.25
    gamma: float = 0.5
    precision: str = "float64"  # number format of the kernel; one of {"float64", "float32"}
    #: divisor of lengths that `dt` does not set: of sub-steps of a stiff contact and of long steps of exact flight
    refinement: float = 1.0
    rest: float = 0.0  # time (s) after the record; infinite: until nothing changes any more

    @property
    def scheme(self) -> Scheme:
        """Scheme of that name."""
        return SCHEMES[self.method]

    def steps(self, record: Record) -> int:
        """Return the steps per record interval."""
        return max(1, math.ceil(record.dt / self.dt - 1e-9))


def kernel_shape(
    scene: Scene,
    law: Law,
    numerics: Numerics,
    reducers: Iterable[str],
    history: bool = False,
    varied: bool = False,
    windows: bool = True,
    by_pair: bool = False,
) -> KernelSpec:
    """Return what the kernel of a scene under a law is compiled for; no contact code where none can touch."""
    touching, buildings = law.has_contact and bool(scene.contacts), scene.buildings
    exists = parts_of(scene) | {"touch": touching}
    wanted = frozenset(name for name in reducers if exists[REDUCERS[name].where])
    if any(scene.falls):
        wanted |= {"collapse"}
    meets = touching or any(REDUCERS[name].where == "neighbours" for name in wanted)
    contacts = scene.contacts if meets else ()
    meeting = [(*((c.right, c.left) if c.tension else (c.left, c.right)), c.pair) for c in contacts]
    of_contacts = [_compiled(bumper.law) if bumper and touching else None for bumper in scene.bumper_of]
    bumpers = tuple(dict.fromkeys(filter(None, of_contacts)))
    return KernelSpec(
        storeys=tuple(b.n_storeys for b in buildings),
        contacts=tuple((*ends, j if bumpers else pair) for j, (*ends, pair) in enumerate(meeting)),
        n_gaps=len(scene.contacts if bumpers else scene.pair_names),
        law=_compiled(law) if touching else None,
        scheme=numerics.method,
        order=numerics.scheme.order,
        implicit=numerics.scheme.implicit,
        by_series=numerics.scheme.flies_exactly,
        located=numerics.locate,
        reducers=wanted,
        history=history,
        precision=numerics.precision,
        varied=varied,
        windows=windows and not history,
        hysteretic=tuple((x.floor, x.law.name, x.law.compiled(x.parameters)) for x in scene.springs),
        tangent=any(any(b.yields) and b.damping_stiffness == "tangent" for b in buildings),
        infill=tuple(e for e, spring in enumerate(scene.springs) if spring.is_infill),
        falling=tuple(np.flatnonzero(scene.falls).tolist()),
        limited=tuple(np.flatnonzero(np.isfinite(variants_of(scene).drift_limits)).tolist()),
        p_delta="shear" in wanted and any(b.p_delta and any(b.yields) for b in buildings),
        struck=tuple(c.struck for c in contacts) if any(c.struck >= 0 for c in contacts) else (),
        dashpots=tuple(np.flatnonzero(scene.dashed).tolist()),
        links=tuple((link.left, link.right) for link in scene.linked_floors),
        foundations=scene.foundations,
        dense=tuple(b.letters for b in buildings) if any(b.letters for b in buildings) else (),
        bumpers=bumpers,
        bumped=tuple(1 + bumpers.index(law) if law else 0 for law in of_contacts) if bumpers else (),
        stiffness_per_contact=bool(bumpers or any(c.struck >= 0 for c in contacts) or (by_pair and touching)),
    )


@lru_cache(maxsize=64)
def _compiled(law: Law) -> LawShape:
    """Part of a law that is compiled."""
    values: dict[str, Any] = {item.name: getattr(law, item.name, None) for item in fields(LawShape)}
    return LawShape(**{**values, "exponent": law.exponent or 1.0, "per_speed": law.damping == "elastic"})


def flight_refinement(accuracy: float) -> float:
    """Divisor of flight's steps with which their septics lose no more than `accuracy` of any mode."""
    return float(FLIGHT_STEP[-1] / (SEPTIC * accuracy) ** 0.125)


def _packed(slots: spec.Slots, values: Mapping[str, Any], n: int) -> np.ndarray:
    """Put values of shape (slots, n), or one for all n, where their slots lie; 0 where there are none."""
    rows = np.zeros((slots.size, n))
    for name, value in values.items():
        first = slots.first[name]
        rows[first : first + slots.count[name]] = value
    return rows


@lru_cache(maxsize=64)
def _constants(
    shape: KernelSpec, scene: Scene, numerics: Numerics, initial_velocity: tuple[float, ...] | None, rough: bool
) -> np.ndarray:
    """Scene constants in a kernel's layout: each chunk asks for them."""
    slots, row = spec.property_slots(shape), variants_of(scene)
    cap = (spec.STAGED_CAP if shape.staged else spec.CONTACT_CAP) / numerics.refinement
    values: dict[str, Any] = {name: read(row).T for name, read in PROPERTIES.items() if slots.count.get(name)}
    values |= {name: numbers.T for name, numbers in row.spring_constants.items() if name in slots.first}
    values["cap"] = spec.SERIES_CAP / numerics.refinement**SERIES_FALL if shape.series else cap
    values |= {"newmark_beta": numerics.beta, "newmark_gamma": numerics.gamma}
    values["settles"] = float(numerics.rest == math.inf)
    if initial_velocity is not None:
        values["v0"] = np.reshape([*initial_velocity, *[0.0] * (shape.n_moving - len(initial_velocity))], (-1, 1))
    if shape.staged:
        values["longest"] = longest_substep(row, numerics.dt, rough, shape.reducers)[0]
    return _packed(slots, values, 1)[:, 0].astype(numerics.precision)


@lru_cache(maxsize=64)
def _layout(shape: KernelSpec, scene: Scene) -> Layout:
    """Where a kernel's tables of flight lie, and what is watched, whatever the steps."""
    constants = _constants(shape, scene, Numerics(shape.scheme, 1.0, precision=shape.precision), None, rough=False)
    return Layout(make_group(shape, None, width(shape.precision), constants))


def longest_rest(row: Scene | Variants) -> tuple[np.ndarray, np.ndarray]:
    """Most time (s) that rests last, and until their motions are small, of each variant; 0 without damping."""
    variants, scene = variants_of(row), variants_of(row).scene
    frequencies, rates = [], []
    for group, system in zip(scene.linked_buildings, variants.systems, strict=True):
        if len(group) == 1 and scene.buildings[group[0]].dashpots:
            *_, w, drags = variants.modal(group)
            system = w, np.diagonal(drags, axis1=1, axis2=2)  # noqa: PLW2901
        w, drag = (item[:, : 2 * len(group)] for item in system)  # the modes that move buildings most
        frequencies.append(w[:, 0])
        ratio = 0.5 * drag / w
        rates.append((w * (ratio - np.sqrt(np.maximum(ratio**2 - 1.0, 0.0)))).min(axis=1))
    longest, rate = REST_PERIODS * 2.0 * np.pi / np.min(frequencies, axis=0), np.min(rates, axis=0)
    small = np.minimum(longest, -math.log(SMALL_MOTION) / np.where(rate > 0.0, rate, np.inf))
    return np.where(rate > 0.0, longest, 0.0), small


def _ground(motion: np.ndarray, steps: int) -> np.ndarray:
    """Accelerations of the ground at the ends of so many steps in each interval of its motion."""
    inner = motion[:-1, None] + (motion[1:] - motion[:-1])[:, None] * (np.arange(steps) / steps)
    return np.append(inner.ravel(), motion[-1])


@dataclass(frozen=True)
class RowKernel:
    """A scene under one law and one scheme, ready to run."""

    scene: Scene  # the row
    law: Law  # contact law
    numerics: Numerics  # scheme and step
    reducers: frozenset[str]  # what is kept of each scenario
    history: bool = False  # keep the state of the first scenario after every step
    #: velocity (m/s) of every floor, building by building; at rest where not given
    initial_velocity: tuple[float, ...] | None = None
    #: damped law in whose kernel this undamped one runs, with c = 0; or any in whose no pounding does, at `FAR_GAP`
    host: Law | None = None
    #: what damping follows from: the law's formula ("published"), or the rebound of two free masses ("realised")
    basis: str = "published"
    varied: bool = False  # building properties differ from scenario to scenario
    #: exact flight leaves out windows of the record: worth it where several scenarios share a row of buildings
    windows: bool = True
    by_pair: bool = False  # pairs have contact stiffnesses of their own
    accuracy: float | None = None  # relative error that each scenario is refined to, from this step on

    @cached_property
    def shape(self) -> KernelSpec:
        """What the kernel is compiled for."""
        law = self.host or self.law
        return kernel_shape(
            self.scene, law, self.numerics, self.reducers, self.history, self.varied, self.windows, self.by_pair
        )

    @property
    def in_double(self) -> RowKernel:
        """The kernel in double precision, at the same steps."""
        return replace(self, numerics=replace(self.numerics, precision="float64"))

    def constants(self, rough: bool = False) -> np.ndarray:
        """Scene constants in the kernel's layout, under a ground motion that is rough or not."""
        return _constants(self.shape, self.scene, self.numerics, self.initial_velocity, rough)

    def intervals_of_rest(self, record: Record, row: Variants, gaps: np.ndarray) -> np.ndarray:
        """Return the record intervals that rests last at most, of each scenario, by its gaps (m)."""
        rest: Any = self.numerics.rest
        clearance = np.min(self._clearances(gaps), axis=1, initial=math.inf)
        if rest == math.inf:
            longest, small = longest_rest(row)
            bounded = ((clearance > 0.0) | (not self._touches)) & self.shape.rest_is_bounded
            # storeys that degrade change their branches in the smallest motion
            bounded = bounded & (not any(spring.law.softens for spring in self.scene.springs))
            rest = np.where(bounded, longest, small)
        return np.asarray(np.ceil(np.broadcast_to(rest, clearance.shape) / record.dt - 1e-9), int)

    def flight_substeps(self, record: Record, variants: Variants | None = None) -> np.ndarray:
        """Return the exact steps of free flight per record interval: a divisor of the steps."""
        row, steps = variants_of(self.scene) if variants is None else variants, self.numerics.steps(record)
        if self.history:
            return np.full(len(row), steps)
        frequencies = row.frequencies
        if self.shape.coupled:
            at = np.cumsum([0, *map(len, self.shape.coupled_groups)])
            w = coupled_modes(row, self.shape.precision).w
            frequencies = [w[:, low:high] for low, high in pairwise(at)]
        rates = np.zeros(len(row))  # least inverse (1/s) of an exact step
        for w in frequencies:
            first = w[:, : len(FLIGHT_STEP)] / FLIGHT_STEP[: w.shape[1]]
            rates = np.maximum(rates, np.maximum(first.max(axis=1), w[:, -1] / FLIGHT_STEP[-1]))
        rates *= record.dt * min(self.numerics.refinement, FINEST_FLIGHT)
        divisors = np.array([n for n in range(1, steps + 1) if steps % n == 0])
        return divisors[np.minimum(np.searchsorted(divisors, rates), len(divisors) - 1)]

    def run(
        self,
        record: Record,
        *,
        scale: np.ndarray,
        gaps: np.ndarray,
        stiffness: np.ndarray,
        restitution: np.ndarray,
        variants: Variants | None = None,
        history: np.ndarray | None = None,
        twin: bool = False,
    ) -> dict[str, np.ndarray]:
        """Integrate scenarios over a record, by the compiled kernel or its twin in plain Python."""
        from pounding_sweep.engine import compile
        from pounding_sweep.engine.kernel import run_twin

        shape, n, groups = self.shape, len(scale), -(-len(scale) // LANES)
        outputs, row = output_slots(shape), variants_of(self.scene) if variants is None else variants
        rests = self.intervals_of_rest(record, row, gaps)
        # in the first interval of a rest the ground comes to rest
        motion = np.append(record.acceleration, [0.0] * bool(rests.any()))
        steps = flight_substeps = self.numerics.steps(record)
        track = np.zeros(1, shape.precision)
        if shape.by_series:
            flight_substeps = int(self.flight_substeps(record, row).max())
            steps = flight_substeps if shape.series or shape.staged else steps
            track = _ground(motion, steps).astype(shape.precision)
        results = np.zeros((groups, outputs.size * LANES))
        history = np.zeros((1, 1)) if history is None else history
        kernel = partial(run_twin, shape) if twin else compile.get_kernel(shape)
        brought = [np.asarray(values, float) for values in (scale, gaps, stiffness, restitution, rests)]
        first = 0
        while first < groups:
            part = row[first * LANES :]
            tables, buildings, count = self._tables(record, motion, flight_substeps, part, groups - first, twin)
            mine = slice(first * LANES, (first + count) * LANES)
            lanes = self._lanes(buildings, row[mine], record.is_rough, (values[mine] for values in brought))
            kernel(
                motion,
                float(record.dt),
                record.n_points - 1,
                steps,
                flight_substeps,
                self.constants(record.is_rough),
                lanes,
                results[first : first + count],
                history,
                track,
                *tables,
                len(scale[mine]),
            )
            if self._shares_tables and not twin:
                _MEMORY.filled = (shape, self.scene, record, flight_substeps, len(motion)), tables[:2]
            first += count
        by_slot = results.reshape(groups, outputs.size, LANES).transpose(1, 0, 2).reshape(outputs.size, -1)[:, :n]
        raw = {name: by_slot[i : i + outputs.count[name]].T for name, i in outputs.first.items()}
        # what status and first touch ask of the scenario beside its results
        raw["scale"] = brought[0][:, None]
        raw["gap"] = self.scene.clearances(brought[1], self.law.thickness)
        if self._touches:  # by how much damping shortens contacts, of each law of it
            raw["quickening"] = quickening = np.ones((n, len(shape.laws)))
            quickening[:, 0] = self.law.quickening(brought[3].reshape(n, -1), self.basis).max(axis=1)
            for which, bumper in zip(shape.bumped, self.scene.bumper_of, strict=False):
                if bumper:
                    quickening[:, which] = np.maximum(quickening[:, which], bumper.quickening(self.basis))
        return raw

    def _clearances(self, gaps: np.ndarray) -> np.ndarray:
        """Return the gaps (m) that are left beside bumpers, of pairs or, where there are any, of contacts."""
        thickness = self.law.thickness
        return self.scene.clearances(gaps, thickness) if self.shape.bumped else gaps - thickness

    @property
    def _touches(self) -> bool:
        """Whether floors can touch."""
        return self.shape.law is not None and self.law.has_contact

    @property
    def _shares_tables(self) -> bool:
        """Whether all scenarios under a record share one table of flight."""
        return self.shape.flies_exactly and not (self.varied or self.shape.blocks)

    def _tables(
        self, record: Record, motion: np.ndarray, n: int, row: Variants, most_groups: int, twin: bool
    ) -> tuple[tuple[np.ndarray, np.ndarray, int], np.ndarray, int]:
        """Return tables of flight in `n` steps an interval, which each scenario has, and how many groups they serve."""
        shape, precision = self.shape, self.numerics.precision
        if not shape.flies_exactly:
            return (np.zeros(1, precision), np.zeros(1), 0), np.zeros(1), most_groups
        stay = self._shares_tables and not twin
        filled, tables = getattr(_MEMORY, "filled", (None, ()))
        if stay and filled == (shape, self.scene, record, n, len(motion)):  # by this thread's last call
            return (*tables, 0), np.zeros(1), most_groups
        layout = _layout(shape, self.scene)
        stops = stops_of(layout, (len(motion) - 1) * n + 1, n)
        row = row if self.varied else variants_of(self.scene)
        new, which = (np.zeros(1, int), np.zeros(1, int)) if len(row) == 1 else row.flights()
        most = max(1, TABLE_BYTES // (np.dtype(precision).itemsize * layout.size(stops)))
        late = np.flatnonzero(which >= most)
        groups = max(1, int(late[0]) // LANES) if len(late) else most_groups
        which = which[: groups * LANES]
        needed = new[: int(which.max()) + 1]
        rows_of = row[needed] if len(needed) < len(row) else row
        tables = flight_tables(layout, rows_of, stops, _ground(motion, n), record.dt / n, precision, n, stay)
        return (*tables, len(needed)), which, groups

    def _lanes(self, buildings: np.ndarray, row: Variants, rough: bool, inputs: Iterable[np.ndarray]) -> np.ndarray:
        """Return the inputs of scenarios as they lie in the lanes, shape (groups, slots times lanes)."""
        scale, gaps, stiffness, restitution, rests = inputs
        stiffness = stiffness if self._touches else np.ones_like(stiffness)
        shape, slots, n = self.shape, spec.input_slots(self.shape), len(scale)
        values: dict[str, Any] = {"scale": scale, "rests": rests}
        if shape.contacts:
            values["gap"] = self._clearances(gaps).T if self._touches else FAR_GAP
        if shape.law is not None:
            k = row.contact_stiffnesses(stiffness).T if shape.stiffness_per_contact else stiffness[None, :]
            e = restitution if restitution.ndim == 1 else self.scene.of_contacts(restitution).T
            c = np.zeros((len(shape.contacts), n))
            if self._touches:
                c = self.law.damping_coefficient(e, k, row.contact_masses.T, self.basis)
            for j, bumper in enumerate(self.scene.bumper_of if shape.bumped else ()):
                if bumper:
                    k[j], c[j] = bumper.stiffness, bumper.damping_coefficient(row.contact_masses[:, j], self.basis)
            values |= {"k": k, "c": c}
        if self.varied:
            values |= {f"p_{name}": read(row).T for name, read in PROPERTIES.items() if f"p_{name}" in slots.first}
            of_springs = row.spring_constants.items()
            values |= {f"p_{name}": numbers.T for name, numbers in of_springs if f"p_{name}" in slots.first}
            if shape.flies_exactly:
                values["tables"] = buildings
            if "p_longest" in slots.first:
                longest = longest_substep(row, self.numerics.dt, rough, shape.reducers) if shape.staged else 0.0
                values["p_longest"] = longest
        groups, packed = -(-n // LANES), _packed(slots, values, n)
        rows = np.pad(packed, ((0, 0), (0, groups * LANES - n)), "edge")  # idle lanes repeat the last scenario
        return rows.reshape(-1, groups, LANES).transpose(1, 0, 2).reshape(groups, -1)


def _of_moving(name: str) -> Callable[[Variants], np.ndarray]:
    """Return what reads a property of floors, then of foundations."""
    return lambda row: np.concatenate([getattr(row, name), getattr(row, f"base_{name}")], axis=1)


#: Building properties by the name of their slots: what reads them, shape (n or 1, slots).
PROPERTIES: dict[str, Callable[[Variants], np.ndarray]] = {
    "m": _of_moving("masses"),
    "im": lambda row: 1.0 / _of_moving("masses")(row),
    "k": _of_moving("stiffnesses"),
    "alpha": lambda row: row.rayleigh_factors[0],
    "beta": lambda row: row.rayleigh_factors[1],
    "reduced": lambda row: row.contact_masses,
    "geometric": lambda row: row.geometric_stiffnesses,
    "flexibility": lambda row: row.flexibilities,
    "drift_limit": lambda row: np.minimum(row.drift_limits, ELASTIC)[None, :],
    "tangent": lambda row: np.array(
        [[float(b.damping_stiffness == "tangent") for b in row.scene.buildings for _ in b.masses]]
    ),
    # shares of each contact's push that the floors below and above it take
    "lower": lambda row: np.array([[column_shares(contact.xi)[0] for contact in row.scene.contacts]]),
    "upper": lambda row: np.array([[column_shares(contact.xi)[1] for contact in row.scene.contacts]]),
    "dashpot": _of_moving("dashpots"),
    "dense_k": lambda row: row.dense("dense_k"),
    "dense_c": lambda row: row.dense("dense_c"),
    "shear_weight": lambda row: np.concatenate([b.shears.ravel() for b in row.scene.buildings])[None],
    "shear_soft": lambda row: row.softness("shear"),
    "moment_weight": lambda row: np.concatenate([b.moment for b in row.scene.buildings])[None],
    "moment_soft": lambda row: row.softness("moment"),
    "height": lambda row: row.storey_heights[None, :],
    "elevation": lambda row: np.concatenate([b.elevations for b in row.scene.buildings])[None, :],
    "link_k": lambda row: np.array([[link.stiffness for link in row.scene.linked_floors]]),
    "link_c": lambda row: np.array([[link.damping for link in row.scene.linked_floors]]),
}
