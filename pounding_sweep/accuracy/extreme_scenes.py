"""Families of extreme scenarios as one table: what a sweep may be asked for taken to its ends, and random rows.

A batch is run as a chunk of a sweep is: by the same function, with the same statuses and masks. Few shapes of row are
used, so that few kernels are compiled.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.laws import LAWS, Law
from pounding_sweep.model.scene import CONTACTS, DAMPING_STIFFNESSES, Building, Foundation, Scene, Wall
from pounding_sweep.model.variants import variants_of
from pounding_sweep.outputs.variables import (
    Status,
    cube_variables,
    get_variable,
    inner_shape,
    mask_invalid,
    reducers_for,
)
from pounding_sweep.plan.scenarios import Scenarios
from pounding_sweep.records import Record, synthetic_record
from pounding_sweep.run.refinement import Values, run_once
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.stability import largest_step

#: Peaks whose error is judged, and what every run reports beside them; the same of storeys that yield.
PEAKS = ("displacement_max", "displacement_min", "impact_force_max", "penetration_max")
OUTPUTS = (
    *PEAKS,
    *(f"energy_{kind}" for kind in ("input", "damping", "kinetic", "strain", "residual")),
    "contact_work",
)
YIELDING_PEAKS = ("ductility_max",)
YIELDING_OUTPUTS = (*YIELDING_PEAKS, "residual_drift", "hysteretic_energy")


@dataclass(frozen=True)
class Batch:
    """Scenarios of one row, law and record, to be run by several schemes at several steps."""

    family: str  # what is stretched
    case: str  # what is extreme about it, for messages
    scene: Scene  # the row; its own gaps are not used
    law: Law
    record: Record  # ground motion (m/s2)
    table: Scenarios
    steps: tuple[float, ...]  # time steps (s)
    initial_velocity: tuple[float, ...] | None = None  # velocity (m/s) of every floor, building by building

    def __len__(self) -> int:
        return len(self.table)

    def __getitem__(self, rows: Any) -> Batch:
        return replace(self, table=self.table[rows])

    @property
    def outputs(self) -> tuple[str, ...]:
        """What a run reports."""
        return (*OUTPUTS, *(YIELDING_OUTPUTS if any(self.scene.yields) else ()))

    def schemes(self, methods: Iterable[str]) -> list[str]:
        """Return the schemes that take the row."""
        return [name for name in methods if SCHEMES[name].refuses(self.scene) is None]

    def kernel(self, method: str, dt: float, precision: str = "float64", refinement: float = 1.0) -> RowKernel:
        """Return the kernel that runs it."""
        numerics = Numerics(method, dt, precision=precision, refinement=refinement)
        return RowKernel(
            self.scene, self.law, numerics, reducers_for(self.outputs), initial_velocity=self.initial_velocity
        )

    def step(self, method: str, dt: float) -> float:
        """Return the time step (s) that is taken for a largest one."""
        return self.record.dt / Numerics(method, dt).steps(self.record)

    def stable_step(self, method: str) -> np.ndarray:
        """Return the largest stable step (s) of each scenario."""
        return largest_step(self.scene, self.law, self.table.stiffness, self.table.restitution, method=method)

    def run(self, method: str, dt: float, precision: str = "float64", refinement: float = 1.0) -> Values:
        """Run every scenario at a step; those beyond the stability limit are refused."""
        rows = np.flatnonzero(self.step(method, dt) <= self.stable_step(method))
        part: Values = {}
        if len(rows):
            kernel = self.kernel(method, dt, precision, refinement)
            part = run_once(kernel, self.record, self.table[rows], variants_of(self.scene), self.outputs)
        result = {}
        for name in cube_variables(self.outputs):
            variable = get_variable(name)
            empty = Status.BEYOND_STABILITY_LIMIT if name == "status" else variable.fill
            result[name] = np.full((len(self), *inner_shape(name, self.scene)), math.nan if empty is None else empty)
            if part:
                result[name][rows] = part[name]
        return mask_invalid(result)


# --- what rows are made of -------------------------------------------------------------------------------------------

#: A gap (m) that no scenario closes.
OPEN_GAP = 1.0e3
#: Least coefficient of restitution tried for laws whose formula divides by it.
LEAST_RESTITUTION = 1.0e-3
#: Contact stiffness (kN/m**exponent) where a family stretches something else.
STIFFNESS = {1.0: 1.0e6, 1.5: 1.0e7}
#: Time steps (s) of a family that stretches something else, and of random scenes.
STEPS, RANDOM_STEPS = (1.0e-2, 2.0e-3, 2.0e-4), (5.0e-3, 1.0e-3, 2.0e-4)


def lowest_restitution(law: Law) -> float:
    """Lower end of the restitutions that are tried under a law."""
    return 0.0 if law.zero_restitution else LEAST_RESTITUTION


def _table(gaps: Any, stiffness: Any, restitution: Any, scale: Any) -> Scenarios:
    zeros = np.zeros(len(gaps), int)
    return Scenarios(zeros, zeros, scale, stiffness, restitution, gaps, zeros)


def make_batch(
    family: str,
    case: str,
    scene: Scene,
    law: Law,
    record: Record | None = None,
    *,
    gaps: Any = 0.005,
    stiffness: Any = None,
    times: Any = 1.0,
    restitution: Any = 0.6,
    scale: Any = 1.0,
    **more: Any,
) -> Batch:
    """Return the batch of every combination of values (numbers or lists; a gap is that of every pair, or a function).

    `times` multiplies the default stiffness; a restitution below the lowest of the law stands for that.
    """
    if stiffness is None:
        stiffness = STIFFNESS.get(law.exponent or 1.0, 1.0e6) * np.asarray(times)
    gaps = gaps() if callable(gaps) else gaps
    axes = [np.atleast_1d(np.asarray(axis, float)) for axis in (gaps, stiffness, restitution, scale)]
    gap, k, e, s = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    table = _table(np.repeat(gap[:, None], len(scene.pair_names), axis=1), k, np.maximum(e, lowest_restitution(law)), s)
    return Batch(family, case, scene, law, record or earthquake(), table, **{"steps": STEPS, **more})


def oscillator(name: str, period: float, mass: float = 100.0, storeys: int = 1, damping: float = 0.05) -> Building:
    """Return a uniform building of that fundamental period (s), mass per floor (t) and damping ratio."""
    unit = 2.0 * math.sin(math.pi / (2.0 * (2 * storeys + 1)))
    stiffness = mass * (2.0 * math.pi / (period * unit)) ** 2
    return Building(name, [mass] * storeys, [stiffness] * storeys, damping)


def pair(periods: tuple[float, float] = (0.4, 0.25), ratio: float = 1.0, damping: float = 0.05) -> Scene:
    """Return two buildings of two storeys; `ratio` of the right one's masses to the left one's."""
    left = oscillator("left", periods[0], 100.0, 2, damping)
    return Scene([left, oscillator("right", periods[1], 100.0 * ratio, 2, damping)], [0.005])


def beside_wall(damping: float = 0.05) -> Scene:
    """Return a building of one storey left of a wall."""
    return Scene([oscillator("left", 0.4, damping=damping), Wall()], [0.005])


def yielding_pair(strength: float, hardening: float, damping_stiffness: str = "initial") -> Scene:
    """Return `pair`, whose left building yields at that strength (m/s2), and the right one at 1 m/s2."""
    buildings = []
    for building, each in zip(pair().buildings, (strength, 1.0), strict=True):
        strengths = [each * float(mass) for mass in np.cumsum(building.masses[::-1])[::-1]]
        buildings.append(
            replace(building, yield_strengths=strengths, hardening=hardening, damping_stiffness=damping_stiffness)
        )
    return Scene(buildings, [0.005])


def on_bases(share: float, stiffer: float, damping: float) -> Scene:
    """Return `pair` on foundations of so much of its mass, its stiffness and damping."""
    row = []
    for building in pair().buildings:
        mass, arm = sum(building.masses), float(building.elevations[-1]) ** 2
        stiffness = stiffer * building.stiffnesses[0]
        rate = 2.0 * damping * math.sqrt(stiffness * mass * (1.0 + share))
        sway = (share * mass, stiffness, rate)
        values = [number * factor for number in sway for factor in (1.0, arm)]
        row.append(replace(building, foundation=Foundation(*values)))
    return Scene(row, [0.005])


def staggered(level: float, depth: float = 0.0, columns: float = 1.0) -> Scene:
    """Return a storey whose slab strikes the upper columns of two of 3 m, and they its own by their lower floor."""
    # `level` and `depth` (m) are of that slab, `columns` the stiffness of struck columns over that of their storeys
    low, high = oscillator("left", 0.4), oscillator("right", 0.25, 100.0, 2)
    stiffnesses = [[k * columns for k in building.stiffnesses] for building in (low, high)]
    left = replace(low, storey_heights=[level], slab_depths=[depth], column_stiffnesses=stiffnesses[0])
    right = replace(high, storey_heights=[3.0, 3.0], column_stiffnesses=stiffnesses[1])
    return Scene([left, right], [0.005], contacts=CONTACTS[1])


def earthquake(pga: float = 4.0, duration: float = 2.0, dt: float = 0.01) -> Record:
    """Return a short synthetic earthquake (PGA in m/s2)."""
    return synthetic_record(7, duration=duration, dt=dt, pga=pga, rise=0.1, strong=0.6)


def _ground(name: str, values: Any, dt: float = 0.01) -> Record:
    return Record(name, dt, np.asarray(values, float))


@cache
def _last_hairs() -> np.ndarray:
    """Gaps (m) a hair from the largest displacement of the building that stands alone, by fine steps."""
    alone = make_batch("", "", beside_wall(), LAWS["linear"], gaps=OPEN_GAP).run("rk4", 1e-4)
    return float(alone["displacement_max"].max()) * (1.0 - np.array([-1e-9, 1e-12, 1e-9, 1e-6, 1e-3, 1e-2]))


# --- the families ----------------------------------------------------------------------------------------------------

#: A case of a family: its name, its row, and the arguments of `make_batch` that are not as usual.
Case = tuple[str, Scene, Mapping[str, Any]]
#: Families that are run under one law of each force exponent, because their kernels are slow to compile; and those of
#: laws whose force is linear in the penetration.
OF_MANY_SHAPES, LINEAR = ("row", "walls", "together"), ("columns",)
#: Masses of foundations over those of their buildings; stiffness of sway over that of the first storey, that of rocking
#: over the same times the square of the height; damping ratios of rigid bodies on them.
BASES = ((1e-3, 1e-1, 0.0), (1e-3, 1e3, 0.1), (0.3, 1e-2, 0.0), (0.3, 1.0, 0.3), (0.3, 1.0, 10.0), (100.0, 1e2, 0.05))


def _cases(scenes: Mapping[str, Scene], **more: Any) -> list[Case]:
    return [(name, scene, more) for name, scene in scenes.items()]


@cache
def families() -> dict[str, list[Case]]:
    """Return every family by name, in the order of the table of docs/extremes.md."""
    wall, west, between, east = beside_wall(), Wall("west"), oscillator("between", 0.4), Wall("east")
    both, some, none = {"pair": pair(), "wall": wall}, [1e-2, 1.0, 1e2], [0.0, 5e-3, OPEN_GAP]
    periods = ((0.02, 0.03), (0.02, 10.0), (10.0, 7.0), (0.3, 0.3))
    slow = {"record": _ground("slow", 3.0 * np.sin(np.arange(81) * 1.7), 0.5), "steps": (0.5, 0.1, 0.05)}
    motions = (
        _ground("one point", [3.0]),
        _ground("two points", [3.0, -3.0]),
        _ground("constant", np.full(101, 4.0)),
        _ground("one spike", 50.0 * (np.arange(101) == 20)),
        _ground("all spikes", np.resize([20.0, -20.0], 101)),
        _ground("two points, far apart", [0.0, 5.0], 2.0),
    )
    ramp, push = _ground("ramp", -np.linspace(0.0, 3.0, 151)), _ground("push", np.full(151, -5.0))
    released = _ground("push and rest", np.where(np.linspace(0.0, 2.0, 201) < 0.5, -6.0, 0.0))
    weak = {
        f"{strength:g} m/s2, hardening {hardening:g}": yielding_pair(strength, hardening)
        for strength in (1e-6, 1e-3, 0.1, 1.0, 1e3, math.inf)
        for hardening in (0.0, 1e-6, 0.05, 0.999)
    }
    lying = {f"left lying, {damping} damping": yielding_pair(0.5, 0.0, damping) for damping in DAMPING_STIFFNESSES}
    struck = {f"xi = {xi:g}": staggered(3.0 + 3.0 * xi) for xi in (5e-4, 0.02, 0.5, 0.98, 1.0 - 5e-4)}
    struck["a slab of nearly a storey"] = staggered(5.99, depth=2.98)
    softer = {f"columns of {x:g} times the storeys' stiffness": staggered(4.5, columns=x) for x in (1e-6, 1e6)}
    base = "{:g} of the mass, {:g} of the stiffness, damping ratio {:g}"
    twelve = [oscillator(f"b{i}", 0.1 + 0.05 * i, 60.0 + 10.0 * (i % 3)) for i in range(12)]
    towers = [oscillator("tower", 4.0, 300.0, 40), oscillator("house", 0.5, 200.0, 5)]
    # two equal buildings that close in upon one at rest
    closing = [oscillator(name, t, 100.0, 2) for name, t in (("west", 0.4), ("between", 0.25), ("east", 0.4))]
    quiet = {"record": _ground("quiet", np.zeros(101)), "initial_velocity": (0.5, 0.5, 0.0, 0.0, -0.5, -0.5)}
    return {
        "stiffness": _cases(both, stiffness=np.logspace(3, 12, 10)),
        "gap": _cases(both, gaps=[0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, OPEN_GAP]),
        "restitution": _cases(both, restitution=[0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.99, 1.0], times=some),
        "mass ratio": _cases({f"{x:g}": pair(ratio=x) for x in (1e-4, 1e-2, 1e2, 1e4)}, times=some),
        "period": _cases({f"{a:g} and {b:g} s": pair((a, b)) for a, b in periods}, gaps=[0.0, 1e-4, 5e-3]),
        "damping": _cases({f"{x:g}": pair(damping=x) for x in (0.0, 0.3, 0.9)}, times=[1e-1, 1.0, 1e2]),
        "step": [
            *_cases({"far too large": pair()}, gaps=[0.0, 1e-3], times=[1e-2, 1.0, 1e2, 1e4, 1e6], **slow),
            *_cases({"tiny": wall}, record=earthquake(duration=0.3), gaps=1e-3, steps=(1e-5, 1e-6)),
        ],
        "amplitude": [
            (f"gap {gap:g} m", pair(), {"gaps": gap, "scale": [0.0, 1e-9, 1e-3, 1.0, 981.0 / 4.0]})
            for gap in (0.0, 5e-3)
        ],
        "record": [(each.name, wall, {"record": each, "gaps": [0.0, 1e-3]}) for each in motions],
        # floors that lean on a wall, touch it with the last 1e-12 of their motion, bounce ever weaker
        "resting": _cases({"ramped ground": wall}, record=ramp, gaps=[0.0, 1e-9, 1e-5], restitution=[0.0, 0.6]),
        "grazing": _cases({"the last hair of the gap": wall}, gaps=_last_hairs),
        "chatter": _cases(
            {"constant push": beside_wall(damping=0.0)},
            **{"record": push, "gaps": 1e-3, "restitution": [0.0, 0.05, 0.5, 0.9], "times": [1.0, 1e2]},
        ),
        # storeys that yield at once, or never; that keep their stiffness, or lose all of it and don't come back
        "yielding": [
            *_cases(weak, gaps=none),
            *_cases(lying, record=released, gaps=[1e-3, 5e-3, OPEN_GAP]),
            *_cases({"steps far too large": yielding_pair(1.0, 0.0)}, gaps=1e-3, **slow),
        ],
        "columns": [*_cases(struck, gaps=[0.0, 1e-3, 5e-3]), *_cases(softer, gaps=1e-3, times=[1e-2, 1.0, 1e3])],
        "foundations": [
            *_cases({base.format(*values): on_bases(*values) for values in BASES}, gaps=none),
            *_cases({"steps far too large": on_bases(*BASES[3])}, gaps=1e-3, **slow),
        ],
        "row": [
            ("one building", Scene([oscillator("alone", 0.4, 100.0, 2)]), {}),
            ("12 buildings", Scene(twelve, [0.002] * 11), {"gaps": [0.0, 2e-3, 1e-2]}),
            ("40 and 5 storeys", Scene(towers, [0.005]), {"gaps": [0.0, 2e-3, 1e-2]}),
        ],
        "walls": _cases(
            {"on both sides": Scene([west, between, east], [0.002, 0.002])},
            **{"gaps": [0.0, 1e-9, 2e-3], "times": [1e-2, 1.0, 1e3]},
        ),
        "together": _cases(
            {"from both sides": Scene(closing, [0.002, 0.002])}, gaps=[0.0, 2e-3], times=[1e-2, 1.0, 1e3], **quiet
        ),
    }


def family_batches(keys: Iterable[str], laws: Sequence[Law]) -> list[Batch]:
    """Return the batches of some families under some laws."""
    first_of_exponent = list({law.exponent: law for law in reversed(laws)}.values())
    return [
        make_batch(key, case, scene, law, **more)
        for key in keys
        for law in (first_of_exponent if key in OF_MANY_SHAPES else laws)
        if law.exponent == 1.0 or key not in LINEAR
        for case, scene, more in families()[key]
    ]


# --- random scenes ---------------------------------------------------------------------------------------------------


def random_batches(scenes: int, seed: int, laws: Sequence[Law]) -> list[Batch]:
    """Draw random scenes: rows, gaps, contacts and ground motions."""
    return [_draw(np.random.default_rng([seed, i]), i, laws) for i in range(-(-scenes // LANES))]


def _draw(rng: np.random.Generator, number: int, laws: Sequence[Law]) -> Batch:
    law = laws[number % len(laws)]
    scene = _random_pair(rng) if (number // len(laws)) % 2 == 0 else _random_beside_wall(rng)
    # a gap is met only if the buildings move as far: drawn around the displacement of the softest one
    period = max(float(b.periods[0]) for b in scene.buildings)
    pga = _log(rng, 0.05, 20.0)
    reach = pga * (period / (2.0 * math.pi)) ** 2
    gaps = reach * 10.0 ** rng.uniform(-3.0, 0.5, (LANES, len(scene.pair_names)))
    gaps[rng.random(gaps.shape) < 0.1] = 0.0
    if law.exponent == 1.0:  # contacts that last 0.3 ms to 0.3 s, and the odd one that is stiffer
        mass = min(contact.mass for contact in scene.contacts)
        stiffness = mass * (math.pi / 10.0 ** rng.uniform(-3.5, -0.5, LANES)) ** 2
    else:
        stiffness = 10.0 ** rng.uniform(3.0, 9.0, LANES)
    motion = _random_motion(rng, pga)
    restitution = np.where(rng.random(LANES) < 0.1, lowest_restitution(law), rng.uniform(0.02, 1.0, LANES))
    table = _table(gaps, np.clip(stiffness, 1e3, 1e12), restitution, 10.0 ** rng.uniform(-0.5, 0.5, LANES))
    return Batch("random", f"number {number}", scene, law, motion, table, RANDOM_STEPS)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _random_damping(rng: np.random.Generator) -> float:
    return float(rng.choice([0.0, 0.02, 0.05, 0.2, 0.6]))


def _random_pair(rng: np.random.Generator) -> Scene:
    buildings = []
    for name in ("left", "right"):
        plain = oscillator(name, _log(rng, 0.05, 3.0), _log(rng, 1.0, 1e4), 2)
        masses, stiffnesses = (rng.uniform(0.5, 2.0, (2, 2)) * [plain.masses, plain.stiffnesses]).tolist()
        buildings.append(Building(name, masses, stiffnesses, _random_damping(rng)))
    return Scene(buildings, [0.0])


def _random_beside_wall(rng: np.random.Generator) -> Scene:
    building = oscillator("left", _log(rng, 0.05, 3.0), _log(rng, 1.0, 1e4), 1, _random_damping(rng))
    return Scene([building, Wall()], [0.0])


def _random_motion(rng: np.random.Generator, pga: float) -> Record:
    kind, dt = rng.integers(4), float(rng.choice([0.005, 0.01, 0.02]))
    if kind == 0:  # white noise: the roughest that a record can be
        noise = rng.standard_normal(round(1.0 / dt))
        return _ground("noise", pga * noise / np.abs(noise).max(), dt)
    if kind == 1:  # a pulse
        t, width = np.arange(0.0, 1.5, dt), _log(rng, 0.05, 0.6)
        return _ground("pulse", pga * np.where(t < width, np.sin(2.0 * np.pi * t / width), 0.0), dt)
    return synthetic_record(int(rng.integers(10**6)), duration=2.0, dt=dt, pga=pga, rise=0.1, strong=0.6)
