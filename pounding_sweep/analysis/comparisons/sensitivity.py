"""Which inputs of a design matter: Sobol indices of every output."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import Row, comparison
from pounding_sweep.analysis.rebuild import stored_sweep
from pounding_sweep.analysis.scenarios import chosen_variables, finished, scenarios_only, values
from pounding_sweep.analysis.sobol_indices import bootstrap_intervals, sobol_indices
from pounding_sweep.base.errors import InputError
from pounding_sweep.outputs.variables import INNER_DIMS, VARIABLES
from pounding_sweep.spec.axes import AXES
from pounding_sweep.spec.design import BLOCK, SAMPLE, Design, design_of

#: Outputs that say how a scenario was run, or are missing where nothing touches: given where they are asked for only.
_ASIDE = {"status", "steps_per_contact", "time_step", "error_estimate", "energy_residual", "first_impact_time"}
#: Times that the points are drawn anew for an interval.
RESAMPLES = 1000
#: Fewer points with a value in every block give no indices.
LEAST = 4


def index_rows(result: xr.Dataset) -> list[Row]:
    """Return a row per input, output, place and group of scenarios; inputs that matter most come first."""
    rows = []
    inputs = result["input"].values.tolist()
    for name in [str(name).removesuffix("_total") for name in result.data_vars if str(name).endswith("_total")]:
        dims = [dim for dim in ("group", *INNER_DIMS) if dim in result[f"{name}_total"].dims]
        first, total = (result[f"{name}_{what}"].transpose(*dims, "input").values for what in ("first", "total"))
        ends = [
            result[f"{name}_{what}_interval"].transpose(*dims, "input", "bound").values for what in ("first", "total")
        ]
        samples = result[f"{name}_samples"].transpose(*dims).values
        for place in np.ndindex(first.shape[:-1]):
            at: Row = {dim: None for dim in INNER_DIMS if dim in result.dims}
            at |= {dim: result[dim].values[i].item() for dim, i in zip(dims, place, strict=True) if dim != "group"}
            group = {key: result[key].values[place[0]].item() for key in ("law", "record", "beside") if key in result}
            row = {"variable": name, **group, **at, "samples": int(samples[place])}
            for i in np.argsort(-total[place], kind="stable") if np.isfinite(total[place]).all() else []:
                one: Row = {**row, "input": inputs[i]}
                for what, found, bounds in (("first", first, ends[0]), ("total", total, ends[1])):
                    numbers = (found[place][i], *bounds[place][i])
                    names = (what, f"{what}_lower", f"{what}_upper")
                    one |= {key: float(n) if np.isfinite(n) else None for key, n in zip(names, numbers, strict=True)}
                rows.append(one)
    return rows


@comparison(
    "which inputs of a design matter: first and total Sobol indices of each output",
    needs='a design of kind "saltelli"',
    columns=("law", "record"),
    figure="sensitivity",
    summary={"resamples": 100},
    rows=index_rows,
)
def sensitivity(
    cube: xr.Dataset, variables: Iterable[str] | None = None, *, confidence: float = 0.95, resamples: int = RESAMPLES
) -> xr.Dataset:
    """Estimate Sobol indices of the outputs of a Saltelli design.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube of a design of kind "saltelli".
    variables : iterable of str, optional
        Outputs; by default all but diagnostics and the time of the first touch.
    confidence : float
        Of the intervals, in (0, 1).
    resamples : int
        Times that points are drawn anew for them.

    Returns
    -------
    xarray.Dataset
        On ``group`` (scenarios of one law, record and value of other axes: coordinates ``law``, ``record``, which is
        "drawn" where it is an input, and ``beside``), ``input`` and the output's own dimensions:
        ``<output>_first``, ``<output>_total``, and with ``bound`` their intervals ``<output>_first_interval`` and
        ``<output>_total_interval``. Without ``input``: ``<output>_samples``, points with a value in all blocks.
        Indices are missing where an output does not vary.

    Raises
    ------
    InputError
        The cube is not of such a design, or lacks an output.

    Notes
    -----
    See `pounding_sweep.analysis.sobol_indices.sobol_indices` for the estimators. A point of which one of the
    ``inputs + 2`` scenarios has no value is left out as a whole.
    """
    if not 0.0 < confidence < 1.0 or resamples < 1:
        msg = f"confidence is {confidence!r} with {resamples!r} resamples; give it between 0 and 1, 0.95 for instance"
        raise InputError(msg)
    cube = scenarios_only(cube)
    design, groups = _groups(cube)
    valid = [str(name) for name in cube.data_vars if name in VARIABLES]
    usual = [name for name in valid if name not in _ASIDE]
    names = chosen_variables(cube, "a sensitivity", variables, usual if variables is None else valid, "output")
    inputs = [each.name for each in design.inputs]
    found: dict[str, Any] = {}
    for name in names:
        given = values(cube, name).transpose("case", ...)
        inner = tuple(str(dim) for dim in given.dims[1:])
        table = given.values.reshape(len(given), -1)
        parts = [_indices(table[rows], len(inputs), confidence, resamples) for rows in groups.values()]
        sizes = given.shape[1:]
        about = str(given.attrs.get("long_name", name))
        for i, what in enumerate(("first", "total")):
            text = f"{what} Sobol index: {about}"
            stacked = np.stack([part[0][i] for part in parts]).reshape(len(groups), len(inputs), *sizes)
            found[f"{name}_{what}"] = (("group", "input", *inner), stacked, {"units": "1", "long_name": text})
            ends = np.stack([part[1][i] for part in parts]).reshape(len(groups), 2, len(inputs), *sizes)
            dims = ("group", "bound", "input", *inner)
            found[f"{name}_{what}_interval"] = (dims, ends, {"units": "1", "long_name": f"confidence interval, {text}"})
        counts = np.stack([part[2] for part in parts]).reshape(len(groups), *sizes)
        text = "points with a value in all blocks"
        found[f"{name}_samples"] = (("group", *inner), counts, {"units": "1", "long_name": text})
    coords: dict[str, Any] = {
        "group": ("group", np.arange(1, len(groups) + 1), {"units": "1", "long_name": "scenarios of one design"}),
        "input": ("input", inputs, {"long_name": "input of the design"}),
        "bound": ("bound", ["lower", "upper"], {"long_name": "end of the confidence interval"}),
    }
    coords |= {dim: cube[dim].variable for dim in INNER_DIMS if dim in cube.coords}
    for key, text in (("law", "contact law"), ("record", "ground-motion record"), ("beside", "values of other axes")):
        labels = [dict(group)[key] for group in groups]
        if any(labels):
            coords[key] = ("group", labels, {"long_name": text})
    result = xr.Dataset(found, coords=coords)
    return finished(result, cube, "sensitivity", confidence=confidence, resamples=resamples)


def _groups(cube: xr.Dataset) -> tuple[Design, dict[tuple[tuple[str, str], ...], np.ndarray]]:
    """Return the design of a cube, and for each group its rows, shape (blocks, samples)."""
    sweep = stored_sweep(cube)
    told = sweep.get("design")
    placed = BLOCK in cube.coords and cube[BLOCK].dims == ("case",) and cube["case"].dtype.kind in "iu"
    if told is None or told["kind"] != "saltelli" or not placed:
        what = "of none" if told is None else f'a part of one of kind "{told["kind"]}"'
        msg = (
            f'Sobol indices need a design of kind "saltelli", and this cube is {what}; run a sweep with '
            '[design] kind = "saltelli", samples = 256 and its inputs'
        )
        raise InputError(msg)
    design, cases = design_of(told), sweep["cases"]
    fixed = [_fixed(case, design) for case in cases]
    places: dict[tuple[tuple[str, str], ...], dict[tuple[str, int], int]] = {}
    numbers = zip(cube["case"].values.tolist(), cube[BLOCK].values.tolist(), cube[SAMPLE].values.tolist(), strict=True)
    for row, (number, block, sample) in enumerate(numbers):
        places.setdefault(fixed[number - 1], {})[block, sample] = row
    whole = [(block, sample) for block in design.blocks for sample in range(1, design.samples + 1)]
    for group, rows in places.items():
        if len(rows) < len(whole):
            msg = (
                f"{len(whole) - len(rows)} of the {len(whole)} points of the design with {dict(group)['law']} are not "
                "in this part of the cube; give the whole cube"
            )
            raise InputError(msg)
    several = [
        key
        for key in dict.fromkeys(key for group in places for key, _ in group)
        if key not in ("law", "record") and len({dict(group).get(key) for group in places} - {None}) > 1
    ]
    labelled: dict[tuple[tuple[str, str], ...], np.ndarray] = {}
    for group, rows in places.items():
        own = dict(group)
        beside = " ".join(f"{key}={own[key]}" for key in several if key in own)
        label = (("law", own["law"]), ("record", own.get("record", "drawn")), ("beside", beside))
        labelled[label] = np.array([rows[key] for key in whole]).reshape(len(design.blocks), -1)
    return design, labelled


def _fixed(case: dict[str, Any], design: Design) -> tuple[tuple[str, str], ...]:
    """Return what of a case the design did not draw, as names and texts."""
    drawn = {(each.argument, each.building) for each in design.inputs}
    found = {key: case[key] for key in ("law", "record") if (f"{key}s", None) not in drawn}
    for argument, axis in AXES.items():
        if axis.by_building:
            factors = dict(case.get(argument, ()))
            found |= {f"{axis.dimension}.{b}": value for b, value in factors.items() if (argument, b) not in drawn}
        elif (argument, None) not in drawn and case.get(axis.dimension) is not None:
            found[axis.dimension] = case[axis.dimension]
    return tuple((key, str(value)) for key, value in found.items())


def _indices(table: np.ndarray, d: int, confidence: float, resamples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return indices, intervals and counts of points of outputs, from values of shape (blocks, samples, outputs)."""
    n_outputs = table.shape[2]
    found, ends = np.full((2, d, n_outputs), np.nan), np.full((2, 2, d, n_outputs), np.nan)
    there = np.isfinite(table).all(axis=0)
    alike: dict[bytes, list[int]] = {}
    for i in range(n_outputs):
        alike.setdefault(there[:, i].tobytes(), []).append(i)
    for columns in alike.values():
        rows = there[:, columns[0]]
        if rows.sum() >= LEAST:
            a, b, *mixed = table[:, rows][:, :, columns].transpose(0, 2, 1)
            given = a, b, np.stack(mixed)
            found[:, :, columns] = sobol_indices(*given)
            ends[:, :, :, columns] = bootstrap_intervals(*given, confidence, resamples)
    return found, ends, there.sum(axis=0)
