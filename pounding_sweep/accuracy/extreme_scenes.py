"""Extreme scenarios side by side: families of them, what a sweep may be asked for taken to its ends, and random rows.

A family is a list of batches that stretch one thing. Few shapes of row are used, so that few kernels are compiled. A
batch is run as a sweep would run it: the same refusals, the same statuses, the same masks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.foundation import Foundation
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import CONTACTS, DAMPING_STIFFNESSES, Building, Scene, Wall
from pounding_sweep.outputs.variables import (
    Status,
    cube_variables,
    get_variable,
    inner_shape,
    mask_invalid,
    reducers_for,
)
from pounding_sweep.records import Record, synthetic_record
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.stability import largest_step

#: Peaks whose error is judged.
PEAKS = ("displacement_max", "displacement_min", "impact_force_max", "penetration_max")
#: What every run reports.
OUTPUTS = (
    *PEAKS,
    "energy_input",
    "energy_damping",
    "energy_kinetic",
    "energy_strain",
    "contact_work",
    "energy_residual",
)
#: What is judged, and what is reported, of storeys that yield beside that.
YIELDING_PEAKS = ("ductility_max",)
YIELDING_OUTPUTS = (*YIELDING_PEAKS, "residual_drift", "hysteretic_energy")


@dataclass(frozen=True)
class Batch:
    """Scenarios of one row, law and record, to be run by both schemes at several steps."""

    family: str  # what is stretched
    case: str  # what is extreme about it, for messages
    scene: Scene  # the row; its own gaps are not used
    law: Law
    record: Record  # ground motion (m/s2)
    gaps: np.ndarray  # gaps (m); shape (n, pairs)
    #: contact stiffness (kN/m**exponent), coefficient of restitution, factor on the record; shape (n,)
    stiffness: np.ndarray
    restitution: np.ndarray
    scale: np.ndarray
    steps: tuple[float, ...]  # time steps (s)
    initial_velocity: tuple[float, ...] | None = None  # velocity (m/s) of every floor, building by building

    def __len__(self) -> int:
        return len(self.scale)


def outputs_of(scene: Scene) -> tuple[str, ...]:
    """Return what a run of a row reports."""
    return (*OUTPUTS, *(YIELDING_OUTPUTS if any(scene.yields) else ()))


def kernel_of(batch: Batch, method: str, dt: float, precision: str = "float64", refinement: float = 1.0) -> RowKernel:
    """Return the kernel that runs a batch."""
    numerics = Numerics(method, dt, precision=precision, refinement=refinement)
    reducers = reducers_for(outputs_of(batch.scene))
    return RowKernel(batch.scene, batch.law, numerics, reducers, initial_velocity=batch.initial_velocity)


def schemes_of(batch: Batch, methods: Sequence[str]) -> list[str]:
    """Return the schemes that take the row of a batch."""
    return [name for name in methods if SCHEMES[name].refuses(batch.scene) is None]


def take(batch: Batch, rows: np.ndarray) -> Batch:
    """Return some scenarios of a batch."""
    return replace(
        batch, **{name: getattr(batch, name)[rows] for name in ("gaps", "stiffness", "restitution", "scale")}
    )


def stable_step(batch: Batch, method: str) -> np.ndarray:
    """Largest stable step (s) of each scenario."""
    return largest_step(batch.scene, batch.law, batch.stiffness, batch.restitution, method=method)


def run_batch(
    batch: Batch, method: str, dt: float, precision: str = "float64", refinement: float = 1.0
) -> dict[str, np.ndarray]:
    """Run every scenario of a batch."""
    kernel = kernel_of(batch, method, dt, precision, refinement)
    step = batch.record.dt / kernel.numerics.steps(batch.record)
    rows = np.flatnonzero(step <= stable_step(batch, method))
    result: dict[str, np.ndarray] = {}
    outputs = outputs_of(batch.scene)
    for name in cube_variables(outputs):
        variable = get_variable(name)
        empty = math.nan if variable.fill is None else variable.fill
        result[name] = np.full((len(batch), *inner_shape(variable, batch.scene)), empty)
    result["status"] = np.full(len(batch), int(Status.BEYOND_STABILITY_LIMIT), dtype=np.int8)
    if len(rows):
        part = take(batch, rows)
        raw = kernel.run(
            part.record, scale=part.scale, gaps=part.gaps, stiffness=part.stiffness, restitution=part.restitution
        )
        for name, values in variables_of(kernel, raw, outputs, part.record).items():
            result[name][rows] = values
    return mask_invalid(result)


#: A gap (m) that no scenario closes.
OPEN_GAP = 1.0e3
#: Least coefficient of restitution tried for laws whose formula divides by it.
LEAST_RESTITUTION = 1.0e-3
#: Time steps (s) of a family that stretches something else.
STEPS = (1.0e-2, 2.0e-3, 2.0e-4)
#: Contact stiffness (kN/m**exponent) where a family stretches something else.
STIFFNESS = {1.0: 1.0e6, 1.5: 1.0e7}


def lowest_restitution(law: Law) -> float:
    """Lower end of the restitutions that are tried under a law."""
    return 0.0 if law.zero_restitution else LEAST_RESTITUTION


def make_batch(
    family: str,
    case: str,
    scene: Scene,
    law: Law,
    record: Record,
    *,
    gaps: Any = 0.005,
    stiffness: Any = None,
    restitution: Any = 0.6,
    scale: Any = 1.0,
    **more: Any,
) -> Batch:
    """Return the batch of every combination of the given values (numbers or lists; a gap is that of every pair)."""
    default = STIFFNESS.get(law.exponent or 1.0, 1.0e6)
    axes = [np.atleast_1d(np.asarray(a, float)) for a in (gaps, stiffness or default, restitution, scale)]
    gap, k, e, s = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    gap_table = np.repeat(gap[:, None], len(scene.pair_names), axis=1)
    return Batch(family, case, scene, law, record, gap_table, k, e, s, **{"steps": STEPS, **more})


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


def _both() -> tuple[tuple[str, Scene], ...]:
    return ("pair", pair()), ("wall", beside_wall())


def earthquake(pga: float = 4.0, duration: float = 2.0, dt: float = 0.01) -> Record:
    """Return a short synthetic earthquake (PGA in m/s2)."""
    return synthetic_record(7, duration=duration, dt=dt, pga=pga, rise=0.1, strong=0.6)


def _stiffness(law: Law) -> Iterable[Batch]:
    values = np.logspace(3, 12, 10)
    for name, scene in _both():
        yield make_batch("stiffness", name, scene, law, earthquake(), stiffness=list(values))


def _gap(law: Law) -> Iterable[Batch]:
    values = [0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, OPEN_GAP]
    for name, scene in _both():
        yield make_batch("gap", name, scene, law, earthquake(), gaps=values)


def _restitution(law: Law) -> Iterable[Batch]:
    values = [lowest_restitution(law), 0.01, 0.05, 0.2, 0.5, 0.8, 0.99, 1.0]
    for name, scene in _both():
        yield make_batch(
            "restitution", name, scene, law, earthquake(), restitution=values, stiffness=_around(law, 1e-2, 1.0, 1e2)
        )


def _around(law: Law, *factors: float) -> list[float]:
    return [STIFFNESS.get(law.exponent or 1.0, 1.0e6) * factor for factor in factors]


def _mass_ratio(law: Law) -> Iterable[Batch]:
    for ratio in (1e-4, 1e-2, 1e2, 1e4):
        scene = pair(ratio=ratio)
        yield make_batch("mass ratio", f"{ratio:g}", scene, law, earthquake(), stiffness=_around(law, 1e-2, 1.0, 1e2))


def _period(law: Law) -> Iterable[Batch]:
    for periods in ((0.02, 0.03), (0.02, 10.0), (10.0, 7.0), (0.3, 0.3)):
        yield make_batch(
            "period", f"{periods[0]:g} and {periods[1]:g} s", pair(periods), law, earthquake(), gaps=[0.0, 1e-4, 5e-3]
        )


def _damping(law: Law) -> Iterable[Batch]:
    for ratio in (0.0, 0.3, 0.9):
        scene = pair(damping=ratio)
        yield make_batch("damping", f"{ratio:g}", scene, law, earthquake(), stiffness=_around(law, 1e-1, 1.0, 1e2))


def _slow() -> Record:
    """Return a motion of few points, far apart."""
    return Record("slow", 0.5, 3.0 * np.sin(np.arange(81) * 1.7))


def _step(law: Law) -> Iterable[Batch]:
    scene, stiffness = pair(), _around(law, 1e-2, 1.0, 1e2, 1e4, 1e6)
    steps = (0.5, 0.1, 0.05)
    yield make_batch("step", "far too large", scene, law, _slow(), gaps=[0.0, 1e-3], stiffness=stiffness, steps=steps)
    fast = earthquake(duration=0.3)
    yield make_batch("step", "tiny", beside_wall(), law, fast, gaps=1e-3, steps=(1e-5, 1e-6))


def _amplitude(law: Law) -> Iterable[Batch]:
    scales = [0.0, 1e-9, 1e-3, 1.0, 981.0 / 4.0]
    for gap in (0.0, 5e-3):
        yield make_batch("amplitude", f"gap {gap:g} m", pair(), law, earthquake(), gaps=gap, scale=scales)


def _record(law: Law) -> Iterable[Batch]:
    spike = np.zeros(101)
    spike[20] = 50.0
    motions = {
        "one point": Record("point", 0.01, np.array([3.0])),
        "two points": Record("points", 0.01, np.array([3.0, -3.0])),
        "constant": Record("constant", 0.01, np.full(101, 4.0)),
        "one spike": Record("spike", 0.01, spike),
        "all spikes": Record("spikes", 0.01, np.resize([20.0, -20.0], 101)),
        "two points, far apart": Record("apart", 2.0, np.array([0.0, 5.0])),
    }
    for name, motion in motions.items():
        yield make_batch("record", name, beside_wall(), law, motion, gaps=[0.0, 1e-3])


def _row(law: Law) -> Iterable[Batch]:
    motion = earthquake()
    alone = Scene([oscillator("alone", 0.4, 100.0, 2)])
    yield make_batch("row", "one building", alone, law, motion)
    twelve = [oscillator(f"b{i}", 0.1 + 0.05 * i, 60.0 + 10.0 * (i % 3)) for i in range(12)]
    yield make_batch("row", "12 buildings", Scene(twelve, [0.002] * 11), law, motion, gaps=[0.0, 2e-3, 1e-2])
    towers = [oscillator("tower", 4.0, 300.0, 40), oscillator("house", 0.5, 200.0, 5)]
    yield make_batch("row", "40 and 5 storeys", Scene(towers, [0.005]), law, motion, gaps=[0.0, 2e-3, 1e-2])


def _walls(law: Law) -> Iterable[Batch]:
    scene = Scene([Wall("west"), oscillator("between", 0.4), Wall("east")], [0.002, 0.002])
    yield make_batch(
        "walls",
        "on both sides",
        scene,
        law,
        earthquake(),
        gaps=[0.0, 1e-9, 2e-3],
        stiffness=_around(law, 1e-2, 1.0, 1e3),
    )


def _together(law: Law) -> Iterable[Batch]:
    """Two equal buildings that close in upon one at rest: every floor is touched from both sides at once."""
    outer = [oscillator(name, 0.4, 100.0, 2) for name in ("west", "east")]
    scene = Scene([outer[0], oscillator("between", 0.25, 100.0, 2), outer[1]], [0.002, 0.002])
    quiet = Record("quiet", 0.01, np.zeros(101))
    yield make_batch(
        "together",
        "from both sides",
        scene,
        law,
        quiet,
        gaps=[0.0, 2e-3],
        stiffness=_around(law, 1e-2, 1.0, 1e3),
        initial_velocity=(0.5, 0.5, 0.0, 0.0, -0.5, -0.5),
    )


def _resting(law: Law) -> Iterable[Batch]:
    """Push ever harder: floors lean on the wall and stay there."""
    ramp = Record("ramp", 0.01, -np.linspace(0.0, 3.0, 151))
    yield make_batch(
        "resting",
        "ramped ground, gap 0",
        beside_wall(),
        law,
        ramp,
        gaps=[0.0, 1e-9, 1e-5],
        restitution=[lowest_restitution(law), 0.6],
    )


def _grazing(law: Law) -> Iterable[Batch]:
    """Gaps a hair smaller than the largest displacement of the building that stands alone."""
    base = make_batch("grazing", "", beside_wall(), law, earthquake(), gaps=OPEN_GAP)
    reach = float(run_batch(base, "rk4", 1e-4)["displacement_max"].max())
    gaps = [reach * (1.0 - part) for part in (-1e-9, 1e-12, 1e-9, 1e-6, 1e-3, 1e-2)]
    yield make_batch("grazing", "the last hair of the gap", beside_wall(), law, earthquake(), gaps=gaps)


def _chatter(law: Law) -> Iterable[Batch]:
    """Push steadily: a floor bounces off the wall again and again, ever weaker."""
    push = Record("push", 0.01, np.full(151, -5.0))
    yield make_batch(
        "chatter",
        "constant push",
        beside_wall(damping=0.0),
        law,
        push,
        gaps=1e-3,
        restitution=[lowest_restitution(law), 0.05, 0.5, 0.9],
        stiffness=_around(law, 1.0, 1e2),
    )


#: Yield strengths (m/s2: storey shears over the masses above) and hardenings of rows that yield; inf: never.
STRENGTHS = (1e-6, 1e-3, 0.1, 1.0, 1e3, math.inf)
HARDENINGS = (0.0, 1e-6, 0.05, 0.999)


def yielding_pair(strength: float, hardening: float, damping_stiffness: str = "initial") -> Scene:
    """Return `pair`, whose left building yields at that strength (m/s2), and the right one at 1 m/s2."""
    buildings = []
    for building, each in zip(pair().buildings, (strength, 1.0), strict=True):
        above = np.cumsum(building.masses[::-1])[::-1]
        buildings.append(
            replace(
                building,
                yield_strengths=[each * float(mass) for mass in above],
                hardening=hardening,
                damping_stiffness=damping_stiffness,
            )
        )
    return Scene(buildings, [0.005])


def _yielding(law: Law) -> Iterable[Batch]:
    """Storeys that yield at once, or never; that keep their stiffness, or lose all of it and don't come back."""
    for strength in STRENGTHS:
        for hardening in HARDENINGS:
            scene, name = yielding_pair(strength, hardening), f"{strength:g} m/s2, hardening {hardening:g}"
            yield make_batch("yielding", name, scene, law, earthquake(), gaps=[0.0, 5e-3, OPEN_GAP])
    time = np.linspace(0.0, 2.0, 201)
    push = Record("push and rest", 0.01, np.where(time < 0.5, -6.0, 0.0))
    for damping in DAMPING_STIFFNESSES:
        scene = yielding_pair(0.5, 0.0, damping)
        yield make_batch("yielding", f"left lying, {damping} damping", scene, law, push, gaps=[1e-3, 5e-3, OPEN_GAP])
    large = (0.5, 0.1, 0.05)
    yield make_batch("yielding", "steps far too large", yielding_pair(1.0, 0.0), law, _slow(), gaps=1e-3, steps=large)


