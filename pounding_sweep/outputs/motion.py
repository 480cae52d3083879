"""Outputs of the motion of floors: displacements, drifts, shears, accelerations, and how near neighbours come."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from pounding_sweep.kernel import bouc_wen, hysteresis, links
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.peaks import Motion, storeys
from pounding_sweep.outputs.declare import CONTACT, FLOOR, UNMEASURED, Reducer, Slot, Variable, needs
from pounding_sweep.outputs.readout import KernelResults, contacts, floors, scatter_base, scatter_dof, scatter_link

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
        "Largest absolute interstorey displacement |u_i - u_(i-1)|; of storey 1, relative to the ground; on a "
        "foundation relative to it, and less what its rotation gives.",
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
        "Largest absolute elastic storey force k |u_i - u_(i-1)|, of a storey that yields that of its hysteresis; "
        "dampers not included; with P-Delta what the columns bear, the push of the weights included.",
        needs("drift", "shear"),
        lambda kept: scatter_dof(_shear(kept), kept.scene),
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
#: Of outputs of storeys that yield.
YIELDS = (
    Variable(
        "ductility_max",
        FLOOR,
        "1",
        "largest storey ductility",
        "Largest absolute interstorey displacement over the yield drift Vy / k (ductility demand mu); missing where a "
        "storey has no yield strength.",
        needs("drift"),
        lambda kept: scatter_dof(_ductility(kept), kept.scene),
        error=UNMEASURED,
        of_yielding=True,
    ),
    Variable(
        "residual_drift",
        FLOOR,
        "m",
        "residual interstorey drift",
        "Signed interstorey displacement at which the building comes to rest after the end of the record (RID, times "
        "the storey height): no storey shear is left. 0 where a storey has not yielded; missing where it falls under "
        "the weight above it, and of storeys of Bouc and Wen.",
        needs("residual"),
        lambda kept: scatter_dof(_residual(kept), kept.scene),
        error=UNMEASURED,
        relative_to=("drift_max",),
        of_yielding=True,
    ),
)
#: Of outputs of links.
LINKS = (
    Variable(
        "link_force_max",
        CONTACT,
        "kN",
        "largest link force",
        "Largest absolute force in the link of the left building's storey to its neighbour, spring and dashpot "
        "together; missing where there is none.",
        needs("link_force"),
        lambda kept: scatter_link(kept.get("link_force", len(kept.scene.linked_floors)), kept.scene),
        error=UNMEASURED,
        of_links=True,
    ),
)
#: Of outputs of foundations.
FOUNDATIONS = (
    Variable(
        "foundation_sway_max",
        ("building",),
        "m",
        "largest sway of the foundation",
        "Largest absolute displacement of the building's foundation relative to the ground; missing where it has none. "
        "The sway spring's largest force is K_h times it.",
        needs("foundation"),
        lambda kept: scatter_base(kept.get("sway", len(kept.scene.foundations)), kept.scene),
        error=UNMEASURED,
        of_foundations=True,
    ),
    Variable(
        "foundation_rotation_max",
        ("building",),
        "rad",
        "largest rotation of the foundation",
        "Largest absolute rotation of the building's foundation in its rocking; missing where it has none. The rocking "
        "spring's largest moment is K_theta times it.",
        needs("foundation"),
        lambda kept: scatter_base(kept.get("rotation", len(kept.scene.foundations)), kept.scene),
        error=UNMEASURED,
        of_foundations=True,
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


def _shear(kept: KernelResults) -> np.ndarray:
    elastic = np.asarray(kept.slots["drift"] * kept.variants.elastic_stiffnesses)
    return np.where(kept.scene.yields, kept.slots["shear"], elastic) if "shear" in kept.slots else elastic


def _ductility(kept: KernelResults) -> np.ndarray:
    limit = kept.variants.yield_drifts
    return np.asarray(kept.slots["drift"] / np.where(np.isfinite(limit), limit, np.nan))


def _residual(kept: KernelResults) -> np.ndarray:
    """Drifts without force: (1 - r) p, as far as no storey yields back, at r d = (1 - r) dy; none where it falls."""
    if "slip" not in kept.slots:
        return np.zeros((len(kept), kept.scene.n_dof))
    p, r, limit = kept.slots["slip"], kept.variants.hardenings, kept.variants.yield_drifts
    p = np.where(kept.scene.smooth, np.nan, p)  # that goes on flowing while it unloads
    back = np.where(r != 0.0, limit / np.where(r != 0.0, np.abs(r), 1.0), np.inf)
    rest = (1.0 - r) * np.sign(p) * np.minimum(np.abs(p), back)
    return np.asarray(np.where((r < 0.0) & (np.abs(p) > back), np.nan, rest))


def _displacements(group: Group, straight: bool) -> Iterator[Motion]:
    for i in group.each(group.spec.n_dof, straight):
        yield Motion(("umax", i), ("umin", i), False, partial(_read, group, i))


def _drifts(group: Group, straight: bool) -> Iterator[Motion]:
    del straight
    for i, below in storeys(group):
        yield Motion(("drift", i), None, True, partial(group.drift, i, below))


def _read(group: Group, i: Any, name: Any) -> Any:
    return group.floor(name, i)


def _shears(group: Group, straight: bool) -> Iterator[Motion]:
    for i, below in hysteresis.each_storey(group, straight):
        # it turns with the drift, which is asked for too
        shear = _borne if group.spec.p_delta else hysteresis.shear
        yield Motion(("shear", i), None, True, partial(shear, group, i, below), shear=i, alone=False)
    for i, below, n in bouc_wen.each_storey(group):
        yield Motion(("shear", i), None, True, partial(_smooth_shear, group, i, below, n))


def _smooth_shear(group: Group, i: int, below: int | None, n: float, name: str) -> Any:
    found = bouc_wen.shear(group, i, below, n, name)
    return found + group.prop("geometric", i) * hysteresis.drift(group, i, below, name) if group.spec.p_delta else found


def _borne(group: Group, i: Any, below: Any, name: Any = "u") -> Any:
    """Shear of a storey that bears what the weights above it push too."""
    pushed = group.prop("geometric", i) * hysteresis.drift(group, i, below, name)
    return hysteresis.shear(group, i, below, name) + pushed


def _bases(group: Group, straight: bool) -> Iterator[Motion]:
    del straight
    for q, b in enumerate(group.spec.foundations):
        for name, i in zip(("sway", "rotation"), group.spec.base(b) or (), strict=True):
            yield Motion((name, q), None, True, partial(_read, group, i))


def _closings(group: Group, straight: bool) -> Iterator[Motion]:
    for j in group.each_closing(straight):
        yield Motion(("closing", j), None, False, partial(group.between, j=j))


def _links(group: Group, straight: bool) -> Iterator[Motion]:
    del straight
    for j, ends in group.each_link():
        yield Motion(("link_force", j), None, True, links.reader(group, j, ends), pulls=True)


def _still(group: Group, i: Any) -> Any:
    return group.state["u", i]


REDUCERS: tuple[Reducer, ...] = (
    Reducer("displacement", (Slot("umax", "floor", _still), Slot("umin", "floor", _still)), follows=_displacements),
    Reducer("drift", (Slot("drift", "floor"),), follows=_drifts),
    Reducer("shear", (Slot("shear", "floor"),), where="yields", follows=_shears),
    Reducer("residual", (Slot("slip", "floor"),), where="yields"),
    Reducer("acceleration", (Slot("acc", "floor"),), looks="ends"),
    Reducer("link_force", (Slot("link_force", "link"),), where="linked", follows=_links, step=links.sample),
    Reducer("foundation", (Slot("sway", "base"), Slot("rotation", "base")), where="founded", follows=_bases),
    Reducer("closing", (Slot("closing", "contact"),), where="neighbours", follows=_closings),
)
