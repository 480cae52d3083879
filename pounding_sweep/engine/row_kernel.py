"""Between scenes and kernels: a scene under one law and one scheme, ready to run scenarios side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from pounding_sweep.engine.flight import Fixed, filled_tables, fixed_tables, flight_tables, keep_filled, stops_of
from pounding_sweep.engine.kernel import make_group, width
from pounding_sweep.kernel.flight import Layout
from pounding_sweep.kernel.spec import (
    CONTACT_CAP,
    LANES,
    SERIES_CAP,
    STAGED_CAP,
    KernelSpec,
    LawShape,
    input_slots,
    property_slots,
)
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import Building, Scene, column_shares
from pounding_sweep.model.variants import Variants, coupled_modes, variants_of
from pounding_sweep.outputs.variables import REDUCERS, output_slots
from pounding_sweep.records import Record
from pounding_sweep.schemes import SCHEMES, Scheme
from pounding_sweep.schemes.stability import longest_substep

#: Largest product of an exact flight step and a modal frequency, of a building's first mode, its second and all
#: others: peaks are those of a septic between the ends, which errs by (w h)**8 / `SEPTIC` of what a mode adds.
FLIGHT_STEP = (0.9, 2.0, 2.8)
#: Largest divisor of these products: their errors are below any accuracy then, however often contacts are refined.
FINEST_FLIGHT = 4.0
#: What the errors of these septics are divided by: 8! 2**8.
SEPTIC = 10321920.0
#: Power of the refinement by which sub-steps by series fall: so much that two runs differ by their rounding.
SERIES_FALL = 0.5
#: Yield drift (m) of storeys that never yield, in both number formats.
ELASTIC = 1e30
#: Tables of flight handed to a kernel at a time, where buildings vary (bytes).
TABLE_BYTES = 1 << 25


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
) -> KernelSpec:
    """Return what the kernel of a scene under a law is compiled for; no contact code where none can touch."""
    touching, yields = law.has_contact and bool(scene.contacts), scene.yields
    exists = {
        "": True,
        "touch": touching,
        "neighbours": bool(scene.contacts),
        "yields": any(yields),
        "linked": bool(scene.links),
        "founded": bool(scene.foundations),
    }
    wanted = frozenset(name for name in reducers if exists[REDUCERS[name].where])
    falls = any(b.p_delta and any(b.yields) for b in scene.buildings)
    if falls:  # which its drift tells
        wanted |= {"drift"}
    meets = touching or any(REDUCERS[name].where == "neighbours" for name in wanted)
    smooth = [building.bouc_wen for building in scene.buildings for _ in building.masses]
    own = [_compiled(bumper.law) for bumper in scene.bumper_of if bumper] if touching else []
    bumpers = tuple(dict.fromkeys(own))
    return KernelSpec(
        storeys=tuple(b.n_storeys for b in scene.buildings),
        contacts=tuple((c.left, c.right, j if bumpers else c.pair) for j, c in enumerate(scene.contacts))
        if meets
        else (),
        n_gaps=len(scene.contacts if bumpers else scene.pair_names),
        law=_compiled(law) if touching else None,
        scheme=numerics.method,
        order=numerics.scheme.order,
        implicit=numerics.scheme.implicit,
        flies_exactly=numerics.scheme.flies_exactly,
        located=numerics.locate,
        reducers=wanted,
        history=history,
        precision=numerics.precision,
        varied=varied,
        windows=windows and not history,
        yielding=tuple(i for i, each in enumerate(yields) if each),
        tangent=any(any(b.yields) and b.damping_stiffness == "tangent" for b in scene.buildings),
        p_delta=falls and "shear" in wanted,
        smooth=tuple((i, law.n) for i, law in enumerate(smooth) if law is not None and yields[i]),
        struck=tuple(c.struck for c in scene.contacts) if meets and any(c.struck >= 0 for c in scene.contacts) else (),
        dashpots=tuple(i for i, each in enumerate(scene.dashed) if each),
        links=tuple((link.left, link.right) for link in scene.linked_floors),
        foundations=scene.foundations,
        bumpers=bumpers,
        bumped=tuple(1 + bumpers.index(_compiled(b.law)) if b else 0 for b in scene.bumper_of) if bumpers else (),
    )


@lru_cache(maxsize=64)
def _compiled(law: Law) -> LawShape:
    """Part of a law that is compiled."""
    return LawShape(
        law.elastic,
        law.elastic_slope,
        law.damper,
        law.damper_slope,
        law.exponent or 1.0,
        law.approach_only,
        law.tension,
        law.damping == "elastic",
        law.damper_exponent,
        law.impulsive,
        law.yields,
        law.rebound_only,
        law.is_power,
        law.grows,
    )


def flight_refinement(accuracy: float) -> float:
    """Divisor of flight's steps with which their septics lose no more than `accuracy` of any mode."""
    return float(FLIGHT_STEP[-1] / (SEPTIC * accuracy) ** 0.125)


