"""The scenarios of a sweep as a table, each that differs in something that matters once, and cut into chunks."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.records import Record
from pounding_sweep.request.axes import AXES, NAMED_KINDS, Axis
from pounding_sweep.request.spec import SweepSpec, case_variants, scene_variants
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.variables.registry import CHANGE

#: Rows of a law that are worked out at once.
BLOCK = 2**15


@dataclass(frozen=True)
class Scenarios:
    """A table of scenarios, one row each."""

    # Columns in which all rows agree may take the memory of one row, and then can't be written to.

    #: index into the plan's laws and records; int
    law: np.ndarray
    record: np.ndarray
    #: values (stiffness in kN/m**exponent); 0 and 1 where the law ignores them; float
    scale: np.ndarray
    #: of all pairs, or of each: shape (n, pairs)
    stiffness: np.ndarray
    restitution: np.ndarray
    gaps: np.ndarray  # gaps (m); infinite where nothing can touch; shape (n, pairs)
    variant: np.ndarray  # row of the plan's table of building properties; 0 stands for the scene as given; int

    def __len__(self) -> int:
        return len(self.law)

    def __getitem__(self, rows: Any) -> Scenarios:
        return Scenarios(*(column[rows] for column in vars(self).values()))

    def by_law(self) -> Iterator[tuple[int, np.ndarray]]:
        """Go through the rows of each law, so many at a time."""
        for law in np.unique(self.law).tolist():
            rows = np.flatnonzero(self.law == law)
            yield from ((law, rows[first : first + BLOCK]) for first in range(0, len(rows), BLOCK))

    def by_step(self, steps: np.ndarray) -> Iterator[tuple[int, int, np.ndarray]]:
        """Go through the rows of each record and number of steps per record interval."""
        for record in np.unique(self.record).tolist():
            of_record = self.record == record
            for count in np.unique(steps[of_record]).tolist():
                yield record, count, np.flatnonzero(of_record & (steps == count))


@dataclass(frozen=True)
class Requested:
    """What a sweep asks for: columns that broadcast over the dimensions of its cube, or over its listed cases."""

    shape: tuple[int, ...]
    #: index into the laws and records of the sweep, and into `variants`; int
    law: np.ndarray
    record: np.ndarray
    variant: np.ndarray
    #: scale, stiffness, restitution and gap; gap has one more dimension for pairs, and where these differ stiffness and
    #: restitution have it, whose values for all pairs then are row_stiffness and row_restitution
    values: dict[str, np.ndarray]
    ranks: dict[str, np.ndarray]  # places of these when sorted, gaps last; int
    variants: Variants  # building properties


def requested_scenarios(spec: SweepSpec) -> Requested:
    """Return the scenarios of a sweep, of its axes or its listed cases."""
    scene, places = spec.scene, {record.name: i for i, record in enumerate(spec.records)}
    if spec.cases is not None:
        cases = spec.cases
        values = {
            "scale": np.array([spec.case_value(case, "scale") for case in cases], float),
            "stiffness": np.array([spec.case_value(case, "stiffness") for case in cases], float),
            "restitution": np.array([1.0 if case.restitution is None else case.restitution for case in cases], float),
            "gap": np.array([case.gaps_of(scene) for case in cases], float),
        }
        for argument in NAMED_KINDS["pair"]:
            for name in dict.fromkeys(name for case in cases for name, _ in getattr(case, argument)):
                own = np.array([dict(getattr(case, argument)).get(name, np.nan) for case in cases])
                _put_pair(values, scene, AXES[argument], name, own)
        law = np.array([spec.laws.index(case.law) for case in cases])
        record = np.array([0 if case.record is None else places[case.record] for case in cases], np.int32)
        variants, variant = case_variants(scene, cases)
        ranks = {key: row_codes(list(np.atleast_2d(column.T))) for key, column in values.items() if "row_" not in key}
        return Requested((len(cases),), law, record, variant, values, ranks, variants)

    grids = np.meshgrid(*(axis.values for axis in spec.named_axes("building")), indexing="ij")
    settings = [
        (axis.kind, axis.name, grid.ravel()) for axis, grid in zip(spec.named_axes("building"), grids, strict=True)
    ]
    variants = scene_variants(scene, grids[0].size if grids else 1, settings)
    if len(variants) == 2 and all(np.array_equal(a, b, equal_nan=True) for a, b in variants.columns):
        variants = variants_of(scene)
    variant = np.arange(len(variants) > 1, len(variants), dtype=np.int32)
    (stiffness, stiffnesses), (scale, scales) = spec.needed_axis("stiffness"), spec.needed_axis("scale")
    of_buildings = {axis.dimension for axis in spec.named_axes("building")}
    axes = {name: column for name, column in spec.axes.items() if name not in of_buildings} | {"variant": variant}

    def along(values: Any, *dims: str) -> np.ndarray:
        """Return values by some dimensions as a column."""
        values = np.asarray(values)
        sizes = [len(values_of) if dim in dims else 1 for dim, values_of in axes.items()]
        return values.reshape(*sizes, *values.shape[len(dims) :])

    gaps = np.array([scene.gaps] if spec.gaps is None else [[v] for v in spec.gaps], float)
    factors = [[spec.scale(scale, v, record) for v in scales] for record in spec.records]
    contact = [[stiffness.value(v, scene=scene, law=spec.law(key)) for v in stiffnesses] for key in spec.laws]
    values = {
        "scale": along(factors, "record", scale.dimension),
        "stiffness": along(contact, "law", stiffness.dimension),
        "restitution": along(np.array(spec.restitutions, float), "restitution"),
        "gap": along(gaps, "gap"),
    }
    dimensions = {"scale": scale.dimension, "stiffness": stiffness.dimension, "restitution": "restitution"}
    ranks = {name: row_codes([along(axes[dim], dim)]) for name, dim in dimensions.items()}
    ranks["gap"] = row_codes(list(np.moveaxis(values["gap"], -1, 0)))
    for axis in spec.named_axes("pair"):
        own = along(axis.values, axis.dimension)
        _put_pair(values, scene, axis.axis, str(axis.name), own)
        ranks[axis.kind] = row_codes([ranks[axis.kind], own])
    return Requested(
        shape=tuple(map(len, axes.values())),
        law=along(np.arange(len(spec.laws)), "law"),
        record=along(np.arange(len(places), dtype=np.int32), "record"),
        variant=along(variant, "variant"),
        values=values,
        ranks=ranks,
        variants=variants,
    )


def _put_pair(values: dict[str, np.ndarray], scene: Scene, axis: Axis, name: str, own: np.ndarray) -> None:
    """Give a pair its own values where they are not NaN; what holds for all pairs is kept as that of the row."""
    column = values[axis.column]
    values.setdefault(f"row_{axis.column}", column)
    column, own = column if column.ndim > own.ndim else column[..., None], own[..., None]
    of_pair = (np.array(scene.pair_names) == name) & ~np.isnan(own)
    values[axis.column] = np.where(of_pair, axis.of_pair(column, own), column)


def unique_scenarios(spec: SweepSpec, laws: Sequence[Law]) -> tuple[Scenarios, Variants, np.ndarray]:
    """Reduce what a sweep asks for to what can matter."""
    requested, last, scene = requested_scenarios(spec), len(laws) - 1, spec.scene
    # no law acts where no floors meet, any where all contacts have bumpers
    acting = {law.key: 0 if scene.padded and i < last else i for i, law in enumerate(laws)}
    law = np.array([acting[key] if scene.contacts else last for key in spec.laws], np.int16)[requested.law]
    touching = law != last
    matters = {
        "gap": touching,
        "stiffness": touching & ~np.array([scene.padded or item.exponent is None for item in laws])[law],
        "restitution": touching & np.array([not scene.padded and item.takes_restitution for item in laws])[law],
    }
    variants = np.argsort(np.lexsort(np.column_stack(requested.variants.columns).T[::-1]))[requested.variant]
    ranks = {"variant": variants, **requested.ranks}
    # the column with most values innermost; sorted() is stable, so that gaps are innermost among equals
    inner = sorted((np.where(matters.get(name, True), rank, 0) for name, rank in ranks.items()), key=np.max)
    codes = np.broadcast_to(row_codes([requested.record, law, *inner]), requested.shape).reshape(-1)
    _, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    del codes

    def column(name: str, values: np.ndarray, ignored: float = 0.0) -> np.ndarray:
        """Return what a column has in each unique scenario; of one value, as one row of memory."""
        inner = values.shape[len(requested.shape) :]
        values = np.where(matters.get(name, np.True_).T, values.T, ignored).T.astype(values.dtype)
        if values.size == math.prod(inner):
            return np.broadcast_to(values.reshape(inner), (len(first), *inner))
        return np.broadcast_to(values, (*requested.shape, *inner)).reshape(-1, *inner)[first]

    values = requested.values
    table = Scenarios(
        law=column("law", law),
        record=column("record", requested.record),
        scale=column("scale", values["scale"]),
        stiffness=column("stiffness", values["stiffness"]),
        restitution=column("restitution", values["restitution"], 1.0),
        gaps=np.broadcast_to(column("gap", values["gap"], math.inf), (len(first), len(scene.pair_names))),
        variant=column("variant", requested.variant),
    )
    return table, requested.variants, inverse.astype(np.int32)


def but_for_gaps(table: Scenarios) -> tuple[Scenarios, np.ndarray]:
    """Return one row for each stretch of rows that differ in their gaps alone, and how many rows that has."""
    columns = [column for name, column in vars(table).items() if name != "gaps"]
    new = np.ones(len(table), bool)
    differ = [column[1:] != column[:-1] for column in columns if column.strides[0]]  # 0: one for all
    new[1:] = np.any([part.any(axis=tuple(range(1, part.ndim))) for part in differ], axis=0)
    if new.all():
        return table, np.broadcast_to(np.int32(1), len(table))
    first = np.flatnonzero(new)
    return table[first], np.diff(first, append=len(table))


def stable_steps(spec: SweepSpec, laws: Sequence[Law], table: Scenarios, variants: Variants, method: str) -> np.ndarray:
    """Largest stable step (s) of each row."""
    limit = np.full(len(table), np.inf)
    settings: dict[str, Any] = {"beta": spec.beta, "gamma": spec.gamma, "basis": spec.restitution_basis}
    for i, rows in table.by_law():
        part = table[rows]
        contacts = variants[part.variant], laws[i], part.stiffness, part.restitution
        limit[rows] = largest_step(*contacts, method=method, **settings)
    return limit


def uncoupled_runs_of(table: Scenarios, no_pounding: int) -> tuple[Scenarios, np.ndarray]:
    """Return the distinct runs without pounding of a table of scenarios."""
    codes = row_codes([table.record, table.variant, table.scale])
    _, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    runs, n = table[first], len(first)
    ignored = {"stiffness": np.zeros_like(runs.stiffness), "restitution": np.ones_like(runs.restitution)}
    ignored["gaps"] = np.full(runs.gaps.shape, np.inf)
    runs = replace(runs, law=np.full(n, no_pounding, np.int16), **ignored)
    return runs, np.broadcast_to(np.int32(0), len(table)) if n == 1 else inverse.astype(np.int32)


def row_codes(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Make one code of columns that broadcast, rising with their values, the last varying fastest."""
    codes, size = np.zeros(1, np.int64), 1
    for column in columns:
        if column.size and (column == column.flat[0]).all():
            codes = codes + np.zeros(column.shape, np.int64)
            continue
        values, index = np.unique(column, return_inverse=True)
        if size * len(values) >= 2**62:  # renumber before the codes overflow
            distinct, ranks = np.unique(codes, return_inverse=True)
            codes, size = ranks.reshape(codes.shape), len(distinct)
        codes = codes * len(values) + index.reshape(column.shape)
        size *= len(values)
    return codes


