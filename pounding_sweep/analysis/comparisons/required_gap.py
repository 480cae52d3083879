"""The gap that each pair needs so that nothing touches: exactly, and by separation rules.

As long as nothing touches, buildings don't know of each other, and floors of a pair
meet where u_left - u_right of the run without pounding reaches the gap. So nothing
touches in a row whose every gap is at least the largest such value of its own pair.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import comparison
from pounding_sweep.analysis.rebuild import runs_of_cube, runs_of_row
from pounding_sweep.analysis.scenarios import ROUND_OFF, described, identity, labelled, peak_displacement, values
from pounding_sweep.analysis.separation_rules import SEPARATION_RULES, BehaviourFactors, Neighbours, cqc_correlation
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
    columns that is struck moves by N1 u_below + N2 u_above (see `pounding_sweep.model.scene.column_shares`); the rules
    take its largest displacement from those of its floors in the same shares, which is never less than its own.

    Examples
    --------
    >>> gaps = required_gap("mate2015", "el_centro")  # doctest: +SKIP
    >>> gaps.exact.sel(record="el_centro", pair="left-middle").item()  # doctest: +SKIP
    """
    factors = behaviour or BehaviourFactors()
    if isinstance(source, xr.Dataset):
        scene, runs = runs_of_cube(source, [] if records is None else records, folders)
    elif records is None:
        raise InputError("the required gap of a row needs records: required_gap(scene, records)")
    else:
        scene, runs = runs_of_row(source, records, folders)
    closing, (ends, thick) = values(runs, "closing_max"), _neighbours(scene, runs, factors)
    closest = closing.where(~(closing <= ROUND_OFF * (ends.left + ends.right)), 0.0)
    exact, reach = (closest + thick).max("storey"), closest.max("storey")
    rules = list(SEPARATION_RULES.values())
    index = labelled("rule", [rule.key for rule in rules], "separation rule")
    rule_gap = xr.concat([(rule.gap(ends) + thick).max("storey") for rule in rules], dim=index)
    found = {
        "closing": (closing, "m", "largest closing displacement"),
        "exact": (exact, "m", "exact required gap"),
        "never": ((reach == 0.0).where(reach.notnull()), "1", "1 where the pair never touches, 0 where it does"),
        "rule_gap": (rule_gap, "m", "required gap by the rule"),
        "ratio": (rule_gap / exact.where(exact > 0.0), "1", "required gap by the rule over the exact one"),
        "correlation": (ends.correlation, "1", "correlation of the first modes"),
    }
    variables = {name: described(part, units, text, bare=True) for name, (part, units, text) in found.items()}
    coords: dict[str, Any] = {
        f"rule_{name}": ("rule", [getattr(rule, name) for rule in rules], {"long_name": f"{name} of the rule"})
        for name in ("title", "formula", "clause", "edition", "note")
    }
    gaps = [scene.gaps[pair] for pair in scene.pair_of_label]
    coords["row_gap"] = ("pair", gaps, {"units": "m", "long_name": "gap of the row"})
    if thick.any():
        coords["thickness"] = ("pair", thick.max("storey").values, {"units": "m", "long_name": "thickness of bumpers"})
    used = {f"factor_{f.name}": factors.text(f.name) for f in fields(factors)}
    about = {} if isinstance(source, xr.Dataset) else identity(runs)
    return xr.Dataset(variables).assign_coords(coords).assign_attrs({**about, **used})


def _neighbours(scene: Scene, runs: xr.Dataset, factors: BehaviourFactors) -> tuple[Neighbours, xr.DataArray]:
    """Return what rules are given, missing where no floors meet, and what bumpers take of the gap (m).

    Both are on pair and storey.
    """
    labels = list(scene.pair_labels)
    names = [building.name for building in scene.buildings]
    pair = {"pair": labels}
    floor = {**pair, "storey": np.arange(1, scene.n_storeys + 1)}
    # building at each side of a pair, -1 for a wall
    row = np.array([names.index(item.name) if isinstance(item, Building) else -1 for item in scene.row])
    sides = [xr.DataArray(row[np.add(scene.pair_of_label, side)], pair, ("pair",)) for side in (0, 1)]

    def of_sides(part: xr.DataArray) -> list[xr.DataArray]:  # of a wall 1
        picked = (part.isel(building=side).where(side >= 0, 1.0) for side in sides)
        return [one.reset_coords(drop=True).transpose("pair", ...) for one in picked]

    # of each floor that could meet another: shares of the floors that it moves with, those beside struck columns
    moves = np.zeros((2, len(labels), scene.n_storeys, len(names), scene.n_storeys))
    thick, meets = np.zeros((2, len(labels), scene.n_storeys))
    for contact, thickness in zip(scene.contacts, scene.thicknesses(), strict=True):
        place = contact.place, contact.storey - 1
        meets[place], thick[place] = 1.0, thickness
        for dof, share in contact.ends:
            building = int(np.searchsorted(scene.offsets, dof, side="right")) - 1
            moves[(int(share < 0.0), *place, building, dof - scene.offsets[building])] += abs(share)
    peaks = peak_displacement(runs).reset_coords(drop=True).rename(storey="floor")
    known = peaks.notnull().any(["building", "floor"]) & xr.DataArray(meets > 0.0, floor, ("pair", "storey"))
    dims = ("pair", "storey", "building", "floor")
    left, right = (xr.dot(xr.DataArray(of, floor, dims), peaks.fillna(0.0)).where(known) for of in moves)
    periods, damping = of_sides(runs["fundamental_period"]), of_sides(runs["first_damping_ratio"])
    level = np.bincount([contact.pair for contact in scene.contacts if contact.struck < 0], minlength=len(row) - 1)
    neighbours = zip(scene.row[:-1], scene.row[1:], strict=True)
    lowest = [min(item.n_storeys for item in both if isinstance(item, Building)) for both in neighbours]
    two = (sides[0] >= 0) & (sides[1] >= 0)
    return Neighbours(
        left,
        right,
        correlation=cqc_correlation(*periods, *damping).where(two, 0.0),
        level=two & xr.DataArray((level == lowest)[list(scene.pair_of_label)], pair, ("pair",)),
        factors={
            f.name: of_sides(xr.DataArray([factors.of(f.name, name) for name in names], dims="building"))
            for f in fields(factors)
        },
    ), xr.DataArray(thick, floor, ("pair", "storey"))
