"""Results of a sweep's scenarios: each stays in the table of its chunk, in memory or on disk.

Of every scenario only the place of its results, its status and whether it touched are held here; what is asked for is
gathered from the tables. Memory therefore does not grow with the outputs of a sweep whose chunks are on disk.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pounding_sweep.base.errors import OutputError, WriteError
from pounding_sweep.model.scene import Scene
from pounding_sweep.outputs.variables import Status, get_variable, inner_shape

#: Most bytes of tables that stay in memory though they are in files: those of a small sweep are not read again.
KEPT_BYTES = 2**24


def table_type(names: Iterable[str], scene: Scene) -> np.dtype:
    """Return the type of a table of results: one row per scenario, one field per variable."""
    return np.dtype([(name, get_variable(name).dtype, inner_shape(name, scene)) for name in names], align=True)


def to_table(found: Mapping[str, np.ndarray], scene: Scene) -> np.ndarray:
    """Put variables of shape (n, *inner) side by side, one row per scenario."""
    table = np.empty(len(next(iter(found.values()))), table_type(found, scene))
    for name, values in found.items():
        table[name] = values
    return table


def _as_bytes(table: np.ndarray) -> np.ndarray:
    """Rows of a table as so many bytes each, which are copied ten times as fast as their fields."""
    return table.view(f"V{table.dtype.itemsize}")


class Results:
    """Where the results of scenarios stand."""

    def __init__(self, names: Iterable[str], scene: Scene, n: int) -> None:
        self.names = tuple(names)
        self.scene = scene
        self.status = np.full(n, int(Status.NOT_RUN), np.int8)
        self.touched = np.zeros(n, bool)
        #: Largest storey drift (m) of all scenarios that are ok, shape (building, storey); 0 where none was kept.
        self.largest_drift = np.zeros(inner_shape("drift_max", scene))
        missing = np.zeros(1, table_type(self.names, scene))  # of scenarios without an answer
        for name in self.names:
            missing[name] = get_variable(name).fill or 0
        self._slot = np.zeros(n, np.int32)
        self._tables: list[np.ndarray | Callable[[], np.ndarray]] = [missing]
        self._first = [0, 1]
        self._kept = 0

    def hold(self, table: np.ndarray, read: Callable[[], np.ndarray] | None = None) -> tuple[int, np.ndarray]:
        """Take up a table."""
        if "drift_max" in self.names:
            drifts = table["drift_max"][table["status"] == Status.OK]
            self.largest_drift = np.fmax(self.largest_drift, np.fmax.reduce(drifts, axis=0, initial=0.0))
        self._tables.append(table if read is None else read)
        self._first.append(self._first[-1] + len(table))
        return len(self._tables) - 1, np.arange(self._first[-2], self._first[-1])

    def move(self, index: int, read: Callable[[], np.ndarray]) -> None:
        """Let go of a table that is now in a file, from which it is to be read, unless there is room for it."""
        table = self._tables[index]
        assert isinstance(table, np.ndarray)
        if self._kept + table.nbytes <= KEPT_BYTES:
            self._kept += table.nbytes
        else:
            self._tables[index] = read

    def answer(self, rows: np.ndarray, slots: np.ndarray, status: np.ndarray, touched: np.ndarray | bool) -> None:
        """Say which rows of tables answer the scenarios `rows`, how they ended and whether they touched."""
        self._slot[rows] = slots
        self.status[rows] = status
        self.touched[rows] = touched

    def gather(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Gather the results of scenarios."""
        kind = table_type(self.names, self.scene)
        found = np.empty(len(rows), kind)
        slots = self._slot[rows]
        order = np.argsort(slots, kind="stable")
        slots = slots[order]
        edges = np.searchsorted(slots, self._first)
        for index in np.flatnonzero(np.diff(edges)).tolist():
            here = slice(edges[index], edges[index + 1])
            table, mine, there = self._table(index), order[here], slots[here] - self._first[index]
            if table.dtype == kind:
                _as_bytes(found)[mine] = _as_bytes(table).take(there)
                continue
            for name in self.names:  # of a run without pounding, which has more fields
                found[name][mine] = table[name].take(there, axis=0)
        found["status"] = self.status[rows]
        return {name: found[name] for name in self.names}

    def _table(self, index: int) -> np.ndarray:
        """Return a table; of one in a file nothing stays in memory."""
        table = self._tables[index]
        if isinstance(table, np.ndarray):
            return table
        try:
            return table()
        except OutputError as error:
            raise WriteError(f"{error}; what is missing or damaged is made anew by the next run") from error

    def let_go(self) -> None:
        """Let go of all tables; status and touched remain."""
        self._tables.clear()


@dataclass
class Outcome:
    """Results of the unique scenarios of a plan."""

    results: Results  # what each of them ended with
    left_out: np.ndarray  # those answered by a run without pounding; all if nothing was run; bool
    run: int = 0  # scenarios integrated, runs without pounding included
    untouched: int = 0  # unique scenarios answered by the run without pounding
    reused: int = 0  # scenarios read from an interrupted run, which it had run itself
    taken: int = 0  # scenarios taken from an earlier cube, in this run or an interrupted one
    taken_from: Mapping[str, Any] | None = None  # what that cube said of itself; see `pounding_sweep.run.reuse`
    compiled: int = 0  # kernels that had to be compiled
    #: wall time of the two stages
    compile_seconds: float = 0.0
    run_seconds: float = 0.0
    #: what went wrong in chunks that have no result, or only what was taken
    failures: list[str] = field(default_factory=list)
