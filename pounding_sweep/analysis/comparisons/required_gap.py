"""The gap that each pair needs so that nothing touches: exactly, and by separation rules.

As long as nothing touches, buildings don't know of each other, and floors of a pair
meet where u_left - u_right of the run without pounding reaches the gap. So nothing
touches in a row whose every gap is at least the largest such value of its own pair.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import comparison
from pounding_sweep.analysis.scenarios import ROUND_OFF, described, finished, labelled, peak_displacement, values
from pounding_sweep.analysis.separation_rules import SEPARATION_RULES, BehaviourFactors, Neighbours, cqc_correlation
from pounding_sweep.analysis.uncoupled_runs import UncoupledRuns, runs_of_cube, runs_of_row
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.records import Record


@comparison(
    "the gap that each pair needs, exactly and by separation rules",
    needs="pairs; the law 'none' with closing_max and displacements, or the records at hand",
    columns=("rule", "pair"),
    variables=("exact", "rule_gap", "ratio"),
    lead=("exact", "ratio"),
    figure="required-gap",
    arguments=("folders",),
    whole=True,
)
def required_gap(
    source: Scene | str | xr.Dataset,
    records: Record | str | os.PathLike[str] | Iterable[Record | str | os.PathLike[str]] | None = None,
    *,
    behaviour: BehaviourFactors | None = None,
    folders: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None = None,
) -> xr.Dataset:
    """Find the gap at which each pair just does not touch, and what separation rules ask for.

    Parameters
    ----------
    source : Scene, str or xarray.Dataset
        A row, the name of a preset, or a cube. Of a cube with the law "none" and the outputs ``closing_max``,
        ``displacement_max`` and ``displacement_min`` nothing is run; of any other the run without pounding is made
        again, with row, building properties and scales from the sweep that the cube carries.
    records : Record, str, path, or several, optional
        Ground motions; needed with a row. With a cube: records to look through before they are looked for by name.
    behaviour : BehaviourFactors, optional
        Factors of the standards, all 1 by default.
    folders : path or several, optional
        Where to find records by name.

    Returns
    -------
    xarray.Dataset
        On ``record``, and on ``scale``, building properties or ``case`` where the cube has them: ``closing`` (pair,
        storey; m), the largest closing displacement of the floors; ``exact`` (pair; m), its largest value over storeys
        and the exact required gap, 0 where it is below 1e-9 of the sum of the floors' displacements; where there are
        bumpers their ``thickness`` (pair; m) is in it, storey by storey, and in what rules ask for; ``never`` (pair) is
        1 there, else 0; ``rule_gap`` (rule, pair; m) and ``ratio`` (rule, pair), its ratio to the exact one, missing
        where that is 0; ``correlation`` (pair) of the first modes. Missing where no floors meet. Beside ``rule`` stand
        its title, formula, clause, edition and note, beside ``pair`` the row's own gap.

    Raises
    ------
    InputError
        A row without records, a row without pairs, or a cube whose row or records can't
        be known; the message says what is missing.

    Notes
    -----
    The exact gap of a pair holds only where every pair of the row has at least its own: once
    another pair pounds, the buildings move otherwise, and this pair may touch at a larger gap.

    Something can strike where floors are level, and where a floor stands before columns ("a-b columns of b"), which is
    looked at whatever the row's ``contacts``; the gap of a pair must be that of all its labels. The point of the
    columns that is struck moves by N1 u_below + N2 u_above (see `pounding_sweep.model.levels.column_shares`); the rules
    take its largest displacement from those of its floors in the same shares, which is never less than its own.

    Examples
    --------
    >>> gaps = required_gap("mate2015", "el_centro")  # doctest: +SKIP
    >>> gaps.exact.sel(record="el_centro", pair="left-middle").item()  # doctest: +SKIP
    """
    factors = behaviour or BehaviourFactors()
    if isinstance(source, xr.Dataset):
        runs = runs_of_cube(source, [] if records is None else records, folders)
    elif records is None:
        msg = "the required gap of a row needs records: required_gap(scene, records)"
        raise InputError(msg)
    else:
        runs = runs_of_row(source, records, folders)
    used = {f"factor_{f.name}": _text(getattr(factors, f.name)) for f in fields(factors)}
    cube = source if isinstance(source, xr.Dataset) else runs.cube
    return finished(_gaps(runs, factors), cube, "required-gap", **used)


def _gaps(runs: UncoupledRuns, factors: BehaviourFactors) -> xr.Dataset:
    closing = values(runs.cube, "closing_max")
    ends = _neighbours(runs, factors)
    never = closing <= ROUND_OFF * (ends.left + ends.right)
    closest, thick = closing.where(~never, 0.0), _thicknesses(runs.scene)
    exact, reach = (closest + thick).max("storey"), closest.max("storey")
    rules = list(SEPARATION_RULES.values())
    index = labelled("rule", [rule.key for rule in rules], "separation rule")
    rule_gap = xr.concat([(rule.gap(ends) + thick).max("storey") for rule in rules], dim=index)
    about: dict[str, Any] = {
        f"rule_{name}": ("rule", [getattr(rule, name) for rule in rules], {"long_name": f"{name} of the rule"})
        for name in ("title", "formula", "clause", "edition", "note")
    }
    own = (
        "pair",
        [runs.scene.gaps[pair] for pair in runs.scene.pair_of_label],
        {"units": "m", "long_name": "gap of the row"},
    )
    found = {
        "closing": (closing, "m", "largest closing displacement"),
        "exact": (exact, "m", "exact required gap"),
        "never": ((reach == 0.0).where(reach.notnull()), "1", "1 where the pair never touches, 0 where it does"),
        "rule_gap": (rule_gap, "m", "required gap by the rule"),
        "ratio": (rule_gap / exact.where(exact > 0.0), "1", "required gap by the rule over the exact one"),
        "correlation": (ends.correlation, "1", "correlation of the first modes"),
    }
    variables = {name: described(part, units, text, bare=True) for name, (part, units, text) in found.items()}
    if thick.any():
        about["thickness"] = ("pair", thick.max("storey").values, {"units": "m", "long_name": "thickness of bumpers"})
    return xr.Dataset(variables).assign_coords({**about, "row_gap": own})


def _thicknesses(scene: Scene) -> xr.DataArray:
    """Return what bumpers take of the gap (m), on pair and storey."""
    found = np.zeros((len(scene.pair_labels), scene.n_storeys))
    for contact, thickness in zip(scene.contacts, scene.thicknesses(), strict=True):
        found[contact.place, contact.storey - 1] = thickness
    return xr.DataArray(found, dims=("pair", "storey"), coords={"pair": list(scene.pair_labels)})


def _text(factor: float | Mapping[str, float]) -> str:
    return ", ".join(f"{k}: {v:g}" for k, v in factor.items()) if isinstance(factor, Mapping) else f"{factor:g}"


def _neighbours(runs: UncoupledRuns, factors: BehaviourFactors) -> Neighbours:
    """Return what rules are given, on pair and storey; missing where no floors meet."""
    scene = runs.scene
    ends = list(zip(scene.row[:-1], scene.row[1:], strict=True))
    buildings = [[item for item in both if isinstance(item, Building)] for both in ends]
    two = _on_pairs(scene, [len(both) == 2 for both in buildings])
    meeting = np.bincount([contact.pair for contact in scene.contacts if contact.struck < 0], minlength=len(ends))
    lowest = [min(item.n_storeys for item in both) for both in buildings]
    periods = _sides(scene, lambda name: runs.periods.sel(building=name, drop=True), 1.0)
    damping = _sides(scene, lambda name: runs.damping.sel(building=name, drop=True), 1.0)
    return Neighbours(
        *_floors(scene, peak_displacement(runs.cube)),
        correlation=cqc_correlation(*periods, *damping).where(two, 0.0),
        level=two & _on_pairs(scene, meeting == np.array(lowest)),
        factors={f.name: _sides(scene, _of(factors, f.name), 1.0) for f in fields(factors)},
    )


def _of(factors: BehaviourFactors, factor: str) -> Callable[[str], float]:
    return lambda building: factors.of(factor, building)


def _on_pairs(scene: Scene, of_pairs: Sequence[bool] | np.ndarray) -> xr.DataArray:
    of_labels = np.asarray(of_pairs)[list(scene.pair_of_label)]
    return xr.DataArray(of_labels, dims="pair", coords={"pair": list(scene.pair_labels)})


def _sides(
    scene: Scene, of: Callable[[str], xr.DataArray | float], at_wall: float
) -> tuple[xr.DataArray, xr.DataArray]:
    """Return something of the left and of the right neighbour, along ``pair``."""
    each = [xr.DataArray(of(item.name) if isinstance(item, Building) else at_wall) for item in scene.row]
    each = list(xr.broadcast(*each))
    index = labelled("pair", scene.pair_labels, "pair of neighbours, left-right")
    left, right = ([each[pair + side] for pair in scene.pair_of_label] for side in (0, 1))
    return xr.concat(left, dim=index), xr.concat(right, dim=index)


def _floors(scene: Scene, of_floors: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray]:
    """Return peaks of both sides of each contact, on pair and storey: 0 at a wall, of columns by shares of floors."""
    dims, shape = ("pair", "storey"), (len(scene.pair_labels), scene.n_storeys)
    coords = {"pair": list(scene.pair_labels), "storey": np.arange(1, scene.n_storeys + 1)}
    there = np.zeros(shape, bool)
    # of each side: the floor, its share, and those of the floor below struck columns
    floors, shares = np.full((2, 2, *shape), -1), np.zeros((2, 2, *shape))
    for contact in scene.contacts:
        place = contact.place, contact.storey - 1
        there[place] = True
        for floor, share in contact.ends:
            side = int(share < 0.0)
            part = int(floor not in (contact.left, contact.right))
            floors[side, part, *place], shares[side, part, *place] = floor, abs(share)
    found = []
    for side in (0, 1):
        total = xr.DataArray(0.0)
        for floor, share in zip(floors[side], shares[side], strict=True):
            building = np.maximum(np.searchsorted(scene.offsets, floor, side="right") - 1, 0)
            storey = np.maximum(floor - np.asarray(scene.offsets)[building], 0)
            at = {"building": xr.DataArray(building, dims=dims), "storey": xr.DataArray(storey, dims=dims)}
            picked = of_floors.isel(at).reset_coords(drop=True).assign_coords(coords)
            weight = xr.DataArray(share, dims=dims, coords=coords)
            total = total + (weight * picked).where(weight > 0.0, 0.0)
        found.append(total.where(xr.DataArray(there, dims=dims, coords=coords)))
    return found[0], found[1]
