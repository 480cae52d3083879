"""A cube as readable text, or as what JSON holds."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import repr_short
from pounding_sweep.base.files import FilePath
from pounding_sweep.base.text import fold, number_text, pairs_text, printable
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.audited import AUDIT_DIMS, audit_table, errors_by_law, errors_sentence
from pounding_sweep.output.identity import ORIGINS, plain, sources
from pounding_sweep.output.netcdf import ENCODING, NETCDF_LOCK, SLAB_BYTES, slabs
from pounding_sweep.request.axes import AXES
from pounding_sweep.request.spec import overview_of
from pounding_sweep.variables.registry import INNER_DIMS, INTEGER_FILL, OUTPUT_NAMES, STATUS, VALID, Status

if TYPE_CHECKING:
    import netCDF4
    import xarray as xr

#: Attributes that are shown in a section of their own.
_SECTION_ATTRIBUTES = {
    *("title", "history", "records", "scenarios_asked", "scenarios_run", *ORIGINS),
    *("accuracy_choice", "accuracy_numbers"),
    *("audit_scenarios", "audit_touching", "audit_share", "audit_reference", "audit_undecided_share"),
}
#: Attributes that are JSON.
_CODED = frozenset({"records", "records_left_out", "sweep", "accuracy_numbers", *ORIGINS})
_WIDTH = 100
#: What listed cases may share.
_LISTED = ("law", "record", "contact_stiffness", *(axis.dimension for axis in AXES.values() if not axis.by))


def _number(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else repr_short(value)


def _short(value: Any, width: int = _WIDTH) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= width else f"{text[: width - 3]}..."


def _plain(value: Any, *, coded: bool = False) -> Any:
    """Return the value of an attribute or an axis as JSON can hold it; what is coded as JSON, as what that says."""
    text = value if coded else json.dumps(plain(value))
    return json.loads(text, parse_constant=lambda _: None)  # not a finite number


def _meaning(array: xr.DataArray) -> dict[str, str]:
    units = str(array.attrs.get("units", array.attrs.get("unit_text", "")))
    return {"units": "" if units == "1" else units, "long_name": str(array.attrs.get("long_name", ""))}


def about(dataset: xr.Dataset) -> dict[str, Any]:
    """Return what `describe` tells of a cube, the ranges of its variables apart, as JSON holds it.

    Parameters
    ----------
    dataset : xarray.Dataset
        As for `describe`: what is not there is left out.

    Returns
    -------
    dict
        ``title``, ``history``, ``versions`` and other attributes, JSON as what it holds; ``dims`` and ``variables``;
        ``scenarios``, how many; ``statuses``, by name; ``not_ok``: each status but ok, ``where`` its scenarios are and
        their number ``by_value`` of each axis; ``audit``: rows of `pounding_sweep.output.audited.audit_table`;
        ``row``: names and descriptions. None for what is not finite.

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"x": ("gap", [3.0, 4.0])}, {"gap": ("gap", [0.01, 0.02], {"units": "m"})}, {"title": "Row"})
    >>> found = about(cube)
    >>> found["title"], found["dims"]["gap"]
    ('Row', {'size': 2, 'values': [0.01, 0.02], 'units': 'm', 'long_name': ''})
    """
    attributes = {str(key): _plain(value, coded=key in _CODED) for key, value in dataset.attrs.items()}
    versions = {key.removesuffix("_version"): attributes.pop(key) for key in [*attributes] if key.endswith("_version")}
    return {
        "title": attributes.pop("title", ""),
        "history": attributes.pop("history", ""),
        "versions": versions,
        "dims": {
            str(dim): {"size": size, "values": _plain(dataset[dim].values), **_meaning(dataset[dim])}
            for dim, size in dataset.sizes.items()
            if dim not in AUDIT_DIMS
        },
        "variables": {
            str(name): {"dims": [str(dim) for dim in array.dims], **_meaning(array)}
            for name, array in dataset.data_vars.items()
            if AUDIT_DIMS[0] not in array.dims
        },
        "scenarios": dataset["status"].size if "status" in dataset.data_vars else None,
        "statuses": {row["label"]: row["count"] for row in statuses(dataset.get("status", []))},
        "not_ok": failures(dataset) if "status" in dataset.data_vars else [],
        "audit": audit_table(dataset),
        "row": [{"name": name, "about": text} for name, text in overview_of(dataset.attrs)],
        "attributes": attributes,
    }


def statuses(status: Any, unsettled_output: Any = ()) -> list[dict[str, Any]]:
    """Return the number of scenarios of each status that occurs, with what it means and which outputs do not settle."""
    codes, times = np.unique(status, return_counts=True)
    counts = dict(zip(codes.tolist(), times.tolist(), strict=True))
    codes, times = np.unique(np.asarray(unsettled_output, int), return_counts=True)
    named = "".join(f", {OUTPUT_NAMES[code]} ({n})" for code, n in zip(codes, times, strict=True) if code)
    return [
        {"status": int(s), "label": s.label, "count": counts[s], "meaning": s.meaning, "remedy": s.remedy}
        | ({"meaning": s.meaning + named} if s == Status.UNSETTLED else {})
        for s in STATUS
        if s in counts
    ]


def failures(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return the rows of `statuses` but ok, with ``where`` these scenarios are, and a table ``by_value`` of axes."""
    status = dataset["status"].load()
    axes = [str(name) for name in (_LISTED if "case" in status.dims else status.dims) if name in dataset.coords]
    ends = [end for end in statuses(status) if end["status"] != Status.OK]
    for end in ends:
        end["by_value"], words = [], []
        for name in (name for name in axes if 1 < np.unique(dataset[name]).size <= 200):
            groups = (status == end["status"]).groupby(name)
            values = (groups.sum(...)[name], groups.sum(...), groups.count(...))
            table = zip(*(array.values.tolist() for array in values), strict=True)
            rows = [{"axis": name, "value": value, "scenarios": count, "of": size} for value, count, size in table]
            end["by_value"] += (hit := [row for row in rows if row["scenarios"]])
            words += [f"{name} {_short(', '.join(_number(row['value']) for row in hit))}"] if hit != rows else []
        end["where"] = f"all {end['count']} at {'; '.join(words)}" if words else "at every value of every axis"
    return ends


