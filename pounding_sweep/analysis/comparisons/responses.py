"""Responses: with pounding and without, by law, what contacts do and take, and over suites of records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import BY_STOREY, check_needs, comparison, over_text
from pounding_sweep.analysis.rebuild import intensity_of, stored_scene
from pounding_sweep.analysis.scenarios import (
    ROUND_OFF,
    TOUCH_VARIABLES,
    chosen_variables,
    described,
    exceeds,
    fractiles_over,
    interpolate,
    labelled,
    law_keys,
    long_name,
    need_variables,
    of_law,
    peak_displacement,
    pounding_only,
    ratio,
    scenario_dims,
    touched,
    trusted,
    values,
    without_pounding,
)
from pounding_sweep.base.errors import InputError, check_choice
from pounding_sweep.model.laws import LAWS
from pounding_sweep.request.axes import DIMENSIONS
from pounding_sweep.variables.registry import STATUS, VALID, VARIABLES

# -- with pounding and without ----------------------------------------------------------------------------------------

#: Responses of which a ratio says something: those of a building that are not zero without pounding.
RESPONSES = (
    *("displacement_max", "displacement_min", "drift_max", "storey_shear_max", "acceleration_max"),
    *("drift_ratio_max", "roof_drift_ratio_max"),
    *("energy_input", "energy_damping"),
)
#: What the ratio of largest absolute displacements is called, and what it is made of.
PEAK, _SIGNED = "displacement_peak", ("displacement_max", "displacement_min")


@comparison
def amplification(cube: xr.Dataset, responses: Iterable[str] | None = None) -> xr.Dataset:
    """Divide each response with pounding by the same response without.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the law "none" among its laws: as an axis, or among listed cases.
    responses : iterable of str, optional
        Out of `RESPONSES`; by default all that the cube has.

    Returns
    -------
    xarray.Dataset
        ``<response>_ratio`` (above 1 where pounding amplifies) on the cube's axes, without the law "none";
        ``displacement_peak_ratio`` of the largest absolute displacements; ``base_shear`` and ``base_shear_without``
        (kN); ``touches``, 1 where floors of the row touch, else 0. Missing where either scenario is not ok, and where
        the response without pounding is below 1e-9 of the largest in the row.

    Raises
    ------
    InputError
        The cube has no run without pounding, no other law, or none of the responses.

    Examples
    --------
    >>> import xarray as xr
    >>> drift = (("law", "building"), [[0.010], [0.012]])
    >>> cube = xr.Dataset({"drift_max": drift}, {"law": ["none", "linear"], "building": ["left"]})
    >>> amplification(cube).drift_max_ratio.values.tolist()
    [[1.2]]
    """
    what = "amplification"
    uncoupled, pounding = without_pounding(cube, what), pounding_only(cube)
    if "case" in pounding.dims:
        uncoupled = uncoupled.sel(case=pounding["case"])
    names = chosen_variables(cube, what, responses, RESPONSES, "response")
    runs = {name: (values(pounding, name), values(uncoupled, name)) for name in names}
    if {*_SIGNED} <= {*names}:
        runs[PEAK] = peak_displacement(pounding), peak_displacement(uncoupled)
    ratios = {}
    for name, (response, base) in runs.items():
        comment = "value with pounding over value without; missing where either scenario is not ok"
        share = ratio(response, base, runs[PEAK][1] if name in _SIGNED and PEAK in runs else base)
        ratios[f"{name}_ratio"] = described(share, "1", f"amplification of the {long_name(response, name)}", comment)
    for key, part in {"base_shear": pounding, "base_shear_without": uncoupled}.items():
        if "storey_shear_max" in names and 1 in part.get("storey", []):
            shear = values(part, "storey_shear_max").sel(storey=1, drop=True)
            words = f"largest shear of the lowest storey with{'out' * key.endswith('out')} pounding"
            ratios[key] = described(shear, "kN", words, bare=True)
    if any(name in pounding for name in TOUCH_VARIABLES):
        touch = touched(pounding, what)
        any_floor = touch.max([dim for dim in ("pair", "storey") if dim in touch.dims])
        ratios["touches"] = described(any_floor, "1", "1 where floors of the row touch, 0 where none do")
    return xr.Dataset(ratios)


def needed_for(ratios: Iterable[str]) -> list[str]:
    """Return the responses that these ratios are made of."""
    peaks = {f"{PEAK}_ratio": _SIGNED}
    return list(dict.fromkeys(name for key in ratios for name in peaks.get(key, (key.removesuffix("_ratio"),))))


# -- law by law -------------------------------------------------------------------------------------------------------

#: What is said of the scenarios that touch, where a cube has it.
_IMPACTS = ("impact_count", "impact_force_max", "impulse", "approach_speed_max", "penetration_max", "first_impact_time")
#: What laws are compared by, where a cube has it.
_COMPARED = (
    *("impact_force_max", "impact_count", "penetration_max", "impulse", "approach_speed_max"),
    *(*RESPONSES[:7], "contact_work"),
)
#: Shares of the largest value in the row below which one is no divisor: the work of laws without damping is what their
#: steps err by.
_LEAST = {"contact_work": 1e-4}


@comparison
def laws(cube: xr.Dataset, reference: str | None = None, outputs: Iterable[str] | None = None) -> xr.Dataset:
    """Compare contact laws with a reference law.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with at least two laws with contact on its axis ``law``.
    reference : str, optional
        Key of the reference law; by default the first that takes a restitution, else the first.
    outputs : iterable of str, optional
        Forces, counts, penetrations, impulses, approach speeds, work of contacts, or responses; by default all that the
        cube has.

    Returns
    -------
    xarray.Dataset
        On ``basis`` (nominal; realised, where it can be had) and the cube's axes, without the law "none":
        ``<output>_compared`` in the output's own units, and ``<output>_ratio``, the law's value over the reference's,
        missing where that is below 1e-9 of the largest value in the row, of the contact work below 1e-4. On the basis
        ``realised``, ``restitution`` is that of two free masses, and values are linear between those of the sweep. The
        attribute ``realised_basis`` says how it was done, or why not.

    Raises
    ------
    InputError
        The cube has listed cases, fewer than two laws with contact, or none of the outputs; or the reference is not
        among its laws.

    Examples
    --------
    >>> import xarray as xr
    >>> force = (("law", "pair"), [[1000.0], [800.0]])
    >>> cube = xr.Dataset({"impact_force_max": force}, {"law": ["linear", "hertz"], "pair": ["left-right"]})
    >>> laws(cube).impact_force_max_ratio.sel(basis="nominal", law="hertz").values.tolist()
    [0.8]
    """
    cube = pounding_only(cube)
    laws = law_keys(cube)
    if reference is None:
        reference = next((law for law in laws if law in LAWS and LAWS[law].takes_restitution), laws[0])
    check_choice("reference law", reference, laws)
    names = chosen_variables(cube, "the comparison of laws", outputs, _COMPARED, "output to compare laws by")
    several = cube.sizes.get("restitution", 1) > 1
    how = "linear between the restitutions of the sweep, each at its realised value"
    if not several:
        how = "not possible: the cube has one restitution; run the sweep over several, or restitution_basis='realised'"
    result: dict[str, xr.DataArray] = {}
    for name in names:
        parts = {"nominal": values(cube, name)}
        if several:
            moved = parts["nominal"].transpose("law", ..., "restitution")
            realised = cube["restitution_realised"].transpose("law", "restitution").values
            pairs = zip(moved.values, realised, strict=True)
            rows = np.stack([interpolate(row, at, cube["restitution"].values) for row, at in pairs])
            parts["realised"] = moved.copy(data=rows).transpose(*parts["nominal"].dims)
        bases = labelled("basis", parts, "what equal restitution means")
        part = xr.concat(list(parts.values()), dim=bases, combine_attrs="override")
        base = part.sel(law=reference).reset_coords(drop=True)
        compared = ratio(part, base, abs(part).max("law"), _LEAST.get(name, ROUND_OFF))
        result[f"{name}_compared"] = part
        result[f"{name}_ratio"] = described(compared, "1", f"{long_name(part, name)} over that of {reference}")
    return xr.Dataset(result, attrs={"reference_law": reference, "realised_basis": how})


@comparison
def impacts(
    cube: xr.Dataset, over: Iterable[str] | None = None, quantiles: Sequence[float] = (0.0, 0.16, 0.5, 0.84, 1.0)
) -> xr.Dataset:
    """Count the scenarios that touch, and give the spread of what happens in those.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with pairs; ``law`` may be an axis, a coordinate of listed cases or one value.
    over : iterable of str, optional
        Axes to take together; by default all but ``law``. The others stay.
    quantiles : sequence of float
        In [0, 1]; 0 and 1 are the smallest and the largest value.

    Returns
    -------
    xarray.Dataset
        On ``law`` and what else stays, without the law "none": ``scenarios`` that are ok and ``left_out`` that are not;
        by pair and storey ``touching`` and ``touching_share``, by pair ``pair_touching`` and ``pair_touching_share``;
        on ``quantile``, by pair and storey, ``<output>_fractiles`` of what the cube has of contacts, in their own
        units, over the scenarios that touch there. The attribute ``over`` names what was taken together.

    Raises
    ------
    InputError
        The cube has no pairs, no law with contact, nothing that tells a touch, or not the axes to take together; a
        quantile is outside [0, 1].

    Examples
    --------
    >>> import xarray as xr
    >>> count = (("law", "record", "pair", "storey"), [[[[0.0]], [[2.0]], [[3.0]], [[1.0]]]])
    >>> cube = xr.Dataset({"impact_count": count}, {"law": ["linear"], "pair": ["left-right"], "storey": [1]})
    >>> statistics = impacts(cube, quantiles=[0.5]).squeeze()
    >>> statistics.touching_share.item(), statistics.impact_count_fractiles.item()
    (0.75, 2.0)
    """
    cube = pounding_only(cube)
    dims = scenario_dims(cube)
    together = [dim for dim in dims if dim != "law"] if over is None else list(over)
    for name in together:
        if name not in dims:
            raise InputError(f"this cube has no axis {name!r} to take together; valid: {', '.join(dims) or 'none'}")
    laws = law_keys(cube)
    if laws and cube["law"].dims == ("case",) and "case" in together:
        parts = [_statistics(of_law(cube, [law]), together, quantiles) for law in laws]
        result = xr.concat(parts, dim=labelled("law", laws, "contact law"), combine_attrs="override")
    else:
        result = _statistics(cube, together, quantiles)
    counted = "fractiles are of the scenarios in which these floors touch; the others do not count as 0"
    result = result.assign_coords({name: cube[name].variable for name in BY_STOREY if name in cube})
    return result.assign_attrs(over=over_text({dim: cube.sizes[dim] for dim in together}), counted=counted)


def _statistics(cube: xr.Dataset, over: list[str], quantiles: Sequence[float]) -> xr.Dataset:
    """Return the statistics of scenarios that are taken together."""
    touch = touched(cube, "impact statistics")
    ok = trusted(cube).broadcast_like(touch.isel(pair=0, storey=0, drop=True, missing_dims="ignore"))
    result = {
        "scenarios": described(ok.sum(over), "1", "scenarios that are ok", bare=True),
        "left_out": described((~ok).sum(over), "1", "scenarios left out: their status is not ok", bare=True),
    }
    pair = touch.max("storey") if "storey" in touch.dims else touch
    for prefix, part, where in (("", touch, "the floors"), ("pair_", pair, "the pair")):
        count, text = part.sum(over, min_count=1), f"scenarios in which {where} touch"
        result[f"{prefix}touching"] = described(count, "1", text, bare=True)
        result[f"{prefix}touching_share"] = described(part.mean(over), "1", f"share of {text}", bare=True)
    for name in (name for name in _IMPACTS if name in cube):
        fractiles, _ = fractiles_over(values(cube, name).where(touch == 1.0), over, quantiles)
        result[f"{name}_fractiles"] = fractiles.assign_attrs(comment="over the scenarios in which these floors touch")
    return xr.Dataset(result)


# -- energies ---------------------------------------------------------------------------------------------------------

#: What each building's budget is made of.
TERMS = ("energy_input", "energy_damping", "energy_held")
#: What cubes of rows that yield, and of rows with links, have beside.
BESIDE = ("hysteretic_energy", "energy_links")


@comparison
def energy(cube: xr.Dataset) -> xr.Dataset:
    """Draw up each building's energy budget at the end of the run, and check it against the contacts' work.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with `TERMS` and, where it has pairs, ``contact_work``.

    Returns
    -------
    xarray.Dataset
        On the cube's axes, all in kN m: `TERMS` and ``energy_transfer`` = input - damping - held (-
        ``hysteretic_energy`` - ``energy_links``) by building, given to contacts, ``contact_work`` by pair,
        ``transfer_sum`` over buildings, ``work_sum`` over pairs and ``residual``, their difference;
        ``residual_relative`` is its size over the largest energy. ``transfer_share`` is transfer over input. Missing
        where a scenario is not ok.

    Raises
    ------
    InputError
        The cube lacks an energy, a building or a pair of its row, or has no scenario.

    Examples
    --------
    >>> import xarray as xr
    >>> energies = {"energy_input": 10.0, "energy_damping": 7.0, "energy_held": 1.0}
    >>> cube = xr.Dataset({name: ("building", [value]) for name, value in energies.items()})
    >>> energy(cube.assign(contact_work=("pair", [2.0]))).energy_transfer.values.tolist()
    [2.0]
    """
    what = "the energy budget"
    pairs = ["pair"] if "pair" in cube.coords else []
    check_needs(cube, what, axes=["building", *pairs])
    terms = [*TERMS, *(["contact_work"] if pairs else [])]
    if "sweep" in cube.attrs:
        scene = stored_scene(cube)
        terms += [name for name, has in zip(BESIDE, (any(scene.yields), scene.links), strict=True) if has]
        # a selection that left buildings or pairs out does not balance
        for dim, count in (("building", len(scene.buildings)), ("pair", len(scene.pair_labels))):
            if cube.sizes.get(dim, 0) != count:
                raise InputError(
                    f"{what} is of the whole row, and this cube has {cube.sizes.get(dim, 0)} of {count} along {dim!r}; "
                    "make it of all, and select from the result"
                )
    need_variables(cube, what, terms)
    if law_keys(cube) not in ([], ["none"]):
        cube = pounding_only(cube)
    result = {name: values(cube, name) for name in (*TERMS, *BESIDE) if name in cube}
    largest = [abs(part).max("building") for part in result.values()]
    transfer = result["energy_transfer"] = energy_transfer(result)
    extremes = ("energy_transfer_max", "energy_transfer_min")
    result |= {name: values(cube, name) for name in (*extremes, "contact_work") if name in cube}
    total = transfer.sum("building", skipna=False)
    work = xr.zeros_like(total)
    if "contact_work" in result:
        work = result["contact_work"].sum("pair", min_count=1)
        largest.append(abs(result["contact_work"]).max("pair"))
    residual, energy_input = total - work, result["energy_input"]
    relative = abs(residual) / xr.concat(largest, "term").max("term").where(lambda energy: energy > 0.0)
    share = transfer / energy_input.where(energy_input != 0.0)
    result |= {
        "transfer_sum": described(total, "kN m", "energy given by all buildings"),
        "work_sum": described(work, "kN m", "work taken by all contacts"),
        "residual": described(residual, "kN m", "energy given less work taken"),
        "residual_relative": described(relative, "1", "size of the residual over the largest energy"),
        "transfer_share": described(share, "1", "share of the input given away"),
    }
    return xr.Dataset(result, attrs={"largest_residual_relative": float(relative.max())})


def energy_transfer(energies: Mapping[Any, xr.DataArray]) -> xr.DataArray:
    """Energy (kN m) that each building has given to its contacts: input less what it lost, holds and gave to links."""
    losses = [name for name in (*TERMS[1:], *BESIDE) if name in energies]
    transfer = sum((-energies[name] for name in losses), start=energies[TERMS[0]])
    return described(transfer, "kN m", "energy given to neighbours and contacts")


# -- suites of records ------------------------------------------------------------------------------------------------

#: Lower, median and upper fractile of a suite: a normal variable's mean and one standard deviation to each side.
QUANTILES = (0.16, 0.5, 0.84)
#: Results that are no response.
NO_RESPONSES = {*(name for name, variable in VARIABLES.items() if variable.always), "energy_residual", "time_step"}
NO_RESPONSES.add("collapse_time")


def responses_of(cube: xr.Dataset, what: str, outputs: Iterable[str] | None) -> list[str]:
    """Return the variables that are asked for, by default those that are responses of scenarios."""
    but = {*NO_RESPONSES, "collapsed_storey"}
    responses = [name for name in VARIABLES if name in cube.data_vars and name not in but]
    return responses if outputs is None else need_variables(cube, what, outputs)


@comparison
def fractiles(
    cube: xr.Dataset,
    quantiles: Sequence[float] = (*QUANTILES, 1.0),
    dim: str = "record",
    outputs: Iterable[str] | None = None,
) -> xr.Dataset:
    """Return fractiles of every response over the records of a suite.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axis `dim`.
    quantiles : sequence of float
        In [0, 1]; 1 is the largest value.
    dim : str
        The axis to take together.
    outputs : iterable of str, optional
        Variables of the cube; by default all that are responses.

    Returns
    -------
    xarray.Dataset
        On ``quantile`` and the cube's other axes, ``<output>_fractiles`` in the output's own units, and
        ``<output>_count``, how many values these are of. ``scenarios`` is the number along `dim` that is ok, and
        ``left_out_<status>`` how many are not. ``touching_share`` is the share of scenarios in which floors touch; the
        others count with force 0.

    Raises
    ------
    InputError
        The cube has no such axis, one value of it, or no such output; a quantile is outside [0, 1].

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"drift_max": ("record", [0.01, 0.02, 0.04])})
    >>> fractiles(cube, [0.5]).drift_max_fractiles.values.tolist()
    [0.02]
    """
    check_needs(cube, "taking fractiles", several=[dim])
    result: dict[str, xr.DataArray] = {}
    for name in responses_of(cube, "taking fractiles", outputs):
        part = values(cube, name)
        if dim in part.dims:  # a selection may not vary along it
            result[f"{name}_fractiles"], count = fractiles_over(part, [dim], quantiles)
            result[f"{name}_count"] = described(count, "1", f"values that the fractiles of {name} are of")
    if dim in trusted(cube).dims:
        count = trusted(cube).sum(dim)
        result["scenarios"] = described(count, "1", f"scenarios along {dim} that are ok, or so up to a fall", bare=True)
        for status in (status for status in STATUS if status not in VALID):
            count = (cube["status"] == int(status)).sum(dim)
            if count.any():
                text = f"scenarios along {dim} that are left out: {status.label}"
                result[f"left_out_{status.label}"] = described(count, "1", text, bare=True)
    about = {"over": over_text({dim: cube.sizes[dim]})}
    if any(name in cube for name in TOUCH_VARIABLES):
        touch = touched(cube, "fractiles")
        about["counted"] = "fractiles are of all scenarios that are ok; forces of those without contact count as 0"
        if dim in touch.dims:
            result["touching_share"] = described(touch.mean(dim), "1", "share of scenarios in which the floors touch")
    heights = {name: cube[name].variable for name in BY_STOREY if name in cube}
    return xr.Dataset(result, attrs=about).assign_coords(heights)


#: Intensities at which the fractiles of a suite are given, where none are.
LEVELS = 25


@comparison
def incremental(
    cube: xr.Dataset,
    outputs: Iterable[str] | None = None,
    *,
    intensity: str | xr.DataArray | None = None,
    quantiles: Sequence[float] = QUANTILES,
    levels: Sequence[float] | None = None,
    records: Any = None,
    folders: Any = None,
) -> xr.Dataset:
    """Return responses against intensity, record by record and for the suite.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axis ``scale`` or ``pga``, and ``record`` where there are several.
    outputs : iterable of str, optional
        Variables of the cube; by default all that are responses.
    intensity, records, folders : optional
        As for `pounding_sweep.analysis.rebuild.intensity_of`.
    quantiles : sequence of float
        In [0, 1].
    levels : sequence of float, optional
        Intensities (in its units) at which fractiles are given; by default the cube's own where all curves share them,
        else `LEVELS` of them over the range that half of the curves reach.

    Returns
    -------
    xarray.Dataset
        Each output on the cube's axes in its own units, beside the coordinate ``intensity`` (record, scale); and
        ``<output>_fractiles`` on ``quantile`` and ``level`` instead of record and scale, with ``<output>_count``, how
        many of the ``curves`` have a value there: linear between the two nearest scales. Fractiles are missing where
        fewer than half have one. Where storeys may fall, ``collapse_share`` by building and level.

    Raises
    ------
    InputError
        The cube has fewer than two scales, or not the outputs; a level or quantile is not valid.

    Examples
    --------
    >>> import xarray as xr
    >>> drift = (("record", "scale"), [[0.01, 0.03], [0.02, 0.05]])
    >>> axes = {"record": ["a", "b"], "scale": [1.0, 2.0], "record_pga": ("record", [3.0, 3.0])}
    >>> curves = incremental(xr.Dataset({"drift_max": drift}, axes), quantiles=[0.5], levels=[4.5])
    >>> curves.drift_max_fractiles.round(4).values.tolist()
    [[0.0275]]
    """
    scaled = next(dim for dim in DIMENSIONS["scale"] if dim in cube.dims)
    names = responses_of(cube, "an incremental curve", outputs)
    strength = intensity_of(cube, intensity, records=records, folders=folders)
    if "record" not in cube.dims:
        cube, strength = cube.expand_dims("record"), strength.expand_dims("record")
    strength = strength.transpose("record", scaled)
    units, words = strength.attrs["units"], strength.attrs["long_name"]
    x = np.asarray(strength.values, dtype=float)
    ways = directions(cube[scaled].values)
    ends = np.array([(min(at[way]), max(at[way])) for at in x for way in ways])
    low, high = np.multiply(ends, (1.0 - ROUND_OFF, 1.0 + ROUND_OFF)).T[..., None]
    tried = np.unique(ends)
    shared = tried[((low <= tried) & (tried <= high)).mean(axis=0) >= 0.5]
    span = shared if shared.size else tried
    if levels is not None:
        at = np.asarray(levels)
    elif len(ways) == 1 and np.allclose(x, x[0], rtol=ROUND_OFF, atol=0.0):
        at = np.sort(x[0])
    else:
        at = np.linspace(span[0], span[-1], LEVELS)
    level = labelled("level", at, words, units)
    result: dict[str, xr.DataArray] = {}
    for name in names:
        result[name] = values(cube, name).transpose("record", ..., scaled)
        fractile, count = fractiles_over(on_levels(result[name], strength, level), ["curve"], quantiles)
        result[f"{name}_fractiles"] = fractile.where(count >= 0.5 * len(ends)).assign_attrs(fractile.attrs)
        result[f"{name}_count"] = described(count, "1", f"curves that the fractiles of {name} are of")
    if "collapsed_storey" in cube:
        fallen = exceeds(cube, "the share of falls", "collapsed_storey", None)
        share = on_levels(fallen.where(fallen == 0.0, np.inf).where(fallen.notnull()), strength, level)
        share = (share > 0.0).where(share.notnull()).mean("curve")
        result["collapse_share"] = described(share, "1", "share of the curves in which the building has fallen")
    over = over_text({"record": len(x), "direction": len(ways)})
    about: dict[str, Any] = {"curves": len(ends), "intensity": f"{words} ({units})", "over": over}
    if not (((low <= at) & (at <= high)).mean(axis=0) >= 0.5).any():
        about["no_fractiles"] = (
            f"none of these intensities is within the scales of half of the {len(ends)} curves; scale the records to "
            "equal peaks (pgas), or over a wider range"
        )
    return xr.Dataset(result, attrs=about).assign_coords(intensity=strength)


def on_levels(response: xr.DataArray, strength: xr.DataArray, level: xr.DataArray) -> xr.DataArray:
    """Return ``curve``s of a response by record and direction at intensities, linear between scales; none outside."""
    scaled = strength.dims[-1]
    part = response.transpose("record", ..., scaled)
    rows = [
        interpolate(curve[..., way], at[way], level.values)
        for curve, at in zip(part.values, strength.values, strict=True)
        for way in directions(strength[scaled].values)
    ]
    coords = {dim: part[dim] for dim in part.dims[1:-1] if dim in part.coords} | {"level": level}
    return xr.DataArray(np.stack(rows), coords, ("curve", *part.dims[1:-1], "level"), attrs=part.attrs)


def directions(scales: np.ndarray) -> list[np.ndarray]:
    """Return the positions of the scales of each direction of the ground motion, as recorded and reversed."""
    return [np.flatnonzero(sign * scales >= 0.0) for sign in (1.0, -1.0) if (sign * scales > 0.0).any()]
