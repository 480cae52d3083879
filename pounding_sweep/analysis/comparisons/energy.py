"""Where the energy of each building went, and whether what buildings gave equals what contacts took.

Energies are in the relative formulation, per building and until the end of the
record: input = damping + kinetic + strain + transfer. What all buildings gave
(a wall gives nothing, it does not move) is the work that the contacts took in.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from pounding_sweep.analysis.comparisons import check_needs, comparison
from pounding_sweep.analysis.rebuild import stored_sweep
from pounding_sweep.analysis.scenarios import described, law_keys, pounding_only, present, values
from pounding_sweep.base.errors import InputError
from pounding_sweep.spec.spec import scene_of

#: What each building's budget is made of.
TERMS = ("energy_input", "energy_damping", "energy_kinetic", "energy_strain")
#: What cubes of some rows have beside, and what the description of such a row holds.
BESIDE = {"hysteretic_energy": '"yield_strengths":', "energy_links": '"links":'}
#: What goes along where a cube has it.
_EXTREMES = ("energy_transfer_max", "energy_transfer_min")


@comparison(
    "where the energy of each building went, and whether transfers sum to the contacts' work",
    needs="energy_input, energy_damping, energy_kinetic, energy_strain and contact_work",
    columns=("law", "building", "pair"),
    lead=("transfer_share", "contact_work", "residual_relative"),
    figure="energy-budget",
    whole=True,
)
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
    row = cube.attrs.get("sweep", cube.attrs.get("scene", ""))
    pairs = ["pair"] if "pair" in cube.coords else []
    terms = [*TERMS, *(["contact_work"] if pairs else []), *(name for name, text in BESIDE.items() if text in row)]
    check_needs(cube, what, axes=["building", *pairs], outputs=terms)
    if "sweep" in cube.attrs:  # a selection that left buildings or pairs out does not balance
        scene = scene_of(stored_sweep(cube)["scene"])
        for dim, count in (("building", len(scene.buildings)), ("pair", len(scene.pair_labels))):
            if cube.sizes.get(dim, 0) != count:
                raise InputError(
                    f"{what} is of the whole row, and this cube has {cube.sizes.get(dim, 0)} of {count} along {dim!r}; "
                    "make it of all, and select from the result"
                )
    if law_keys(cube) not in ([], ["none"]):
        cube = pounding_only(cube)
    result = {name: values(cube, name) for name in present(cube, (*TERMS, *BESIDE))}
    largest = xr.concat([abs(part).max("building") for part in result.values()], "term").max("term")
    transfer = result["energy_transfer"] = energy_transfer(result)
    result |= {name: values(cube, name) for name in present(cube, (*_EXTREMES, "contact_work"))}
    total = transfer.sum("building", skipna=False)
    taken = xr.zeros_like(total)
    if "contact_work" in result:
        work = result["contact_work"]
        taken = work.sum("pair").where(work.notnull().any("pair"))
        most = abs(work).max("pair").fillna(0.0)
        largest = largest.where(~(most > largest), most)
    residual, given = total - taken, result["energy_input"]
    relative = abs(residual) / largest.where(largest > 0.0)
    for name, part, units, text in (
        ("transfer_sum", total, "kN m", "energy given by all buildings"),
        ("work_sum", taken, "kN m", "work taken by all contacts"),
        ("residual", residual, "kN m", "energy given less work taken"),
        ("residual_relative", relative, "1", "size of the residual over the largest energy"),
        ("transfer_share", transfer / given.where(given != 0.0), "1", "share of the input given away"),
    ):
        result[name] = described(part, units, text)
    return xr.Dataset(result, attrs={"largest_residual_relative": float(relative.max())})


def energy_transfer(energies: Mapping[Any, xr.DataArray]) -> xr.DataArray:
    """Energy (kN m) that each building has given to its contacts: input less what it lost, holds and gave to links."""
    losses = [name for name in (*TERMS[1:], *BESIDE) if name in energies]
    transfer = sum((-energies[name] for name in losses), start=energies[TERMS[0]])
    return described(transfer, "kN m", "energy given to neighbours and contacts")
