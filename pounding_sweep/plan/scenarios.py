"""The scenarios of a sweep as a table, each that differs in something that matters once, and cut into chunks."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.outputs.variables import CHANGE
from pounding_sweep.records import Record
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.spec.axes import FACTOR_KINDS, Case, PropertyAxis
from pounding_sweep.spec.spec import SweepSpec

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
    stiffness: np.ndarray
    restitution: np.ndarray
    gaps: np.ndarray  # gaps (m); infinite where nothing can touch; shape (n, pairs)
    variant: np.ndarray  # row of the plan's table of building properties; 0 stands for the scene as given; int

    def __len__(self) -> int:
        return len(self.law)

    def __getitem__(self, rows: Any) -> Scenarios:
        return Scenarios(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

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
    #: index into the laws and records of the sweep; int
    law: np.ndarray
    record: np.ndarray
    values: dict[str, np.ndarray]  # scale, stiffness, restitution, and gap, with one more dimension for pairs
    ranks: dict[str, np.ndarray]  # places of these when sorted, gaps last; int
    variant: np.ndarray
    variants: Variants  # building properties


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
    ranks = {name: np.where(matters.get(name, True), column, 0) for name, column in ranks.items()}
    # the column with most values innermost; sorted() is stable, so that gaps are innermost among equals
    inner = sorted(((column, int(column.max()) + 1) for column in ranks.values()), key=lambda item: item[1])
    codes = _combine([(requested.record, len(spec.records)), (law, len(laws)), *inner])
    first, inverse = _distinct(np.broadcast_to(codes, requested.shape).reshape(-1))
    del codes, inner, ranks
    steps = [math.prod(requested.shape[i + 1 :]) for i in range(len(requested.shape))]

    def column(values: np.ndarray) -> np.ndarray:
        """Return what a column has in each unique scenario; of one value, as one row of memory."""
        varies = [size > 1 for size in values.shape[: len(steps)]]
        if not any(varies):
            return np.broadcast_to(values[(0,) * len(steps)], (len(first), *values.shape[len(steps) :]))
        places = zip(varies, steps, values.shape, strict=False)
        return values[tuple(first // step % size if several else 0 for several, step, size in places)]

    def effective(name: str, ignored: float) -> np.ndarray:
        values, used = requested.values[name], matters[name]
        return column(np.where(used[..., None] if name == "gap" else used, values, ignored))

    table = Scenarios(
        law=column(law),
        record=column(requested.record),
        scale=column(requested.values["scale"]),
        stiffness=effective("stiffness", 0.0),
        restitution=effective("restitution", 1.0),
        gaps=np.broadcast_to(effective("gap", math.inf), (len(first), len(scene.pair_names))),
        variant=column(requested.variant),
    )
    return table, requested.variants, inverse


def requested_scenarios(spec: SweepSpec) -> Requested:
    """Return the scenarios of a sweep, of its axes or its listed cases."""
    return _product(spec) if spec.cases is None else _listed(spec)


def _product(spec: SweepSpec) -> Requested:
    dims = ("law", "gap", "stiffness", "restitution", "record", "scale", "variant")

    def along(*own: str, values: Any) -> np.ndarray:
        """Return values by some dimensions as a column."""
        values = np.asarray(values)
        sizes = dict(zip(own, values.shape, strict=False))
        return values.reshape([sizes.get(dim, 1) for dim in dims] + list(values.shape[len(own) :]))

    (stiffness, stiffnesses), (scale, scales) = spec.needed_axis("stiffness"), spec.needed_axis("scale")
    contact = [[stiffness.value(v, scene=spec.scene, law=spec.law(key)) for v in stiffnesses] for key in spec.laws]
    factors = np.array([[spec.scale(scale, v, record) for v in scales] for record in spec.records])
    gaps = np.array([spec.scene.gaps] if spec.gaps is None else np.array(spec.gaps)[:, None], float)
    variants = _product_variants(spec.scene, spec.property_axes)
    variant = np.arange(len(variants) > 1, len(variants), dtype=np.int32)
    ranks = {
        "scale": _ranks(scales),
        "stiffness": _ranks(stiffnesses),
        "restitution": _ranks(spec.restitutions),
        "gap": np.zeros(1, np.int64) if spec.gaps is None else _ranks(spec.gaps),
    }
    law, record = np.arange(len(spec.laws)), np.arange(len(spec.records), dtype=np.int32)
    lengths = {name: len(own) for name, own in (ranks | {"law": law, "record": record, "variant": variant}).items()}
    return Requested(
        shape=tuple(lengths[dim] for dim in dims),
        law=along("law", values=law),
        record=along("record", values=record),
        values={
            "scale": along("record", "scale", values=factors),
            "stiffness": along("law", "stiffness", values=contact),
            "restitution": along("restitution", values=np.array(spec.restitutions, float)),
            "gap": along("gap", values=gaps),
        },
        ranks={name: along(name, values=own) for name, own in ranks.items()},
        variant=along("variant", values=variant),
        variants=variants,
    )


def _listed(spec: SweepSpec) -> Requested:
    cases, places = spec.cases or (), {record.name: i for i, record in enumerate(spec.records)}
    variants, variant = case_variants(spec.scene, cases)
    n_pairs, own = len(spec.scene.pair_names), spec.scene.gaps
    gaps = np.array([np.broadcast_to(own if case.gap is None else case.gap, n_pairs) for case in cases], float)
    values = {
        "scale": np.array([spec.case_value(case, "scale") for case in cases], float),
        "stiffness": np.array([spec.case_value(case, "stiffness") for case in cases], float),
        "restitution": np.array([1.0 if case.restitution is None else case.restitution for case in cases], float),
    }
    return Requested(
        shape=(len(cases),),
        law=np.array([spec.laws.index(case.law) for case in cases]),
        record=np.array([0 if case.record is None else places[case.record] for case in cases], np.int32),
        values=values | {"gap": gaps},
        ranks={name: np.unique(own, return_inverse=True)[1] for name, own in values.items()}
        | {"gap": np.unique(gaps, axis=0, return_inverse=True)[1].reshape(-1)},
        variant=variant,
        variants=variants,
    )


def joined(parts: Sequence[Scenarios]) -> Scenarios:
    """Put tables one below the other."""
    return Scenarios(
        *(np.concatenate(columns) for columns in zip(*(vars(part).values() for part in parts), strict=True))
    )


def _distinct(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where each code is first, by rising codes, and which of them each place has."""
    order = np.argsort(codes, kind="stable")
    new = np.ones(len(order), bool)
    rising = codes[order]
    np.not_equal(rising[1:], rising[:-1], out=new[1:])
    del rising
    inverse = np.empty(len(order), np.int32)
    inverse[order] = np.cumsum(new, dtype=np.int32) - np.int32(1)
    return order if new.all() else order[new], inverse