#: Masses of foundations over those of their buildings; stiffness of sway over that of the first storey, that of rocking
#: over the same times the square of the height; damping ratios of rigid bodies on them.
BASES = ((1e-3, 1e-1, 0.0), (1e-3, 1e3, 0.1), (0.3, 1e-2, 0.0), (0.3, 1.0, 0.3), (0.3, 1.0, 10.0), (100.0, 1e2, 0.05))


def on_bases(share: float, stiffer: float, damping: float) -> Scene:
    """Return `pair` on foundations of so much of its mass, its stiffness and damping."""
    row = []
    for building in pair().buildings:
        height, mass = float(building.elevations[-1]), sum(building.masses)
        stiffness = stiffer * building.stiffnesses[0]
        rate = 2.0 * damping * math.sqrt(stiffness * mass * (1.0 + share))
        arm = height**2
        base = Foundation(
            share * mass, share * mass * arm, stiffness, stiffness * arm, sway_damping=rate, rocking_damping=rate * arm
        )
        row.append(replace(building, foundation=base))
    return Scene(row, [0.005])


def _foundations(law: Law) -> Iterable[Batch]:
    """Bases that hardly hold, or hardly move; without damping, or with more than any vibration takes."""
    for share, stiffer, damping in BASES:
        name = f"{share:g} of the mass, {stiffer:g} of the stiffness, damping ratio {damping:g}"
        scene = on_bases(share, stiffer, damping)
        yield make_batch("foundations", name, scene, law, earthquake(), gaps=[0.0, 5e-3, OPEN_GAP])
    large = (0.5, 0.1, 0.05)
    yield make_batch("foundations", "steps far too large", on_bases(*BASES[3]), law, _slow(), gaps=1e-3, steps=large)


