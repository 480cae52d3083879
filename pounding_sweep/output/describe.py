"""A cube as readable text, or as what JSON holds.

Beside the CF attributes, these global attributes are understood where they are there: ``records`` (JSON list of tables
with ``name``, ``pga`` in m/s2 and anything else), ``scenarios_asked``, ``scenarios_run``, and everything whose name
ends in ``_version``. Any other global attribute is shown shortened.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import shown
from pounding_sweep.base.text import printable
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.audited import AUDIT_DIMS, audit_sentence, audit_table
from pounding_sweep.output.dataset import SOURCE_ATTRIBUTE
from pounding_sweep.output.identity import LIBRARIES, ORIGINS, plain, sources
from pounding_sweep.output.netcdf import ENCODING, NETCDF_LOCK, SLAB_BYTES, slabs
from pounding_sweep.outputs.variables import INNER_DIMS, INTEGER_FILL, STATUS, Status
from pounding_sweep.spec.spec import overview_of

if TYPE_CHECKING:
    import netCDF4
    import xarray as xr


_SHOWN_ELSEWHERE = {
    *("title", "history", "records", "scenarios_asked", "scenarios_run"),
    *("accuracy_choice", "accuracy_numbers"),
    *("audit_scenarios", "audit_touching", "audit_share", "audit_perturbation", "audit_undecided_share"),
}
#: Attributes that are JSON.
_CODED = frozenset({"records", "records_left_out", "sweep", "accuracy_numbers", *ORIGINS})
#: Counts that a cube keeps of one that its results were taken from.
_COUNTS = {"scenarios_asked": "asked", "scenarios_run": "run", "scenarios_taken": "taken"}
_WIDTH = 100
#: Digits of a digest that tell it from others.
_DIGITS = 12


def _number(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return f"{value:.6g}"
    return value if isinstance(value, str) else shown(value)


def _short(value: Any, width: int = _WIDTH) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= width else f"{text[: width - 3]}..."


def _meaning(array: xr.DataArray) -> dict[str, str]:
    units = str(array.attrs.get("units", array.attrs.get("unit_text", "")))
    return {"units": "" if units == "1" else units, "long_name": str(array.attrs.get("long_name", ""))}


def _of_scenarios(arrays: Mapping[Any, xr.DataArray]) -> dict[str, xr.DataArray]:
    """Return arrays by name, without those of the audit."""
    return {str(name): array for name, array in arrays.items() if AUDIT_DIMS[0] not in array.dims}


def _axes(dataset: xr.Dataset, *, inner: bool) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for dim, size in dataset.sizes.items():
        if dim in AUDIT_DIMS or (dim in INNER_DIMS) != inner:
            continue
        axis = dataset[dim]  # a dimension without coordinate counts from 0
        values, (units, name) = axis.values, _meaning(axis).values()
        if values.dtype.kind not in "iuf" or size <= 8:
            text = _short(", ".join(_number(value) for value in values.tolist()))
        else:
            text = f"{_number(values.min().item())} to {_number(values.max().item())}"
        rows.append((str(dim), str(size), f"{text} {units}".rstrip() + (f"  ({name})" if name else "")))
    return rows


def _range(values: xr.DataArray, status: xr.DataArray | None) -> str:
    """Smallest and largest finite value, of the scenarios that are ok where there is a status."""
    if values.dtype.kind not in "iuf":
        return "-"
    low, high = np.inf, -np.inf
    dims = [dim for dim in values.dims if dim not in INNER_DIMS]
    sizes = [values.sizes[dim] for dim in dims]
    each = max(1, values.nbytes // max(1, math.prod(sizes)))
    for slab in slabs(sizes, SLAB_BYTES // each):  # that fit into memory
        cut = dict(zip(dims, slab, strict=True))
        kept = values.isel(cut).astype(float)
        if status is not None and set(status.dims) <= set(kept.dims):
            kept = kept.where(status.isel(cut, missing_dims="ignore") == int(Status.OK))
        array = kept.values[np.isfinite(kept.values)]
        low, high = min(low, array.min(initial=np.inf)), max(high, array.max(initial=-np.inf))
    return f"{_number(low)} to {_number(high)}" if low <= high else "no values"


def _records(records: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for record in records:
        told = {k: v for k, v in record.items() if k not in ("name", "pga") and v not in ("", None)}
        more = [f"{k} {_number(v)[:_DIGITS] if k == 'sha256' else _number(v)}" for k, v in told.items()]
        peak = f"PGA {_number(record['pga'])} m/s2"
        rows.append((_short(record["name"]), peak, _short(", ".join(more), 2 * _WIDTH)))
    return rows


def _origins(attributes: Mapping[Any, Any]) -> list[tuple[str, ...]]:
    """List the cubes that results were taken from."""
    rows: list[tuple[str, ...]] = []
    for key, how in ORIGINS.items():
        for one in sources(attributes, key):
            counts = [f"{one[name]} {text}" for name, text in _COUNTS.items() if name in one]
            if one.get("made_from"):
                counts.append(f"made from {', '.join(one['made_from'])}")
            makers = {name: one.get(f"{name}_version") for name in LIBRARIES}
            made_by = {"source": str(one.get(SOURCE_ATTRIBUTE, ""))[:_DIGITS], **makers}
            made = ", ".join(f"{name} {maker}" for name, maker in made_by.items() if maker)
            rows.append((how, *map(_short, (one["file"], one.get("history", ""), ", ".join(counts), made))))
    return rows


def _audit(table: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for row in table:
        median, largest, apart = (
            "-" if row[name] is None else f"{row[name]:.1e}"
            for name in ("error_median", "error_max", "error_max_undecided")
        )
        undecided = f"undecided ones up to {apart}" if row["undecided"] else ""
        rows.append((row["output"], f"median {median}", f"up to {largest}", undecided))
    return rows


def about(dataset: xr.Dataset) -> dict[str, Any]:
    """Return what `describe` tells of a cube, the ranges of its variables apart, as JSON holds it.

    Parameters
    ----------
    dataset : xarray.Dataset
        As for `describe`: what is not there is left out.

    Returns
    -------
    dict
        ``title``, ``history``, ``versions`` and other attributes, by their names; those that are JSON, such as
        ``records``, ``sweep``, ``merged_from`` and ``extended_from``, as what they hold. ``dims``: dimensions with
        ``size``, ``values``, ``units`` and ``long_name``; ``variables``: with ``dims``, ``units`` and ``long_name``;
        ``scenarios``: how many there are; ``statuses``: scenarios by name of their status;
        ``audit``: rows of `pounding_sweep.output.audited.audit_table`;
        ``row``: names and descriptions of `pounding_sweep.spec.spec.overview`.
        Numbers that are not finite are None.

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"x": ("gap", [3.0, 4.0])}, {"gap": ("gap", [0.01, 0.02], {"units": "m"})}, {"title": "Row"})
    >>> found = about(cube)
    >>> found["title"], found["dims"]["gap"]
    ('Row', {'size': 2, 'values': [0.01, 0.02], 'units': 'm', 'long_name': ''})
    """
    told = {str(key): _plain(value, coded=key in _CODED) for key, value in dataset.attrs.items()}
    versions = {key.removesuffix("_version"): told.pop(key) for key in list(told) if key.endswith("_version")}
    return {
        "title": told.pop("title", ""),
        "history": told.pop("history", ""),
        "versions": versions,
        "dims": {
            str(dim): {"size": size, "values": _plain(dataset[dim].values), **_meaning(dataset[dim])}
            for dim, size in dataset.sizes.items()
            if dim not in AUDIT_DIMS
        },
        "variables": {
            name: {"dims": [str(dim) for dim in array.dims], **_meaning(array)}
            for name, array in _of_scenarios(dataset.data_vars).items()
        },
        "scenarios": dataset["status"].size if "status" in dataset.data_vars else None,
        "statuses": {row["label"]: row["count"] for row in statuses(dataset.get("status", []))},
        "audit": audit_table(dataset),
        "row": [{"name": name, "about": text} for name, text in overview_of(dataset.attrs)],
        "attributes": told,
    }


def _plain(value: Any, *, coded: bool = False) -> Any:
    """Return the value of an attribute or an axis as JSON can hold it; what is coded as JSON, as what that says."""
    text = value if coded else json.dumps(plain(value))
    return json.loads(text, parse_constant=lambda _: None)  # not a finite number


def statuses(status: Any) -> list[dict[str, Any]]:
    """Return the number of scenarios of each status that occurs, with what it means."""
    codes, times = np.unique(status, return_counts=True)
    counts = dict(zip(codes.tolist(), times.tolist(), strict=True))
    return [
        {"status": int(s), "label": s.label, "count": counts[s], "meaning": s.meaning, "remedy": s.remedy}
        for s in STATUS
        if s in counts
    ]


def describe(dataset: xr.Dataset) -> str:
    """Describe a cube in plain text.

    Parameters
    ----------
    dataset : xarray.Dataset
        A cube of this package, or any dataset: what is not there is left out.

    Returns
    -------
    str
        Title, scenarios, row, axes, variables with their range over the scenarios that are ok, statuses with remedies,
        measured errors, records and versions; several lines without a line break at the end.

    Notes
    -----
    Reads every variable once, a part at a time. Control characters of a file are escaped, and what is long is cut.
    """
    attributes, audit = dataset.attrs, audit_table(dataset)
    status = dataset["status"] if "status" in dataset.data_vars else None

    lines = [_short(attributes.get("title", "(no title)"))]
    lines += [f"  {_short(line)}" for line in str(attributes.get("history", "")).splitlines()]
    asked = attributes.get("scenarios_asked")
    if status is not None and status.size != asked:
        changed = "" if asked is None else f" (joined or cut after a run of {asked})"
        lines.append(f"  {status.size} scenarios{changed}")
    elif asked is not None:
        lines.append(f"  {asked} scenarios asked, {attributes.get('scenarios_run')} run")
    if "accuracy_choice" in attributes:
        lines.append(f"  accuracy {attributes['accuracy_choice']}")

    variables, coordinates = [], []
    for name, variable in _of_scenarios(dataset.data_vars).items():
        if name != "status":
            inner = " and ".join(str(dim) for dim in variable.dims if dim in INNER_DIMS)
            units, text = _meaning(variable).values()
            variables.append((name, units or "-", _range(variable, status), f"{text}, per {inner}" if inner else text))
    for name, coordinate in _of_scenarios(dataset.coords).items():
        if name not in dataset.dims:
            units, text = _meaning(coordinate).values()
            coordinates.append((name, f"({', '.join(map(str, coordinate.dims))})", units or "-", text))
    versions = {str(k): v for k, v in attributes.items() if str(k).endswith("_version")}
    others = [(str(k), _short(v)) for k, v in attributes.items() if k not in {*_SHOWN_ELSEWHERE, *versions, *ORIGINS}]
    errors = "Audit: relative error, by the difference to half the step"
    sections: dict[str, Sequence[tuple[str, ...]]] = {
        "Row": [(f"{name}:", text) for name, text in overview_of(attributes)],
        "Scenario axes": _axes(dataset, inner=False),
        "Within a scenario": _axes(dataset, inner=True),
        "Further coordinates": coordinates,
        f"Variables{'' if status is None else ' (range over scenarios that are ok)'}": variables,
        "Scenarios by status": [
            (str(row["count"]), row["label"], f"{row['meaning']}: {row['remedy']}" if row["remedy"] else row["meaning"])
            for row in statuses(dataset.get("status", []))
        ],
        errors: _audit(audit),
        "Records": _records(json.loads(attributes.get("records", "[]"))),
        "Made from": _origins(attributes),
        "Versions": [(k.removesuffix("_version"), str(v)) for k, v in versions.items()],
        "Attributes": others,
    }
    for heading, rows in sections.items():
        if rows:
            lines += ["", heading] + ([f"  {audit_sentence(audit, attributes)}"] if heading == errors else [])
            widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
            for row in rows:
                cells = (cell.ljust(width) for cell, width in zip(row[:-1], widths, strict=False))
                lines.append("  ".join(["", *cells, row[-1]]).rstrip())
    return "\n".join(map(printable, lines))


def summarize(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what `run` reports of the cube that it wrote, read without xarray, which takes longer to load."""
    import netCDF4

    with NETCDF_LOCK, netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        attributes, arrays = file.__dict__, file.variables
        audit, ends, impacts = audit_table(arrays), statuses(arrays["status"][...]), _impacts(arrays)
    return {
        "extended_from": json.loads(attributes.get("extended_from", "null")),
        "accuracy_choice": attributes.get("accuracy_choice", ""),
        "accuracy_numbers": json.loads(attributes.get("accuracy_numbers", "null")),
        "audit": audit,
        "audit_sentence": audit_sentence(audit, attributes),
        "statuses": ends,
        "summary": impacts,
    }


