"""The stability suite: families of extreme scenarios in every scheme, every one judged and counted.

A batch is run as a chunk of a sweep is. `judge` has the demands, which docs/extremes.md explains.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from pounding_sweep.accuracy.certificate import prepare_kernels
from pounding_sweep.base.errors import InputError, check_choice
from pounding_sweep.base.files import read_data
from pounding_sweep.engine.postprocess import displacement_limit, energy_limit
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.building import Building, Foundation
from pounding_sweep.model.frames import typical_building
from pounding_sweep.model.laws import LAWS, Law, get_law
from pounding_sweep.model.meeting import CONTACTS
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.model.variants import variants_of
from pounding_sweep.output.dataset import global_attributes
from pounding_sweep.plan.advice import measured_schemes
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.plan.scenarios import ChunkTask, Scenarios, changed
from pounding_sweep.records import Record, synthetic_record
from pounding_sweep.request.spec import SweepSpec
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.refinement import Values, run_scenarios
from pounding_sweep.schemes import SCHEMES, reference_scheme
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.variables import registry
from pounding_sweep.variables.registry import CHANGE, OK_CLAIM, SETTLED, STATUS, WITH_VALUES, Status, get_variable

#: Peaks whose error is judged, and what every run reports beside them; the same of storeys that yield.
PEAKS = ("displacement_max", "displacement_min", "impact_force_max", "penetration_max")
ENERGIES = ("energy_input", "energy_damping", "energy_kinetic", "energy_strain", "energy_residual", "contact_work")
OUTPUTS = (*PEAKS, *ENERGIES)
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
        if not all(
            spring.law.straight for spring in self.scene.springs
        ):  # whose plastic drift flows on as they unload: none is residual
            return (*OUTPUTS, *YIELDING_PEAKS)
        return (*OUTPUTS, *YIELDING_OUTPUTS) if any(self.scene.yields) else OUTPUTS

    def schemes(self, methods: Iterable[str]) -> list[str]:
        """Return the schemes that take the row."""
        return [name for name in methods if SCHEMES[name].refuses(self.scene) is None]

    def kernel(self, numerics: Numerics) -> RowKernel:
        """Return the kernel that runs it."""
        reducers = registry.reducers_for(self.outputs)
        return RowKernel(self.scene, self.law, numerics, reducers, initial_velocity=self.initial_velocity)

    def step(self, numerics: Numerics) -> float:
        """Return the time step (s) that is taken for a largest one."""
        return self.record.dt / numerics.steps(self.record)

    def stable_step(self, method: str) -> np.ndarray:
        """Return the largest stable step (s) of each scenario."""
        return largest_step(self.scene, self.law, self.table.stiffness, self.table.restitution, method=method)

    def run(self, numerics: Numerics) -> Values:
        """Run every scenario; those beyond the stability limit are refused."""
        rows, scene = np.flatnonzero(self.step(numerics) <= self.stable_step(numerics.method)), self.scene
        names = registry.cube_variables(self.outputs)
        values = {name: np.full((len(self), *registry.inner_shape(name, scene)), np.nan) for name in names}
        values["status"] = np.full(len(self), Status.BEYOND_STABILITY_LIMIT)
        if len(rows):
            task = ChunkTask(self.kernel(numerics), self.record, self.table[rows], variants_of(scene), self.outputs)
            part = run_scenarios(task)
            for name, column in values.items():
                column[rows] = part[name]
        return registry.mask_invalid(values)


def oscillator(name: str, period: float, mass: float = 100.0, storeys: int = 1, damping: float = 0.05) -> Building:
    """Return a uniform building of that fundamental period (s), mass per floor (t) and damping ratio."""
    unit = 2.0 * math.sin(math.pi / (2.0 * (2 * storeys + 1)))
    stiffness = mass * (2.0 * math.pi / (period * unit)) ** 2
    return Building(name, [mass] * storeys, [stiffness] * storeys, damping)


def row(*buildings: Building | Wall, **settings: Any) -> Scene:
    """Return a row of buildings; the gaps are those of each scenario."""
    return Scene(buildings, [0.005] * (len(buildings) - 1), **settings)


def pair(left: float = 0.4, right: float = 0.25, ratio: float = 1.0, damping: float = 0.05) -> Scene:
    """Return two buildings of two storeys, by their periods; `ratio` of the right one's masses to the left one's."""
    return row(oscillator("left", left, 100.0, 2, damping), oscillator("right", right, 100.0 * ratio, 2, damping))


def beside_wall(damping: float = 0.05) -> Scene:
    """Return a building of one storey left of a wall."""
    return row(oscillator("left", 0.4, damping=damping), Wall())


def yielding_pair(
    strength: float, hardening: float, damping_stiffness: str = "initial", hysteresis: dict[str, Any] | None = None
) -> Scene:
    """Return `pair`, whose left building yields at that strength (m/s2), and the right one at 1 m/s2."""
    settings: dict[str, Any] = {
        "hardening": hardening,
        "damping_stiffness": damping_stiffness,
        "hysteresis": hysteresis,
    }
    buildings = []
    for building, acceleration in zip(pair().buildings, (strength, 1.0), strict=True):
        above = np.cumsum(building.masses[::-1])[::-1]
        buildings.append(replace(building, yield_strengths=(acceleration * above).tolist(), **settings))
    return row(*buildings)


def on_bases(share: float, stiffer: float, damping: float) -> Scene:
    """Return `pair` on foundations of so much of its mass, its stiffness and damping."""
    buildings = []
    for building in pair().buildings:
        mass, arm = sum(building.masses), building.elevations[-1] ** 2
        stiffness = stiffer * building.storey_stiffnesses[0]
        sway = share * mass, stiffness, 2.0 * damping * math.sqrt(stiffness * mass * (1.0 + share))
        foundation = Foundation(*(value * factor for value in sway for factor in (1.0, arm)))
        buildings.append(replace(building, foundation=foundation))
    return row(*buildings)


def staggered(level: float, depth: float = 0.0, columns: float = 1.0) -> Scene:
    """Return a storey whose slab strikes the upper columns of two of 3 m, and they its own by their lower floor."""
    # `level` and `depth` (m) are of that slab, `columns` the stiffness of struck columns over that of their storeys
    low, high = oscillator("left", 0.4), oscillator("right", 0.25, 100.0, 2)
    stiffnesses = [[k * columns for k in building.storey_stiffnesses] for building in (low, high)]
    left = replace(low, storey_heights=[level], slab_depths=[depth], column_stiffnesses=stiffnesses[0])
    right = replace(high, storey_heights=[3.0, 3.0], column_stiffnesses=stiffnesses[1])
    return row(left, right, contacts=CONTACTS[1])


#: Rows of buildings of families, by name.
SCENES: dict[str, Callable[..., Scene]] = {
    "pair": pair,
    "wall": beside_wall,
    "mass ratio": lambda ratio: pair(ratio=ratio),
    "damping": lambda damping: pair(damping=damping),
    "yielding": yielding_pair,
    "smooth": lambda strength, n: yielding_pair(strength, 0.05, hysteresis={"law": "bouc_wen", "n": n}),
    "degrading": lambda law, cap, falls: yielding_pair(
        2.0, 0.05, hysteresis={"law": law, "cap_drift": cap, "post_cap": falls, "deterioration": {"strength": 0.2}}
    ),
    "matrix": lambda alpha, damping: row(
        typical_building("left", 4, 0.4, 100.0, kind=alpha, modal_damping=damping), oscillator("right", 0.25, 100.0, 2)
    ),
    "staggered": staggered,
    "struck column": lambda xi: staggered(3.0 + 3.0 * xi),
    "bases": on_bases,
    "one building": lambda: row(oscillator("alone", 0.4, 100.0, 2)),
    "12 buildings": lambda: row(*(oscillator(f"b{i}", 0.1 + 0.05 * i, 60.0 + 10.0 * (i % 3)) for i in range(12))),
    "40 and 5 storeys": lambda: row(oscillator("tower", 4.0, 300.0, 40), oscillator("house", 0.5, 200.0, 5)),
    "between walls": lambda: row(Wall("west"), oscillator("between", 0.4), Wall("east")),
    "three": lambda: row(
        *(oscillator(name, t, 100.0, 2) for name, t in (("west", 0.4), ("between", 0.25), ("east", 0.4)))
    ),
}


def earthquake(duration: float = 2.0, dt: float = 0.01) -> Record:
    """Return a short synthetic earthquake of 4 m/s2."""
    return synthetic_record(7, duration=duration, dt=dt, pga=4.0, rise=0.1, strong=0.6)


#: Ground motions of families: name, accelerations (m/s2) and time step (s).
RECORDS = {
    name: Record(name, dt, np.asarray(values, float))
    for name, dt, values in (
        ("slow", 0.5, 3.0 * np.sin(np.arange(81) * 1.7)),
        ("one point", 0.01, [3.0]),
        ("two points", 0.01, [3.0, -3.0]),
        ("constant", 0.01, np.full(101, 4.0)),
        ("one spike", 0.01, 50.0 * (np.arange(101) == 20)),
        ("all spikes", 0.01, np.resize([20.0, -20.0], 101)),
        ("two points, far apart", 2.0, [0.0, 5.0]),
        ("ramp", 0.01, -np.linspace(0.0, 3.0, 151)),
        ("push", 0.01, np.full(151, -5.0)),
        ("push and rest", 0.01, np.where(np.linspace(0.0, 2.0, 201) < 0.5, -6.0, 0.0)),
        ("quiet", 0.01, np.zeros(101)),
        ("short", 0.01, earthquake(duration=0.3).acceleration),
    )
}


#: Least coefficient of restitution tried for laws whose formula divides by it.
LEAST_RESTITUTION = 1.0e-3
#: Contact stiffness (kN/m**exponent) where a family stretches something else.
STIFFNESS = {1.0: 1.0e6, 1.5: 1.0e7}
#: Time steps (s) of a family that stretches something else, and of random scenes.
STEPS, RANDOM_STEPS = (1.0e-2, 2.0e-3, 2.0e-4), (5.0e-3, 1.0e-3, 2.0e-4)
#: Name of the family of a sweep's own row, factors on its first building's masses and on contact stiffness, and seconds
#: of its record before and after the peak.
SWEEP, MASS_FACTORS, STIFFER, PEAK_SECONDS = "your row", (0.01, 1.0, 100.0), (0.01, 1.0, 100.0), 2.5
#: Families that are run under one law of each force exponent, and those of laws whose force is linear.
OF_MANY_SHAPES, LINEAR = ("row", "walls", "together", "smooth"), ("columns",)


def lowest_restitution(law: Law) -> float:
    """Lower end of the restitutions that are tried under a law."""
    return 0.0 if law.zero_restitution else LEAST_RESTITUTION


def _table(gaps: np.ndarray, stiffness: np.ndarray, restitution: np.ndarray, scale: np.ndarray) -> Scenarios:
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
    steps: Sequence[float] = STEPS,
    initial_velocity: Sequence[float] | None = None,
) -> Batch:
    """Return the batch of every combination of values (numbers or lists; a gap is that of every pair, or "last hairs").

    `times` multiplies the default stiffness; a restitution below the lowest of the law stands for that.
    """
    if stiffness is None:
        stiffness = STIFFNESS.get(law.exponent or 1.0, 1.0e6) * np.asarray(times)
    gaps = _last_hairs() if isinstance(gaps, str) else gaps
    axes = [np.atleast_1d(np.asarray(axis, float)) for axis in (gaps, stiffness, restitution, scale)]
    gap, k, e, s = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    table = _table(np.repeat(gap[:, None], len(scene.pair_names), axis=1), k, np.maximum(e, lowest_restitution(law)), s)
    velocity = None if initial_velocity is None else tuple(initial_velocity)
    return Batch(family, case, scene, law, record or earthquake(), table, tuple(steps), velocity)


@cache
def _last_hairs() -> np.ndarray:
    """Gaps (m) a hair from the largest displacement of the building that stands alone, by fine steps."""
    alone = make_batch("", "", beside_wall(), LAWS["linear"], gaps=1.0e3).run(Numerics("rk4", 1e-4))
    return float(alone["displacement_max"].max()) * (1.0 - np.array([-1e-9, 1e-12, 1e-9, 1e-6, 1e-3, 1e-2]))


#: A case of a family: its name, its row, and the arguments of `make_batch` that are not as usual.
Case = tuple[str, Scene, dict[str, Any]]


@cache
def all_families() -> dict[str, list[Case]]:
    """Return the cases of every family, from ``data/extremes.toml``."""
    families: dict[str, list[Case]] = {}
    for family, cases in read_data("extremes.toml").items():
        families[family] = []
        for case in cases:
            name, scene, of = case.pop("name"), SCENES[case.pop("scene")], case.pop("of", [])
            settings = case | {"record": RECORDS.get(case.get("record"))}
            families[family] += [(name.format(*values), scene(*values), settings) for values in product(*of)]
    return families


def family_batches(keys: Iterable[str], laws: Sequence[Law]) -> list[Batch]:
    """Return the batches of some families under some laws."""
    first_of_exponent = list({law.exponent: law for law in reversed(laws)}.values())
    return [
        make_batch(key, case, scene, law, **settings)
        for key in keys
        for law in (first_of_exponent if key in OF_MANY_SHAPES else laws)
        if law.exponent == 1.0 or key not in LINEAR
        for case, scene, settings in all_families()[key]
    ]


def sweep_batches(spec: SweepSpec) -> list[Batch]:
    """Return batches of a sweep's row, laws and first record around its peak, at the ends of what a user may change."""
    plan, record, batches = make_plan(spec), spec.records[0], []
    peak, reach = int(np.abs(record.acceleration).argmax()), round(PEAK_SECONDS / record.dt)
    motion = Record(record.name, record.dt, record.acceleration[max(0, peak - reach) : peak + reach])
    first = spec.scene.row.index(spec.scene.buildings[0])
    # floors at rest on each other by themselves, since their references are of exact flight
    for factor, at_rest, (i, rows) in product(MASS_FACTORS, (True, False), plan.unique.by_law()):
        law, part = plan.laws[i], plan.unique[rows]
        if law.has_contact:
            items = list(spec.scene.row)
            items[first] = replace(spec.scene.buildings[0], masses=factor * np.array(spec.scene.buildings[0].masses))
            gaps = [0.0] if at_rest else [part.gaps.min(), part.gaps.max()]
            ends = {"gaps": gaps, "restitution": part.restitution.min()}
            ends |= {"stiffness": np.multiply.outer([part.stiffness.min(), part.stiffness.max()], STIFFER).ravel()}
            case = f"masses of {items[first].name} times {factor:g}"
            ends |= {"scale": part.scale.max(), "steps": STEPS}
            batches.append(make_batch(SWEEP, case, replace(spec.scene, row=items), law, motion, **ends))
    return batches


