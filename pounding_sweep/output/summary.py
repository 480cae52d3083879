"""A cube in a few rows: what each law does to each pair, and how the scenarios ended."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.audited import audit_sentence, audit_table
from pounding_sweep.output.netcdf import ENCODING, NETCDF_LOCK
from pounding_sweep.output.slabs import SLAB_BYTES, block_shape, slabs
from pounding_sweep.outputs.variables import INTEGER_FILL, STATUS, Status

if TYPE_CHECKING:
    import netCDF4


def summarize(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what `run` reports of the cube that it wrote, read without xarray, which takes longer to load."""
    import netCDF4

    with NETCDF_LOCK, netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        attributes, audit = file.__dict__, audit_table(file.variables)
        counts, rows = _ends_and_impacts(file.variables)
    return {
        "extended_from": json.loads(attributes.get("extended_from", "null")),
        "accuracy_choice": attributes.get("accuracy_choice", ""),
        "accuracy_numbers": json.loads(attributes.get("accuracy_numbers", "null")),
        "audit": audit,
        "audit_sentence": audit_sentence(audit, attributes),
        "statuses": [
            {"status": int(s), "label": s.label, "count": counts[s], "meaning": s.meaning, "remedy": s.remedy}
            for s in STATUS
            if s in counts
        ],
        "summary": rows,
    }


def _ends_and_impacts(arrays: Mapping[str, netCDF4.Variable]) -> tuple[Counter[int], list[dict[str, Any]]]:
    """Return scenarios by status, and a row for each law and pair over those that are ok."""
    names = [name for name in ("impact_force_max", "impact_count") if name in arrays]
    status, laws = arrays["status"], _texts(arrays["law"])
    pairs = _texts(arrays["pair"]).tolist() if "pair" in arrays else []
    titles = {key: law.title for key, law in LAWS.items()}
    if "law_title" in arrays:
        titles |= dict(zip(laws.tolist(), _texts(arrays["law_title"]).tolist(), strict=True))
    along = status.dimensions.index(arrays["law"].dimensions[0])
    ends, rows = Counter[int](), dict[tuple[str, str], dict[str, Any]]()
    each = max([1, *(arrays[name].dtype.itemsize * arrays[name].size // status.size for name in names)])
    for slab in slabs(status.shape, block_shape(status.shape, max(1, SLAB_BYTES // each))):
        _add(ends, status[slab])
        ok = np.moveaxis(status[slab] == Status.OK, along, 0)
        # the largest of all floors, shape (*scenarios, pair); missing where no floors meet
        largest = {name: np.moveaxis(np.fmax.reduce(arrays[name][slab], axis=-1), along, 0) for name in names}
        for law in dict.fromkeys(laws[slab[along]].tolist()):
            some = ok & (laws[slab[along]] == law).reshape(-1, *(1,) * (ok.ndim - 1))
            for p, pair in enumerate(pairs):
                row = rows.setdefault((law, pair), {"number": 0, "touching": 0, "peak": -np.inf, "counts": Counter()})
                row["number"] += int(some.sum())
                at_pair = {name: values[some, p] for name, values in largest.items()}
                if names:  # a pair touches where it is hit, or pressed
                    row["touching"] += int((at_pair[names[-1]] > 0).sum())
                if "impact_force_max" in at_pair:
                    row["peak"] = np.fmax.reduce(at_pair["impact_force_max"], initial=row["peak"])
                if "impact_count" in at_pair:
                    _add(row["counts"], at_pair["impact_count"])
    for row in rows.values():
        row["counts"].pop(INTEGER_FILL, None)
        row["hits"] = np.repeat(*np.array([item for item in row["counts"].items() if item[0]], int).reshape(-1, 2).T)
    return ends, [
        {
            "law": law,
            "title": titles.get(law, ""),
            "pair": pair,
            "scenarios": row["number"],
            "touching": row["touching"] if names else None,
            "peak_force": float(row["peak"]) if np.isfinite(row["peak"]) else None,
            "impacts_max": max(row["counts"], default=None),
            "impacts_median": float(np.median(row["hits"])) if len(row["hits"]) else None,
        }
        for (law, pair), row in rows.items()
    ]


def _add(counts: Counter[int], values: np.ndarray) -> None:
    """Count how often each value occurs."""
    numbers, times = np.unique(values, return_counts=True)
    counts.update(dict(zip(numbers.tolist(), times.tolist(), strict=True)))


def _texts(variable: netCDF4.Variable) -> np.ndarray:
    import netCDF4

    values = variable[...]
    return values if values.dtype.kind == "U" else netCDF4.chartostring(values, ENCODING)
