"""Which inputs of a design matter: Sobol indices of every output."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import Row, comparison, plain_rows
from pounding_sweep.analysis.rebuild import stored_sweep
from pounding_sweep.analysis.scenarios import ROUND_OFF, chosen_variables, labelled, long_name, numbers_in, values
from pounding_sweep.base.errors import InputError
from pounding_sweep.outputs.variables import INNER_DIMS, VARIABLES
from pounding_sweep.spec.axes import AXES
from pounding_sweep.spec.design import Design, design_of

#: Outputs that say how a scenario was run, or are missing where nothing touches: given where they are asked for only.
_ASIDE = {"status", "steps_per_contact", "time_step", "error_estimate", "energy_residual", "first_impact_time"}
#: Times that the points are drawn anew for an interval.
RESAMPLES = 1000
#: Fewer points with a value in every block give no indices.
LEAST = 4
#: Numbers of the bootstrap that are held at a time.
BLOCK_NUMBERS = 1 << 22
#: The two kinds of indices, and the ends of an interval.
_KINDS, _BOUNDS = ("first", "total"), ("lower", "upper")


def index_rows(result: xr.Dataset) -> list[Row]:
    """Return a row per input, output, place and group of scenarios; inputs that matter most come first."""
    rows, count = [], result.sizes["input"]
    dims = [dim for dim in INNER_DIMS if dim in result.dims]
    numbers = [f"{kind}{end}" for kind in _KINDS for end in ("", *(f"_{bound}" for bound in _BOUNDS))]
    keys = (*(key for key in ("law", "record", "beside") if key in result), *dims, "samples", "input", *numbers)
    for name in (str(name).removesuffix("_total") for name in result.data_vars if str(name).endswith("_total")):
        parts = {f"{name}_{part}": part for part in ("samples", *_KINDS, *(f"{kind}_interval" for kind in _KINDS))}
        columns = result[[*parts]].rename(parts)
        table = plain_rows(columns.transpose("group", *dims, "input", ..., missing_dims="ignore"))
        for part in (table[first : first + count] for first in range(0, len(table), count)):
            if all(row["total"] is not None for row in part):
                ordered = sorted(part, key=lambda row: -row["total"])
                rows += [{"variable": name, **{key: row.get(key) for key in keys}} for row in ordered]
    return rows


@comparison("sensitivity")
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
    See `pounding_sweep.analysis.comparisons.sensitivity.sobol_indices` for the estimators. A point of which one of the
    ``inputs + 2`` scenarios has no value is left out as a whole.
    """
    numbers_in("(0, 1)", confidence, "confidence")
    numbers_in("[1, inf)", resamples, "resamples")
    design, labels, rows = _groups(cube)
    valid = [str(name) for name in cube.data_vars if name in VARIABLES]
    default = [name for name in valid if name not in _ASIDE]
    names = chosen_variables(cube, "a sensitivity", variables, default if variables is None else valid, "output")
    result: dict[str, Any] = {}
    for name in names:
        response = values(cube, name).transpose("case", ...)
        inner, table = response.dims[1:], response.values.reshape(len(response), -1)
        parts = [_indices(table[places], len(design.inputs), confidence, resamples) for places in rows]
        indices, ends, counts = (
            np.stack(part).reshape(len(rows), *part[0].shape[:-1], *response.shape[1:])
            for part in zip(*parts, strict=True)
        )
        for i, kind in enumerate(_KINDS):
            text = f"{kind} Sobol index: {long_name(response, name)}"
            about = {"units": "1", "long_name": text}, {"units": "1", "long_name": f"confidence interval, {text}"}
            result[f"{name}_{kind}"] = (("group", "input", *inner), indices[:, i], about[0])
            result[f"{name}_{kind}_interval"] = (("group", "bound", "input", *inner), ends[:, :, i], about[1])
        text = "points with a value in all blocks"
        result[f"{name}_samples"] = (("group", *inner), counts, {"units": "1", "long_name": text})
    coords: dict[str, Any] = {
        "group": labelled("group", np.arange(1, len(rows) + 1), "scenarios of one design", "1"),
        "input": labelled("input", (item.name for item in design.inputs), "input of the design"),
        "bound": labelled("bound", _BOUNDS, "end of the confidence interval"),
    }
    coords |= {dim: cube[dim].variable for dim in INNER_DIMS if dim in cube.coords}
    about_groups = {"law": "contact law", "record": "ground-motion record", "beside": "values of other axes"}
    for (key, text), texts in zip(about_groups.items(), zip(*labels, strict=True), strict=True):
        if any(texts):
            coords[key] = ("group", list(texts), {"long_name": text})
    return xr.Dataset(result, coords, {"confidence": confidence, "resamples": resamples})


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
    fixed = [_fixed(sweep["cases"][group * len(design)], design) for group in groups]
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


def _fixed(case: dict[str, Any], design: Design) -> dict[str, str]:
    """Return what of a case the design did not draw, as names and texts."""
    drawn = {(item.argument, item.building) for item in design.inputs}
    result: dict[str, Any] = {key: case[key] for key in ("law", "record") if (f"{key}s", None) not in drawn}
    for argument, axis in AXES.items():
        if axis.by_building:
            factors = dict(case.get(argument, ()))
            result |= {f"{axis.dimension}.{b}": value for b, value in factors.items() if (argument, b) not in drawn}
        elif (argument, None) not in drawn and case.get(axis.dimension) is not None:
            result[axis.dimension] = case[axis.dimension]
    return {key: str(value) for key, value in result.items()}


def _indices(table: np.ndarray, d: int, confidence: float, resamples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return indices, intervals and counts of points of outputs, from values of shape (blocks, samples, outputs)."""
    n_outputs = table.shape[2]
    indices, ends = np.full((2, d, n_outputs), np.nan), np.full((2, 2, d, n_outputs), np.nan)
    valid = np.isfinite(table).all(axis=0)
    points, which = np.unique(valid, axis=1, return_inverse=True)  # outputs that are valid at the same points
    for i, rows in enumerate(points.T):
        if rows.sum() >= LEAST:
            columns = np.flatnonzero(which.ravel() == i)
            blocks = table[:, rows][:, :, columns].swapaxes(1, 2)
            indices[:, :, columns] = sobol_indices(blocks)
            ends[:, :, :, columns] = bootstrap_intervals(blocks, confidence, resamples)
    return indices, ends, valid.sum(axis=0)


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
    random, held = np.random.default_rng(seed), max(1, BLOCK_NUMBERS // n)
    parts = [
        sobol_indices(blocks, (random.multinomial(n, np.full(n, 1.0 / n), size=min(held, resamples - first)) / n).T)
        for first in range(0, resamples, held)
    ]
    return np.quantile(np.concatenate(parts, axis=-1), [tail, 1.0 - tail], axis=-1)
