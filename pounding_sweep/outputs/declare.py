"""What an output is: what users see of it, how it is compared and read, and what kernels keep for it."""

from __future__ import annotations

from dataclasses import dataclass

from pounding_sweep.emit.spec import KernelSpec
from pounding_sweep.emit.text import Address, Source
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
#: What a reducer asks of each sub-step of a closed contact, each with those before it: nothing, the penetration at
#: both ends, the force too, or that forces and their rates at both ends are kept for all floors.
LOOKS = ("", "depth", "force", "ends")


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
    of_force : bool
        Missing where floors touched under a law without a force (velocities jump).
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
    of_force: bool = False
    dtype: str = "f8"
    default: bool = False
    always: bool = False
    flag_values: tuple[int, ...] = ()
    flag_meanings: str = ""

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


def needs(*names: str) -> frozenset[str]:
    """Return the reducers of these names."""
    return frozenset(names)


@dataclass(frozen=True)
class Slot:
    """A number that a kernel keeps of each "floor", "contact" or "building", and the text of its first value ("": 0).

    In that text, as in all of a reducer's, ``l`` is the lane and ``i``, ``j`` or ``b`` the floor, contact or building.
    """

    name: str
    per: str
    first: str = ""

    def count(self, shape: KernelSpec) -> int:
        """How many of it a kernel has."""
        return {"floor": shape.n_dof, "contact": len(shape.contacts), "building": shape.n_buildings}[self.per]

    @property
    def begin(self) -> str:
        """The statement that gives it its first value."""
        index = {"floor": "i", "contact": "j", "building": "b"}[self.per]
        return f"S[{self.name.upper()} + {index} * L + l] = {self.first}"


@dataclass(frozen=True)
class Reducer:
    """What the compiled loop keeps for outputs, in kernels of those that ask for it only.

    The text of a contact's events and sub-steps stands in fields, and is put into the templates where a line
    ``# reducers: FIELD`` says so. A reducer of peaks that are looked for within steps is a subclass with text for them.

    Attributes
    ----------
    name : str
        By which outputs need it.
    slots : tuple of Slot
        What it leaves for the readouts.
    where : {"", "neighbours", "touch"}
        Whether it exists in all kernels, where floors of neighbours stand at one height, or where they can touch.
    keeps : tuple of Slot
        What it needs beside.
    looks : str
        Out of `LOOKS`.
    peaks : {"", "floors", "contacts"}
        Whose turning points it looks for.
    quick : bool
        High modes weigh in it: exact flight takes shorter steps.
    touch : str
        Statements at the onset of contact ``j`` of lane ``l`` at the rate ``v``, ``q = j * L + l``.
    substep : str
        Statements after each sub-step, of lengths ``S[HL + l]``, in which contacts are in modes ``I[MODE + q]`` (0:
        open).
    plain : str
        Statements about a contact at the end of an unlocated step ``h``: ``closed``, ``fresh`` (it was open before),
        penetration ``d``, rate ``v``; ``{j0} + l`` instead of ``q``.
    """

    name: str
    slots: tuple[Slot, ...]
    where: str = ""
    keeps: tuple[Slot, ...] = ()
    looks: str = ""
    peaks: str = ""
    quick: bool = False
    touch: str = ""
    substep: str = ""
    plain: str = ""

    def watch_floors(self, src: Source, shape: KernelSpec, at: Address, floors: list[int]) -> None:
        """Lower ``turn`` to zero or less where what is kept of these floors turns in the step."""

    def watch_contacts(self, src: Source, at: Address, ends: list[tuple[int, int]]) -> None:
        """Lower ``turn`` to zero or less where what is kept of two floors that can meet turns in the step."""

    def turns(self, src: Source) -> None:
        """Write the peaks that lie inside the step just taken."""

    def sample_floor(self, src: Source, shape: KernelSpec, at: Address, u: list[str], i: int) -> None:
        """Write, in a lane loop, the peak at the displacements `u` of the floors, as far as it is of floor `i`."""

    def sample_contacts(self, src: Source, shape: KernelSpec, at: Address, u: list[str]) -> None:
        """Write, in a lane loop, the peaks at the displacements `u` of the floors, of all contacts."""

    def sample_loops(self, src: Source) -> None:
        """Write the same for a longer row, in loops over its floors or contacts."""
