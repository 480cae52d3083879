"""Every output of a sweep, declared once.

Dimensions, units, names, definitions and what each needs from the compiled
loop stand here; kernels, planner, cube, command line and documentation read
the registry. Adding an output is adding one `Variable` to it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

from pounding_sweep.base.errors import InputError, unknown

#: Dimensions inside a scenario.
INNER_DIMS = ("building", "pair", "storey")
#: Stored in integer variables where there is no value.
INTEGER_FILL = -1
#: Relative error beyond which the peaks of a scenario are wrong, where no other was asked for.
OK_CLAIM = 0.05
#: Difference to a run at half the step within which one at a given step is ok, where that is asked for: an error that
#: impacts have magnified need not shrink with the step as small ones do.
SETTLED = 0.02


class Status(IntEnum):
    """How a scenario ended; its value in the cube, with what it means and what to do."""

    meaning: str
    remedy: str
    has_values: bool

    def __new__(cls, code: int, meaning: str, remedy: str, has_values: bool) -> Status:
        """Make the member of value `code`."""
        member = int.__new__(cls, code)
        member._value_ = code
        member.meaning = meaning
        member.remedy = remedy
        member.has_values = has_values
        return member

    OK = (
        0,
        "the scenario ran to the end of its record, and its step resolves contacts, buildings and ground by "
        "all rules of the engine; where error_estimate is there, a run at another step agrees as well",
        "",
        True,
    )
    DIVERGED = (
        1,
        "the motion left the range of finite numbers, or of what the ground can bring about; no peaks are reported",
        "use a smaller dt, the newmark scheme or a softer contact",
        False,
    )
    UNDER_RESOLVED_CONTACT = (
        2,
        "the shortest contact lasted too few time steps for its peaks to be trusted",
        "use a smaller dt (see steps_per_contact)",
        True,
    )
    NEWTON_NOT_CONVERGED = (
        3,
        "the implicit contact equation was not solved within its tolerance in some step",
        "use a smaller dt",
        True,
    )
    BEYOND_STABILITY_LIMIT = (
        4,
        "the time step is beyond the stability limit of the scheme; the scenario was refused",
        "use a smaller dt or the newmark scheme",
        False,
    )
    NOT_RUN = (
        5,
        "the scenario has no result, for instance because its worker failed or because no merged cube has it",
        "run the sweep again, for a merged cube with --extend of it",
        False,
    )
    UNDER_RESOLVED_MOTION = (
        6,
        "the time step is too long for a building's fundamental period, or for the ground motion",
        "use a smaller dt, or the rk4 scheme",
        True,
    )
    UNSETTLED = (
        7,
        "half the time step changes an output by more than the accuracy asked for, however often it was halved, or, "
        f"at a given step, by more than {SETTLED:.0%}",
        "use a smaller dt, or ask for a larger relative error (see error_estimate)",
        True,
    )

    @property
    def label(self) -> str:
        """Name in ``flag_meanings``."""
        return self.name.lower()


#: Every status, by rising value.
STATUS: tuple[Status, ...] = tuple(Status)


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
    dtype : {"f8", "i4", "i1"}
        Stored type.
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
    dtype: str = "f8"
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


_FLOOR = ("building", "storey")
_CONTACT = ("pair", "storey")


def _needs(*names: str) -> frozenset[str]:
    return frozenset(names)


_ALL = (
    Variable(
        "displacement_max",
        _FLOOR,
        "m",
        "largest floor displacement",
        "Largest signed displacement of the floor relative to the ground, positive to the right.",
        _needs("displacement"),
    ),
    Variable(
        "displacement_min",
        _FLOOR,
        "m",
        "smallest floor displacement",
        "Smallest signed displacement of the floor relative to the ground, negative to the left.",
        _needs("displacement"),
    ),
    Variable(
        "drift_max",
        _FLOOR,
        "m",
        "largest interstorey drift",
        "Largest absolute interstorey displacement |u_i - u_(i-1)|; of storey 1, relative to the ground.",
        _needs("drift"),
    ),
    Variable(
        "storey_shear_max",
        _FLOOR,
        "kN",
        "largest storey shear",
        "Largest absolute elastic storey force k |u_i - u_(i-1)|, dampers not included.",
        _needs("drift"),
    ),
    Variable(
        "acceleration_max",
        _FLOOR,
        "m s-2",
        "largest total floor acceleration",
        "Largest absolute total acceleration of the floor (relative + ground); where the contact force jumps at a "
        "touch, the limit just after it counts; where velocities jump, the jump itself does not.",
        _needs("acceleration"),
    ),
    Variable(
        "impact_force_max",
        _CONTACT,
        "kN",
        "largest contact force",
        "Largest contact force, pressing positive, 0 where the floors never touched; where the force jumps at a "
        "touch, the limit just after it counts. Missing where floors touched under a law without a force (velocities "
        "jump).",
        _needs("force"),
    ),
    Variable(
        "impact_count",
        _CONTACT,
        "1",
        "number of impacts",
        "Number of onsets of contact, the penetration d = u_left - u_right - gap going from <= 0 to > 0.",
        _needs("count"),
        dtype="i4",
    ),
    Variable(
        "penetration_max",
        _CONTACT,
        "m",
        "largest penetration",
        "Largest positive penetration d = u_left - u_right - gap, 0 where the floors never touched. Missing where "
        "floors touched under a law without a force (velocities jump).",
        _needs("penetration"),
    ),
    Variable(
        "impulse",
        _CONTACT,
        "kN s",
        "impulse of the contact force",
        "Time integral of the contact force over the whole record.",
        _needs("impulse"),
    ),
    Variable(
        "first_impact_time",
        _CONTACT,
        "s",
        "time of the first impact",
        "Time of the first onset of contact after the first point of the record; missing where there was none.",
        _needs("first_time"),
    ),
    Variable(
        "approach_speed_max",
        _CONTACT,
        "m s-1",
        "largest approach speed",
        "Largest rate of the penetration d at an onset of contact, 0 where the floors never touched.",
        _needs("approach_speed"),
    ),
    Variable(
        "energy_input",
        ("building",),
        "kN m",
        "energy input",
        "Energy put in by the ground until the end of the record, -int m ag v dt with v relative to the ground.",
        _needs("energy"),
    ),
    Variable(
        "energy_damping",
        ("building",),
        "kN m",
        "energy lost in damping",
        "Energy lost in the building's own damping until the end of the record, int v'Cv dt.",
        _needs("energy"),
    ),
    Variable(
        "energy_kinetic",
        ("building",),
        "kN m",
        "kinetic energy at the end",
        "Kinetic energy v'Mv/2 of the motion relative to the ground, at the end of the record.",
        _needs("energy"),
    ),
    Variable(
        "energy_strain",
        ("building",),
        "kN m",
        "strain energy at the end",
        "Elastic strain energy u'Ku/2 at the end of the record.",
        _needs("energy"),
    ),
    Variable(
        "energy_transfer_max",
        ("building",),
        "kN m",
        "largest energy transfer",
        "Largest value over time of the transfer = input - kinetic - damping - strain: what the building has given "
        "to its neighbours and contacts.",
        _needs("energy", "transfer"),
    ),
    Variable(
        "energy_transfer_min",
        ("building",),
        "kN m",
        "smallest energy transfer",
        "Smallest value over time of the transfer = input - kinetic - damping - strain; negative where the building "
        "has taken energy from its neighbours.",
        _needs("energy", "transfer"),
    ),
    Variable(
        "contact_work",
        ("pair",),
        "kN m",
        "work taken by contacts",
        "Work the contacts of the pair took in until the end of the record, int F d' dt.",
        _needs("work"),
    ),
    Variable(
        "closing_max",
        _CONTACT,
        "m",
        "largest closing displacement",
        "Largest u_left - u_right; in a run without pounding, the gap that would just not be touched.",
        _needs("closing"),
    ),
    Variable(
        "time_step",
        (),
        "s",
        "time step",
        "Time step of the scenario; in every cube whose steps were chosen for an accuracy, scenario by scenario.",
    ),
    Variable(
        "error_estimate",
        (),
        "1",
        "estimated relative error",
        "Largest relative difference of an output to a run at half the time step, or, where an accuracy chose the "
        "step, at twice; then it is in every cube.",
    ),
    Variable(
        "amplification",
        (),
        "1",
        "amplification of small changes",
        "Largest relative change of an output over that of gaps, contact stiffness and ground motion, by a change of "
        "1e-6 of each; the scenario is ill-conditioned where it is large.",
    ),
    Variable(
        "status",
        (),
        "1",
        "status of the scenario",
        "How the scenario ended; never missing. Only an ok scenario's values are to be trusted.",
        dtype="i1",
        always=True,
        flag_values=tuple(int(s) for s in Status),
        flag_meanings=" ".join(s.label for s in Status),
    ),
    Variable(
        "energy_residual",
        (),
        "1",
        "relative residual of the energy balance",
        "|sum of the buildings' transfers - sum of the contacts' works| at the end of the record, over the largest "
        "absolute value among the energies of the balance (input, damping, kinetic, strain, contact work).",
        _needs("energy", "work"),
    ),
    Variable(
        "steps_per_contact",
        (),
        "1",
        "time steps in the shortest contact",
        "Time steps in the shortest contact, by the duration of an elastic contact of its stiffness, effective mass "
        "and approach velocity; missing where nothing touched.",
        always=True,
    ),
)

#: Every output by name, in the order in which cubes and tables list them.
VARIABLES: dict[str, Variable] = {variable.name: variable for variable in _ALL}

#: Every reducer that some output needs.
REDUCERS: frozenset[str] = frozenset().union(*(variable.needs for variable in _ALL))

#: What a sweep reports where its ``outputs`` are not given.
DEFAULT_OUTPUTS: tuple[str, ...] = (
    "displacement_max",
    "displacement_min",
    "drift_max",
    "storey_shear_max",
    "impact_force_max",
    "impact_count",
    "penetration_max",
    "first_impact_time",
)


def get_variable(name: str | Variable) -> Variable:
    """Return the declared output of that name; a `Variable` is returned as it is."""
    if isinstance(name, Variable):
        return name
    try:
        return VARIABLES[name]
    except (KeyError, TypeError):
        raise InputError(unknown("output", name, VARIABLES)) from None


def check_outputs(names: Iterable[str]) -> tuple[str, ...]:
    """Check the names of outputs, drop repeated ones and put them into the order of the registry."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        msg = f"outputs must be a list of names, not {names!r}; write [{names!r}] for a single one"
        raise InputError(msg)
    asked = {get_variable(name).name for name in names}
    return tuple(name for name in VARIABLES if name in asked)


def cube_variables(names: Iterable[str]) -> tuple[str, ...]:
    """Return the variables of a cube with those outputs: they and the ones that are in every cube."""
    asked = check_outputs(names)
    return tuple(name for name, variable in VARIABLES.items() if variable.always or name in asked)


def reducers_for(names: Iterable[str]) -> frozenset[str]:
    """Return the reducers that the compiled loop must run for those outputs."""
    return frozenset().union(*(VARIABLES[name].needs for name in check_outputs(names)))
