"""Outputs of contacts: forces, impacts, penetrations, impulses, times and speeds of touches.

The text of these reducers stands with the law's in the templates, behind switches ``HAS_...``.
"""

from __future__ import annotations

import numpy as np

from pounding_sweep.outputs.declare import CONTACT, UNMEASURED, Reducer, Slot, Variable, needs
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
    Variable(
        "contact_time",
        CONTACT,
        "s",
        "time in contact",
        "Total time in contact, from each onset to the release (d > 0), 0 where the floors never touched; impulse over "
        "it is the mean contact force. Where velocities jump, the time that floors rest on each other, which is rough "
        "where they are hardly pressed.",
        needs("time"),
        contacts("tclosed"),
        error=UNMEASURED,
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
    Reducer(
        "time",
        (Slot("tclosed", "contact"),),
        where="touch",
        substep="""\
for j in range(NC):
    for l in range(L):
        S[TCLOSED + j * L + l] += S[HL + l] if I[MODE + j * L + l] != 0 else 0.0""",
        plain="S[TCLOSED + {j0} + l] += h if closed else 0.0",
    ),
)