def staggered(level: float, depth: float = 0.0, columns: float = 1.0) -> Scene:
    """Return a storey whose slab strikes the upper columns of two of 3 m, and they its own by their lower floor."""
    # `level` and `depth` (m) are of that slab, `columns` the stiffness of struck columns over that of their storeys
    low, high = oscillator("left", 0.4), oscillator("right", 0.25, 100.0, 2)
    given = [[k * columns for k in building.stiffnesses] for building in (low, high)]
    left = replace(low, storey_heights=[level], slab_depths=[depth], column_stiffnesses=given[0])
    right = replace(high, storey_heights=[3.0, 3.0], column_stiffnesses=given[1])
    return Scene([left, right], [0.005], contacts=CONTACTS[1])


def _columns(law: Law) -> Iterable[Batch]:
    """Slabs just above a floor and just below the next one, of hardly any depth and of nearly a storey's."""
    if law.exponent != 1.0:
        return
    for xi in (5e-4, 0.02, 0.5, 0.98, 1.0 - 5e-4):
        scene = staggered(3.0 + 3.0 * xi)
        yield make_batch("columns", f"xi = {xi:g}", scene, law, earthquake(), gaps=[0.0, 1e-3, 5e-3])
    scene = staggered(5.99, depth=2.98)
    yield make_batch("columns", "a slab of nearly a storey", scene, law, earthquake(), gaps=[0.0, 1e-3, 5e-3])
    for share in (1e-6, 1e6):
        scene, stiffness = staggered(4.5, columns=share), _around(law, 1e-2, 1.0, 1e3)
        name = f"columns of {share:g} times the storeys' stiffness"
        yield make_batch("columns", name, scene, law, earthquake(), gaps=1e-3, stiffness=stiffness)


