"""The stability suite: families of extreme scenarios in every scheme, every one judged and counted.

A batch is run as a chunk of a sweep is: by the same function, with the same statuses and masks. Few shapes of row are
used, so that few kernels are compiled. Five things are demanded of a run, at any step:

1. It ends, within a bounded time, and with Newmark's method it stays bounded.
2. Its status tells the truth: a scenario with values has finite ones only, one without has none.
3. Its energy is possible. The ground can bring no more energy into a row than
   ``(sqrt(M) int |a_g| dt + sqrt(2 E_0))**2 / 2`` (M all masses, E_0 the energy at the start), because contacts and
   dampers only take energy; that bounds the energy at the end and every displacement, resolved or not.
4. Where the status is ok, contacts create no energy: their work is not negative.
5. Where the status is ok, and a run at half the step agrees within `SETTLED`, the peaks are within `OK_CLAIM` of those
   of a converged run, unless it is sensitive: `CHANGE` of all inputs changes a peak by more than that.

All ok scenarios that are farther off are counted as missed by the rules of the status, whether half the step tells them
or not and however sensitive they are.
"""

from __future__ import annotations

import math
import os
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.engine.compile import prepare, still_to_compile
from pounding_sweep.engine.postprocess import displacement_limit, energy_limit
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.laws import LAWS, Law, get_law
from pounding_sweep.model.scene import CONTACTS, Building, Foundation, Scene, Wall
from pounding_sweep.model.variants import variants_of
from pounding_sweep.output.dataset import made_here
from pounding_sweep.outputs.variables import (
    CHANGE,
    OK_CLAIM,
    SETTLED,
    STATUS,
    Status,
    cube_variables,
    get_variable,
    inner_shape,
    mask_invalid,
    reducers_for,
    relative_error,
    scatter_contact,
    scatter_dof,
)
from pounding_sweep.plan.advice import measured_schemes
from pounding_sweep.plan.scenarios import Scenarios, changed
from pounding_sweep.records import Record, synthetic_record
from pounding_sweep.run.execute import Progress
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
    """Return the batch of every combination of values (numbers or lists; a gap is that of every pair, or "last hairs").

    `times` multiplies the default stiffness; a restitution below the lowest of the law stands for that.
    """
    if stiffness is None:
        stiffness = STIFFNESS.get(law.exponent or 1.0, 1.0e6) * np.asarray(times)
    gaps = _last_hairs() if isinstance(gaps, str) else gaps
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
_SAMPLES = np.arange(101)
#: Ground motions of families, by name.
RECORDS = {
    record.name: record
    for record in (
        _ground("slow", 3.0 * np.sin(np.arange(81) * 1.7), 0.5),
        _ground("one point", [3.0]),
        _ground("two points", [3.0, -3.0]),
        _ground("constant", 4.0 + 0.0 * _SAMPLES),
        _ground("one spike", 50.0 * (_SAMPLES == 20)),
        _ground("all spikes", np.resize([20.0, -20.0], 101)),
        _ground("two points, far apart", [0.0, 5.0], 2.0),
        _ground("ramp", -np.linspace(0.0, 3.0, 151)),
        _ground("push", np.full(151, -5.0)),
        _ground("push and rest", np.where(np.linspace(0.0, 2.0, 201) < 0.5, -6.0, 0.0)),
        _ground("quiet", 0.0 * _SAMPLES),
        earthquake(duration=0.3).renamed("short"),
    )
}
#: Rows of buildings of families, by name.
SCENES: dict[str, Callable[..., Scene]] = {
    "pair": pair,
    "wall": beside_wall,
    "mass ratio": lambda ratio: pair(ratio=ratio),
    "periods": lambda left, right: pair((left, right)),
    "damping": lambda damping: pair(damping=damping),
    "yielding": yielding_pair,
    "staggered": staggered,
    "struck column": lambda xi: staggered(3.0 + 3.0 * xi),
    "bases": on_bases,
    "one building": lambda: Scene([oscillator("alone", 0.4, 100.0, 2)]),
    "12 buildings": lambda: Scene(
        [oscillator(f"b{i}", 0.1 + 0.05 * i, 60.0 + 10.0 * (i % 3)) for i in range(12)], [0.002] * 11
    ),
    "40 and 5 storeys": lambda: Scene(
        [oscillator("tower", 4.0, 300.0, 40), oscillator("house", 0.5, 200.0, 5)], [0.005]
    ),
    "between walls": lambda: Scene([Wall("west"), oscillator("between", 0.4), Wall("east")], [0.002, 0.002]),
    "three": lambda: Scene(
        [oscillator(name, t, 100.0, 2) for name, t in (("west", 0.4), ("between", 0.25), ("east", 0.4))], [0.002, 0.002]
    ),
}


