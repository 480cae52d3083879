"""A cube in a few rows: what each law does to each pair, and how the scenarios ended."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.model.laws import LAWS
from pounding_sweep.outputs.variables import INTEGER_FILL, STATUS, Status

if TYPE_CHECKING:
    import xarray as xr


class Tally:
    """Impacts by law and pair, and statuses, of a cube that is being made and shown one slab after another."""

    def __init__(self, cube: xr.Dataset, outer: Sequence[str]) -> None:
        law = cube.coords["law"]
        self._along, self._laws, self._titles = outer.index(law.dims[0]), law.values, _titles(cube.coords)
        self._pairs = [str(name) for name in cube.coords["pair"].values] if "pair" in cube.coords else []
        self._present = [name for name in ("impact_force_max", "impact_count") if name in cube.data_vars]
        forces, counted = (name in self._present for name in ("impact_force_max", "impact_count"))
        self._found = {str(key): [_Impacts(forces, counted) for _ in self._pairs] for key in self._laws}
        self._scenarios: Counter[str] = Counter()
        self._statuses: Counter[int] = Counter()

    def add(self, slab: Sequence[slice], values: Mapping[str, np.ndarray]) -> None:
        """Take up the values of a slab, as they are stored."""
        self._statuses += _counted(values["status"])
        laws = self._laws[slab[self._along]]
        ok, *found = (np.moveaxis(values[name], self._along, 0) for name in ("status", *self._present))
        ok = ok == Status.OK
        for law in dict.fromkeys(laws.tolist()):
            at = np.flatnonzero(laws == law)
            mine: Any = slice(at[0], at[-1] + 1) if at[-1] - at[0] < len(at) else at  # a part of an array is no copy
            some = ok[mine]
            number = int(some.sum())
            self._scenarios[law] += number
            whole = ... if number == some.size else some
            floors = {name: each[mine][whole] for name, each in zip(self._present, found, strict=True)}
            for p, impacts in enumerate(self._found[law]):
                impacts.add(**{name: each[..., p, :] for name, each in floors.items()})

    def summary(self) -> list[dict[str, Any]]:
        """Return the impacts, one row per law and pair."""
        return [
            {
                "law": law,
                "title": self._titles.get(law, ""),
                "pair": pair,
                "scenarios": self._scenarios[law],
                **impacts.row(),
            }
            for law, found in self._found.items()
            for pair, impacts in zip(self._pairs, found, strict=True)
        ]

    def statuses(self) -> list[dict[str, Any]]:
        """Return the number of scenarios of each status that occurs, with what it means."""
        return [
            {"status": int(s), "label": s.label, "count": self._statuses[s], "meaning": s.meaning, "remedy": s.remedy}
            for s in STATUS
            if s in self._statuses
        ]


@dataclass
class _Impacts:
    """What happened at one pair, over the parts of a cube that were seen."""

    forces: bool
    counted: bool
    peak: float = -np.inf
    touching: int = 0
    #: Scenarios by the largest count at one floor.
    most: Counter[int] = field(default_factory=Counter)

    def add(self, impact_force_max: np.ndarray | None = None, impact_count: np.ndarray | None = None) -> None:
        """Take up scenarios: force and count of their floors, shape (..., storey), missing where no floors meet."""
        if impact_force_max is not None:
            largest = np.asarray(reduce(np.fmax, np.moveaxis(impact_force_max, -1, 0), -np.inf))
            self.peak = max(self.peak, float(np.max(largest, initial=-np.inf)))
        if impact_count is not None:
            largest = np.asarray(reduce(np.maximum, np.moveaxis(impact_count, -1, 0), INTEGER_FILL))
            self.most += _counted(largest[largest != INTEGER_FILL])
        if self.forces or self.counted:
            self.touching += int(np.sum(largest > 0))

    def row(self) -> dict[str, Any]:
        """Return the columns of a summary."""
        hit = {value: times for value, times in self.most.items() if value > 0}
        return {
            "touching": self.touching if self.forces or self.counted else None,
            "peak_force": self.peak if np.isfinite(self.peak) else None,
            "impacts_max": int(max(self.most)) if self.most else None,
            "impacts_median": _median(hit) if hit else None,
        }


def _counted(numbers: np.ndarray) -> Counter[int]:
    """Count how often each of few whole numbers, none of them negative, is there."""
    times = np.bincount(numbers.ravel())
    return Counter({value: int(times[value]) for value in np.flatnonzero(times).tolist()})


def _median(times: dict[int, int]) -> float:
    """Median of values that occur so many times each."""
    values = np.array(sorted(times))
    upto = np.cumsum([times[value] for value in values.tolist()])
    middle = np.searchsorted(upto, [(upto[-1] - 1) // 2, upto[-1] // 2], side="right")
    return float(values[middle].mean())


def _titles(coordinates: Mapping[Any, Any]) -> dict[str, str]:
    """Titles of laws by their keys: those of the registry, and of a user's own where the cube knows them."""
    known = {key: law.title for key, law in LAWS.items()}
    if "law_title" not in coordinates:
        return known
    return known | dict(
        zip(*(np.ravel(coordinates[name].values).tolist() for name in ("law", "law_title")), strict=True)
    )