@dataclass(frozen=True)
class Family:
    """A family of extreme scenarios."""

    key: str  # name in tables
    title: str  # what is stretched, and how far
    make: Callable[[Law], Iterable[Batch]]  # batches of the family under a law
    #: whether it is run under every law; else under one law of each force exponent, because its kernels are slow to
    #: compile
    wide: bool = True


#: Every family by name, in the order of the table.
FAMILIES: dict[str, Family] = {
    family.key: family
    for family in (
        Family("stiffness", "contact stiffness 1e3 to 1e12 kN/m", _stiffness),
        Family("gap", "gap 0, 1e-9 m and more, up to one that never closes", _gap),
        Family("restitution", "restitution from the lower end of the law's validity to 1", _restitution),
        Family("mass ratio", "masses of neighbours 1e-4 to 1e4 of each other", _mass_ratio),
        Family("period", "fundamental periods 0.02 to 10 s", _period),
        Family("damping", "damping ratio 0 to 0.9", _damping),
        Family("step", "time step 0.5 s to 1e-6 s", _step),
        Family("amplitude", "PGA 0 to 100 g", _amplitude),
        Family("record", "records of one point, two points, a constant, spikes", _record),
        Family("resting", "floors that lean on a wall", _resting),
        Family("grazing", "a touch with the last 1e-12 of the displacement", _grazing),
        Family("chatter", "bounces without end, ever weaker", _chatter),
        Family("yielding", "yield strengths 1e-6 m/s2 to never, hardening 0 to 0.999", _yielding),
        Family("columns", "slabs at 5e-4 to 1 - 5e-4 of a storey, struck columns far softer and stiffer", _columns),
        Family("foundations", "bases of 1e-3 to 100 of the mass, 1e-2 to 1e3 of the stiffness", _foundations),
        Family("row", "1 to 12 buildings, 1 to 40 storeys", _row, wide=False),
        Family("walls", "walls on both sides", _walls, wide=False),
        Family("together", "all floors touched from both sides at the same instant", _together, wide=False),
    )
}


