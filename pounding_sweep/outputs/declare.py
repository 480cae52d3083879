"""What an output is: what users see of it, how it is compared and read, and what kernels keep for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.kernel.forces import Sample, Touch
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.peaks import Motion
from pounding_sweep.kernel.spec import KernelSpec
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants

#: Dimensions inside a scenario.
INNER_DIMS = ("building", "pair", "storey")
#: What there may be several of in a scenario, and where each stands in a cube.
DIMS = {
    "floor": ("building", "storey"),
    "contact": ("pair", "storey"),
    "link": ("pair", "storey"),
    "building": ("building",),
    "base": ("building",),
    "pair": ("pair",),
    "scenario": (),
}
#: Classes of outputs whose errors were measured together (the largest among them): a choice of steps reads them.
ERROR_CLASSES = ("motions", "contacts", "energies")
#: The class of an output whose errors were not measured yet: it has no say in the choice of steps, and is compared
#: with a run at half the step like any other.
UNMEASURED = "unmeasured"
#: Stored in integer variables where there is no value.
INTEGER_FILL = -1


def _places(scene: Scene, per: str) -> list[int]:
    """Return where floors, contacts, ... stand among the values of their dimensions, in one row."""
    n = scene.n_storeys
    if per == "floor":
        return [i * n + storey for i, building in enumerate(scene.buildings) for storey in range(building.n_storeys)]
    if per in ("contact", "link"):
        ends: Sequence[Any] = scene.contacts if per == "contact" else scene.linked_floors
        return [end.place * n + end.storey - 1 for end in ends]
    sizes = {"building": len(scene.buildings), "pair": len(scene.pair_labels), "scenario": 1}
    return list(scene.foundations if per == "base" else range(sizes[per]))


def scatter(values: Any, scene: Scene, per: str) -> np.ndarray:
    """Put a value for each floor, contact, ... where it belongs in a cube; no copy if there is one for every place."""
    values, places = np.asarray(values), _places(scene, per)
    if values.ndim == 0 or values.shape[-1] != len(places):
        raise InputError(
            f"the last dimension of the values must be the scene's {len(places)} {per}s, not shape {values.shape}"
        )
    sizes = {"building": len(scene.buildings), "pair": len(scene.pair_labels), "storey": scene.n_storeys}
    inner = [sizes[dim] for dim in DIMS[per]]
    if places == list(range(math.prod(inner))):
        return values.reshape(*values.shape[:-1], *inner)
    missing = INTEGER_FILL if np.issubdtype(values.dtype, np.integer) else np.nan
    # in memory scenarios lie side by side, so that what goes over all is fast
    lying = np.full((math.prod(inner), *values.shape[:-1]), missing, values.dtype)
    lying[places] = np.moveaxis(values, -1, 0)
    return np.moveaxis(lying, 0, -1).reshape(*values.shape[:-1], *inner)


scatter_dof, scatter_contact = partial(scatter, per="floor"), partial(scatter, per="contact")
scatter_link, scatter_base = partial(scatter, per="link"), partial(scatter, per="base")


@dataclass(frozen=True)
class KernelResults:
    """What a kernel returned, by the names of its slots, shape (scenarios, slots), and what the scenarios were."""

    scene: Scene
    slots: Mapping[str, np.ndarray]
    variants: Variants
    step: float  # time step (s)
    initial_velocity: Sequence[float] | None = None  # of every floor (m/s), None at rest

    def __len__(self) -> int:
        return len(self.slots["flags"])

    def get(self, slot: str, per: str, missing: float = 0.0) -> np.ndarray:
        """Return a slot's values; `missing` where the kernel did not keep them: nothing can touch."""
        if slot in self.slots:
            return self.slots[slot]
        return np.full((len(self), len(_places(self.scene, per))), missing)

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