def describe(dataset: xr.Dataset, columns: int = 10**6) -> str:
    """Describe a cube in plain text.

    Parameters
    ----------
    dataset : xarray.Dataset
        A cube of this package, or any dataset: what is not there is left out.
    columns : int
        Width that lines are folded to.

    Returns
    -------
    str
        Title, scenarios, row, axes, variables with their range over the scenarios that are ok, statuses with remedies,
        measured errors, records and versions; several lines without a line break at the end.

    Notes
    -----
    Reads every variable once, a part at a time. Control characters of a file are escaped, and what is long is cut.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> cube = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.01, 0.02]).run()
    >>> print(describe(cube).splitlines()[2].strip())
    2 scenarios asked, 2 run
    """
    attributes, cube = dataset.attrs, about(dataset)
    status = dataset["status"] if "status" in dataset.data_vars else None
    lines = [_short(attributes.get("title", "(no title)"))]
    if (cube["scenarios"] or 0) > 0 == cube["statuses"].get(Status.OK.label, 0):
        lines.insert(0, f"No scenario is ok: {', '.join(f'{n} {label}' for label, n in cube['statuses'].items())}")
    lines += [f"  {_short(line)}" for line in str(cube["history"]).splitlines()]
    requested = attributes.get("scenarios_asked")
    if status is not None and status.size != requested:
        changed = "" if requested is None else f" (joined or cut after a run of {requested})"
        lines.append(f"  {status.size} scenarios{changed}")
    elif requested is not None:
        lines.append(f"  {requested} scenarios asked, {attributes.get('scenarios_run')} run")
    if "accuracy_choice" in attributes:
        lines.append(f"  accuracy {attributes['accuracy_choice']}")
    if status is not None and (sentence := errors_sentence(dataset, attributes)):
        lines.append(f"  errors {sentence}")

    axes: dict[bool, list[tuple[str, ...]]] = {False: [], True: []}
    for dim, axis in cube["dims"].items():
        values = dataset[dim].values  # of a dimension without coordinate it counts from 0
        if values.dtype.kind in "iuf" and axis["size"] > 8:
            text = f"{_number(values.min().item())} to {_number(values.max().item())}"
        else:
            text = _short(", ".join(map(_number, values.tolist())))
        name = f"  ({axis['long_name']})" if axis["long_name"] else ""
        axes[dim in INNER_DIMS].append((dim, str(axis["size"]), f"{text} {axis['units']}".rstrip() + name))
    coordinates, variables = list[tuple[str, ...]](), list[tuple[str, ...]]()
    for key, array in dataset.coords.items():
        if AUDIT_DIMS[0] not in array.dims and key not in dataset.dims:
            units, name = _meaning(array).values()
            coordinates.append((str(key), f"({', '.join(map(str, array.dims))})", units or "-", name))
    for key, variable in cube["variables"].items():
        if key != "status":
            inner = " and ".join(dim for dim in variable["dims"] if dim in INNER_DIMS)
            text = f"{variable['long_name']}, per {inner}" if inner else variable["long_name"]
            variables.append((key, variable["units"] or "-", _range(dataset[key], status), text))
    numbers = "median", "max", "max_undecided"
    rest = {str(key): value for key, value in attributes.items() if key not in _SECTION_ATTRIBUTES}
    sections: dict[str, Sequence[Sequence[str]]] = {
        "Row": [(f"{item['name']}:", item["about"]) for item in cube["row"]],
        "Scenario axes": axes[False],
        "Within a scenario": axes[True],
        "Further coordinates": coordinates,
        f"Variables{'' if status is None else ' (range over scenarios that are ok or fell)'}": variables,
        "Scenarios by status": [
            (str(end["count"]), end["label"], f"{end['meaning']}: {end['remedy']}" if end["remedy"] else end["meaning"])
            for end in statuses(dataset.get("status", []), dataset.get("unsettled_output", []))
        ],
        "Where scenarios are not ok": [(end["label"], end["where"]) for end in cube["not_ok"]],
        "Audit: relative errors": [
            (row["output"], *(f"{name} {number_text(row[f'error_{name}'])}".replace("_", " ") for name in numbers))
            for row in cube["audit"]
        ],
        "Records": [
            (_short(record["name"]), f"PGA {_number(record['pga'])} m/s2", _listed(record))
            for record in json.loads(attributes.get("records", "[]"))
        ],
        "Made from": [
            (how, _short(source["file"]), _short(source.get("history", "")), _listed(source))
            for key, how in ORIGINS.items()
            for source in sources(attributes, key)
        ],
        "Versions": [(name, str(version)) for name, version in cube["versions"].items()],
        "Attributes": [(key, _short(value)) for key, value in rest.items() if not key.endswith("_version")],
    }
    folded = [fold(printable(line), columns) for line in lines]
    for heading, rows in sections.items():
        if rows:
            folded += ["", heading, pairs_text(rows, 2, columns)]
    return "\n".join(folded)


