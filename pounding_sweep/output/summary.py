"""A cube in a few rows: what each law does to each pair, and how the scenarios ended."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.dataset import as_stored
from pounding_sweep.output.slabs import cuts, status_counts
from pounding_sweep.outputs.variables import INTEGER_FILL, STATUS, Status

if TYPE_CHECKING:
    import xarray as xr


def statuses(cube: xr.Dataset) -> list[dict[str, Any]]:
    """Return the number of scenarios of each status that occurs, with what it means."""
    counts = status_counts(cube["status"])
    return [
        {"status": int(s), "label": s.label, "count": counts[s], "meaning": s.meaning, "remedy": s.remedy}
        for s in STATUS
        if s in counts
    ]


def impacts(cube: xr.Dataset) -> list[dict[str, Any]]:
    """Return what each law does to each pair, one row per law and pair, over the scenarios with status ok."""
    names = [name for name in ("impact_force_max", "impact_count") if name in cube]
    pairs = [str(name) for name in cube["pair"].values] if "pair" in cube.coords else []
    outer, titles = cube["status"].dims, _titles(cube.coords)
    along = outer.index(cube["law"].dims[0])
    scenarios, found = Counter[str](), dict[tuple[str, str], dict[str, Any]]()
    for cut in cuts(max((cube[name] for name in ("status", *names)), key=lambda variable: variable.nbytes)):
        part = cube[["status", *names]].isel(cut)
        ok = np.moveaxis(part["status"].values == Status.OK, along, 0)
        # the largest of all floors, shape (*scenarios, pair); missing where no floors meet
        largest: dict[str, np.ndarray] = {}
        for name in names:
            values = as_stored(name, part[name].transpose(*outer, "pair", "storey").values)
            values = (np.fmax if name == "impact_force_max" else np.maximum).reduce(values, axis=-1)
            largest[name] = np.moveaxis(values, along, 0)
        laws = part["law"].values
        for law in dict.fromkeys(laws.tolist()):
            some = ok & (laws == law).reshape(-1, *(1,) * (ok.ndim - 1))
            scenarios[law] += int(some.sum())
            for p, pair in enumerate(pairs):
                row = found.setdefault((law, pair), {"touching": 0, "peak": -np.inf, "counts": Counter[int]()})
                at_pair = {name: values[some, p] for name, values in largest.items()}
                if names:  # a pair touches where it is hit, or pressed
                    row["touching"] += int((at_pair[names[-1]] > 0).sum())
                if "impact_force_max" in at_pair:
                    peak = np.fmax.reduce(at_pair["impact_force_max"], initial=-np.inf)
                    row["peak"] = max(row["peak"], float(peak))
                if "impact_count" in at_pair:
                    count = at_pair["impact_count"]
                    numbers, times = np.unique(count[count != INTEGER_FILL], return_counts=True)
                    row["counts"].update(dict(zip(numbers.tolist(), times.tolist(), strict=True)))
    return [
        {
            "law": law,
            "title": titles.get(law, ""),
            "pair": pair,
            "scenarios": scenarios[law],
            "touching": row["touching"] if names else None,
            "peak_force": row["peak"] if np.isfinite(row["peak"]) else None,
            "impacts_max": max(row["counts"], default=None),
            "impacts_median": _median({value: times for value, times in row["counts"].items() if value > 0}),
        }
        for (law, pair), row in found.items()
    ]


def _median(times: dict[int, int]) -> float | None:
    """Median of values that occur so many times each; None where there is none."""
    if not times:
        return None
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