def but_for_gaps(table: Scenarios) -> tuple[Scenarios, np.ndarray]:
    """Return one row for each stretch of rows that differ in their gaps alone, and how many rows that has."""
    new = np.ones(len(table), bool)
    new[1:] = False
    for name in Scenarios.__dataclass_fields__:
        column = getattr(table, name)
        if name != "gaps" and column.strides[0]:  # else one value for all
            new[1:] |= column[1:] != column[:-1]
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
        own = variants[part.variant], laws[i], part.stiffness, part.restitution
        limit[rows] = largest_step(*own, method=method, **settings)
    return limit


def uncoupled_runs_of(table: Scenarios, no_pounding: int) -> tuple[Scenarios, np.ndarray]:
    """Return the distinct runs without pounding of a table of scenarios."""
    columns = (table.record, table.variant, table.scale)
    if len(table) and not any(column.strides[0] for column in columns):  # one run for all
        first, inverse = np.zeros(1, np.int64), np.broadcast_to(np.int32(0), len(table))
    else:
        first, inverse = _distinct(_combine([_factors(column) for column in columns]))
    runs, n = table[first], len(first)
    ignored = {"stiffness": np.zeros(n), "restitution": np.ones(n), "gaps": np.full(runs.gaps.shape, np.inf)}
    return replace(runs, law=np.full(n, no_pounding, np.int16), **ignored), inverse


def _factors(column: np.ndarray) -> tuple[np.ndarray, int]:
    """Codes of a column, rising with its values, and how many there are."""
    if len(column) and (column == column[0]).all():
        return np.zeros(len(column), np.int64), 1
    found, inverse = np.unique(column, return_inverse=True)
    return inverse.reshape(-1), len(found)


def _combine(columns: Sequence[tuple[np.ndarray, int]]) -> np.ndarray:
    """Make one code of several, the last varying fastest."""
    codes, size = np.zeros(1, dtype=np.int64), 1
    for index, count in columns:
        if size * count >= 2**62:  # renumber before the codes overflow
            found, codes = np.unique(codes, return_inverse=True)
            size = len(found)
        codes = codes * count + index
        size *= count
    return codes


def _ranks(values: Sequence[float]) -> np.ndarray:
    """Places of the values of an axis when sorted."""
    return np.argsort(np.argsort(np.asarray(values, float), kind="stable"))


