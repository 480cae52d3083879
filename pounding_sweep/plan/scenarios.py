"""The scenarios of a sweep as a table, each that differs in something that matters once, and cut into chunks."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.outputs.variables import CHANGE
from pounding_sweep.spec.axes import FACTOR_KINDS, Case, PropertyAxis
from pounding_sweep.spec.spec import SweepSpec

#: Scenarios whose columns are worked out at once.
BLOCK = 2**18
#: Share of what is left that one chunk takes, near the end of a sweep.
SHARE = 1.0 / 16.0
#: Smallest chunk over the largest, where there are scenarios for it.
SMALLEST = 1.0 / 4.0


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


@dataclass(frozen=True)
class _Asked:
    """What a sweep asks for, coded: equal codes are scenarios that can't differ."""

    codes: np.ndarray  # sorted by them, scenarios that are most alike stand side by side; int64, shape (n_asked,)
    variants: Variants  # building properties
    table: Callable[[np.ndarray], Scenarios]  # asked scenarios (positions) -> `Scenarios`


def unique_scenarios(spec: SweepSpec, laws: Sequence[Law]) -> tuple[Scenarios, Variants, np.ndarray]:
    """Reduce what a sweep asks for to what can matter."""
    asked = _asked_product(spec, laws) if spec.cases is None else _asked_cases(spec, laws)
    first, inverse = _distinct(asked.codes)
    variants, table_of = asked.variants, asked.table
    del asked  # and its codes
    if len(first) <= BLOCK:
        return table_of(first), variants, inverse
    starts = range(0, len(first), BLOCK)
    return joined([table_of(first[start : start + BLOCK]) for start in starts]), variants, inverse


def joined(parts: list[Scenarios]) -> Scenarios:
    """Put tables one below the other; a column in which all rows agree takes the memory of one row again."""
    n = sum(map(len, parts))

    columns = {name: [getattr(part, name) for part in parts] for name in Scenarios.__dataclass_fields__}
    parts.clear()

    def column(name: str) -> np.ndarray:
        pieces = columns.pop(name)  # let go of before the next column is joined
        if all(not piece.strides[0] and (piece[0] == pieces[0][0]).all() for piece in pieces):
            return np.broadcast_to(pieces[0][:1], (n, *pieces[0].shape[1:]))
        if name == "gaps" and not any(piece.strides[1] for piece in pieces):
            return np.broadcast_to(np.concatenate([piece[:, :1] for piece in pieces]), (n, pieces[0].shape[1]))
        return np.concatenate(pieces)

    return Scenarios(*(column(name) for name in list(columns)))


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


def uncoupled_runs_of(table: Scenarios, no_pounding: int) -> tuple[Scenarios, np.ndarray]:
    """Return the distinct runs without pounding of a table of scenarios."""
    columns = (table.record, table.variant, table.scale)
    if len(table) and not any(column.strides[0] for column in columns):  # one run for all
        first, inverse = np.zeros(1, np.int64), np.broadcast_to(np.int32(0), len(table))
    else:
        first, inverse = _distinct(_combine([_factors(column) for column in columns]))
    n = len(first)
    uncoupled = Scenarios(
        law=np.full(n, no_pounding, np.int16),
        record=table.record[first],
        scale=table.scale[first],
        stiffness=np.zeros(n),
        restitution=np.ones(n),
        gaps=np.full((n, table.gaps.shape[1]), np.inf),
        variant=table.variant[first],
    )
    return uncoupled, inverse


def _factors(column: np.ndarray) -> tuple[np.ndarray, int]:
    """Codes of a column, rising with its values, and how many there are."""
    if len(column) and not column.strides[0]:  # one value, repeated
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