@cache
def all_families() -> dict[str, list[Case]]:
    """Return every family by name, from ``data/extremes.toml``."""
    families: dict[str, list[Case]] = {}
    text = files("pounding_sweep").joinpath("data", "extremes.toml").read_text("utf-8")
    for family, rows in tomllib.loads(text).items():
        families[family] = []
        for row in rows:
            more: dict[str, Any] = {
                key: tuple(value) if isinstance(value, list) else value for key, value in row.items()
            }
            name, scene, of = more.pop("name"), SCENES[more.pop("scene")], more.pop("of", ())
            if "record" in more:
                more["record"] = RECORDS[more["record"]]
            families[family] += [(name.format(*values), scene(*values), more) for values in product(*of)]
    return families


def family_batches(keys: Iterable[str], laws: Sequence[Law]) -> list[Batch]:
    """Return the batches of some families under some laws."""
    first_of_exponent = list({law.exponent: law for law in reversed(laws)}.values())
    return [
        make_batch(key, case, scene, law, **more)
        for key in keys
        for law in (first_of_exponent if key in OF_MANY_SHAPES else laws)
        if law.exponent == 1.0 or key not in LINEAR
        for case, scene, more in all_families()[key]
    ]


# --- random scenes ---------------------------------------------------------------------------------------------------


