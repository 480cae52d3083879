"""What matters most: Sobol indices of the inputs of a design, shares of the variance of the axes of a grid."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis import scenarios
from pounding_sweep.analysis.comparisons import Row, comparison, plain_rows
from pounding_sweep.analysis.comparisons.responses import NO_RESPONSES
from pounding_sweep.analysis.rebuild import stored_sweep
from pounding_sweep.analysis.scenarios import ROUND_OFF, described, labelled, long_name, scenario_dims, values
from pounding_sweep.base.errors import InputError
from pounding_sweep.request.design import Design, design_of
from pounding_sweep.variables.registry import INNER_DIMS, VARIABLES

#: Fewer points with a value in every block give no indices.
LEAST = 4
#: The two kinds of indices, and the ends of an interval.
_KINDS, _BOUNDS = ("first", "total"), ("lower", "upper")
#: What a result has of each output.
_PARTS = ("samples", "first", "first_interval", "total", "total_interval", "mean_interval", "at_interval")


def index_rows(result: xr.Dataset) -> list[Row]:
    """Return a row per input, output, place and group of scenarios; inputs that matter most come first."""
    rows, count = list[Row](), result.sizes["input"]
    dims = [dim for dim in INNER_DIMS if dim in result.dims]
    labels = [key for key in ("law", "record", "beside") if key in result]
    for name in (str(name).removesuffix("_total") for name in result.data_vars if str(name).endswith("_total")):
        parts = {f"{name}_{part}": part for part in _PARTS if f"{name}_{part}" in result}
        columns = result[[*parts]].rename(parts)
        table = plain_rows(columns.transpose("group", *dims, "input", ..., missing_dims="ignore"))
        first = {"variable": name, **dict.fromkeys([*labels, *dims, "samples", "input"])}
        for start in range(0, len(table), count):
            part = [first | row for row in table[start : start + count]]
            if all(row["total"] is not None for row in part):
                rows += sorted(part, key=lambda row: -row["total"])
    for row in rows:
        del row["group"]
    return rows


@comparison
def sensitivity(
    cube: xr.Dataset, variables: Iterable[str] | None = None, *, confidence: float = 0.95, resamples: int = 1000
) -> xr.Dataset:
    """Compute which inputs of a Saltelli design, or which axes of a grid, the outputs depend on most.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube of a design of kind "saltelli", or of axes.
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

        Of axes, which are then the inputs, ``<output>_first`` and ``<output>_total`` are the shares of the variance
        over the ok scenarios with contact: that of the means at each value of the axis, and what varies along it while
        all others are held. ``<output>_mean_interval`` has the smallest and largest of these means,
        ``<output>_at_interval`` their values of the axis.

    Raises
    ------
    InputError
        The cube lists cases without such a design, has no axis of several values, or lacks an output.

    Notes
    -----
    See `pounding_sweep.analysis.comparisons.sensitivity.sobol_indices` for the estimators. A point of which one of the
    ``inputs + 2`` scenarios has no value is left out as a whole.
    """
    scenarios.numbers_in("[1, inf)", resamples, "resamples")
    valid = [str(name) for name in cube.data_vars if name in VARIABLES]
    if variables is None:  # the time of the first touch is missing where nothing touches
        aside = {*NO_RESPONSES, "error_estimate", "first_impact_time"}
        variables = [name for name in valid if name not in aside]
    names = scenarios.chosen_variables(cube, "a sensitivity", variables, valid, "output")
    if "case" not in cube.dims:
        return _shares(
            scenarios.pounding_only(cube) if {*scenarios.law_keys(cube)} - {scenarios.NO_POUNDING} else cube, names
        )
    design, labels, rows = _groups(cube)
    points, result = xr.DataArray(rows, dims=("group", "block", "sample")), xr.Dataset()
    for name in names:
        parts = xr.apply_ufunc(
            _indices,
            values(cube, name, np.nan).reset_coords(drop=True).drop_vars("case").isel(case=points),
            kwargs={"confidence": confidence, "resamples": resamples},
            input_core_dims=[["block", "sample"]],
            output_core_dims=[["kind", "input"], ["kind", "input", "bound"], []],
            vectorize=True,
        )
        indices, ends, counts = (
            part.transpose("group", "bound", "input", ..., missing_dims="ignore") for part in parts
        )
        for i, kind in enumerate(_KINDS):
            text = f"{kind} Sobol index: {long_name(cube[name], name)}"
            result[f"{name}_{kind}"] = described(indices.isel(kind=i), "1", text)
            result[f"{name}_{kind}_interval"] = described(ends.isel(kind=i), "1", f"confidence interval, {text}")
        result[f"{name}_samples"] = described(counts, "1", "points with a value in all blocks")
    coords: dict[str, Any] = {
        "group": labelled("group", np.arange(1, len(rows) + 1), "scenarios of one design", "1"),
        "input": labelled("input", (item.name for item in design.inputs), "input of the design"),
        "bound": labelled("bound", _BOUNDS, "end of the confidence interval"),
    }
    about_groups = {"law": "contact law", "record": "ground-motion record", "beside": "values of other axes"}
    for (key, text), texts in zip(about_groups.items(), zip(*labels, strict=True), strict=True):
        if any(texts):
            coords[key] = ("group", list(texts), {"long_name": text})
    return result.assign_coords(coords).assign_attrs(confidence=confidence, resamples=resamples)


def _shares(cube: xr.Dataset, names: Iterable[str]) -> xr.Dataset:
    """Return what share of the variance of outputs each axis of a grid has, and their means at its values."""
    axes = [dim for dim in scenario_dims(cube) if cube.sizes[dim] > 1]
    if not axes:
        raise InputError('the sensitivity needs an axis of several values, or a design of kind "saltelli"')
    counts, *parts = (xr.Dataset() for _ in ("", *axes))
    for name in names:
        text, response = long_name(cube[name], name), values(cube, name, np.nan).reset_coords(drop=True)
        response = response.squeeze([dim for dim in scenario_dims(cube) if dim not in axes], drop=True)
        count, spread = response.count(axes), response.var(axes)
        whole = (count * spread).where(spread > (ROUND_OFF * abs(response).max(axes)) ** 2)
        counts[f"{name}_samples"] = described(count, "1", "scenarios with a value")
        for axis, part in zip(axes, parts, strict=True):
            others = [dim for dim in axes if dim != axis]
            means = response.mean(others)
            alone = ((means - response.mean(axes)) ** 2 * response.count(others)).sum(axis) / whole
            along = (response.var(axis) * response.count(axis)).sum(others) / whole
            part[f"{name}_first"] = described(alone, "1", f"share of the variance by one axis alone: {text}")
            part[f"{name}_total"] = described(along, "1", f"share of the variance with interactions: {text}")
            ends = xr.concat([means.min(axis), means.max(axis)], "bound")
            part[f"{name}_mean_interval"] = ends.assign_attrs(response.attrs)
            part[f"{name}_at_interval"] = xr.concat([means.idxmin(axis), means.idxmax(axis)], "bound").astype(object)
    grid = " x ".join(f"{axis.replace('_', ' ')} ({cube.sizes[axis]})" for axis in axes)
    over = f"ok scenarios of the grid {grid}, all equally likely: not Sobol' indices of a distribution"
    labels = [f"{axis} ({cube[axis].attrs.get('units', '1')})".removesuffix(" (1)") for axis in axes]
    result = xr.concat(parts, labelled("input", labels, "axis of the sweep")).assign(counts).expand_dims("group")
    return result.assign_coords(bound=labelled("bound", _BOUNDS, "end")).assign_attrs(over=over)


def _groups(cube: xr.Dataset) -> tuple[Design, list[tuple[str, str, str]], np.ndarray]:
    """Return the design of a cube, each law, record and values of other axes, and rows: (group, blocks, samples)."""
    sweep = stored_sweep(cube)
    stored = sweep.get("design")
    if stored is None or stored["kind"] != "saltelli":
        what = "of none" if stored is None else f'a part of one of kind "{stored["kind"]}"'
        raise InputError(
            f'Sobol indices need a design of kind "saltelli", and this cube is {what}; run a sweep with '
            '[design] kind = "saltelli", samples = 256 and its inputs'
        )
    design = design_of(stored)
    order = np.argsort(cube["case"].values)  # numbers from 1, points of the design innermost
    groups, counts = np.unique((cube["case"].values[order] - 1) // len(design), return_counts=True)
    drawn = {f"{item.argument}.{item.building}" if item.building else item.name for item in design.inputs}
    fixed = []  # what of a case the design did not draw
    for group in groups:
        case = sweep["cases"][group * len(design)].items()
        named = ((key, *pair) for key, value in case for pair in (value if isinstance(value, list) else [("", value)]))
        texts = {f"{key}.{name}".rstrip("."): str(value) for key, name, value in named}
        fixed.append({key: text for key, text in texts.items() if key not in drawn})
    for texts, count in zip(fixed, counts, strict=True):
        if count < len(design):
            raise InputError(
                f"{len(design) - count} of the {len(design)} points of the design with {texts['law']} are not "
                "in this part of the cube; give the whole cube"
            )
    rows = order.reshape(len(groups), len(design.blocks), -1)
    labels = []
    for texts in fixed:
        varied = [key for key in texts if len({other.get(key) for other in fixed} - {None}) > 1]
        others = " ".join(f"{key}={texts[key]}" for key in varied if key not in ("law", "record"))
        labels.append((texts["law"], texts.get("record", "drawn"), others))
    return design, labels, rows


def _indices(table: np.ndarray, confidence: float, resamples: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return indices, intervals and count of points of an output, from values of shape (blocks, samples)."""
    valid = np.isfinite(table).all(axis=0)
    if valid.sum() < LEAST:
        return np.full((2, len(table) - 2), np.nan), np.full((2, len(table) - 2, 2), np.nan), valid.sum()
    ends = bootstrap_intervals(table[:, valid], confidence, resamples)
    return sobol_indices(table[:, valid]), np.moveaxis(ends, 0, -1), valid.sum()


