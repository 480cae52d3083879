"""A cube in a few rows: what each law does to each pair, and how the scenarios ended."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.output.dataset import as_read
from pounding_sweep.output.slabs import cuts, status_counts
from pounding_sweep.outputs.variables import INNER_DIMS, STATUS, Status

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.output.frame import Frame


def summary_table(cube: xr.Dataset) -> list[dict[str, Any]]:
    """Summarise the impacts of a cube, one row per law and pair."""
    if "pair" not in cube.coords:
        return []
    pairs = [str(name) for name in np.atleast_1d(cube["pair"].values)]
    titles = _titles(cube.coords)
    return [row for law, part in _by_law(cube) for row in _rows(law, titles, pairs, *_impacts(part, len(pairs)))]


class Tally:
    """`summary_table` and `status_table` of a cube that is being made, of which it is shown one slab after another."""

    def __init__(self, cube: Frame, outer: Sequence[str]) -> None:
        law = cube.coords["law"]
        self._along, self._laws, self._titles = outer.index(law.dims[0]), law.values, _titles(cube.coords)
        self._pairs = [str(name) for name in cube.coords["pair"].values] if "pair" in cube.coords else []
        self._present = [name for name in ("impact_force_max", "impact_count") if name in cube.data_vars]
        self._found = {str(key): self._nothing() for key in self._laws}
        self._scenarios: Counter[str] = Counter()
        self._statuses: Counter[int] = Counter()

    def _nothing(self) -> list[_Impacts]:
        return [_Impacts("impact_force_max" in self._present, "impact_count" in self._present) for _ in self._pairs]

    def add(self, slab: Sequence[slice], values: Mapping[str, np.ndarray]) -> None:
        """Take up the values of a slab, as they are stored."""
        codes, counts = np.unique(values["status"], return_counts=True)
        self._statuses.update(dict(zip(codes.tolist(), counts.tolist(), strict=True)))
        laws = self._laws[slab[self._along]]
        status = np.moveaxis(values["status"], self._along, 0)
        floors = {name: np.moveaxis(as_read(name, values[name]), self._along, 0) for name in self._present}
        for law in dict.fromkeys(laws.tolist()):
            mine = laws == law
            ok = status[mine] == Status.OK
            self._scenarios[law] += int(ok.sum())
            # scenarios without a value have none at any floor, others none where no floors meet
            force, count = (
                np.nan_to_num(floors[name][mine][ok], nan=-np.inf) if name in floors else None
                for name in ("impact_force_max", "impact_count")
            )
            for p, impacts in enumerate(self._found[law]):
                impacts.add(None if force is None else force[:, p], None if count is None else count[:, p])

    def summary(self) -> list[dict[str, Any]]:
        """Return the rows of `summary_table`."""
        found = self._found.items()
        return [
            row
            for law, impacts in found
            for row in _rows(law, self._titles, self._pairs, self._scenarios[law], impacts)
        ]

    def statuses(self) -> list[dict[str, Any]]:
        """Return the rows of `status_table`."""
        return _status_rows(self._statuses)


@dataclass
class _Impacts:
    """What happened at one pair, over the parts of a cube that were seen."""

    forces: bool
    counted: bool
    peak: float = -np.inf
    touching: int = 0
    #: Scenarios by the largest count at one floor.
    most: Counter[float] = field(default_factory=Counter)

    def add(self, force: np.ndarray | None, count: np.ndarray | None) -> None:
        """Take up scenarios: force and count of their floors, shape (n, storey)."""
        found = count if count is not None else force
        if found is not None:
            self.touching += int((np.max(found, axis=-1, initial=-np.inf) > 0).sum())
        if force is not None:
            self.peak = max(self.peak, float(np.max(force, initial=-np.inf)))
        if count is not None:
            largest = np.max(count, axis=-1, initial=-np.inf)
            values, times = np.unique(largest[np.isfinite(largest)], return_counts=True)
            self.most.update(dict(zip(values.tolist(), times.tolist(), strict=True)))

    def row(self) -> dict[str, Any]:
        """Return the columns of a summary."""
        hit = {value: times for value, times in self.most.items() if value > 0}
        return {
            "touching": self.touching if self.forces or self.counted else None,
            "peak_force": self.peak if np.isfinite(self.peak) else None,
            "impacts_max": int(max(self.most)) if self.most else None,
            "impacts_median": _median(hit) if hit else None,
        }


def _impacts(cube: xr.Dataset, n_pairs: int) -> tuple[int, list[_Impacts]]:
    """Go once through a cube of one law: its ok scenarios, and what happened at each pair."""
    present = [name for name in ("impact_force_max", "impact_count", "status") if name in cube.data_vars]
    found = [_Impacts("impact_force_max" in present, "impact_count" in present) for _ in range(n_pairs)]
    scenarios = 0
    for cut in cuts(cube[present[0]]) if present else [{}]:
        part = cube.isel(cut, missing_dims="ignore")
        ok = _ok(part)
        scenarios += int(ok.sum())
        force, count = (_floors(part, name, ok) for name in ("impact_force_max", "impact_count"))
        for index, impacts in enumerate(found):
            impacts.add(None if force is None else force[index], None if count is None else count[index])
    return scenarios, found


def _median(times: dict[float, int]) -> float:
    """Median of values that occur so many times each."""
    values = np.array(sorted(times))
    upto = np.cumsum([times[value] for value in values.tolist()])
    middle = np.searchsorted(upto, [(upto[-1] - 1) // 2, upto[-1] // 2], side="right")
    return float(values[middle].mean())


def status_table(cube: xr.Dataset) -> list[dict[str, Any]]:
    """Count the scenarios of a cube by status."""
    return _status_rows(status_counts(cube["status"]))


def _rows(
    law: str, titles: Mapping[str, str], pairs: Sequence[str], scenarios: int, found: Sequence[_Impacts]
) -> list[dict[str, Any]]:
    about = {"law": law, "title": titles.get(law, "")}
    return [
        {**about, "pair": pair, "scenarios": scenarios, **impacts.row()}
        for pair, impacts in zip(pairs, found, strict=True)
    ]


def _status_rows(found: Mapping[int, int]) -> list[dict[str, Any]]:
    return [
        {"status": int(s), "label": s.label, "count": found[int(s)], "meaning": s.meaning, "remedy": s.remedy}
        for s in STATUS
        if int(s) in found
    ]


def _titles(coordinates: Mapping[Any, Any]) -> dict[str, str]:
    """Titles of laws by their keys: those of the registry, and of a user's own where the cube knows them."""
    from pounding_sweep.model.laws import LAWS

    known = {key: law.title for key, law in LAWS.items()}
    if "law_title" not in coordinates:
        return known
    return known | dict(
        zip(*(np.ravel(coordinates[name].values).tolist() for name in ("law", "law_title")), strict=True)
    )