def _range(values: xr.DataArray, status: xr.DataArray | None) -> str:
    """Smallest and largest finite value, of the scenarios that are ok or fell where there is a status."""
    if values.dtype.kind not in "iuf":
        return "-"
    low, high = np.inf, -np.inf
    dims = [dim for dim in values.dims if dim not in INNER_DIMS]
    sizes = [values.sizes[dim] for dim in dims]
    for slab in slabs(sizes, SLAB_BYTES // max(1, values.nbytes // max(1, math.prod(sizes)))):  # that fit into memory
        part: Any = dict(zip(dims, slab, strict=True))
        valid = values.isel(part).astype(float)
        if status is not None and set(status.dims) <= set(valid.dims):
            valid = valid.where(status.isel(part, missing_dims="ignore").isin(VALID))
        array = valid.values[np.isfinite(valid.values)]
        low, high = min(low, array.min(initial=np.inf)), max(high, array.max(initial=-np.inf))
    return f"{_number(float(low))} to {_number(float(high))}" if low <= high else "no values"


def _listed(table: Mapping[str, Any]) -> str:
    """Return names and values of a table but its name, file, history and peak; digests are cut."""
    names = [key for key in table if key not in ("name", "file", "history", "pga") and table[key] not in ("", None)]
    texts = {key: ", ".join(table[key]) if isinstance(table[key], list) else _number(table[key]) for key in names}
    listed = (f"{key} {text[:12] if key.endswith('sha256') else text}" for key, text in texts.items())
    return _short(", ".join(listed), 4 * _WIDTH)


def summarize(path: FilePath) -> dict[str, Any]:
    """Return what `run` reports of the cube that it wrote, read without xarray, which takes longer to load."""
    import netCDF4

    with NETCDF_LOCK, netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        attributes, arrays = file.__dict__, file.variables
        texts = {name: _texts(arrays[name]) for name in ("audit_law", "law") if name in arrays}
        return {
            "extended_from": json.loads(attributes.get("extended_from", "null")),
            "accuracy_choice": attributes.get("accuracy_choice", ""),
            "accuracy_numbers": json.loads(attributes.get("accuracy_numbers", "null")),
            "audit": audit_table(arrays),
            "errors_sentence": errors_sentence({**arrays, **texts}, attributes),
            "errors_by_law": errors_by_law({**arrays, **texts}),
            "statuses": statuses(*(arrays[name][...] for name in ("status", "unsettled_output") if name in arrays)),
            "rest_note": attributes.get("rest_note"),
            "at_rest": "pair_gap" in arrays and bool((arrays["pair_gap"][...] == 0.0).any()),
            "summary": _impacts(arrays) if "pair" in arrays else [],
        }


def _impacts(arrays: Mapping[str, netCDF4.Variable]) -> list[dict[str, Any]]:
    """Return what each law does to each pair, one row per law and pair, over the scenarios that are ok or fell."""
    status, laws, pairs = arrays["status"], _texts(arrays["law"]), _texts(arrays["pair"]).tolist()
    titles = {key: item.title for key, item in LAWS.items()}
    if "law_title" in arrays:
        titles |= dict(zip(laws.tolist(), _texts(arrays["law_title"]).tolist(), strict=True))
    across = tuple(axis for axis, dim in enumerate(status.dimensions) if dim not in arrays["law"].dimensions)
    ok, law_of_scenario, largest = np.isin(status[...], VALID), np.expand_dims(laws, across), {}
    # the largest of all floors; missing where no floors meet
    for name in (name for name in ("impact_force_max", "impact_count") if name in arrays):
        array = arrays[name]
        most = SLAB_BYTES // max(1, array.dtype.itemsize * array.size // max(1, status.size))
        parts = [np.fmax.reduce(array[slab], axis=-1).reshape(-1, len(pairs)) for slab in slabs(status.shape, most)]
        largest[name] = np.concatenate(parts).reshape(*status.shape, -1)
    rows = []
    for law in dict.fromkeys(laws.tolist()):
        mask = ok & (law_of_scenario == law)
        for p, pair in enumerate(pairs):
            values = {name: column[mask][:, p] for name, column in largest.items()}
            peak = np.fmax.reduce(values.get("impact_force_max", []), initial=-np.inf)
            counts = np.array(values.get("impact_count", []))
            rows.append(
                {
                    **{"law": law, "title": titles.get(law, ""), "pair": pair, "scenarios": int(mask.sum())},
                    # a pair touches where it is hit, or pressed
                    "touching": int(([*values.values()][-1] > 0).sum()) if values else None,
                    "peak_force": float(peak) if np.isfinite(peak) else None,
                    "impacts_max": int(counts.max()) if (counts != INTEGER_FILL).any() else None,
                    "impacts_median": float(np.median(counts[counts > 0])) if (counts > 0).any() else None,
                }
            )
    return rows


def _texts(variable: netCDF4.Variable) -> np.ndarray:
    import netCDF4

    values = variable[...]
    return values if values.dtype.kind == "U" else netCDF4.chartostring(values, ENCODING)