def _flight_rate(w: np.ndarray) -> Any:
    """Least inverse (1/s) of an exact flight step, by natural frequencies of buildings, rising along the last axis."""
    first = w[..., : len(FLIGHT_STEP)]
    return np.maximum((first / FLIGHT_STEP[: first.shape[-1]]).max(axis=-1), w[..., -1] / FLIGHT_STEP[-1])


@lru_cache(maxsize=64)
def _constants(
    shape: KernelSpec, scene: Scene, numerics: Numerics, initial_velocity: tuple[float, ...] | None, rough: bool
) -> np.ndarray:
    """Scene constants in a kernel's layout: each chunk asks for them."""
    slots = property_slots(shape)
    values = np.zeros(slots.size, numerics.precision)

    def put(name: str, numbers: Any) -> None:
        numbers = np.atleast_1d(np.asarray(numbers, dtype=float))
        values[slots.first[name] : slots.first[name] + slots.count[name]] = numbers[: slots.count[name]]

    for name, values_of in _PROPERTIES.items():
        if slots.count.get(name):
            put(name, values_of(variants_of(scene))[0])
    if initial_velocity is not None:
        put("v0", (*initial_velocity, *[0.0] * (slots.count["v0"] - len(initial_velocity))))
    cap = STAGED_CAP if shape.staged else CONTACT_CAP
    put("cap", SERIES_CAP / numerics.refinement**SERIES_FALL if shape.series else cap / numerics.refinement)
    if shape.staged:
        put("longest", longest_substep(variants_of(scene), numerics.dt, rough, shape.reducers)[0])
    put("newmark_beta", numerics.beta)
    put("newmark_gamma", numerics.gamma)
    return values


@lru_cache(maxsize=64)
def _layout(shape: KernelSpec, scene: Scene) -> Layout:
    """Where a kernel's tables of flight lie, and what is watched, whatever the steps."""
    constants = _constants(shape, scene, Numerics(shape.scheme, 1.0, precision=shape.precision), None, rough=False)
    return Layout(make_group(shape, None, width(shape.precision), constants))


def _fixed_tables(shape: KernelSpec, row: Variants, record: Record, flight_substeps: int) -> tuple[Fixed, np.ndarray]:
    """Tables of flight of some rows of buildings that hold at any time, and what a kernel fills the others from."""
    n = flight_substeps
    return fixed_tables(_layout(shape, row.scene), row, _ground(record, n), record.dt / n, shape.precision, n)


def _ground(record: Record, steps: int) -> np.ndarray:
    """Accelerations of the ground at the ends of so many steps in each interval of the record."""
    motion = np.array(record.acceleration)
    inner = motion[:-1, None] + (motion[1:] - motion[:-1])[:, None] * (np.arange(steps) / steps)
    return np.append(inner.ravel(), motion[-1])