def _by_law(cube: xr.Dataset) -> list[tuple[str, xr.Dataset]]:
    """Cut a cube by law, in the order in which laws first occur."""
    if "law" not in cube.coords:
        return [("", cube)]
    laws = cube["law"]
    if not laws.dims:
        return [(str(laws.values), cube)]
    names = [str(name) for name in laws.values]
    dim = laws.dims[0]
    return [(law, cube.isel({dim: [i for i, name in enumerate(names) if name == law]})) for law in dict.fromkeys(names)]


def _ok(cube: xr.Dataset) -> xr.DataArray:
    """Which scenarios are ok; all of them where the cube does not say."""
    import xarray as xr

    if "status" in cube.data_vars:
        return cube["status"] == int(Status.OK)
    sizes = {dim: size for dim, size in cube.sizes.items() if dim not in INNER_DIMS}
    return xr.DataArray(np.ones(tuple(sizes.values()), dtype=bool), dims=tuple(sizes))


def _floors(cube: xr.Dataset, name: str, ok: xr.DataArray) -> np.ndarray | None:
    """Values of ok scenarios, shape (pair, scenario, storey), -inf where there is none; None if the cube lacks it."""
    if name not in cube.data_vars:
        return None
    values = cube[name].where(ok)
    for dim in ("pair", "storey"):
        if dim not in values.dims:
            values = values.expand_dims(dim)
    array = values.transpose("pair", ..., "storey").values.astype(float)
    array = np.where(np.isfinite(array), array, -np.inf)
    return array.reshape(array.shape[0], -1, array.shape[-1])
