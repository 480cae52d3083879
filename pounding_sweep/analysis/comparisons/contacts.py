"""How often, how hard and how soon floors touch, and whether what buildings gave equals what contacts took."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import xarray as xr

from pounding_sweep.analysis.comparisons import check_needs, comparison, over_text
from pounding_sweep.analysis.rebuild import stored_sweep
from pounding_sweep.analysis.scenarios import (
    check_quantiles,
    described,
    fractiles_over,
    labelled,
    law_keys,
    need_variables,
    of_law,
    pounding_only,
    present,
    scenario_dims,
    touched,
    trusted,
    values,
)
from pounding_sweep.base.errors import InputError
from pounding_sweep.spec.spec import scene_of

#: What is said of the scenarios that touch, where a cube has it.
OUTPUTS = ("impact_count", "impact_force_max", "impulse", "approach_speed_max", "penetration_max", "first_impact_time")
#: Smallest, usual and largest values.
QUANTILES = (0.0, 0.16, 0.5, 0.84, 1.0)


@comparison("impacts")
def impact_statistics(
    cube: xr.Dataset, over: Iterable[str] | None = None, quantiles: Sequence[float] = QUANTILES
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
        by pair and storey ``touching`` and ``touching_share``, by pair ``pair_touching`` and ``pair_touching_share`` (a
        touch at any storey); and on ``quantile``, by pair and storey, ``<output>_fractiles`` of the outputs of
        `OUTPUTS` that the cube has, in their own units, over the scenarios that touch there. The attribute ``over``
        names what was taken together.

    Raises
    ------
    InputError
        The cube has no pairs, no law with contact, nothing that tells a touch, or not the
        axes to take together; a quantile is outside [0, 1].

    Examples
    --------
    >>> import xarray as xr
    >>> count = (("law", "record", "pair", "storey"), [[[[0.0]], [[2.0]], [[3.0]], [[1.0]]]])
    >>> cube = xr.Dataset({"impact_count": count}, {"law": ["linear"], "pair": ["left-right"], "storey": [1]})
    >>> found = impact_statistics(cube, quantiles=[0.5]).squeeze()
    >>> found.touching_share.item(), found.impact_count_fractiles.item()
    (0.75, 2.0)
    """
    check_quantiles(quantiles)
    cube = pounding_only(cube)
    dims = scenario_dims(cube)
    over = [over] if isinstance(over, str) else over
    together = [dim for dim in dims if dim != "law"] if over is None else list(over)
    for name in together:
        if name not in dims:
            raise InputError(f"this cube has no axis {name!r} to take together; valid: {', '.join(dims) or 'none'}")
    if "law" in cube.coords and cube["law"].dims == ("case",) and "case" in together:
        laws = law_keys(cube)
        parts = [_statistics(of_law(cube, [law]), together, quantiles) for law in laws]
        result = xr.concat(parts, dim=labelled("law", laws, "contact law"), combine_attrs="override")
    else:
        result = _statistics(cube, together, quantiles)
    return result.assign_attrs(over=over_text({dim: cube.sizes[dim] for dim in together}))


def _statistics(cube: xr.Dataset, over: list[str], quantiles: Sequence[float]) -> xr.Dataset:
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
    for name in present(cube, OUTPUTS):
        fractiles, _ = fractiles_over(values(cube, name).where(touch == 1.0), over, quantiles)
        result[f"{name}_fractiles"] = fractiles.assign_attrs(comment="over the scenarios in which these floors touch")
    return xr.Dataset(result)


#: What each building's budget is made of.
TERMS = ("energy_input", "energy_damping", "energy_kinetic", "energy_strain")
#: What cubes of rows that yield, and of rows with links, have beside.
BESIDE = ("hysteretic_energy", "energy_links")
#: What goes along where a cube has it.
_EXTREMES = ("energy_transfer_max", "energy_transfer_min")


@comparison("energy")
def energy_budget(cube: xr.Dataset) -> xr.Dataset:
    """Draw up each building's energy budget at the end of the record, and check it against the contacts' work.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with `TERMS` and, where it has pairs, ``contact_work``.

    Returns
    -------
    xarray.Dataset
        On the cube's axes, all in kN m: `TERMS` and ``energy_transfer`` = input - damping - kinetic - strain (-
        ``hysteretic_energy`` where storeys yield, - ``energy_links`` where neighbours are linked) by building (given to
        contacts, negative where taken), ``contact_work`` by pair, ``transfer_sum`` over buildings, ``work_sum`` over
        pairs and ``residual``, their difference; ``residual_relative`` is its size over the largest energy of the
        balance. ``transfer_share`` is transfer over input. The attribute ``largest_residual_relative`` is the largest
        of all scenarios. Missing where a scenario is not ok.

    Raises
    ------
    InputError
        The cube lacks an energy, a building or a pair of its row, or has no scenario.

    Examples
    --------
    >>> import xarray as xr
    >>> energies = {"energy_input": 10.0, "energy_damping": 7.0, "energy_kinetic": 0.5, "energy_strain": 0.5}
    >>> cube = xr.Dataset({name: ("building", [value]) for name, value in energies.items()})
    >>> energy_budget(cube.assign(contact_work=("pair", [2.0]))).energy_transfer.values.tolist()
    [2.0]
    """
    what = "the energy budget"
    pairs = ["pair"] if "pair" in cube.coords else []
    check_needs(cube, what, axes=["building", *pairs])
    terms = [*TERMS, *(["contact_work"] if pairs else [])]
    if "sweep" in cube.attrs:
        scene = scene_of(stored_sweep(cube)["scene"])
        has_them = any(scene.yields), bool(scene.links)
        need_variables(cube, what, [*terms, *(name for name, has in zip(BESIDE, has_them, strict=True) if has)])
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
    result = {name: values(cube, name) for name in present(cube, (*TERMS, *BESIDE))}
    largest = [abs(part).max("building") for part in result.values()]
    transfer = result["energy_transfer"] = energy_transfer(result)
    result |= {name: values(cube, name) for name in present(cube, (*_EXTREMES, "contact_work"))}
    total = transfer.sum("building", skipna=False)
    taken = xr.zeros_like(total)
    if "contact_work" in result:
        taken = result["contact_work"].sum("pair", min_count=1)
        largest.append(abs(result["contact_work"]).max("pair"))
    residual, energy_input = total - taken, result["energy_input"]
    relative = abs(residual) / xr.concat(largest, "term").max("term").where(lambda energy: energy > 0.0)
    result |= {
        "transfer_sum": described(total, "kN m", "energy given by all buildings"),
        "work_sum": described(taken, "kN m", "work taken by all contacts"),
        "residual": described(residual, "kN m", "energy given less work taken"),
        "residual_relative": described(relative, "1", "size of the residual over the largest energy"),
        "transfer_share": described(
            transfer / energy_input.where(energy_input != 0.0), "1", "share of the input given away"
        ),
    }
    return xr.Dataset(result, attrs={"largest_residual_relative": float(relative.max())})


def energy_transfer(energies: Mapping[Any, xr.DataArray]) -> xr.DataArray:
    """Energy (kN m) that each building has given to its contacts: input less what it lost, holds and gave to links."""
    losses = [name for name in (*TERMS[1:], *BESIDE) if name in energies]
    transfer = sum((-energies[name] for name in losses), start=energies[TERMS[0]])
    return described(transfer, "kN m", "energy given to neighbours and contacts")
