"""Scenarios cut into chunks: what one task runs, and what is kept of an interrupted run."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.variants import Variants
from pounding_sweep.plan.scenarios import Scenarios

#: Share of what is left that one chunk takes, near the end of a sweep.
SHARE = 1.0 / 16.0
#: Smallest chunk over the largest, where there are scenarios for it.
SMALLEST = 1.0 / 4.0


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