def family_batches(keys: Sequence[str], laws: Sequence[Law]) -> list[Batch]:
    """Return the batches of some families under some laws."""
    found: list[Batch] = []
    for key in keys:
        family = FAMILIES[key]
        chosen = laws if family.wide else list({law.exponent: law for law in reversed(laws)}.values())
        for law in chosen:
            found += family.make(law)
    return found


#: Time steps (s) that random scenes are run at.
RANDOM_STEPS = (5.0e-3, 1.0e-3, 2.0e-4)


def random_batches(scenes: int, seed: int, laws: Sequence[Law]) -> list[Batch]:
    """Draw random scenes: rows, gaps, contacts and ground motions."""
    return [_draw(np.random.default_rng([seed, i]), i, laws) for i in range(-(-scenes // LANES))]


def _draw(rng: np.random.Generator, number: int, laws: Sequence[Law]) -> Batch:
    law = laws[number % len(laws)]
    kind = (number // len(laws)) % 2
    scene = _pair(rng) if kind == 0 else _beside_wall(rng)
    pairs = len(scene.pair_names)
    # a gap is met only if the buildings move as far: drawn around the displacement of the softest one
    period = max(float(b.periods[0]) for b in scene.buildings)
    pga = _log(rng, 0.05, 20.0)
    reach = pga * (period / (2.0 * math.pi)) ** 2
    gaps = reach * 10.0 ** rng.uniform(-3.0, 0.5, (LANES, pairs))
    gaps[rng.random(gaps.shape) < 0.1] = 0.0
    mass = min(contact.mass for contact in scene.contacts)
    if law.exponent == 1.0:  # contacts that last 0.3 ms to 0.3 s, and the odd one that is stiffer
        stiffness = mass * (math.pi / 10.0 ** rng.uniform(-3.5, -0.5, LANES)) ** 2
    else:
        stiffness = 10.0 ** rng.uniform(3.0, 9.0, LANES)
    return Batch(
        "random",
        f"number {number}",
        scene,
        law,
        _motion(rng, pga),
        gaps,
        np.clip(stiffness, 1e3, 1e12),
        np.where(rng.random(LANES) < 0.1, lowest_restitution(law), rng.uniform(0.02, 1.0, LANES)),
        10.0 ** rng.uniform(-0.5, 0.5, LANES),
        RANDOM_STEPS,
    )


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _draw_damping(rng: np.random.Generator) -> float:
    return float(rng.choice([0.0, 0.02, 0.05, 0.2, 0.6]))


def _pair(rng: np.random.Generator) -> Scene:
    buildings = []
    for name in ("left", "right"):
        plain = oscillator(name, _log(rng, 0.05, 3.0), _log(rng, 1.0, 1e4), 2)
        uneven = rng.uniform(0.5, 2.0, (2, 2))
        masses = [m * u for m, u in zip(plain.masses, uneven[0], strict=True)]
        stiffnesses = [k * u for k, u in zip(plain.stiffnesses, uneven[1], strict=True)]
        buildings.append(Building(name, masses, stiffnesses, _draw_damping(rng)))
    return Scene(buildings, [0.0])


def _beside_wall(rng: np.random.Generator) -> Scene:
    return Scene([oscillator("left", _log(rng, 0.05, 3.0), _log(rng, 1.0, 1e4), 1, _draw_damping(rng)), Wall()], [0.0])


def _motion(rng: np.random.Generator, pga: float) -> Record:
    kind = rng.integers(4)
    dt = float(rng.choice([0.005, 0.01, 0.02]))
    if kind == 0:  # white noise: the roughest that a record can be
        noise = rng.standard_normal(round(1.0 / dt))
        return Record("noise", dt, pga * noise / np.abs(noise).max())
    if kind == 1:  # a pulse
        t = np.arange(0.0, 1.5, dt)
        width = _log(rng, 0.05, 0.6)
        return Record("pulse", dt, pga * np.where(t < width, np.sin(2.0 * np.pi * t / width), 0.0))
    return synthetic_record(int(rng.integers(10**6)), duration=2.0, dt=dt, pga=pga, rise=0.1, strong=0.6)