def _gather(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return `values` at `index`; where there is but one value, as one row of memory."""
    return values[index] if len(values) > 1 else np.broadcast_to(values, (len(index), *values.shape[1:]))


def _effective_laws(spec: SweepSpec, laws: Sequence[Law]) -> dict[str, int]:
    """Law that really acts, by key: none where no floors meet, any where all contacts have bumpers."""
    last = len(laws) - 1
    if not spec.scene.contacts:
        return {law.key: last for law in laws}
    return {law.key: 0 if spec.scene.padded and law.has_contact else i for i, law in enumerate(laws)}


def _ranks(values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Places of the values of an axis when sorted."""
    ranks = np.empty(len(values), np.int64)
    ranks[np.argsort(np.asarray(values, dtype=float), kind="stable")] = np.arange(len(values))
    return ranks


def _variant_ranks(spec: SweepSpec) -> np.ndarray:
    """Places of the combinations of property values when sorted, the axis with the most values innermost."""
    axes = spec.property_axes
    shape = [len(axis.values) for axis in axes]
    codes = np.zeros(shape, np.int64)
    for place in sorted(range(len(axes)), key=shape.__getitem__):
        ranks = _ranks(axes[place].values)
        codes = codes * len(ranks) + ranks.reshape([-1 if i == place else 1 for i in range(len(axes))])
    return codes.reshape(-1)


def _asked_product(spec: SweepSpec, laws: Sequence[Law]) -> _Asked:
    acting, last = _effective_laws(spec, laws), len(laws) - 1
    law_of = np.array([acting[key] for key in spec.laws], np.int16)
    kind, values = spec.needed_axis("stiffness")
    stiffness = np.array([[kind.value(v, scene=spec.scene, law=spec.law(key)) for v in values] for key in spec.laws])
    n_pairs = len(spec.scene.pair_names)
    if spec.gaps is None:
        gaps, gap_ranks = np.array([spec.scene.gaps], dtype=float).reshape(1, n_pairs), np.zeros(1, np.int64)
    else:
        gap_ranks = _ranks(spec.gaps)
        gaps = np.broadcast_to(np.array(spec.gaps, dtype=float)[:, None], (len(spec.gaps), n_pairs))
    equal = bool((gaps == gaps[:, :1]).all())  # at all pairs
    restitutions = np.array(spec.restitutions, dtype=float)
    kind, scales = spec.needed_axis("scale")
    factors = np.array([[spec.scale(kind, v, record) for v in scales] for record in spec.records])
    alike = bool((factors == factors[0]).all())  # whatever the record
    variants = product_variants(spec.scene, spec.property_axes)
    first_variant = len(variants) > 1  # behind the scene as given
    ranks = {
        "scale": _ranks(scales),
        "stiffness": _ranks(values),
        "restitution": _ranks(restitutions),
        "variant": _variant_ranks(spec),
        "gap": gap_ranks,
    }
    dims = ("gap", "stiffness", "restitution", "record", "scale", "variant")  # as in the cube, behind the law
    shape = tuple(len(spec.records) if dim == "record" else len(ranks[dim]) for dim in dims)
    # outermost first; sorted() is stable, so that gaps are innermost among equals
    order = sorted(ranks, key=lambda name: len(ranks[name]))
    codes = np.empty((len(spec.laws), *shape), np.int64)
    for i, law in enumerate(law_of):
        ignored = {"stiffness", "restitution", "gap"} if law == last else set()
        ignored |= {"stiffness", "restitution"} if spec.scene.padded else set()
        ignored |= set() if laws[law].takes_restitution else {"restitution"}
        ignored |= {"stiffness"} if laws[law].exponent is None else set()  # velocities jump
        block = np.arange(len(spec.records)) * len(laws) + law
        block = block.reshape([-1 if dim == "record" else 1 for dim in dims])
        for name in order:
            own = np.zeros_like(ranks[name]) if name in ignored else ranks[name]
            block = block * len(own) + own.reshape([-1 if dim == name else 1 for dim in dims])
        codes[i] = block

    asked_shape = codes.shape

    def table(asked: np.ndarray) -> Scenarios:
        at_law, at_gap, at_stiffness, at_restitution, at_record, at_scale, at_variant = np.unravel_index(
            asked, asked_shape
        )
        law = _gather(law_of, at_law)
        open_everywhere = law == last
        takes = np.array([item.takes_restitution for item in laws])[law]
        rows = np.broadcast_to(_gather(gaps[:, :1], at_gap), (len(asked), n_pairs)) if equal else _gather(gaps, at_gap)
        return Scenarios(
            law=law,
            record=_gather(np.arange(len(spec.records), dtype=np.int32), at_record),
            scale=_gather(factors[0], at_scale) if alike else factors[at_record, at_scale],
            stiffness=np.where(open_everywhere, 0.0, stiffness[at_law, at_stiffness]),
            restitution=np.where(takes, restitutions[at_restitution], 1.0),
            gaps=np.where(open_everywhere[:, None], np.inf, rows) if open_everywhere.any() else rows,
            variant=_gather(np.arange(first_variant, len(variants), dtype=np.int32), at_variant),
        )

    return _Asked(codes.reshape(-1), variants, table)


def _asked_cases(spec: SweepSpec, laws: Sequence[Law]) -> _Asked:
    cases = spec.cases or ()
    acting, last = _effective_laws(spec, laws), len(laws) - 1
    names = {record.name: i for i, record in enumerate(spec.records)}
    law = np.array([acting[c.law] for c in cases], np.int16)
    record = np.array([names[c.record] if c.record is not None else 0 for c in cases], np.int32)
    takes = np.array([item.takes_restitution for item in laws])[law]
    restitution = np.array([1.0 if c.restitution is None else c.restitution for c in cases])
    stiffness = np.array([spec.case_value(case, "stiffness") for case in cases])
    if spec.scene.padded:
        restitution[:] = stiffness[:] = 1.0
    gaps = np.empty((len(cases), len(spec.scene.pair_names)))
    for i, case in enumerate(cases):
        gaps[i] = spec.scene.gaps if case.gap is None else case.gap
    gaps[law == last] = np.inf
    variants, variant = case_variants(spec.scene, cases)
    whole = Scenarios(
        law=law,
        record=record,
        scale=np.array([spec.case_value(case, "scale") for case in cases], dtype=float),
        stiffness=np.where(law == last, 0.0, stiffness),
        restitution=np.where(takes, restitution, 1.0),
        gaps=gaps,
        variant=variant,
    )
    columns = (whole.scale, whole.stiffness, whole.restitution, variant, *whole.gaps.T)
    inner = sorted((_factors(column) for column in columns), key=lambda column: column[1])
    return _Asked(_combine([_factors(record), _factors(law), *inner]), variants, whole.__getitem__)


def changed(table: Scenarios, change: float = CHANGE) -> Scenarios:
    """Return scenarios with every input changed by `change` of itself."""
    return replace(
        table,
        scale=table.scale * (1.0 - change),
        stiffness=table.stiffness * (1.0 + change),
        gaps=table.gaps * (1.0 + change),
    )


def product_variants(scene: Scene, axes: Sequence[PropertyAxis]) -> Variants:
    """Return the scene as given, and behind it every combination of the values of axes, the last varying fastest."""
    shape = [len(axis.values) for axis in axes]
    n = 1 + math.prod(shape) if axes else 1
    kinds = ("period_factor", "mass_factor", "damping_ratio", "strength_factor", "hardening")
    columns: dict[str, dict[str | None, np.ndarray]] = {kind: {} for kind in kinds}
    for place, axis in enumerate(axes):
        values = np.array(axis.values).reshape([-1 if i == place else 1 for i in range(len(shape))])
        columns[axis.kind][axis.building] = np.broadcast_to(values, shape).ravel()

    def factors(kind: str, own: float = 1.0) -> np.ndarray:
        result = np.full((n if columns[kind] else 1, len(scene.buildings)), own)
        for index, building in enumerate(scene.buildings):
            if building.name in columns[kind]:
                result[1:, index] = columns[kind][building.name]
        return np.broadcast_to(result, (n, result.shape[1]))

    ratio = np.full(n, np.nan)
    for values in columns["damping_ratio"].values():
        ratio[1:] = _own_ratio(scene, values)
    hardening = _own_hardening(scene, factors("hardening", np.nan))
    scaled = (factors(kind) for kind in ("period_factor", "mass_factor", "strength_factor"))
    period, mass, strength = scaled
    same = n == 2 and np.isnan(ratio[1]) and np.isnan(hardening).all()
    same = same and all((each == 1.0).all() for each in (period, mass, strength))
    return variants_of(scene) if same else Variants(scene, period, mass, ratio, strength, hardening)


def case_variants(scene: Scene, cases: Sequence[Case]) -> tuple[Variants, np.ndarray]:
    """Return the scene as given and behind it what cases make of it, each once; and the row of each case."""
    n = len(scene.buildings)
    table = np.ones((1 + len(cases), len(FACTOR_KINDS) * n + 1))
    at = {kind: slice(i * n, (i + 1) * n) for i, kind in enumerate(FACTOR_KINDS.values())}
    table[:, at["hardening"]] = table[:, -1] = np.nan
    place = {building.name: i for i, building in enumerate(scene.buildings)}
    for row, case in zip(table[1:], cases, strict=True):
        for argument, kind in FACTOR_KINDS.items():
            for name, factor in dict(getattr(case, argument)).items():
                row[at[kind]][place[name]] = factor
        if case.damping_ratio is not None:
            row[-1] = case.damping_ratio
    table[:, -1] = _own_ratio(scene, table[:, -1])
    table[:, at["hardening"]] = _own_hardening(scene, table[:, at["hardening"]])
    found: dict[bytes, int] = {}
    index = np.array([found.setdefault(row.tobytes(), len(found)) for row in table], np.int32)
    kept = table[np.unique(index, return_index=True)[1]]
    return Variants(scene, damping_ratio=kept[:, -1], **{kind: kept[:, part] for kind, part in at.items()}), index[1:]


def _own_hardening(scene: Scene, hardening: np.ndarray) -> np.ndarray:
    """Replace a hardening that a building has of its own by NaN."""
    if np.isnan(hardening).all():
        return hardening
    return np.where(hardening == [building.uniform_hardening for building in scene.buildings], np.nan, hardening)


def _own_ratio(scene: Scene, ratios: np.ndarray) -> np.ndarray:
    """Replace a damping ratio that all buildings have of their own by NaN."""
    own = {building.damping_ratio for building in scene.buildings}
    (ratio,) = own if len(own) == 1 else (None,)
    return np.where(ratios == ratio, np.nan, ratios) if isinstance(ratio, float) else ratios


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
    differing = [column for column in (flights, steps, table.law, table.record) if column.strides[0]]
    differing = [column for column in differing if len(rows) and (column[rows] != column[rows[0]]).any()]
    order = rows[np.lexsort([column[rows] for column in differing])] if differing else rows
    ends = np.zeros(max(0, len(order) - 1), bool)
    for column in differing:
        values = column[order]
        ends |= values[1:] != values[:-1]
    parts = np.split(order, np.flatnonzero(ends) + 1) if len(order) else []
    found = []
    for part in parts:
        record, law, count = (int(values[part[0]]) for values in (table.record, table.law, steps))
        found.append((max(seconds(record, count), 1e-12), record, law, count, part))
    found.sort(key=lambda kind: -kind[0])
    left = sum(each * len(part) for each, *_, part in found)
    result: list[Chunk] = []
    for each, record, law, count, part in found:
        first = 0
        while first < len(part):
            wanted = min(longest, max(SMALLEST * longest, SHARE * left))
            mine = part[first : first + LANES * max(1, int(min(wanted / each, most) / LANES))]
            result.append(Chunk(chunk_key(f"{name}:{record}:{law}:{count}:", mine), law, record, mine, count))
            first += len(mine)
            left -= each * len(mine)
    return result


@dataclass(frozen=True)
class ChunkTask:
    """One chunk, ready to be run by anybody."""

    key: str  # name of the chunk
    kernel: RowKernel  # what runs
    record: int  # index of the record
    table: Scenarios  # scenarios to run
    variants: Variants  # their building properties
    outputs: tuple[str, ...]  # variables asked for


#: (kernel, record, scenarios, variants, outputs) -> table of results, or what went wrong; can be pickled
Run = Callable[..., "np.ndarray | str"]
#: (position of the chunk, its table or what went wrong)
Receive = Callable[[int, "np.ndarray | str"], None]