def random_batches(scenes: int, seed: int, laws: Sequence[Law]) -> list[Batch]:
    """Draw random scenes: rows, gaps, contacts and ground motions."""
    return [_draw(np.random.default_rng([seed, i]), i, laws) for i in range(-(-scenes // LANES))]


def _draw(rng: np.random.Generator, number: int, laws: Sequence[Law]) -> Batch:
    law = laws[number % len(laws)]
    scene = _random_scene(rng, ("left", "right") if (number // len(laws)) % 2 == 0 else ("left",))
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


def _random_scene(rng: np.random.Generator, names: Sequence[str]) -> Scene:
    """Draw two buildings of two storeys, or one of one storey beside a wall."""
    buildings: list[Building | Wall] = []
    for name in names:
        plain = oscillator(name, _log(rng, 0.05, 3.0), _log(rng, 1.0, 1e4), len(names))
        masses, stiffnesses = plain.masses, plain.stiffnesses
        if len(names) == 2:
            masses, stiffnesses = (rng.uniform(0.5, 2.0, (2, 2)) * [plain.masses, plain.stiffnesses]).tolist()
        buildings.append(Building(name, masses, stiffnesses, float(rng.choice([0.0, 0.02, 0.05, 0.2, 0.6]))))
    return Scene([*buildings, Wall()][:2], [0.0])


def _random_motion(rng: np.random.Generator, pga: float) -> Record:
    kind, dt = rng.integers(4), float(rng.choice([0.005, 0.01, 0.02]))
    if kind == 0:  # white noise: the roughest that a record can be
        noise = rng.standard_normal(round(1.0 / dt))
        return _ground("noise", pga * noise / np.abs(noise).max(), dt)
    if kind == 1:  # a pulse
        t, width = np.arange(0.0, 1.5, dt), _log(rng, 0.05, 0.6)
        return _ground("pulse", pga * np.where(t < width, np.sin(2.0 * np.pi * t / width), 0.0), dt)
    return synthetic_record(int(rng.integers(10**6)), duration=2.0, dt=dt, pga=pga, rise=0.1, strong=0.6)


#: A reference run is believed where one of half the step agrees with it this closely.
CONVERGED = 0.1 * OK_CLAIM
#: Most energy that contacts may create in an ok scenario, relative to the largest energy of its balance.
CREATED_BOUND = 0.01
#: Most energy of a scenario, relative to what the ground can bring in: ok, and any other with values.
ENERGY_BOUND = {True: 1.01, False: 1.1}
#: Seconds of CPU time that a run of a few scenarios may take.
TIME_LIMIT = 60.0
#: Longest reference run (steps of the record).
REFERENCE_STEPS = 4_000_000


@dataclass(frozen=True)
class Reference:
    """What the scenarios of a batch should give."""

    peaks: dict[str, np.ndarray]  # the peaks, shape (n, ...); NaN where there is no reference
    known: np.ndarray  # whether the reference converged; shape (n,)
    step: np.ndarray  # its time step (s); shape (n,)


@dataclass(frozen=True)
class Run:
    """What a batch gave in one scheme at one step."""

    batch: Batch
    method: str
    dt: float  # largest time step (s)
    values: Values
    precision: str = "float64"
    seconds: float = 0.0  # CPU time

    @property
    def status(self) -> np.ndarray:
        """Status of each scenario."""
        return self.values["status"]


@dataclass(frozen=True)
class Verdict:
    """What the judge found in a run; arrays of shape (n,)."""

    run: Run
    error: np.ndarray  # largest relative error of a peak; NaN where it was not to be judged
    #: ok, but off by more than the claim; those of them that half the step gives away, and that are sensitive
    missed: np.ndarray
    told: np.ndarray
    sensitive: np.ndarray
    unknown: np.ndarray  # ok, but without a converged reference
    created: np.ndarray  # energy created by contacts, relative to the largest of the balance
    energy: np.ndarray  # largest energy, over what the ground can have brought in
    faults: list[tuple[int, str]]  # scenario and what is wrong with it


def peaks_of(values: Mapping[str, np.ndarray]) -> Values:
    """Return the judged peaks, those that are there; both displacements as one, so that the larger is the measure."""
    both = np.stack([values["displacement_max"], values["displacement_min"]], axis=1)
    names = (name for name in (*PEAKS[2:], *YIELDING_PEAKS) if name in values)
    return {"displacement_max": both, **{name: values[name] for name in names}}


def peak_error(peaks: Mapping[str, np.ndarray], reference: Mapping[str, np.ndarray]) -> np.ndarray:
    """Largest relative error of the peaks of each scenario, shape (n,)."""
    return np.max([relative_error(name, peaks[name], reference[name]) for name in reference], axis=0)


def make_reference(batch: Batch, wanted: np.ndarray, shortest: np.ndarray) -> Reference:
    """Run scenarios by RK4 at ever finer steps until half the step changes nothing that matters.

    `shortest` contact (s) of each scenario.
    """
    known, steps, rows = np.zeros(len(batch), bool), np.full(len(batch), np.nan), np.flatnonzero(wanted)
    step = batch.record.dt
    if len(rows):
        step = min(min(batch.steps) / 4.0, shortest[rows].min() / 40.0, batch.stable_step("rk4")[rows].min() / 4.0)
    coarse = batch[rows].run("rk4", step)
    peaks = {name: np.full((len(batch), *each.shape[1:]), np.nan) for name, each in peaks_of(coarse).items()}
    while len(rows) and batch.record.duration / step <= REFERENCE_STEPS:
        step /= 2.0
        fine = batch[rows].run("rk4", step)
        done = (fine["status"] == Status.OK) & (coarse["status"] == Status.OK)
        done &= peak_error(peaks_of(coarse), peaks_of(fine)) <= CONVERGED
        for name, values in peaks_of(fine).items():
            peaks[name][rows[done]] = values[done]
        known[rows[done]], steps[rows[done]] = True, step
        rows, coarse = rows[~done], {name: values[~done] for name, values in fine.items()}
    return Reference(peaks, known, steps)


def sensitive_rows(batch: Batch, reference: Reference, rows: np.ndarray) -> np.ndarray:
    """Whether a change of all inputs by `CHANGE` changes a peak of each of those scenarios by more than the claim."""
    sensitive = np.zeros(len(rows), bool)
    against = {name: values[rows] for name, values in reference.peaks.items()}
    for change in (CHANGE, -CHANGE):  # a touch that just comes goes with more gap, and the reverse
        moved = replace(batch, table=changed(batch.table[rows], change))
        peaks = peaks_of(moved.run("rk4", float(np.nanmin(reference.step[rows]))))
        sensitive |= peak_error(peaks, against) > OK_CLAIM
    return sensitive


def told_rows(run: Run, rows: np.ndarray) -> np.ndarray:
    """Whether a run at half the step of each of those scenarios differs by more than `SETTLED`."""
    half = run.batch[rows].run(run.method, run.dt / 2.0, run.precision, refinement=2.0)
    whole = {name: values[rows] for name, values in run.values.items()}
    return (peak_error(peaks_of(whole), peaks_of(half)) > SETTLED) | (half["status"] != Status.OK)


def energy_share(batch: Batch, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Energy at the end, or as the displacements imply, over what the ground can have brought in, shape (n,)."""
    limit = energy_limit(batch.scene, batch.record, batch.table.scale, batch.initial_velocity)
    share = (values["energy_kinetic"] + values["energy_strain"]).sum(axis=1)
    yields = any(batch.scene.yields)  # beyond yielding a displacement grows up to like its energy, not like the root
    reach = scatter_dof(displacement_limit(batch.scene, limit if yields else np.ones(len(batch))), batch.scene)
    for name in ("displacement_max", "displacement_min"):
        part = np.abs(values[name]) / np.where(reach > 0.0, reach, 1e-300)
        implied = (limit[:, None, None] * part if yields else np.square(part)).reshape(len(batch), -1)
        share = np.maximum(share, np.max(np.nan_to_num(implied, nan=0.0, posinf=np.inf), axis=1))
    return np.where(share == 0.0, 0.0, share / np.where(limit > 0.0, limit, 1e-300))


def created_energy(values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Energy that contacts created, over the largest energy of the balance, shape (n,)."""
    work = values["contact_work"]
    gained = values["energy_kinetic"] + values["energy_strain"]
    parts = [np.abs(values["energy_input"]), values["energy_damping"], gained, np.abs(work)]
    size = np.max([part.sum(axis=1) for part in parts], axis=0)
    return np.asarray(np.abs(work.min(axis=1, initial=0.0)) / np.where(size > 0.0, size, 1.0))


def judge(run: Run, reference: Reference) -> Verdict:
    """Judge what a run of a batch gave."""
    batch, values, status = run.batch, run.values, run.status
    ok, has_values = status == Status.OK, np.isin(status, [int(s) for s in STATUS if s.has_values])
    finite, empty = np.ones(len(batch), bool), np.ones(len(batch), bool)
    for name in values:
        if name not in ("status", "steps_per_contact") and not (batch.law.impulsive and get_variable(name).of_force):
            found = np.isfinite(values[name][:, _exists(batch, name, values[name])])
            finite &= found.all(axis=1)
            empty &= ~found.any(axis=1)
    sound = has_values & finite
    with np.errstate(invalid="ignore", over="ignore"):
        created = np.where(sound, created_energy(values), 0.0)
        share = np.where(sound, energy_share(batch, values), 0.0)
    judged = ok & sound & reference.known
    error = np.where(judged, peak_error(peaks_of(values), reference.peaks), np.nan)
    missed = judged & (error > OK_CLAIM)
    sensitive, told = np.zeros(len(batch), bool), np.zeros(len(batch), bool)
    rows = np.flatnonzero(missed)
    if len(rows):
        sensitive[rows], told[rows] = sensitive_rows(batch, reference, rows), told_rows(run, rows)
    off = f"is ok at half the step too, but a peak is off by {{:.3g}} (claim {OK_CLAIM:g})"
    beyond = share > np.where(ok, ENERGY_BOUND[True], ENERGY_BOUND[False])
    demands = (
        (has_values & ~finite, "has values that are not finite", share),
        (~has_values & ~empty, "has no result by its status, but finite values", share),
        (status == Status.NOT_RUN, "was not run", share),
        ((status == Status.DIVERGED) & SCHEMES[run.method].implicit, "diverged, though its contact is implicit", share),
        (ok & (created > CREATED_BOUND), "its contacts created energy: {:.3g} of the balance", created),
        (beyond, "holds {:.4g} times the energy that can have come in", share),
        (missed & ~told & ~sensitive, off, error),
        ((np.arange(len(batch)) == 0) & (run.seconds > TIME_LIMIT), f"took {run.seconds:.0f} s", share),
    )
    faults = [(int(i), text.format(float(of[i]))) for rows, text, of in demands for i in np.flatnonzero(rows)]
    unknown = ok & sound & ~reference.known
    return Verdict(run, error, missed, told, sensitive, unknown, created, share, faults)


def _exists(batch: Batch, name: str, values: np.ndarray) -> np.ndarray:
    """Whether there is what a value is of, not so at walls, missing storeys and floors that meet nothing."""
    dims, scene = get_variable(name).dims, batch.scene
    if dims == ("building", "storey"):
        exists = np.where(scene.yields, 0.0, np.nan) if name in YIELDING_PEAKS else np.zeros(scene.n_dof)
        return np.isfinite(scatter_dof(exists[None], scene))[0]
    if dims == ("pair", "storey"):
        return np.isfinite(scatter_contact(np.zeros((1, len(scene.contacts))), scene))[0]
    return np.ones(values.shape[1:], bool)


#: Name of the family of random scenes, and how many there are where no number is given.
RANDOM, DEFAULT_SCENES = "random", 320


@dataclass
class FamilyResult:
    """What the judge found of a family in one scheme."""

    family: str
    method: str
    scenarios: int = 0  # each step counted
    statuses: Counter[str] = field(default_factory=Counter)  # scenarios by label of their status
    #: ok scenarios that are off by more than the claim, those of them that are sensitive, and ok ones without reference
    missed: int = 0
    sensitive: int = 0
    unknown: int = 0
    worst_error: float = 0.0  # of ok scenarios that half the step does not give away and that are not sensitive
    worst_created_energy: float = 0.0  # by contacts of an ok scenario, relative to the largest energy of its balance
    #: scenarios that failed a demand, each with what is needed to run it again
    violations: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0  # CPU time of the runs, without references and compilation

    def add(self, verdict: Verdict) -> None:
        """Count one run of a batch."""
        status = verdict.run.status
        self.scenarios += len(status)
        self.statuses.update(STATUS[s].label for s in status)
        for name in ("missed", "sensitive", "unknown"):
            setattr(self, name, getattr(self, name) + int(getattr(verdict, name).sum()))
        errors = verdict.error[~verdict.told & ~verdict.sensitive & np.isfinite(verdict.error)]
        created = verdict.created[status == Status.OK]
        worst = {"worst_error": errors, "worst_created_energy": created}
        for name, values in worst.items():
            setattr(self, name, float(values.max(initial=getattr(self, name))))
        run, batch = verdict.run, verdict.run.batch
        for row, text in verdict.faults:
            where = {"fault": text, "family": self.family, "case": batch.case, "law": batch.law.key}
            how = {
                "method": self.method,
                "precision": run.precision,
                "dt": run.dt,
                "status": STATUS[int(status[row])].label,
            }
            names = ("gaps", "stiffness", "restitution", "scale")
            self.violations.append({**where, **how, **{n: getattr(batch.table, n)[row].tolist() for n in names}})
        self.seconds += verdict.run.seconds


@dataclass(frozen=True)
class Extremes:
    """What a run of the suite found."""

    results: list[FamilyResult]  # family by family, scheme by scheme
    laws: tuple[str, ...]
    scenes: int  # random ones
    seed: int  # of these
    seconds: float  # wall time, references included, compilation of kernels not
    compile_seconds: float  # time until all kernels were ready

    @property
    def faults(self) -> list[dict[str, Any]]:
        """Every violation."""
        return [violation for result in self.results for violation in result.violations]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        results = [vars(result) for result in self.results]
        return {"claim": OK_CLAIM, **vars(self), "results": results, "violations": len(self.faults)}


def run_extremes(
    scenes: int = DEFAULT_SCENES,
    *,
    seed: int = 1,
    laws: Iterable[str | Law] | None = None,
    families: Iterable[str] | None = None,
    methods: Iterable[str] | None = None,
    precision: str = "float64",
    workers: int | None = None,
    progress: Progress | None = None,
) -> Extremes:
    """Run the stability suite, in the schemes that ``accuracy`` chooses from unless others are given."""
    schemes = measured_schemes() if methods is None else tuple(methods)
    chosen = [law for law in (get_law(key) for key in (LAWS if laws is None else laws)) if law.has_contact]
    if not chosen:
        raise InputError(
            f"no law with contact is given; give some of {', '.join(k for k, v in LAWS.items() if v.has_contact)}"
        )
    if scenes < 0 or seed < 0:
        raise InputError(f"scenes = {scenes} and seed = {seed} must not be negative")
    progress, start = progress or Progress(), time.perf_counter()
    valid = [*all_families(), RANDOM]
    keys = valid if families is None else list(dict.fromkeys(families))
    for key in keys:
        if key not in valid:
            raise InputError(unknown("family", key, valid))
    batches = family_batches([key for key in keys if key != RANDOM], chosen)
    batches += random_batches(scenes, seed, chosen) if RANDOM in keys else []
    runs = [(batch, method) for batch in batches for method in batch.schemes(schemes)]
    formats = dict.fromkeys(("float64", precision))
    shapes = list(dict.fromkeys(b.kernel(method, b.steps[0], f).shape for b, method in runs for f in formats))
    progress.stage("compiling" if still_to_compile(shapes)[0] else "kernels", len(shapes))
    prepare(shapes, workers or len(os.sched_getaffinity(0)), progress.advance)
    ready = time.perf_counter()
    results: dict[tuple[str, str], FamilyResult] = {}
    progress.stage("batches", len(batches))
    for batch in batches:
        for verdict in run_judged(batch, precision, schemes):
            place = (batch.family, verdict.run.method)
            results.setdefault(place, FamilyResult(*place)).add(verdict)
        progress.advance(1)
    end = time.perf_counter()
    return Extremes(list(results.values()), tuple(law.key for law in chosen), scenes, seed, end - ready, ready - start)


def run_judged(batch: Batch, precision: str = "float64", methods: Sequence[str] | None = None) -> list[Verdict]:
    """Run a batch in each scheme at every step, and judge all runs against one reference."""
    runs, wanted, shortest = [], np.zeros(len(batch), bool), np.full(len(batch), np.inf)
    for method in batch.schemes(measured_schemes() if methods is None else methods):
        for dt in batch.steps:
            start = time.process_time()  # machines may be busy with other work
            values = batch.run(method, dt, precision)
            runs.append(Run(batch, method, dt, values, precision, time.process_time() - start))
            ok = values["status"] == Status.OK
            wanted |= ok
            shortest = np.fmin(shortest, np.where(ok, values["steps_per_contact"] * batch.step(method, dt), np.nan))
    reference = make_reference(batch, wanted, shortest)
    return [judge(run, reference) for run in runs]


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
    axes: dict[str, Any] = {"stiffness": stiffnesses, "restitution": RESTITUTION, "steps": tuple(steps)}
    batch = make_batch("map", "", pair(), chosen, earthquake(dt=0.02), **axes)
    runs = {
        (s, j): batch.run(method, dt, precision)
        for (s, (method, precision)), (j, dt) in product(enumerate(SHOWN), enumerate(steps))
    }
    status = np.zeros((len(SHOWN), len(batch), len(steps)), dtype=np.int8)
    error, shortest = np.full(status.shape, np.nan), np.full(len(batch), np.inf)
    for (s, j), run in runs.items():
        status[s, :, j] = run["status"]
        shortest = np.fmin(shortest, run["steps_per_contact"] * batch.step(SHOWN[s][0], steps[j]))
    # one stiffness at a time: a stiff contact needs a fine reference, a soft one does not
    for i in range(len(batch)):
        reference = make_reference(batch[[i]], np.ones(1, bool), shortest[[i]])
        for (s, j), run in runs.items() if reference.known[0] else ():
            if STATUS[int(status[s, i, j])].has_values:
                force, expected = run["impact_force_max"][[i]], reference.peaks["impact_force_max"]
                error[s, i, j] = relative_error("impact_force_max", force, expected)[0]
    dims = ("scheme", "stiffness", "dt")
    labels = " ".join(s.label for s in STATUS)
    codes = np.arange(len(STATUS), dtype=np.int8)
    flags = {"long_name": "status of the scenario", "flag_values": codes, "flag_meanings": labels}
    return xr.Dataset(
        {
            "peak_force_error": (dims, error, {"units": "1", "long_name": "relative error of the peak contact force"}),
            "status": (dims, status, flags),
        },
        {
            "scheme": ("scheme", [f"{method} {precision}" for method, precision in SHOWN]),
            "stiffness": (
                "stiffness",
                list(stiffnesses),
                {"units": chosen.stiffness_unit, "long_name": "contact stiffness"},
            ),
            "dt": ("dt", list(steps), {"units": "s", "long_name": "time step"}),
        },
        {
            **made_here(f"Stability map: {chosen.title}"),
            "law": chosen.key,
            "restitution": RESTITUTION if chosen.takes_restitution else "none",
            "ok_claim": OK_CLAIM,
        },
    )
