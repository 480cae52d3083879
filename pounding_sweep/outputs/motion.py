"""Outputs of the motion of floors: displacements, drifts, shears, accelerations, and how near neighbours come."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.peaks import Motion, storeys
from pounding_sweep.outputs.declare import CONTACT, FLOOR, Reducer, Slot, Variable, needs
from pounding_sweep.outputs.readout import contacts, floors, scatter_dof

#: Of outputs of floors.
MOTIONS = (
    Variable(
        "displacement_max",
        FLOOR,
        "m",
        "largest floor displacement",
        "Largest signed displacement of the floor relative to the ground, positive to the right.",
        needs("displacement"),
        floors("umax"),
        error="motions",
        relative_to=("displacement_min",),
        default=True,
    ),
    Variable(
        "displacement_min",
        FLOOR,
        "m",
        "smallest floor displacement",
        "Smallest signed displacement of the floor relative to the ground, negative to the left.",
        needs("displacement"),
        floors("umin"),
        error="motions",
        relative_to=("displacement_max",),
        default=True,
    ),
    Variable(
        "drift_max",
        FLOOR,
        "m",
        "largest interstorey drift",
        "Largest absolute interstorey displacement |u_i - u_(i-1)|; of storey 1, relative to the ground.",
        needs("drift"),
        floors("drift"),
        error="motions",
        default=True,
    ),
    Variable(
        "storey_shear_max",
        FLOOR,
        "kN",
        "largest storey shear",
        "Largest absolute elastic storey force k |u_i - u_(i-1)|, dampers not included.",
        needs("drift"),
        lambda kept: scatter_dof(kept.slots["drift"] * kept.variants.stiffnesses, kept.scene),
        error="motions",
        default=True,
    ),
    Variable(
        "acceleration_max",
        FLOOR,
        "m s-2",
        "largest total floor acceleration",
        "Largest absolute total acceleration of the floor (relative + ground); where the contact force jumps at a "
        "touch, the limit just after it counts; where velocities jump, the jump itself does not.",
        needs("acceleration"),
        floors("acc"),
        error="contacts",
    ),
)
#: Of outputs of neighbours.
CLOSINGS = (
    Variable(
        "closing_max",
        CONTACT,
        "m",
        "largest closing displacement",
        "Largest u_left - u_right; in a run without pounding, the gap that would just not be touched.",
        needs("closing"),
        contacts("closing"),
        error="motions",
    ),
)


def _displacements(group: Group, straight: bool) -> Iterator[Motion]:
    for i in group.each(group.spec.n_dof, straight):
        yield Motion(("umax", i), ("umin", i), False, partial(_read, group, i))


def _drifts(group: Group, straight: bool) -> Iterator[Motion]:
    del straight
    for i, below in storeys(group):
        yield Motion(("drift", i), None, True, partial(_read, group, i, below=below))


def _read(group: Group, i: Any, name: str, below: Any = None) -> Any:
    x = group.state[name, i]
    return x if below is None else x - group.state[name, below]


def _closings(group: Group, straight: bool) -> Iterator[Motion]:
    for j in group.each_closing(straight):
        yield Motion(("closing", j), None, False, partial(group.between, j=j))


def _still(group: Group, i: Any) -> Any:
    return group.state["u", i]


REDUCERS: tuple[Reducer, ...] = (
    Reducer("displacement", (Slot("umax", "floor", _still), Slot("umin", "floor", _still)), follows=_displacements),
    Reducer("drift", (Slot("drift", "floor"),), follows=_drifts),
    Reducer("acceleration", (Slot("acc", "floor"),), looks="ends", quick=True),
    Reducer("closing", (Slot("closing", "contact"),), where="neighbours", follows=_closings),
)
