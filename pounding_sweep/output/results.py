"""Results of a sweep's scenarios: each stays in the table of its chunk, in memory or on disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pounding_sweep.base.errors import OutputError, WriteError
from pounding_sweep.model.scene import Scene
from pounding_sweep.variables.registry import COPY, NOT_RUN, Status, get_variable, inner_shape

#: Outputs whose largest values plausibility checks look at after a run.
LARGEST = ("drift_max", "penetration_max")


def table_type(names: Iterable[str], scene: Scene) -> np.dtype:
    """Return the type of a table of results: one row per scenario, one field per variable."""
    return np.dtype([(name, get_variable(name).dtype, inner_shape(name, scene)) for name in names], align=True)


def to_table(values: Mapping[str, np.ndarray], scene: Scene) -> np.ndarray:
    """Put variables of shape (n, *inner) side by side, one row per scenario."""
    table = np.empty(len(next(iter(values.values()))), table_type(values, scene))
    for name, column in values.items():
        table[name] = column
    return table


def number_runs(origin: np.ndarray, run: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``origin`` and ``run`` of scenarios, by what tells runs apart: numbers from 1, the first is no copy."""
    origin, numbers = origin.copy(), np.zeros(run.shape, np.int32)
    answered, ran = (np.flatnonzero(origin != NOT_RUN), np.flatnonzero(origin <= COPY))
    _, first, index = np.unique(run.flat[answered], return_index=True, return_inverse=True)
    numbers.flat[answered] = 1 + np.argsort(np.argsort(first))[index]
    origin.flat[ran] = COPY
    origin.flat[ran[np.unique(run.flat[ran], return_index=True)[1]]] = 0
    return origin, numbers


class Results:
    """Where the results of scenarios stand."""

    def __init__(self, names: Iterable[str], scene: Scene, n: int) -> None:
        self.names, self.scene = tuple(names), scene
        self.status = np.full(n, int(Status.NOT_RUN), np.int8)
        self.touched = np.zeros(n, bool)
        #: Largest storey drifts and penetrations (m) of all scenarios that are ok, of those that are asked for.
        self.largest = {name: np.zeros(inner_shape(name, scene)) for name in LARGEST if name in self.names}
        missing = {name: np.full((1, *inner_shape(name, scene)), get_variable(name).fill or 0) for name in self.names}
        #: the first has what stands for scenarios without an answer
        self.tables: list[np.ndarray | Callable[[], np.ndarray]] = [to_table(missing, scene)]
        self._slot, self._first = np.zeros(n, np.int32), [0, 1]

    def hold(self, table: np.ndarray, read: Callable[[], np.ndarray] | None = None) -> np.ndarray:
        """Take up a table, or what reads it from a file; returns where its rows stand."""
        for name, largest in self.largest.items():
            values = table[name][table["status"] == Status.OK]
            self.largest[name] = np.fmax(largest, np.fmax.reduce(values, axis=0, initial=0.0))
        self.tables.append(table if read is None else read)
        self._first.append(self._first[-1] + len(table))
        return np.arange(self._first[-2], self._first[-1])

    def answer(self, rows: np.ndarray, slots: np.ndarray, status: np.ndarray, touched: np.ndarray | bool) -> None:
        """Say which rows of tables answer the scenarios `rows`, how they ended and whether they touched."""
        self._slot[rows], self.status[rows], self.touched[rows] = slots, status, touched

    def gather(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Gather the results of scenarios; nothing of a table that is in a file stays in memory."""
        kind = table_type(self.names, self.scene)
        result, as_bytes = np.empty(len(rows), kind), f"V{kind.itemsize}"
        order = np.argsort(self._slot[rows], kind="stable")
        slots = self._slot[rows][order]
        edges = np.searchsorted(slots, self._first)
        for index in np.flatnonzero(np.diff(edges)).tolist():
            part = slice(edges[index], edges[index + 1])
            table, wanted, stored = self.tables[index], order[part], slots[part] - self._first[index]
            try:
                table = table if isinstance(table, np.ndarray) else table()
            except OutputError as error:
                raise WriteError(f"{error}; what is missing or damaged is made anew by the next run") from error
            if table.dtype == kind:  # rows as so many bytes are copied ten times as fast as their fields
                result.view(as_bytes)[wanted] = table.view(as_bytes).take(stored)
                continue
            for name in self.names:  # of a run without pounding, which has more fields
                result[name][wanted] = table[name].take(stored, axis=0)
        result["status"] = self.status[rows]
        return {name: result[name] for name in self.names}


@dataclass
class Outcome:
    """Results of the unique scenarios of a plan."""

    results: Results  # what each of them ended with
    left_out: np.ndarray  # those answered by a run without pounding; all if nothing was run; bool
    run: int = 0  # scenarios integrated, runs without pounding included
    untouched: int = 0  # unique scenarios answered by the run without pounding
    reused: int = 0  # scenarios read from an interrupted run, which it had run itself
    copied: int = 0  # scenarios taken from an earlier cube, in this run or an interrupted one
    copied_from: Mapping[str, Any] | None = None  # what that cube said of itself; see `pounding_sweep.run.reuse`
    compiled: int = 0  # kernels that had to be compiled
    refined: int = 0  # scenarios run at less than half of the step that they began with, for an accuracy
    #: wall time of the two stages
    compile_seconds: float = 0.0
    run_seconds: float = 0.0
    #: what went wrong in chunks that have no result, or only what was taken
    failures: list[str] = field(default_factory=list)