def random_batches(scenes: int, seed: int, laws: Sequence[Law]) -> list[Batch]:
    """Draw random scenes: rows, gaps, contacts and ground motions."""
    batches = []
    for i in range(-(-scenes // LANES)):
        rng, law = np.random.default_rng([seed, i]), laws[i % len(laws)]
        scene = _random_scene(rng, ("left", "right") if (i // len(laws)) % 2 == 0 else ("left",))
        # a gap is met only if the buildings move as far: drawn around the displacement of the softest one
        period, pga = max(b.periods[0] for b in scene.buildings), _log(rng, 0.05, 20.0)
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
        batches.append(Batch(RANDOM, f"number {i}", scene, law, motion, table, RANDOM_STEPS))
    return batches


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return np.exp(rng.uniform(np.log(low), np.log(high)))


def _random_scene(rng: np.random.Generator, names: Sequence[str]) -> Scene:
    """Draw two buildings of two storeys, or one of one storey beside a wall."""
    buildings: list[Building | Wall] = []
    for name in names:
        plain = oscillator(name, _log(rng, 0.05, 3.0), _log(rng, 1.0, 1e4), len(names))
        factors = rng.uniform(0.5, 2.0, (2, 2)) if len(names) == 2 else np.ones((2, 1))
        masses, stiffnesses = (factors * [plain.masses, plain.storey_stiffnesses]).tolist()
        buildings.append(Building(name, masses, stiffnesses, rng.choice([0.0, 0.02, 0.05, 0.2, 0.6])))
    return row(*buildings, *([Wall()] if len(names) == 1 else []))


def _random_motion(rng: np.random.Generator, pga: float) -> Record:
    """Draw white noise, a pulse or, as likely as both, an earthquake."""
    kind, dt = rng.integers(4), float(rng.choice([0.005, 0.01, 0.02]))
    if kind == 0:
        noise = rng.standard_normal(round(1.0 / dt))
        return Record("noise", dt, pga * noise / np.abs(noise).max())
    if kind == 1:
        t, width = np.arange(0.0, 1.5, dt), _log(rng, 0.05, 0.6)
        return Record("pulse", dt, pga * np.where(t < width, np.sin(2.0 * np.pi * t / width), 0.0))
    return synthetic_record(int(rng.integers(10**6)), duration=2.0, dt=dt, pga=pga, rise=0.1, strong=0.6)


#: A reference run is believed where one of half the step agrees with it this closely.
CONVERGED = 0.1 * OK_CLAIM
#: Most energy that contacts may create in an ok scenario, relative to the largest energy of its balance.
CREATED_BOUND = 0.01
#: Most energy of a scenario, relative to what the ground can bring in: ok, and any other with values.
ENERGY_BOUNDS = 1.01, 1.1
#: Seconds of CPU time that a run of a few scenarios may take.
TIME_LIMIT = 60.0
#: Longest reference run (steps of the record).
REFERENCE_STEPS = 4_000_000


class Reference(NamedTuple):
    """What the scenarios of a batch should give."""

    values: Values  # of shape (n, ...); NaN where no step was fine enough
    step: np.ndarray  # time step (s) of the converged run, shape (n,); NaN without one


@dataclass(frozen=True)
class Run:
    """What a batch gave in one scheme at one step."""

    batch: Batch
    numerics: Numerics
    values: Values
    seconds: float = 0.0  # CPU time


def peak_error(values: Mapping[str, np.ndarray], reference: Mapping[str, np.ndarray]) -> np.ndarray:
    """Largest relative error of a run's peaks in each scenario, shape (n,)."""
    peaks = [name for name in (*PEAKS, *YIELDING_PEAKS) if name in values]
    return np.max(list(registry.relative_errors(peaks, values, reference).values()), axis=0)


def make_reference(batch: Batch, wanted: np.ndarray, shortest: np.ndarray) -> Reference:
    """Run scenarios by `reference_scheme` at ever finer steps until half the step changes nothing that matters.

    `shortest` contact (s) of each scenario.
    """
    steps, rows = np.full(len(batch), np.nan), np.flatnonzero(wanted)
    step, method = batch.record.dt, reference_scheme(batch.scene, batch.table.gaps)
    if len(rows):
        step = min(min(batch.steps) / 4.0, shortest[rows].min() / 40.0, batch.stable_step("rk4")[rows].min() / 4.0)
    coarse = batch[rows].run(Numerics(method, step))
    values = {name: np.full((len(batch), *column.shape[1:]), np.nan) for name, column in coarse.items()}
    while len(rows) and batch.record.duration / step <= REFERENCE_STEPS:
        step /= 2.0
        fine = batch[rows].run(Numerics(method, step))
        done = (fine["status"] == Status.OK) & (coarse["status"] == Status.OK)
        done &= peak_error(coarse, fine) <= CONVERGED
        for name, column in fine.items():
            values[name][rows[done]] = column[done]
        steps[rows[done]] = step
        rows, coarse = rows[~done], {name: column[~done] for name, column in fine.items()}
    return Reference(values, steps)


def sensitive_rows(batch: Batch, reference: Reference, rows: np.ndarray) -> np.ndarray:
    """Whether a change of all inputs by `CHANGE` changes a peak of each of those scenarios by more than the claim."""
    sensitive = np.zeros(len(rows), bool)
    expected = {name: values[rows] for name, values in reference.values.items()}
    method = reference_scheme(batch.scene, batch.table.gaps)
    numerics = Numerics(method, np.nanmin(reference.step[rows]))
    for change in (CHANGE, -CHANGE):  # a touch that just comes goes with more gap, and the reverse
        moved = replace(batch, table=changed(batch.table[rows], change))
        sensitive |= peak_error(moved.run(numerics), expected) > OK_CLAIM
    return sensitive


def unsettled_rows(run: Run, rows: np.ndarray) -> np.ndarray:
    """Whether a run at half the step of each of those scenarios differs by more than `SETTLED`."""
    half = run.batch[rows].run(replace(run.numerics, dt=run.numerics.dt / 2.0, refinement=2.0))
    whole = {name: values[rows] for name, values in run.values.items()}
    return (peak_error(whole, half) > SETTLED) | (half["status"] != Status.OK)


def energy_share(batch: Batch, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Energy at the end, or as the displacements imply, over what the ground can have brought in, shape (n,)."""
    limit = energy_limit(batch.scene, batch.record, batch.table.scale, batch.initial_velocity)
    share = (values["energy_kinetic"] + values["energy_strain"]).sum(axis=1)
    yields = any(batch.scene.yields)  # beyond yielding a displacement grows up to like its energy, not like the root
    reach = displacement_limit(batch.scene, limit if yields else np.ones(len(batch)))
    reach = registry.scatter_dof(reach, batch.scene)
    for name in ("displacement_max", "displacement_min"):
        part = np.abs(values[name]) / np.where(reach > 0.0, reach, 1e-300)
        implied = (limit[:, None, None] * part if yields else np.square(part)).reshape(len(batch), -1)
        share = np.maximum(share, np.fmax.reduce(implied, axis=1, initial=0.0))
    return np.where(share == 0.0, 0.0, share / np.where(limit > 0.0, limit, 1e-300))


def created_energy(values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Energy that contacts created, over the largest energy of the balance, shape (n,)."""
    work = values["contact_work"]
    gained = values["energy_kinetic"] + values["energy_strain"]
    parts = [np.abs(values["energy_input"]), values["energy_damping"], gained, np.abs(work)]
    size = np.max([part.sum(axis=1) for part in parts], axis=0)
    return (0.0 - work.min(axis=1, initial=0.0)) / np.where(size > 0.0, size, 1.0)


def judge(run: Run, reference: Reference) -> pd.DataFrame:
    """Judge what a run of a batch gave; a row per scenario.

    ``error``: largest relative one of a peak, NaN where it is not judged; ``missed``: ok, but off by more than the
    claim; ``unsettled``, ``sensitive``: those of them that half the step gives away, and that are sensitive;
    ``unknown``: ok, but without a reference; ``created``: energy by contacts over the largest of the balance;
    ``energy``: over what the ground can have brought in; ``faults``: demands that are not met.
    """
    batch, numerics, values, status = run.batch, run.numerics, dict(run.values), run.values["status"]
    if "residual_drift" in values:  # nothing rests where a storey falls
        fell = (status == Status.COLLAPSED)[:, None, None]
        values["residual_drift"] = np.where(fell, np.nan_to_num(values["residual_drift"]), values["residual_drift"])
    ok, has_values, has_reference = status == Status.OK, np.isin(status, WITH_VALUES), np.isfinite(reference.step)
    checked = [
        array[:, _exists(batch.scene, name, array.shape[1:])]
        for name, array in values.items()
        if not get_variable(name).always and not (batch.law.impulsive and get_variable(name).of_force)
    ]
    is_finite = np.isfinite(np.hstack(checked))
    finite, empty = is_finite.all(axis=1), ~is_finite.any(axis=1)
    sound = has_values & finite
    with np.errstate(invalid="ignore", over="ignore"):
        created = np.where(sound, created_energy(values), 0.0)
        share = np.where(sound, energy_share(batch, values), 0.0)
    judged = ok & sound & has_reference
    error = np.where(judged, peak_error(values, reference.values), np.nan)
    missed = judged & (error > OK_CLAIM)
    sensitive, unsettled = np.zeros((2, len(batch)), bool)
    if len(rows := np.flatnonzero(missed)):
        sensitive[rows], unsettled[rows] = sensitive_rows(batch, reference, rows), unsettled_rows(run, rows)
    off = f"is ok at half the step too, but a peak is off by {{:.3g}} (claim {OK_CLAIM:g})"
    first = np.arange(len(batch)) == 0
    implicit = numerics.scheme.implicit and not any(batch.scene.falls)  # a fall in too large a step is no result
    demands = (
        (has_values & ~finite, "has values that are not finite", share),
        (~has_values & ~empty, "has no result by its status, but finite values", share),
        (status == Status.NOT_RUN, "was not run", share),
        ((status == Status.DIVERGED) & implicit, "diverged, though its contact is implicit", share),
        (ok & (created > CREATED_BOUND), "its contacts created energy: {:.3g} of the balance", created),
        (share > np.where(ok, *ENERGY_BOUNDS), "holds {:.4g} times the energy that can have come in", share),
        (missed & ~unsettled & ~sensitive, off, error),
        (first & (run.seconds > TIME_LIMIT), f"took {run.seconds:.0f} s", share),
    )
    faults = [[text.format(number[i]) for rows, text, number in demands if rows[i]] for i in range(len(batch))]
    return pd.DataFrame(
        {
            "family": batch.family,
            "case": batch.case,
            "law": batch.law.key,
            **{name: getattr(numerics, name) for name in ("method", "precision", "dt")},
            **{name: getattr(batch.table, name) for name in ("stiffness", "restitution", "scale")},
            "gaps": batch.table.gaps.tolist(),
            "status": [STATUS[code].label for code in status.astype(int)],
            "error": error,
            "missed": missed,
            "unsettled": unsettled,
            "sensitive": sensitive,
            "unknown": ok & sound & ~has_reference,
            "created": created,
            "energy": share,
            "faults": faults,
            "seconds": run.seconds / len(batch),
        }
    )


def _exists(scene: Scene, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Whether there is what a value is of, not so at walls, missing storeys and floors that meet nothing."""
    per = get_variable(name).per
    if per == "floor":
        column = np.where(scene.yields, 0.0, np.nan) if name in YIELDING_PEAKS else np.zeros(scene.n_dof)
    elif per == "contact":
        column = np.zeros(len(scene.contacts))
    else:
        return np.ones(shape, bool)
    return np.isfinite(registry.scatter(column, scene, per))


def run_judged(batch: Batch, precision: str, methods: Sequence[str]) -> list[pd.DataFrame]:
    """Run a batch in each scheme at every step, and judge all runs against one reference."""
    runs, wanted, shortest = [], np.zeros(len(batch), bool), np.full(len(batch), np.inf)
    for method, dt in product(batch.schemes(methods), batch.steps):
        numerics = Numerics(method, dt, precision=precision)
        start = time.process_time()  # machines may be busy with other work
        values = batch.run(numerics)
        runs.append(Run(batch, numerics, values, time.process_time() - start))
        ok = values["status"] == Status.OK
        wanted |= ok
        shortest = np.fmin(shortest, np.where(ok, values["steps_per_contact"] * batch.step(numerics), np.nan))
    reference = make_reference(batch, wanted, shortest)
    return [judge(run, reference) for run in runs]


#: Name of the family of random scenes, and how many there are where no number is given.
RANDOM, DEFAULT_SCENES = "random", 320
#: What a violation says of its scenario: all that is needed to run it again.
_VIOLATION = ["fault", "family", "case", "law", "method", "precision", "dt", "status"]
_VIOLATION += ["gaps", "stiffness", "restitution", "scale"]


def run_extremes(
    scenes: int = DEFAULT_SCENES,
    *,
    seed: int = 1,
    laws: Iterable[str | Law] | None = None,
    families: Iterable[str] | None = None,
    methods: Iterable[str] | None = None,
    precision: str = "float64",
    sweep: SweepSpec | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Run the stability suite, in the schemes that ``accuracy`` chooses from by default; returns its report, for JSON.

    With a `sweep` its row and laws are run in place of scenes and families that are not named. The report has a
    conclusion, a result for each family and scheme, the number of violations, and what was run in which time.
    """
    schemes = measured_schemes() if methods is None else tuple(methods)
    if sweep is not None:
        laws, families = laws or [sweep.law(key) for key in sweep.laws], families or ()
    chosen = [law for law in map(get_law, LAWS if laws is None else laws) if law.has_contact]
    if not chosen:
        raise InputError(
            f"no law with contact is given; give some of {', '.join(k for k, v in LAWS.items() if v.has_contact)}"
        )
    if scenes < 0 or seed < 0:
        raise InputError(f"scenes = {scenes} and seed = {seed} must not be negative")
    progress, start = progress or Progress(), time.perf_counter()
    valid = [*all_families(), RANDOM]
    keys = dict.fromkeys(valid if families is None else families)
    for key in keys:
        check_choice("family", key, valid)
    batches = family_batches([key for key in keys if key != RANDOM], chosen)
    batches += random_batches(scenes, seed, chosen) if RANDOM in keys else []
    batches += [batch for batch in sweep_batches(sweep) if batch.law in chosen] if sweep else []
    kernels = [
        batch.kernel(Numerics(method, batch.steps[0], precision=form))
        for batch in batches
        for method in batch.schemes(schemes)
        for form in ("float64", precision)
    ]
    prepare_kernels(kernels, workers, progress)
    ready = time.perf_counter()
    verdicts: list[pd.DataFrame] = []
    progress.stage("batches", len(batches))
    for batch in batches:
        verdicts += run_judged(batch, precision, schemes)
        progress.advance(1)
    results = summarise(pd.concat(verdicts, ignore_index=True)) if verdicts else []
    return {
        "claim": OK_CLAIM,
        "conclusion": conclude(results),
        "results": results,
        "laws": [law.key for law in chosen],
        "scenes": scenes,
        "seed": seed,
        "seconds": time.perf_counter() - ready,  # wall time, references included, compilation of kernels not
        "compile_seconds": ready - start,
        "violations": sum(len(result["violations"]) for result in results),
    }


def conclude(results: Sequence[Mapping[str, Any]]) -> str:
    """Say what an ok was worth, and how far it holds."""
    able = [result for result in results if Status.OK.label in result["statuses"]]
    among = f"in {sum(result['scenarios'] for result in results)} extreme scenarios"
    if not able:
        return f"No result was called ok {among}."
    worst, stiffness, step = (
        max(result[name] for result in able) for name in ("worst_error", "largest_ok_stiffness", "largest_ok_step")
    )
    excused = sum(result["excused"] for result in able)
    but = f", but {excused} that half the step or inputs changed by {CHANGE:g} change as much" if excused else ""
    holds = f"ok holds up to k = {stiffness:.2g} kN/m^n, step = {step:g} s."
    return f"No result called ok was off by more than {100.0 * worst:.2g} % {among}{but}; {holds}"


def summarise(verdicts: pd.DataFrame) -> list[dict[str, Any]]:
    """Count the verdicts of each family and scheme; ``seconds`` are CPU time of the runs, without references."""
    results = []
    for (family, method), part in verdicts.groupby(["family", "method"], sort=False):
        faults = part.explode("faults").dropna(subset="faults").rename(columns={"faults": "fault"})
        errors = part.error[~part.unsettled & ~part.sensitive & np.isfinite(part.error)]
        is_ok = part.status == Status.OK.label
        created = part.created[is_ok]
        results.append(
            {
                "family": family,
                "method": method,
                "scenarios": len(part),
                "statuses": part.status.value_counts(sort=False).to_dict(),
                **{name: int(part[name].sum()) for name in ("missed", "sensitive", "unknown")},
                "excused": int((part.unsettled | part.sensitive).sum()),
                "largest_ok_stiffness": float(part.stiffness[is_ok].max()),
                "largest_ok_step": float(part.dt[is_ok].max()),
                "worst_error": float(errors.to_numpy().max(initial=0.0)),
                "worst_created_energy": float(created.to_numpy().max(initial=0.0)),
                "violations": faults[_VIOLATION].to_dict("records"),
                "seconds": float(part.seconds.sum()),
            }
        )
    return results


#: Schemes and number formats of the map, and its restitution.
SHOWN = (("rk4", "float64"), ("newmark", "float64"), ("rk4", "float32"), ("newmark", "float32"))
RESTITUTION = 0.6


def stability_map(
    law: str | Law = "kelvin_voigt",
    *,
    stiffnesses: Sequence[float] = tuple(np.logspace(3, 12, 19)),
    steps: Sequence[float] = tuple(np.geomspace(1e-5, 2e-2, 12)),
) -> xr.Dataset:
    """Run one scene at every contact stiffness and time step, and compare with converged runs."""
    chosen = get_law(law)
    if chosen.exponent is None:
        raise InputError(f"law {chosen.key!r} has no contact force to map; give one with a contact stiffness")
    batch = make_batch(
        "map", "", pair(), chosen, earthquake(dt=0.02), stiffness=stiffnesses, restitution=RESTITUTION, steps=steps
    )
    grid = [Numerics(method, dt, precision=form) for (method, form), dt in product(SHOWN, steps)]
    runs = {numerics: batch.run(numerics) for numerics in grid}
    status = np.array([run["status"] for run in runs.values()], np.int8).reshape(len(SHOWN), -1, len(batch))
    contacts = [run["steps_per_contact"] * batch.step(numerics) for numerics, run in runs.items()]
    shortest = np.fmin.reduce([np.full(len(batch), np.inf), *contacts])
    # one stiffness at a time: a stiff contact needs a fine reference, a soft one does not
    references = [make_reference(batch[[i]], np.ones(1, bool), shortest[[i]]) for i in range(len(batch))]
    name = "impact_force_max"
    expected = np.concatenate([reference.values[name] for reference in references])
    has_reference = np.isfinite(np.concatenate([reference.step for reference in references]))
    errors = np.array([registry.relative_error(name, run[name], expected) for run in runs.values()]).reshape(
        status.shape
    )
    drawn = has_reference & np.isin(status, WITH_VALUES)
    dims, codes = ("scheme", "dt", "stiffness"), np.arange(len(STATUS), dtype=np.int8)
    about = {"units": "1", "long_name": "relative error of the peak contact force"}
    flags = {"flag_values": codes, "flag_meanings": " ".join(s.label for s in STATUS)}
    unit = {"units": chosen.stiffness_unit, "long_name": "contact stiffness"}
    return xr.Dataset(
        {
            "peak_force_error": (dims, np.where(drawn, errors, np.nan), about),
            "status": (dims, status, {"long_name": "status of the scenario", **flags}),
        },
        {
            "scheme": [f"{method} {precision}" for method, precision in SHOWN],
            "stiffness": ("stiffness", list(stiffnesses), unit),
            "dt": ("dt", list(steps), {"units": "s", "long_name": "time step"}),
        },
        {
            **global_attributes(f"Stability map: {chosen.title}"),
            "law": chosen.key,
            "restitution": RESTITUTION if chosen.takes_restitution else "none",
            "ok_claim": OK_CLAIM,
        },
    ).transpose("scheme", "stiffness", "dt")