def _impacts(arrays: Mapping[str, netCDF4.Variable]) -> list[dict[str, Any]]:
    """Return what each law does to each pair, one row per law and pair, over the scenarios with status ok."""
    if "pair" not in arrays:
        return []
    status, laws, pairs = arrays["status"], _texts(arrays["law"]), _texts(arrays["pair"]).tolist()
    titles = {key: law.title for key, law in LAWS.items()}
    if "law_title" in arrays:
        titles |= dict(zip(laws.tolist(), _texts(arrays["law_title"]).tolist(), strict=True))
    along = status.dimensions.index(arrays["law"].dimensions[0])
    names = [name for name in ("impact_force_max", "impact_count") if name in arrays]
    each = max([1, *(arrays[name].dtype.itemsize * arrays[name].size // status.size for name in names)])
    found: dict[str, list[list[np.ndarray]]] = {}
    for slab in slabs(status.shape, SLAB_BYTES // each):
        # the largest of all floors, shape (*scenarios, pair); missing where no floors meet
        largest = [np.fmax.reduce(arrays[name][slab], axis=-1) for name in names]
        by_law = np.expand_dims(laws[slab[along]], [axis for axis in range(status.ndim) if axis != along])
        ok = status[slab] == Status.OK
        for law in dict.fromkeys(laws[slab[along]].tolist()):
            some = ok & (by_law == law)
            found.setdefault(law, []).append([ok[some], *(values[some] for values in largest)])
    rows = []
    for law, parts in found.items():
        scenarios, *values = (np.concatenate(part) for part in zip(*parts, strict=True))
        for p, pair in enumerate(pairs):
            at_pair = {name: column[:, p] for name, column in zip(names, values, strict=True)}
            peak = np.fmax.reduce(at_pair.get("impact_force_max", []), initial=-np.inf)
            counts = np.array(at_pair.get("impact_count", []))
            row = {"law": law, "title": titles.get(law, ""), "pair": pair, "scenarios": len(scenarios)}
            # a pair touches where it is hit, or pressed
            row["touching"] = int((at_pair[names[-1]] > 0).sum()) if names else None
            row["peak_force"] = float(peak) if np.isfinite(peak) else None
            row["impacts_max"] = int(counts.max()) if (counts != INTEGER_FILL).any() else None
            row["impacts_median"] = float(np.median(counts[counts > 0])) if (counts > 0).any() else None
            rows.append(row)
    return rows


def _texts(variable: netCDF4.Variable) -> np.ndarray:
    import netCDF4

    values = variable[...]
    return values if values.dtype.kind == "U" else netCDF4.chartostring(values, ENCODING)