def changed(table: Scenarios, change: float = CHANGE) -> Scenarios:
    """Return scenarios with every input changed by `change` of itself."""
    return replace(
        table,
        scale=table.scale * (1.0 - change),
        stiffness=table.stiffness * (1.0 + change),
        gaps=table.gaps * (1.0 + change),
    )


@dataclass(frozen=True)
class Chunk:
    """Scenarios of one kernel and one record that one task runs."""

    key: str  # digest of the sweep and of the scenarios: the same chunk of the same sweep has the same key
    #: index into the plan's laws and records
    law: int
    record: int
    rows: np.ndarray  # rows of the table that was cut; int
    steps: int  # steps per record interval


def chunk_key(name: str, rows: np.ndarray) -> str:
    """Digest of a name and of rows of a table."""
    return hashlib.sha256(name.encode() + np.ascontiguousarray(rows, dtype="<i8").tobytes()).hexdigest()[:32]


def cut(
    table: Scenarios,
    rows: np.ndarray,
    steps: np.ndarray,
    flights: np.ndarray,
    *,
    name: str,
    longest: float,
    most: int,
    seconds: Callable[[int, int], float],
    elastic: bool,
) -> list[Chunk]:
    """Cut scenarios into chunks, the dearest first; depends on nothing but the arguments.

    In a chunk of `elastic` rows those with most contacts come first, and those that touch alike lie side by side: their
    motions grow with the record's scale.
    """
    codes = row_codes([column[rows] for column in (table.record, table.law, steps, flights)])
    order = np.argsort(codes, kind="stable")
    if elastic:
        gap_by_scale = np.arctan2(table.gaps[rows].sum(axis=1), np.abs(table.scale[rows]))
        order = np.lexsort((gap_by_scale, table.variant[rows], codes))
    parts = []
    for part in np.split(rows[order], np.flatnonzero(np.diff(codes[order])) + 1) if len(rows) else ():
        record, law, count = (int(values[part[0]]) for values in (table.record, table.law, steps))
        parts.append((max(seconds(record, count), 1e-12), record, law, count, part))
    chunks = []
    for cost, record, law, count, part in sorted(parts, key=lambda part: -part[0]):
        size = LANES * max(1, int(min(longest / cost, most) / LANES))
        for chunk in np.split(part, range(size, len(part), size)):
            chunks.append(Chunk(chunk_key(f"{name}:{record}:{law}:{count}:", chunk), law, record, chunk, count))
    return chunks


class ChunkTask(NamedTuple):
    """Scenarios of one kernel and one record, ready to be run by anybody."""

    kernel: RowKernel  # what runs
    record: Record  # the motion
    table: Scenarios  # scenarios to run
    variants: Variants  # their building properties
    outputs: Sequence[str]  # variables asked for
    once: bool = False  # whether one run of each is enough for the kernel's accuracy

    def part(self, rows: np.ndarray) -> ChunkTask:
        """Return some of the scenarios."""
        return self._replace(table=self.table[rows], variants=self.variants[rows])
