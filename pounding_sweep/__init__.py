"""Parametric sweeps of seismic pounding between adjacent buildings.

Units kN, t, m, s throughout. Names are loaded where they are first used, so
that importing the package is fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pounding_sweep.deferred import attribute

_HOME = {
    "Building": "pounding_sweep.scene",
    "ContactProperties": "pounding_sweep.scene",
    "Scene": "pounding_sweep.scene",
    "Wall": "pounding_sweep.scene",
    "Law": "pounding_sweep.contact.laws",
    "LAWS": "pounding_sweep.contact.laws",
    "get_law": "pounding_sweep.contact.laws",
    "hertz_stiffness": "pounding_sweep.contact.hertz",
    "Record": "pounding_sweep.records",
    "read_record": "pounding_sweep.records",
    "find_record": "pounding_sweep.records",
    "list_records": "pounding_sweep.records",
    "pulse_record": "pounding_sweep.records",
    "synthetic_record": "pounding_sweep.records",
    "get_preset": "pounding_sweep.presets",
    "Range": "pounding_sweep.sweep.axes",
    "Sweep": "pounding_sweep.sweep.sweep",
    "load_sweep": "pounding_sweep.sweep.sweep",
    "simulate": "pounding_sweep.scenario",
    "open_cube": "pounding_sweep.cube.write",
    "tradeoff": "pounding_sweep.accuracy.tradeoff",
    "PoundingSweepError": "pounding_sweep.errors",
}

__all__ = [
    "LAWS",
    "Building",
    "ContactProperties",
    "Law",
    "PoundingSweepError",
    "Range",
    "Record",
    "Scene",
    "Sweep",
    "Wall",
    "__version__",
    "find_record",
    "get_law",
    "get_preset",
    "hertz_stiffness",
    "list_records",
    "load_sweep",
    "open_cube",
    "pulse_record",
    "read_record",
    "simulate",
    "synthetic_record",
    "tradeoff",
]

if TYPE_CHECKING:
    from pounding_sweep.accuracy.tradeoff import tradeoff
    from pounding_sweep.contact.hertz import hertz_stiffness
    from pounding_sweep.contact.laws import LAWS, Law, get_law
    from pounding_sweep.cube.write import open_cube
    from pounding_sweep.errors import PoundingSweepError
    from pounding_sweep.presets import get_preset
    from pounding_sweep.records import (
        Record,
        find_record,
        list_records,
        pulse_record,
        read_record,
        synthetic_record,
    )
    from pounding_sweep.scenario import simulate
    from pounding_sweep.scene import Building, ContactProperties, Scene, Wall
    from pounding_sweep.sweep.axes import Range
    from pounding_sweep.sweep.sweep import Sweep, load_sweep


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from pounding_sweep.cube.assemble import package_version

        return package_version()
    return attribute(__name__, _HOME, name)


def __dir__() -> list[str]:
    return sorted(__all__)
