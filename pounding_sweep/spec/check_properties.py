"""Checks of axes over building properties."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pounding_sweep.base.errors import InputError, shown, unknown
from pounding_sweep.model.scene import Scene
from pounding_sweep.spec.faults import FAILED, Faults, Place, axis_values

#: Least and largest factor on a period or on masses: beyond it nothing is a building, and numbers run out of range.
FACTOR_RANGE = (1e-3, 1e3)


def check_factor(value: float) -> None:
    """Raise `InputError` unless `value` is in `FACTOR_RANGE`."""
    low, high = FACTOR_RANGE
    if not low <= value <= high:
        msg = f"factor is {value!r}; it must be in [{low:g}, {high:g}]"
        raise InputError(msg)


def check_ratio(value: float) -> None:
    """Raise `InputError` unless `value` is in [0, 1)."""
    if not 0.0 <= value < 1.0:
        msg = f"damping ratio is {value!r}; it must be in [0, 1)"
        raise InputError(msg)


def named_buildings(faults: Faults, place: Place, given: Any, scene: Scene | None) -> list[tuple[str, Any]]:
    """Return what a table gives for each building, in the order of the row; names that the row lacks are faults."""
    if given is None or given is FAILED:
        return []
    if not isinstance(given, Mapping):
        faults.add(place, f'must be a table by name of the building, such as {{"left": 1.2}}, not {shown(given)}')
        return []
    if scene is None:
        return []
    names = [building.name for building in scene.buildings]
    for name in given:
        if name not in names:
            faults.add((*place, str(name)), unknown("building", name, names))
    return [(name, given[name]) for name in names if name in given and given[name] is not FAILED]


def factor_axes(
    faults: Faults, sizes: dict[str, int], name: str, given: Any, scene: Scene | None
) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Check axes of factors by building; `sizes` gets their numbers of values."""
    found = []
    for building, values in named_buildings(faults, (name,), given, scene):
        checked = axis_values(faults, sizes, (name, building), values, check_factor, what="factors")
        if checked is not None:
            found.append((building, checked))
        elif values is None:
            faults.add((name, building), "is empty; give factors or leave the building out")
    return tuple(found)
