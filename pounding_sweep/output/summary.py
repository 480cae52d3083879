"""A cube in a few rows: what each law does to each pair, and how the scenarios ended."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.output.slabs import cuts, status_counts
from pounding_sweep.outputs.variables import INNER_DIMS, STATUS, Status

if TYPE_CHECKING:
    import xarray as xr


def summary_table(cube: xr.Dataset) -> list[dict[str, Any]]:
    """Summarise the impacts of a cube, one row per law and pair."""
    if "pair" not in cube.coords:
        return []
    pairs = [str(name) for name in np.atleast_1d(cube["pair"].values)]
    rows = []
    for law, part in _by_law(cube):
        scenarios, found = _impacts(part, len(pairs))
        for pair, impacts in zip(pairs, found, strict=True):
            rows.append({"law": law, "title": _title(part, law), "pair": pair, "scenarios": scenarios, **impacts.row()})
    return rows


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
    found = status_counts(cube["status"])
    return [
        {"status": int(s), "label": s.label, "count": found[int(s)], "meaning": s.meaning, "remedy": s.remedy}
        for s in STATUS
        if int(s) in found
    ]


def _title(part: xr.Dataset, law: str) -> str:
    """Title of a law, one of the registry or a user's own, of which the cube knows it."""
    from pounding_sweep.model.laws import LAWS

    if law in LAWS or "law_title" not in part.coords:
        return LAWS[law].title if law in LAWS else ""
    return str(np.ravel(part["law_title"].values)[0])


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
