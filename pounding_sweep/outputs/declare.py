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
    """One output of a sweep.

    Attributes
    ----------
    name : str
        Name in cubes and in ``outputs``.
    dims : tuple of str
        Dimensions inside a scenario, out of `INNER_DIMS`; () for one value per scenario.
    units : str
        In UDUNITS spelling.
    long_name : str
        For axes and tables.
    definition : str
        What exactly is reported, in one sentence.
    needs : frozenset of str
        Reducers of the compiled loop that it is made from.
    readout : callable, optional
        Makes its values of a `KernelResults`. None: they are worked out after the run, zeros until then.
    error : str
        One of `ERROR_CLASSES`, or `UNMEASURED`; "" for one that says how a run went and not what it found, which has
        no error.
    relative_to : tuple of str or of pairs of str
        Outputs (or pairs, whose product counts) to whose largest its error is relative as well as to its own: it is
        a difference of larger ones, or one end of a range.
    least : float
        What its error is relative to at least: a touch at rest is found within rounding of the record's first point.
    of_force : bool
        Missing where floors touched under a law without a force (velocities jump).
    of_yielding : bool
        It says nothing of a row whose storeys are all elastic.
    of_columns : bool
        It exists only where floors strike columns.
    of_links : bool
        It exists only where neighbours are linked.
    of_foundations : bool
        It exists only where buildings stand on foundations.
    dtype : {"f8", "i4", "i1"}
        Stored type.
    default : bool
        It is reported where no ``outputs`` are given.
    always : bool
        It is in every cube, asked for or not.
    flag_values : tuple of int
        CF flags of a status variable.
    flag_meanings : str
        Their meanings, separated by blanks.
    """

    name: str
    dims: tuple[str, ...]
    units: str
    long_name: str
    definition: str
    needs: frozenset[str] = frozenset()
    readout: Readout | None = None
    error: str = ""
    relative_to: tuple[str | tuple[str, str], ...] = ()
    least: float = 0.0
    of_force: bool = False
    of_yielding: bool = False
    of_columns: bool = False
    of_links: bool = False
    of_foundations: bool = False
    dtype: str = "f8"
    default: bool = False
    always: bool = False
    flag_values: tuple[int, ...] = ()
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
    """What the compiled loop keeps for outputs, in kernels of those that ask for it only.

    Its functions write rows of the group's state, lane by lane. What presses, moves or heats a row (forces, works,
    energies, accelerations) is found by the kernel's own parts, where a kernel `asked` for it.

    Attributes
    ----------
    name : str
        By which outputs need it.
    slots : tuple of Slot
        What it leaves for the readouts.
    where : {"", "yields", "linked", "founded", "neighbours", "touch"}
        Whether it exists in all kernels, where storeys yield, where neighbours are linked, where buildings stand on
        foundations, where floors of neighbours stand at one height, or where they can touch.
    keeps : tuple of Slot
        What it needs beside.
    looks : str
        Out of `pounding_sweep.kernel.group.LOOKS`.
    follows : callable, optional
        Gives the motions whose extremes it keeps, turning points inside steps included; in one straight line of code
        where that is asked for and the row is short.
    step : callable, optional
        What it does after each located step and sub-step.
    touch : callable, optional
        What it does at the onset of a contact.
    substep : callable, optional
        What it does after each sub-step beside contacts, of lengths ``h``, in modes ``mode`` (0: open).
    plain : callable, optional
        What it does about a contact at the end of an unlocated step.
    """

    name: str
    slots: tuple[Slot, ...]
    where: str = ""
    keeps: tuple[Slot, ...] = ()
    looks: str = ""
    follows: Callable[[Group, bool], Iterable[Motion]] | None = None
    step: Callable[[Group], None] | None = None
    touch: Callable[[Group, Touch], None] | None = None
    substep: Callable[[Group], None] | None = None
    plain: Callable[[Group, Sample], None] | None = None