def sobol_indices(blocks: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Estimate first and total Sobol indices, shape (2, inputs, ...); NaN where values differ by rounding alone."""
    # `blocks`, shape (inputs + 2, ..., n), are values at A, B and A with one input of B each; `weights` (n, resamples)
    # of the points add a last dimension. First indices by Saltelli et al. (2010), Computer Physics Communications
    # 181(2), table 2 (b): mean of f(B) (f(AB_i) - f(A)) over the variance of A and B; total ones by Jansen (1999),
    # ibid. 117: half the mean of (f(A) - f(AB_i))^2 over it. The mean of all is taken off first, which lessens the
    # error
    size = ROUND_OFF * np.abs(blocks[0]).max(axis=-1)
    a, b, *mixed = blocks - blocks[:2].mean(axis=(0, -1))[..., None]
    columns = np.stack(
        [*(b * (m - a) for m in mixed), *(0.5 * (a - m) ** 2 for m in mixed), 0.5 * (a + b), 0.5 * (a**2 + b**2)]
    )
    means = columns.mean(axis=-1) if weights is None else columns @ weights
    variance = means[-1] - means[-2] ** 2
    varies = variance > (size if weights is None else size[..., None]) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(varies, means[:-2].reshape(2, len(mixed), *means.shape[1:]) / variance, np.nan)


def bootstrap_intervals(blocks: np.ndarray, confidence: float, resamples: int, seed: int = 0) -> np.ndarray:
    """Return percentile intervals of the indices, shape (lower and upper, first and total, inputs, ...)."""
    # points are drawn anew, each with its values in all blocks (Efron & Tibshirani 1993, "An Introduction to the
    # Bootstrap", chapter 13)
    n, tail = blocks.shape[-1], (1.0 - confidence) / 2.0
    random, held = np.random.default_rng(seed), max(1, (1 << 22) // n)
    parts = [
        sobol_indices(blocks, (random.multinomial(n, np.full(n, 1.0 / n), size=min(held, resamples - first)) / n).T)
        for first in range(0, resamples, held)
    ]
    return np.quantile(np.concatenate(parts, axis=-1), [tail, 1.0 - tail], axis=-1)
