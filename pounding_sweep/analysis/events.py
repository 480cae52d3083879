"""What can happen in a scenario that a fragility is asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pounding_sweep.base.errors import InputError, unknown


@dataclass(frozen=True)
class Event:
    """Something that happens in a scenario or does not."""

    key: str  # name in calls and tables
    title: str  # in words, ``{level}`` standing for the level with its unit
    variable: str  # output that must exceed the level; "" for a touch, which needs none
    per: str  # whom it happens to, "pair" or "building"; any storey counts
    units: str = ""  # unit of the level

    def words(self, level: float | None) -> str:
        """Return the event in words."""
        return self.title.format(level="" if level is None else f"{level:g} {self.units}")


#: Every event by key.
EVENTS: dict[str, Event] = {
    event.key: event
    for event in (
        Event("touch", "the pair touches", "", "pair"),
        Event("force", "contact force above {level}", "impact_force_max", "pair", "kN"),
        Event("penetration", "penetration above {level}", "penetration_max", "pair", "m"),
        Event("drift", "interstorey drift above {level}", "drift_max", "building", "m"),
        Event("shear", "storey shear above {level}", "storey_shear_max", "building", "kN"),
        Event("acceleration", "floor acceleration above {level}", "acceleration_max", "building", "m s-2"),
    )
}


def get_event(key: str, level: float | None) -> Event:
    """Return an event by key."""
    if key not in EVENTS:
        raise InputError(unknown("event", key, EVENTS))
    event = EVENTS[key]
    if event.variable and (level is None or not math.isfinite(level) or level < 0.0):
        raise InputError(
            f"event {key!r} needs a level that {event.variable} must exceed ({event.units}), not {level!r}"
        )
    if not event.variable and level is not None:
        raise InputError(f"event {key!r} takes no level; leave out level = {level!r}, or give an event that has one")
    return event
