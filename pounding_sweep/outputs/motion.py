"""Outputs of the motion of floors: displacements, drifts, shears, accelerations, and how near neighbours come."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from pounding_sweep.kernel import bouc_wen, hysteresis, links
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.peaks import Motion, storeys
from pounding_sweep.outputs.declare import UNMEASURED, KernelResults, Reducer, Slot, Variable


def _shear(results: KernelResults) -> np.ndarray:
    elastic = np.asarray(results.slots["drift"] * results.variants.elastic_stiffnesses)
    return np.where(results.scene.yields, results.slots["shear"], elastic) if "shear" in results.slots else elastic


def _ductility(results: KernelResults) -> np.ndarray:
    limit = results.variants.yield_drifts
    return np.asarray(results.slots["drift"] / np.where(np.isfinite(limit), limit, np.nan))


def _residual(results: KernelResults) -> np.ndarray:
    """Drifts without force: (1 - r) p, as far as no storey yields back, at r d = (1 - r) dy; none where it falls."""
    if "slip" not in results.slots:
        return np.zeros((len(results), results.scene.n_dof))
    p, r, limit = results.slots["slip"], results.variants.hardenings, results.variants.yield_drifts
    p = np.where(results.scene.smooth, np.nan, p)  # that goes on flowing while it unloads
    back = np.where(r != 0.0, limit / np.where(r != 0.0, np.abs(r), 1.0), np.inf)
    rest = (1.0 - r) * np.sign(p) * np.minimum(np.abs(p), back)
    return np.asarray(np.where((r < 0.0) & (np.abs(p) > back), np.nan, rest))


_floor = partial(Variable, per="floor", error="motions")
_yielding = partial(Variable, per="floor", error=UNMEASURED, of_yielding=True)
_base = partial(Variable, per="base", error=UNMEASURED, of_foundations=True)
#: Outputs of floors, of storeys that yield, of links, of foundations and of neighbours.
MOTIONS = (
    _floor(
        "displacement_max",
        "m",
        "largest floor displacement",
        "Largest signed displacement of the floor relative to the ground, positive to the right.",
        "umax",
        relative_to=("displacement_min",),
        default=True,
    ),
    _floor(
        "displacement_min",
        "m",
        "smallest floor displacement",
        "Smallest signed displacement of the floor relative to the ground, negative to the left.",
        "umin",
        relative_to=("displacement_max",),
        default=True,
    ),
    _floor(
        "drift_max",
        "m",
        "largest interstorey drift",
        "Largest absolute interstorey displacement |u_i - u_(i-1)|; of storey 1, relative to the ground; on a "
        "foundation relative to it, and less what its rotation gives.",
        "drift",
        default=True,
    ),
    _floor(
        "storey_shear_max",
        "kN",
        "largest storey shear",
        "Largest absolute elastic storey force k |u_i - u_(i-1)|, of a storey that yields that of its hysteresis; "
        "dampers not included; with P-Delta what the columns bear, the push of the weights included.",
        _shear,
        needs=frozenset({"drift", "shear"}),
        default=True,
    ),
    _floor(
        "acceleration_max",
        "m s-2",
        "largest total floor acceleration",
        "Largest absolute total acceleration of the floor (relative + ground); where the contact force jumps at a "
        "touch, the limit just after it counts; where velocities jump, the jump itself does not.",
        "acc",
        error="contacts",
    ),
)
YIELDS = (
    _yielding(
        "ductility_max",
        "1",
        "largest storey ductility",
        "Largest absolute interstorey displacement over the yield drift Vy / k (ductility demand mu); missing "
        "where a storey has no yield strength.",
        _ductility,
        needs=frozenset({"drift"}),
    ),
    _yielding(
        "residual_drift",
        "m",
        "residual interstorey drift",
        "Signed interstorey displacement at which the building comes to rest after the end of the record (RID, "
        "times the storey height): no storey shear is left. 0 where a storey has not yielded; missing where it "
        "falls under the weight above it, and of storeys of Bouc and Wen.",
        _residual,
        needs=frozenset({"residual"}),
        relative_to=("drift_max",),
    ),
)
LINKS = (
    Variable(
        "link_force_max",
        "kN",
        "largest link force",
        "Largest absolute force in the link of the left building's storey to its neighbour, spring and dashpot "
        "together; missing where there is none.",
        "link_force",
        error=UNMEASURED,
        of_links=True,
        per="link",
    ),
)
FOUNDATIONS = (
    _base(
        "foundation_sway_max",
        "m",
        "largest sway of the foundation",
        "Largest absolute displacement of the building's foundation relative to the ground; missing where it has "
        "none. The sway spring's largest force is K_h times it.",
        "sway",
    ),
    _base(
        "foundation_rotation_max",
        "rad",
        "largest rotation of the foundation",
        "Largest absolute rotation of the building's foundation in its rocking; missing where it has none. The "
        "rocking spring's largest moment is K_theta times it.",
        "rotation",
    ),
)
CLOSINGS = (
    Variable(
        "closing_max",
        "m",
        "largest closing displacement",
        "Largest u_left - u_right; in a run without pounding, the gap that would just not be touched.",
        "closing",
        error="motions",
        per="contact",
    ),
)


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
