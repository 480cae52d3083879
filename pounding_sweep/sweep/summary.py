"""A cube in a few rows: what each law does to each pair, and how the scenarios ended."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.cube.variables import INNER_DIMS, STATUS, Status

if TYPE_CHECKING:
    import xarray as xr


def summary_table(cube: xr.Dataset) -> list[dict[str, Any]]:
    """Summarise the impacts of a cube, one row per law and pair.

    Only scenarios whose status is ok count.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube, or a selection from one, with ``law`` as a dimension, as a coordinate of
        listed cases, or as a single value.

    Returns
    -------
    list of dict
        ``law``, ``title``, ``pair`` (texts); ``scenarios`` (ok ones, broadcast ones
        included); ``touching`` (those among them with an impact at this pair);
        ``peak_force`` (kN, largest over scenarios and floors); ``impacts_max`` (largest
        count at one floor in one scenario); ``impacts_median`` (median over the touching
        scenarios of the largest count at one floor). None where the cube does not hold
        the variable or has no value. Empty for a cube without pairs.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> pulse = ps.pulse_record("sine", amplitude=3.0, period=0.4, dt=0.01)
    >>> cube = ps.Sweep("mate2015", records=pulse, laws="none").run()
    >>> [(row["pair"], row["peak_force"]) for row in summary_table(cube)]
    [('left-middle', 0.0), ('middle-right', 0.0)]
    """
    if "pair" not in cube.coords:
        return []
    pairs = [str(name) for name in np.atleast_1d(cube["pair"].values)]
    rows = []
    for law, part in _by_law(cube):
        ok = _ok(part)
        force = _floors(part, "impact_force_max", ok)
        count = _floors(part, "impact_count", ok)
        found = count if count is not None else force
        for index, pair in enumerate(pairs):
            most = None if count is None else _finite(np.max(count[index], axis=-1, initial=-np.inf))
            touched = None if found is None else np.max(found[index], axis=-1, initial=-np.inf) > 0
            hit = None if most is None else most[most > 0]
            rows.append(
                {
                    "law": law,
                    "title": _title(law),
                    "pair": pair,
                    "scenarios": int(ok.sum()),
                    "touching": None if touched is None else int(touched.sum()),
                    "peak_force": None if force is None else _largest(force[index]),
                    "impacts_max": None if most is None or not most.size else int(most.max()),
                    "impacts_median": None if hit is None or not hit.size else float(np.median(hit)),
                }
            )
    return rows


def status_table(cube: xr.Dataset) -> list[dict[str, Any]]:
    """Count the scenarios of a cube by status.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube, or a selection from one that still holds ``status``.

    Returns
    -------
    list of dict
        ``status`` (code), ``label``, ``count``, ``meaning``, ``remedy`` of each status
        that occurs, ok first.
    """
    codes, counts = np.unique(cube["status"].values, return_counts=True)
    found = dict(zip(codes.tolist(), counts.tolist(), strict=True))
    return [
        {"status": int(s), "label": s.label, "count": found[int(s)], "meaning": s.meaning, "remedy": s.remedy}
        for s in STATUS
        if int(s) in found
    ]


def _title(law: str) -> str:
    from pounding_sweep.contact.laws import LAWS

    return LAWS[law].title if law in LAWS else ""


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


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _largest(values: np.ndarray) -> float | None:
    found = _finite(values)
    return float(found.max()) if found.size else None
