"""The slow twin of a compiled kernel: the same source, run on NumPy arrays in double precision."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pounding_sweep.engine.kernel import make_flights, make_group, noter, run_group, width
from pounding_sweep.kernel.lanes import Ledger
from pounding_sweep.kernel.spec import LANES, KernelSpec, Slots, input_slots
from pounding_sweep.outputs.variables import output_slots
from pounding_sweep.schemes.exact import Events


class Ground:
    """The record as the twin steps through it."""

    def __init__(self, motion: np.ndarray, length: float, steps: int, substeps: int, track: np.ndarray) -> None:
        self._motion, self.steps, self.substeps, self.track = motion, steps, substeps, track
        self.intervals, self.h, self.long = len(motion) - 1, length / steps, length / substeps

    def start(self) -> Any:
        """Acceleration at the first point."""
        return self._motion[0]

    def _between(self, i: int, j: int) -> Any:
        return self._motion[i] + (self._motion[i + 1] - self._motion[i]) * (j / self.steps)

    def ends(self, i: int, j: int) -> tuple[Any, Any]:
        """Accelerations at both ends of a step."""
        return self._between(i, j), self._motion[i + 1] if j == self.steps - 1 else self._between(i, j + 1)

    def time(self, number: int) -> float:
        """Time (s) after so many steps."""
        return number * self.h


def run(
    spec: KernelSpec,
    motion: np.ndarray,
    length: float,
    steps: int,
    substeps: int,
    constants: np.ndarray,
    inputs: np.ndarray,
    results: np.ndarray,
    history: np.ndarray,
    track: np.ndarray,
    tables: np.ndarray,
    decays: np.ndarray,
    rows: int,
    scenarios: int,
    lanes: int = LANES,
) -> None:
    """Do what the compiled kernel of `spec` does, for the first `lanes` of each group."""
    ground = Ground(motion, length, steps, substeps, track)

    def put(row: int, column: int, value: np.ndarray) -> None:
        history[row, column] = value[0]

    if spec.flies_exactly:
        group = make_group(spec, None, width(spec.precision), constants)
        note = noter(group, put, True) if spec.history else None
        with np.errstate(all="ignore"):
            arrays = {"inputs": inputs.reshape(-1, LANES), "results": results.reshape(-1, LANES), "memory": None}
            arrays |= {"tables": tables, "decays": decays}
            counts = rows, scenarios, group.passing
            flights = make_flights(group, ground, arrays, counts, note, Ledger(None))
            Events(group, ground, flights.serve, flights.course, note).run()
        return
    with np.errstate(all="ignore"):
        for given, found in zip(inputs, results, strict=True):
            group = make_group(spec, None, lanes, constants)
            for name, i, row in _rows(input_slots(spec), given):
                group.state[name, i] = row[:lanes]
            run_group(group, ground, noter(group, put, True) if spec.history else None)
            for name, i, row in _rows(output_slots(spec), found):
                row[:lanes] = group.state[name, i]


def _rows(slots: Slots, values: np.ndarray) -> Iterator[tuple[str, int, np.ndarray]]:
    """Rows of a lane group by name and number, views of what lies there."""
    lanes = values.reshape(-1, LANES)
    for name, first in slots.first.items():
        for i in range(slots.count[name]):
            yield name, i, lanes[first + i]
