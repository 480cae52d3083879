"""Outputs of contacts: forces, impacts, penetrations, impulses, times and speeds of touches.

The text of these reducers stands with the law's in the templates, behind switches ``HAS_...``.
"""

from __future__ import annotations

import numpy as np

from pounding_sweep.outputs.declare import CONTACT, Reducer, Slot, Variable, needs
from pounding_sweep.outputs.readout import KernelResults, contacts


def _first_time(kept: KernelResults) -> np.ndarray:
    times = kept.contacts("tfirst", missing=-1.0)
    return np.where(times < 0, np.nan, times)


#: Of outputs of contacts.
CONTACTS = (
    Variable(
        "impact_force_max",
        CONTACT,
        "kN",
        "largest contact force",
        "Largest contact force, pressing positive, 0 where the floors never touched; where the force jumps at a "
        "touch, the limit just after it counts. Missing where floors touched under a law without a force (velocities "
        "jump).",
        needs("force"),
        contacts("fmax"),
        error="contacts",
        of_force=True,
        default=True,
    ),
    Variable(
        "impact_count",
        CONTACT,
        "1",
        "number of impacts",
        "Number of onsets of contact, the penetration d = u_left - u_right - gap going from <= 0 to > 0.",
        needs("count"),
        lambda kept: kept.whole_contacts("count"),
        error="contacts",
        dtype="i4",
        default=True,
    ),
    Variable(
        "penetration_max",
        CONTACT,
        "m",
        "largest penetration",
        "Largest positive penetration d = u_left - u_right - gap, 0 where the floors never touched. Missing where "
        "floors touched under a law without a force (velocities jump).",
        needs("penetration"),
        contacts("dmax"),
        error="contacts",
        of_force=True,
        default=True,
    ),
    Variable(
        "impulse",
        CONTACT,
        "kN s",
        "impulse of the contact force",
        "Time integral of the contact force over the whole record.",
        needs("impulse"),
        contacts("impulse"),
        error="contacts",
    ),
    Variable(
        "first_impact_time",
        CONTACT,
        "s",
        "time of the first impact",
        "Time of the first onset of contact after the first point of the record; missing where there was none.",
        needs("first_time"),
        _first_time,
        error="contacts",
        default=True,
    ),
    Variable(
        "approach_speed_max",
        CONTACT,
        "m s-1",
        "largest approach speed",
        "Largest rate of the penetration d at an onset of contact, 0 where the floors never touched.",
        needs("approach_speed"),
        contacts("vmax"),
        error="contacts",
    ),
)


def _of_contacts(name: str, slot: str, first: str = "", looks: str = "") -> Reducer:
    return Reducer(name, (Slot(slot, "contact", first),), where="touch", looks=looks)


REDUCERS = (
    _of_contacts("force", "fmax", looks="force"),
    _of_contacts("count", "count"),
    _of_contacts("penetration", "dmax", looks="depth"),
    _of_contacts("impulse", "impulse"),
    _of_contacts("first_time", "tfirst", first="-1.0"),
    _of_contacts("approach_speed", "vmax"),
)