@dataclass(frozen=True)
class Variable:
    """One output of a sweep."""

    name: str  # name in cubes and in ``outputs``
    units: str  # in UDUNITS spelling
    long_name: str  # for axes and tables
    definition: str  # what exactly is reported, in one sentence
    #: slot of the kernel that holds its values, or what makes them of what a kernel returned; None: they are worked out
    #: after the run, zeros until then (of scenarios only)
    source: str | Callable[[KernelResults], np.ndarray] | None = None
    per: str = "scenario"  # what there is a value for, a key of `DIMS`
    needs: frozenset[str] = frozenset()  # reducers of the compiled loop that it is made from, beside that of its slot
    #: one of `ERROR_CLASSES`, or `UNMEASURED`; "" for one that says how a run went and not what it found
    error: str = ""
    #: outputs (or pairs, whose product counts) to whose largest its error is relative as well as to its own: it is a
    #: difference of larger ones, or one end of a range
    relative_to: tuple[str | tuple[str, str], ...] = ()
    #: what its error is relative to at least: a touch at rest is found within rounding of the record's first point
    least: float = 0.0
    of_force: bool = False  # missing where floors touched under a law without a force (velocities jump)
    of_yielding: bool = False  # it says nothing of a row whose storeys are all elastic
    of_columns: bool = False  # it exists only where floors strike columns
    of_links: bool = False  # it exists only where neighbours are linked
    of_foundations: bool = False  # it exists only where buildings stand on foundations
    dtype: str = "f8"  # stored type, "f8", "i4" or "i1"
    default: bool = False  # it is reported where no ``outputs`` are given
    always: bool = False  # it is in every cube, asked for or not
    flag_values: tuple[int, ...] = ()  # CF flags of a status variable, and their meanings, separated by blanks
    flag_meanings: str = ""

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions inside a scenario, out of `INNER_DIMS`; () for one value per scenario."""
        return DIMS[self.per]

    @property
    def per_pair(self) -> bool:
        """Whether it describes pairs of neighbours, which a single building has none of."""
        return "pair" in self.dims

    @property
    def fill(self) -> float | int | None:
        """What stands where there is no value: NaN, `INTEGER_FILL`, or None for a variable that is never missing."""
        if self.flag_values:
            return None
        return float("nan") if self.dtype == "f8" else INTEGER_FILL

    def exists_in(self, scene: Scene) -> bool:
        """Whether a scene has what it describes: pairs of neighbours, columns that are struck, links, foundations."""
        struck = any(contact.struck >= 0 for contact in scene.contacts)
        there = (struck or not self.of_columns) and (bool(scene.links) or not self.of_links)
        there = there and (bool(scene.foundations) or not self.of_foundations)
        return there and (not self.per_pair or bool(scene.pair_names))

    def read(self, results: KernelResults) -> np.ndarray:
        """Return its values, shape (scenarios, dimensions)."""
        if self.source is None:
            return np.zeros(len(results))
        values = results.get(self.source, self.per) if isinstance(self.source, str) else self.source(results)
        values = values.astype(np.int32) if self.dtype == "i4" else values
        return values if self.per == "scenario" else scatter(values, results.scene, self.per)


@dataclass(frozen=True)
class Slot:
    """A number that a kernel keeps of each "floor", "contact", "link", "building" or "base", and its first value."""

    # the first value follows from the number of the floor or contact, or from the floors of the building; else it is 0

    name: str
    per: str
    first: Callable[[Group, Any], Any] | None = None

    def count(self, shape: KernelSpec) -> int:
        """How many of it a kernel has."""
        counts = {"contact": len(shape.contacts), "link": len(shape.links), "building": shape.n_buildings}
        return {**counts, "base": len(shape.foundations)}.get(self.per, shape.n_dof)


@dataclass(frozen=True)
class Reducer:
    """What the compiled loop keeps for outputs, in kernels of those that ask for it only."""

    # its functions write rows of the group's state, lane by lane. What presses, moves or heats a row (forces, works,
    # energies, accelerations) is found by the kernel's own parts, where a kernel `asked` for it

    name: str  # by which outputs need it
    slots: tuple[Slot, ...]  # what it leaves for outputs
    #: "": it exists in all kernels; else where storeys yield, "yields", neighbours are linked, "linked", buildings
    #: stand on foundations, "founded", floors of neighbours stand at one height, "neighbours", or can touch, "touch"
    where: str = ""
    keeps: tuple[Slot, ...] = ()  # what it needs beside
    looks: str = ""  # out of `pounding_sweep.kernel.group.LOOKS`
    #: gives the motions whose extremes it keeps, turning points inside steps included; in one straight line of code
    #: where that is asked for and the row is short
    follows: Callable[[Group, bool], Iterable[Motion]] | None = None
    step: Callable[[Group], None] | None = None  # what it does after each located step and sub-step
    touch: Callable[[Group, Touch], None] | None = None  # what it does at the onset of a contact
    #: what it does after each sub-step beside contacts, of lengths ``h``, in modes ``mode`` (0: open)
    substep: Callable[[Group], None] | None = None
    plain: Callable[[Group, Sample], None] | None = None  # about a contact at the end of an unlocated step
