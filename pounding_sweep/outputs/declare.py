"""What an output is: what users see of it, how it is compared and read, and what kernels keep for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from pounding_sweep.kernel.forces import Sample, Touch
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.peaks import Motion
from pounding_sweep.kernel.spec import KernelSpec
from pounding_sweep.model.scene import Scene
from pounding_sweep.outputs.readout import INTEGER_FILL, Readout

#: Dimensions inside a scenario.
INNER_DIMS = ("building", "pair", "storey")
FLOOR = ("building", "storey")
CONTACT = ("pair", "storey")
#: Classes of outputs whose errors were measured together (the largest among them): a choice of steps reads them.
ERROR_CLASSES = ("motions", "contacts", "energies")
#: The class of an output whose errors were not measured yet: it has no say in the choice of steps, and is compared
#: with a run at half the step like any other.
UNMEASURED = "unmeasured"


@dataclass(frozen=True)
class Variable:
    """One output of a sweep."""

    name: str  # name in cubes and in ``outputs``
    dims: tuple[str, ...]  # dimensions inside a scenario, out of `INNER_DIMS`; () for one value per scenario
    units: str  # in UDUNITS spelling
    long_name: str  # for axes and tables
    definition: str  # what exactly is reported, in one sentence
    needs: frozenset[str] = frozenset()  # reducers of the compiled loop that it is made from
    readout: Readout | None = None  # makes its values; None: they are worked out after the run, zeros until then
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
    def per_pair(self) -> bool:
        """Whether it describes pairs of neighbours, which a single building has none of."""
        return "pair" in self.dims

    def exists_in(self, scene: Scene) -> bool:
        """Whether a scene has what it describes: pairs of neighbours, columns that are struck, links, foundations."""
        struck = any(contact.struck >= 0 for contact in scene.contacts)
        there = (struck or not self.of_columns) and (bool(scene.links) or not self.of_links)
        there = there and (bool(scene.foundations) or not self.of_foundations)
        return there and (not self.per_pair or bool(scene.pair_names))

    @property
    def fill(self) -> float | int | None:
        """What stands where there is no value: NaN, `INTEGER_FILL`, or None for a variable that is never missing."""
        if self.flag_values:
            return None
        return float("nan") if self.dtype == "f8" else INTEGER_FILL


def needs(*names: str) -> frozenset[str]:
    """Return the reducers of these names."""
    return frozenset(names)


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
    slots: tuple[Slot, ...]  # what it leaves for the readouts
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
