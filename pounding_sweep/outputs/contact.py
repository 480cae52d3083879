"""Outputs of contacts: forces, impacts, penetrations, impulses, times and speeds of touches."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from pounding_sweep.kernel.forces import Sample, Touch
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import maximum, where
from pounding_sweep.model.scene import column_shares
from pounding_sweep.outputs.declare import UNMEASURED, KernelResults, Reducer, Slot, Variable


def _column_shear(results: KernelResults, end: int) -> np.ndarray:
    """Return the largest shear at the lower (0) or upper (1) end of struck columns, missing between floors."""
    shares = [column_shares(c.xi)[end] if c.struck >= 0 else np.nan for c in results.scene.contacts]
    return results.get("fmax", "contact") * np.array(shares)


def _first_time(results: KernelResults) -> np.ndarray:
    times = results.get("tfirst", "contact", missing=-1.0)
    return np.where(times < 0, np.nan, times)


_contact = partial(Variable, per="contact", error="contacts")
CONTACTS = (
    _contact(
        "impact_force_max",
        "kN",
        "largest contact force",
        "Largest contact force, pressing positive, 0 where the floors never touched; where the force jumps at a "
        "touch, the limit just after it counts. Missing where floors touched under a law without a force "
        "(velocities jump).",
        "fmax",
        of_force=True,
        default=True,
    ),
    _contact(
        "impact_count",
        "1",
        "number of impacts",
        "Number of onsets of contact, the penetration d = u_left - u_right - gap going from <= 0 to > 0.",
        "count",
        dtype="i4",
        default=True,
    ),
    _contact(
        "penetration_max",
        "m",
        "largest penetration",
        "Largest positive penetration d = u_left - u_right - gap, 0 where the floors never touched. Missing where "
        "floors touched under a law without a force (velocities jump).",
        "dmax",
        of_force=True,
        default=True,
    ),
    _contact(
        "impulse",
        "kN s",
        "impulse of the contact force",
        "Time integral of the contact force over the whole record.",
        "impulse",
    ),
    _contact(
        "first_impact_time",
        "s",
        "time of the first impact",
        "Time of the first onset of contact after the first point of the record; missing where there was none.",
        _first_time,
        needs=frozenset({"first_time"}),
        least=0.01,
        default=True,
    ),
    _contact(
        "approach_speed_max",
        "m s-1",
        "largest approach speed",
        "Largest rate of the penetration d at an onset of contact, 0 where the floors never touched.",
        "vmax",
        least=0.0001,
    ),
    _contact(
        "contact_time",
        "s",
        "time in contact",
        "Total time in contact, from each onset to the release (d > 0), 0 where the floors never touched; impulse "
        "over it is the mean contact force. Where velocities jump, the time that floors rest on each other, which "
        "is rough where they are hardly pressed.",
        "tclosed",
        error=UNMEASURED,
    ),
    _contact(
        "column_shear_bottom_max",
        "kN",
        "largest shear of struck columns, below",
        "Largest shear that the contact force F brings into the struck columns between their lower end and the "
        "struck point, N1 F with N1 = 1 - 3 xi^2 + 2 xi^3; that of the storey's drift comes on top. Missing where "
        "floors meet.",
        partial(_column_shear, end=0),
        needs=frozenset({"force"}),
        error=UNMEASURED,
        of_columns=True,
    ),
    _contact(
        "column_shear_top_max",
        "kN",
        "largest shear of struck columns, above",
        "Largest shear that the contact force F brings into the struck columns between the struck point and their "
        "upper end, N2 F with N2 = 3 xi^2 - 2 xi^3; that of the storey's drift comes on top. Missing where floors "
        "meet.",
        partial(_column_shear, end=1),
        needs=frozenset({"force"}),
        error=UNMEASURED,
        of_columns=True,
    ),
)


def _count(group: Group, at: Touch | Sample) -> None:
    s = group.state
    s["count", at.j] = s["count", at.j] + where(at.fresh, 1.0, group.full(0.0))


def _deepest(group: Group, at: Sample) -> None:
    group.state["dmax", at.j] = maximum(group.state["dmax", at.j], at.d)


def _first(group: Group, j: Any, lanes: Any, time: Any) -> None:
    s = group.state
    s["tfirst", j] = where(lanes & (s["tfirst", j] < 0.0), time, s["tfirst", j])


def _fastest(group: Group, j: Any, lanes: Any, v: Any) -> None:
    s = group.state
    s["vmax", j] = where(lanes, maximum(s["vmax", j], v), s["vmax", j])


def _closed(group: Group, j: Any, lanes: Any, h: Any) -> None:
    s = group.state
    s["tclosed", j] = s["tclosed", j] + where(lanes, h, group.full(0.0))


def _closed_substep(group: Group) -> None:
    for j in group.each_contact():
        _closed(group, j, ~(group.state["mode", j] == 0.0), group.state["h"])


REDUCERS = (
    Reducer("force", (Slot("fmax", "contact"),), where="touch", looks="force"),
    Reducer("count", (Slot("count", "contact"),), where="touch", touch=_count, plain=_count),
    Reducer("penetration", (Slot("dmax", "contact"),), where="touch", looks="depth", plain=_deepest),
    Reducer("impulse", (Slot("impulse", "contact"),), where="touch"),
    Reducer(
        "first_time",
        (Slot("tfirst", "contact", lambda group, j: -1.0),),
        where="touch",
        touch=lambda group, at: _first(group, at.j, at.lanes, group.clock(at.h)),
        plain=lambda group, at: _first(group, at.j, at.fresh, at.time),
    ),
    Reducer(
        "approach_speed",
        (Slot("vmax", "contact"),),
        where="touch",
        touch=lambda group, at: _fastest(group, at.j, at.lanes, at.v),
        plain=lambda group, at: _fastest(group, at.j, at.fresh, at.speed),
    ),
    Reducer(
        "time",
        (Slot("tclosed", "contact"),),
        where="touch",
        substep=_closed_substep,
        plain=lambda group, at: _closed(group, at.j, at.closed, at.h),
    ),
)