#: Those of a scene as given: all its runs under a record share them, whatever their sub-steps in contact.
_fixed_tables_of_scene = lru_cache(maxsize=8)(_fixed_tables)


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
    host: Law | None = None  # damped law in whose kernel this undamped one runs, with c = 0
    #: whether damping follows from the restitution by the law's published formula, or so that two free masses rebound
    #: at exactly it; one of {"published", "realised"}
    basis: str = "published"
    varied: bool = False  # building properties differ from scenario to scenario
    #: exact flight leaves out windows of the record: worth it where several scenarios share a row of buildings
    windows: bool = True
    accuracy: float | None = None  # relative error that each scenario is refined to, from this step on

    @cached_property
    def shape(self) -> KernelSpec:
        """What the kernel is compiled for."""
        law = self.host or self.law
        return kernel_shape(self.scene, law, self.numerics, self.reducers, self.history, self.varied, self.windows)

    @property
    def in_double(self) -> RowKernel:
        """The kernel in double precision, at the same steps."""
        return replace(self, numerics=replace(self.numerics, precision="float64"))

    def constants(self, rough: bool = False) -> np.ndarray:
        """Scene constants in the kernel's layout, under a ground motion that is rough or not."""
        return _constants(self.shape, self.scene, self.numerics, self.initial_velocity, rough)

    def flight_substeps(self, record: Record, variants: Variants | None = None) -> np.ndarray:
        """Return the exact steps of free flight per record interval: a divisor of the steps."""
        row = variants_of(self.scene) if variants is None else variants
        return (_substeps_of_one if len(row) == 1 else RowKernel._flight_substeps)(self, record, row)

    def _flight_substeps(self, record: Record, row: Variants) -> np.ndarray:
        steps = self.numerics.steps(record)
        if self.history:
            return np.full(len(row), steps)
        frequencies = row.frequencies
        if self.shape.coupled:
            w, at = coupled_modes(row, self.shape.precision).w, np.cumsum([0, *(many for _, many in self.shape.flocks)])
            frequencies = [w[:, low:high] for low, high in pairwise(at)]
        need = np.max([_flight_rate(w) for w in frequencies], axis=0)
        need *= record.dt * min(self.numerics.refinement, FINEST_FLIGHT)
        divisors = np.array([n for n in range(1, steps + 1) if steps % n == 0])
        return np.asarray(divisors[np.minimum(np.searchsorted(divisors, need), len(divisors) - 1)])

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
        from pounding_sweep.engine.compile import get_kernel, twin_of

        n = len(scale)
        groups = -(-n // LANES)
        outputs = output_slots(self.shape)
        row = variants_of(self.scene) if variants is None else variants
        flight_substeps = int(self.flight_substeps(record, row).max())
        results = np.zeros((groups, outputs.size * LANES))
        if history is None:
            history = np.zeros((1, 1))
        kernel = (twin_of if twin else get_kernel)(self.shape)
        steps = flight_substeps if self.shape.series or self.shape.staged else self.numerics.steps(record)
        track = _ground(record, steps) if self.shape.flies_exactly else np.zeros(1)
        track = track.astype(self.shape.precision)
        given = {"scale": scale, "gaps": gaps, "stiffness": stiffness, "restitution": restitution}
        given = {name: np.asarray(values, float) for name, values in given.items()}
        first = 0
        while first < groups:
            part = row[first * LANES :]
            tables, buildings, groups_done, shared = self._tables(record, flight_substeps, part, groups - first, twin)
            mine = slice(first * LANES, (first + groups_done) * LANES)
            inputs = {name: values[mine] for name, values in given.items()}
            lanes = self._lanes(buildings, row=row[mine], rough=record.is_rough, **inputs)
            kernel(
                np.array(record.acceleration),
                float(record.dt),
                steps,
                flight_substeps,
                self.constants(record.is_rough),
                lanes.reshape(len(lanes), -1),
                results[first : first + groups_done],
                history,
                track,
                *tables,
                len(inputs["scale"]),
            )
            if shared is not None:
                keep_filled(shared, tables[0])
            first += groups_done
        by_slot = results.reshape(groups, outputs.size, LANES).transpose(1, 0, 2).reshape(outputs.size, -1)[:, :n]
        found = {name: by_slot[i : i + outputs.count[name]].T for name, i in outputs.first.items()}
        # what the status asks of the scenario beside its results
        found["scale"] = given["scale"][:, None]
        if self.shape.law is not None:  # factors by which damping shortens contacts, of each law of the kernel
            quickening = np.ones((n, len(self.shape.laws)))
            quickening[:, 0] = self.law.quickening(given["restitution"], self.basis)
            for which, bumper in zip(self.shape.bumped, self.scene.bumper_of, strict=False):
                if bumper:
                    quickening[:, which] = np.maximum(quickening[:, which], bumper.quickening(self.basis))
            found["quickening"] = quickening
        return found

    def _tables(
        self, record: Record, flight_substeps: int, row: Variants, most_groups: int, twin: bool
    ) -> tuple[tuple[np.ndarray, np.ndarray, int], np.ndarray, int, Fixed | None]:
        """Tables of flight, which each scenario needs, how many groups (at most so many) they serve; their `Fixed`."""
        if not self.numerics.scheme.flies_exactly:
            return (np.zeros(1, self.numerics.precision), np.zeros(1), 0), np.zeros(1), most_groups, None
        new, which = (np.zeros(1, int), np.zeros(1, int)) if len(row) == 1 else row.flights()
        points, precision = (record.n_points - 1) * flight_substeps + 1, self.numerics.precision
        layout = _layout(self.shape, self.scene)
        stops = stops_of(layout, points, flight_substeps)
        most = max(1, TABLE_BYTES // (np.dtype(precision).itemsize * layout.size(stops)))
        late = np.flatnonzero(which >= most)
        groups = max(1, int(late[0]) // LANES) if len(late) else most_groups
        which = which[: groups * LANES]
        needed = new[: int(which.max()) + 1]
        rows: Any = needed if len(needed) < len(row) else slice(None)
        if self.varied or self.shape.blocks:
            fixed, decays = _fixed_tables(self.shape, row[rows], record, flight_substeps)
            return (flight_tables(layout, stops, fixed), decays, len(needed)), which, groups, None
        fixed, decays = _fixed_tables_of_scene(self.shape, variants_of(self.scene), record, flight_substeps)
        if not twin and (filled := filled_tables(fixed)) is not None:
            return (filled, decays, 0), which, groups, None
        tables = flight_tables(layout, stops, fixed, stay=not twin)
        return (tables, decays, len(needed)), which, groups, None if twin else fixed

    def _lanes(
        self,
        buildings: np.ndarray,
        *,
        scale: np.ndarray,
        gaps: np.ndarray,
        stiffness: np.ndarray,
        restitution: np.ndarray,
        row: Variants,
        rough: bool,
    ) -> np.ndarray:
        """Return the inputs of scenarios as they lie in the lanes, shape (groups, slots, lanes)."""
        slots, n = input_slots(self.shape), len(scale)
        groups = -(-n // LANES)
        rows = np.empty((slots.size, groups * LANES))

        def put(name: str, values: np.ndarray) -> None:
            """Put in values of shape (slots, n), or (slots, 1) where all lanes agree."""
            first = slots.first[name]
            rows[first : first + slots.count[name], :n] = values

        put("scale", scale[None, :])
        if "gap" in slots.first:
            thickness: Any = self.law.thickness
            if self.shape.bumped:
                gaps = gaps[:, [contact.pair for contact in self.scene.contacts]]
                thickness = self.scene.thicknesses(thickness)
            put("gap", (gaps - thickness).T)
        if self.shape.law is not None:
            k = row.contact_stiffnesses(stiffness).T if self.shape.own_stiffness else stiffness[None, :]
            c = self.law.damping_coefficient(restitution, k, row.contact_masses.T, self.basis)
            for j, bumper in enumerate(self.scene.bumper_of if self.shape.bumped else ()):
                if bumper:
                    k[j], c[j] = bumper.stiffness, bumper.damping_coefficient(row.contact_masses[:, j], self.basis)
            put("k", k)
            put("c", c)
        if self.varied:
            for name, values_of in _PROPERTIES.items():
                if f"p_{name}" in slots.first:
                    put(f"p_{name}", values_of(row).T)
            if self.numerics.scheme.flies_exactly:
                put("tables", buildings[None, :])
                if "p_longest" in slots.first:
                    about = row, self.numerics.dt, rough, self.shape.reducers
                    put("p_longest", longest_substep(*about)[None, :] if self.shape.staged else np.zeros((1, 1)))
        rows[:, n:] = rows[:, n - 1 : n]  # idle lanes repeat the last scenario
        return np.ascontiguousarray(rows.reshape(-1, groups, LANES).transpose(1, 0, 2))


#: Exact steps of a single row: each chunk asks for them.
_substeps_of_one = lru_cache(maxsize=64)(RowKernel._flight_substeps)


def _of_moving(name: str) -> Callable[[Variants], np.ndarray]:
    """Return what reads a property of floors, then of foundations."""
    return lambda row: np.concatenate([getattr(row, name), getattr(row, f"base_{name}")], axis=1)


def _of_storeys(read: Callable[[Building], float]) -> Callable[[Variants], np.ndarray]:
    """Return what reads a property that all storeys of a building share, of each floor."""
    return lambda row: np.array([[float(read(b)) for b in row.scene.buildings for _ in b.masses]])


#: Building properties by the name of their slots: what reads them, shape (n or 1, slots).
_PROPERTIES: dict[str, Callable[[Variants], np.ndarray]] = {
    "m": _of_moving("masses"),
    "im": lambda row: 1.0 / _of_moving("masses")(row),
    "k": _of_moving("stiffnesses"),
    "alpha": lambda row: row.rayleigh_factors[0],
    "beta": lambda row: row.rayleigh_factors[1],
    "reduced": lambda row: row.contact_masses,
    "hardening": lambda row: row.hardenings,
    "yield_drift": lambda row: np.minimum(row.yield_drifts, ELASTIC),
    "geometric": lambda row: row.geometric_stiffnesses,
    "tangent": _of_storeys(lambda b: b.damping_stiffness == "tangent"),
    # shares of each contact's push that the floors below and above it take
    "lower": lambda row: np.array([[column_shares(contact.xi)[0] for contact in row.scene.contacts]]),
    "upper": lambda row: np.array([[column_shares(contact.xi)[1] for contact in row.scene.contacts]]),
    "dashpot": _of_moving("dashpots"),
    "height": lambda row: row.storey_heights[None, :],
    "elevation": lambda row: np.concatenate([b.elevations for b in row.scene.buildings])[None, :],
    "link_k": lambda row: np.array([[link.stiffness for link in row.scene.linked_floors]]),
    "link_c": lambda row: np.array([[link.damping for link in row.scene.linked_floors]]),
    # zero where the law of Bouc and Wen is not the storey's
    "wen_beta": _of_storeys(lambda b: b.bouc_wen.beta if b.bouc_wen else 0.0),
    "wen_gamma": _of_storeys(lambda b: b.bouc_wen.gamma if b.bouc_wen else 0.0),
    "wen_limit": _of_storeys(lambda b: b.bouc_wen.limit if b.bouc_wen else 0.0),
}
