"""Where the energy of each building went, and whether what buildings gave equals what contacts took.

Energies are in the relative formulation, per building and until the end of the
record: input = damping + kinetic + strain + transfer. What all buildings gave
(a wall gives nothing, it does not move) is the work that the contacts took in.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from pounding_sweep.analysis.comparisons import comparison
from pounding_sweep.analysis.rebuild import stored_sweep
from pounding_sweep.analysis.scenarios import (
    described,
    finished,
    law_keys,
    need_dims,
    need_variables,
    pounding_only,
    scenarios_only,
    values,
)
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
    cube = scenarios_only(cube)
    row = cube.attrs.get("sweep", cube.attrs.get("scene", ""))
    beside = [name for name, text in BESIDE.items() if text in row]
    need_variables(cube, what, [*TERMS, *(["contact_work"] if "pair" in cube.coords else []), *beside])
    need_dims(cube, what, ["building", *(["pair"] if "pair" in cube.coords else [])])
    _check_whole(cube, what)
    if law_keys(cube) not in ([], ["none"]):
        cube = pounding_only(cube)
    if 0 in cube.sizes.values():
        msg = f"{what} needs a scenario, and this cube has none; select at least one"
        raise InputError(msg)
    terms = [*TERMS, *(name for name in BESIDE if name in cube.data_vars)]
    found = {name: values(cube, name) for name in terms}
    given, transfer = found["energy_input"], energy_transfer(found)
    found["energy_transfer"] = transfer
    found |= {name: values(cube, name) for name in _EXTREMES if name in cube.data_vars}
    work = values(cube, "contact_work") if "contact_work" in cube.data_vars else None
    total = transfer.sum("building", skipna=False)
    taken = xr.zeros_like(total) if work is None else work.sum("pair").where(work.notnull().any("pair"))
    largest = xr.concat([abs(found[name]).max("building") for name in terms], "term").max("term")
    if work is not None:
        found["contact_work"] = work
        most = abs(work).max("pair").fillna(0.0)
        largest = largest.where(~(most > largest), most)
    residual = total - taken
    found["transfer_sum"] = _about(total, "energy given by all buildings")
    found["work_sum"] = _about(taken, "work taken by all contacts")
    found["residual"] = _about(residual, "energy given less work taken")
    relative = abs(residual) / largest.where(largest > 0.0)
    found["residual_relative"] = _about(relative, "size of the residual over the largest energy", "1")
    found["transfer_share"] = _about(transfer / given.where(given != 0.0), "share of the input given away", "1")
    worst = float(relative.max()) if bool(relative.notnull().any()) else float("nan")
    dataset = given.to_dataset(name=TERMS[0]).assign(found)
    return finished(dataset, cube, "energy", largest_residual_relative=worst)


def _check_whole(cube: xr.Dataset, what: str) -> None:
    """Raise `InputError` where a selection left buildings or pairs out: what is left does not balance."""
    if "sweep" not in cube.attrs:
        return
    scene = scene_of(stored_sweep(cube)["scene"])
    for dim, count in (("building", len(scene.buildings)), ("pair", len(scene.pair_labels))):
        there = cube.sizes.get(dim, 0)
        if there != count:
            msg = (
                f"{what} is of the whole row, and this cube has {there} of {count} along {dim!r}; make it of all, and "
                "select from the result"
            )
            raise InputError(msg)


def energy_transfer(energies: Mapping[Any, xr.DataArray]) -> xr.DataArray:
    """Energy (kN m) that each building has given to its contacts: input less what it lost, holds and gave to links."""
    given, damping, kinetic, strain = (energies[name] for name in TERMS)
    transfer = given - damping - kinetic - strain
    for name in (name for name in BESIDE if name in energies):
        transfer = transfer - energies[name]
    return _about(transfer, "energy given to neighbours and contacts")


def _about(part: xr.DataArray, text: str, units: str = "kN m") -> xr.DataArray:
    return described(part, units, text)