def changed(table: Scenarios, change: float = CHANGE) -> Scenarios:
    """Return scenarios with every input changed by `change` of itself."""
    return replace(
        table,
        scale=table.scale * (1.0 - change),
        stiffness=table.stiffness * (1.0 + change),
        gaps=table.gaps * (1.0 + change),
    )


def _product_variants(scene: Scene, axes: Sequence[PropertyAxis]) -> Variants:
    """Return the scene as given, and behind it every combination of the values of axes, the last varying fastest."""
    grids = np.meshgrid(*(axis.values for axis in axes), indexing="ij")
    settings = [(axis.kind, axis.building, grid.ravel()) for axis, grid in zip(axes, grids, strict=True)]
    table = _variants(scene, grids[0].size if axes else 0, settings)
    same = len(table) <= 2 and all(np.array_equal(own[0], own[-1], equal_nan=True) for own in table.columns)
    return variants_of(scene) if same else table


def case_variants(scene: Scene, cases: Sequence[Case]) -> tuple[Variants, np.ndarray]:
    """Return the scene as given and behind it what cases make of it, each once; and the row of each case."""
    ratios = [np.nan if case.damping_ratio is None else case.damping_ratio for case in cases]
    settings: list[tuple[str, str | None, np.ndarray]] = [("damping_ratio", None, np.array(ratios, float))]
    for argument, kind in FACTOR_KINDS.items():
        factors = [dict(getattr(case, argument)) for case in cases]
        default = math.nan if kind == "hardening" else 1.0
        for name in {name for own in factors for name in own}:
            settings.append((kind, name, np.array([own.get(name, default) for own in factors])))
    table, rows = _variants(scene, len(cases), settings), dict[bytes, int]()
    index = [rows.setdefault(row.tobytes(), len(rows)) for row in np.column_stack(table.columns)]
    return table[np.unique(index, return_index=True)[1]], np.array(index[1:], np.int32)


def _variants(scene: Scene, n: int, settings: Iterable[tuple[str, str | None, np.ndarray]]) -> Variants:
    """Return the scene as given and behind it `n` variants: values of a property of a building, or of all."""
    shape = (n + 1, len(scene.buildings))
    columns = {kind: np.broadcast_to(math.nan if kind == "hardening" else 1.0, shape) for kind in FACTOR_KINDS.values()}
    ratio, ratios = np.full(n + 1, math.nan), {building.damping_ratio for building in scene.buildings}
    for kind, name, values in settings:  # NaN: the scene's own
        if name is None:
            (own,) = ratios if len(ratios) == 1 else (None,)
            ratio[1:] = np.where(values == own, math.nan, values) if isinstance(own, float) else values
            continue
        index = [building.name for building in scene.buildings].index(name)
        columns[kind] = columns[kind].copy()
        columns[kind][1:, index] = values
        if kind == "hardening":
            columns[kind][columns[kind] == [building.uniform_hardening for building in scene.buildings]] = math.nan
    return Variants(scene, damping_ratio=ratio, **columns)


@dataclass(frozen=True)
class Chunk:
    """Scenarios of one kernel and one record that one task runs."""

    key: str  # digest of the sweep and of the scenarios: the same chunk of the same sweep has the same key
    #: index into the plan's laws and records
    law: int
    record: int
    rows: np.ndarray  # rows of the table that was cut, neighbouring gaps side by side; int
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
) -> list[Chunk]:
    """Cut scenarios into chunks, the dearest first; depends on nothing but the arguments."""
    codes = _combine([_factors(column[rows]) for column in (table.record, table.law, steps, flights)])
    order = np.argsort(codes, kind="stable")
    found = []
    for part in np.split(rows[order], np.flatnonzero(np.diff(codes[order])) + 1) if len(rows) else ():
        record, law, count = (int(values[part[0]]) for values in (table.record, table.law, steps))
        found.append((max(seconds(record, count), 1e-12), record, law, count, part))
    found.sort(key=lambda kind: -kind[0])
    result = []
    for each, record, law, count, part in found:
        size = LANES * max(1, int(min(longest / each, most) / LANES))
        for own in np.split(part, range(size, len(part), size)):
            result.append(Chunk(chunk_key(f"{name}:{record}:{law}:{count}:", own), law, record, own, count))
    return result


class ChunkTask(NamedTuple):
    """One chunk, ready to be run by anybody."""

    kernel: RowKernel  # what runs
    record: Record  # the motion
    table: Scenarios  # scenarios to run
    variants: Variants  # their building properties
    outputs: tuple[str, ...]  # variables asked for
