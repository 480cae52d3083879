"""How values of a cube are made of what kernels keep, and where a floor or a contact stands in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.model.links import LinkedFloors
from pounding_sweep.model.scene import Contact, Scene
from pounding_sweep.model.variants import Variants

#: Stored in integer variables where there is no value.
INTEGER_FILL = -1


def _unfilled(values: np.ndarray, *inner: int) -> np.ndarray:
    """Return an array without values; in memory scenarios lie side by side, so that what goes over all is fast."""
    missing = INTEGER_FILL if np.issubdtype(values.dtype, np.integer) else np.nan
    lying = np.full((*inner, *values.shape[:-1]), missing, values.dtype)
    return lying.transpose(*range(len(inner), lying.ndim), *range(len(inner)))


def _check_last(values: np.ndarray, size: int, what: str) -> None:
    if values.ndim == 0 or values.shape[-1] != size:
        msg = f"the last dimension of the values must be the scene's {size} {what}, not shape {values.shape}"
        raise InputError(msg)


def scatter_dof(values: Any, scene: Scene) -> np.ndarray:
    """Put values per degree of freedom where their building and storey are."""
    values = np.asarray(values)
    _check_last(values, scene.n_dof, "degrees of freedom")
    result = _unfilled(values, len(scene.buildings), scene.n_storeys)
    for i, (start, stop) in enumerate(zip(scene.offsets[:-1], scene.offsets[1:], strict=True)):
        result[..., i, : stop - start] = values[..., start:stop]
    return result


def scatter_contact(values: Any, scene: Scene) -> np.ndarray:
    """Put values per contact where their pair and storey are."""
    return _between(values, scene.contacts, "contacts", scene)


def scatter_link(values: Any, scene: Scene) -> np.ndarray:
    """Put values per link where their pair and the storey of their left floor are."""
    return _between(values, scene.linked_floors, "links", scene)


def _between(values: Any, joints: Sequence[Contact | LinkedFloors], what: str, scene: Scene) -> np.ndarray:
    values = np.asarray(values)
    _check_last(values, len(joints), what)
    result = _unfilled(values, len(scene.pair_labels), scene.n_storeys)
    for i, joint in enumerate(joints):
        result[..., joint.place, joint.storey - 1] = values[..., i]
    return result


def scatter_base(values: Any, scene: Scene) -> np.ndarray:
    """Put values per foundation where their building is."""
    values = np.asarray(values)
    _check_last(values, len(scene.foundations), "foundations")
    result = _unfilled(values, len(scene.buildings))
    result[..., list(scene.foundations)] = values
    return result


@dataclass(frozen=True)
class KernelResults:
    """What a kernel returned, by the names of its slots, shape (scenarios, slots), and what the scenarios were."""

    # `step` is the time step (s); `initial_velocity` that of every floor (m/s), None at rest

    scene: Scene
    slots: Mapping[str, np.ndarray]
    variants: Variants
    step: float
    initial_velocity: Sequence[float] | None = None

    def __len__(self) -> int:
        return len(self.slots["flags"])

    def get(self, slot: str, count: int, missing: float = 0.0) -> np.ndarray:
        """Return a slot's values; `missing`, `count` times, where the kernel did not keep them: nothing can touch."""
        return self.slots[slot] if slot in self.slots else np.full((len(self), count), missing)

    def floors(self, slot: str) -> np.ndarray:
        """Return a value per floor, shape (scenarios, buildings, storeys)."""
        return scatter_dof(self.slots[slot], self.scene)

    def contacts(self, slot: str, missing: float = 0.0) -> np.ndarray:
        """Return a value per contact, shape (scenarios, pairs, storeys)."""
        return scatter_contact(self.get(slot, len(self.scene.contacts), missing), self.scene)

    def whole_contacts(self, slot: str) -> np.ndarray:
        """Return a whole number per contact, shape (scenarios, pairs, storeys)."""
        return scatter_contact(self.get(slot, len(self.scene.contacts)).astype(np.int32), self.scene)

    def buildings(self, slot: str) -> np.ndarray:
        """Return a value per building, shape (scenarios, buildings)."""
        return self.get(slot, len(self.scene.buildings)).copy()

    @cached_property
    def steps_per_contact(self) -> np.ndarray:
        """Time steps in the shortest contact, NaN where nothing touched."""
        return np.asarray(np.fmin.reduce(self.steps_by_law, axis=1))

    @cached_property
    def steps_by_law(self) -> np.ndarray:
        """Time steps in the shortest contact of each law, NaN where none touched, shape (scenarios, laws)."""
        if "shortest" not in self.slots:
            return np.full((len(self), 1), np.nan)
        lasted = self.slots["shortest"] / self.step
        return np.where(lasted < 1e30, lasted, np.nan)


#: How an output is made of what a kernel returned.
Readout = Callable[[KernelResults], np.ndarray]


def floors(slot: str) -> Readout:
    """Read a value per floor as it is kept."""
    return lambda kept: kept.floors(slot)


def contacts(slot: str) -> Readout:
    """Read a value per contact as it is kept, 0 where nothing can touch."""
    return lambda kept: kept.contacts(slot)


def buildings(slot: str) -> Readout:
    """Read a value per building as it is kept, 0 where nothing can touch."""
    return lambda kept: kept.buildings(slot)
