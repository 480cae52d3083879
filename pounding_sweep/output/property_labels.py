"""What a cube says of the building properties that its sweep varies."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.dataset import Axis
from pounding_sweep.spec.axes import PropertyAxis, plain_name

#: name -> (dimensions, values, attributes)
Coordinates = dict[str, tuple[tuple[str, ...], Any, dict[str, Any]]]

#: Kind of axis -> what it is called, and what it does.
_ABOUT = {
    "period_factor": ("factor on all periods", "stiffnesses are divided by its square, masses kept"),
    "mass_factor": ("factor on all masses", "stiffnesses take it too, so that periods are kept"),
    "damping_ratio": ("damping ratio of the first two modes of all buildings", ""),
}


def _period(building: Building) -> float:
    return float(building.periods[0])


def _mass(building: Building) -> float:
    return float(sum(building.masses))


#: Kind of axis -> name, value as given, unit and long name of what it multiplies.
_MULTIPLIES: dict[str, tuple[str, Callable[[Building], float], str, str]] = {
    "period_factor": ("period", _period, "s", "fundamental period"),
    "mass_factor": ("mass", _mass, "t", "total mass"),
}


def property_axis(axis: PropertyAxis) -> Axis:
    """Return an axis over a building property as the cube has it."""
    what, comment = _ABOUT[axis.kind]
    long_name = what if axis.building is None else f"{what} of building {axis.building}"
    return Axis(axis.dimension, axis.values, "1", long_name, comment)


def product_coordinates(scene: Scene, axes: tuple[PropertyAxis, ...]) -> Coordinates:
    """Return the period or mass of each building along its axis, and its ratio to that of each neighbour."""
    found: Coordinates = {}
    taken = [axis.dimension for axis in axes]

    def add(label: str, dims: tuple[str, ...], values: np.ndarray, units: str, long_name: str) -> None:
        name = plain_name(label, (*taken, *found))
        found[name] = (dims, values, {"units": units, "long_name": long_name})

    for kind, (short, own, units, what) in _MULTIPLIES.items():
        mine = {axis.building: axis for axis in axes if axis.kind == kind}
        for building in scene.buildings:
            if building.name in mine:
                axis = mine[building.name]
                values = own(building) * np.array(axis.values)
                add(f"{short}_{building.name}", (axis.dimension,), values, units, f"{what} of building {building.name}")
        for left, right in pairwise(scene.row):
            varied = [mine[item.name] for item in (left, right) if item.name in mine]
            if varied and isinstance(left, Building) and isinstance(right, Building):
                top, bottom = (np.array(mine[b.name].values if b.name in mine else [1.0]) for b in (left, right))
                ratio = own(left) / own(right) * top[:, None] / bottom[None, :]
                add(
                    f"{short}_ratio_{left.name}_{right.name}",
                    tuple(axis.dimension for axis in varied),
                    ratio.reshape([len(axis.values) for axis in varied]),
                    "1",
                    f"{what} of building {left.name} over that of building {right.name}",
                )
    return found


def row_coordinates(variants: Variants, dimension: str, prefix: str = "") -> Coordinates:
    """Return what the buildings are along a dimension of listed scenarios, one of each row of `variants`."""
    periods = np.stack(
        [2.0 * np.pi / variants.frequencies(b)[:, 0] for b in range(len(variants.scene.buildings))], axis=1
    )
    each = dimension, "building"
    own = "; missing where it is the building's own"
    return {
        f"{prefix}period_factor": (
            each,
            variants.period_factor,
            {"units": "1", "long_name": _ABOUT["period_factor"][0]},
        ),
        f"{prefix}mass_factor": (each, variants.mass_factor, {"units": "1", "long_name": _ABOUT["mass_factor"][0]}),
        f"{prefix}fundamental_period": (each, periods, {"units": "s", "long_name": "fundamental period"}),
        f"{prefix}damping_ratio": (
            (dimension,),
            variants.damping_ratio,
            {"units": "1", "long_name": f"{_ABOUT['damping_ratio'][0]}{own}"},
        ),
    }
