"""Parametric sweeps of seismic pounding between adjacent buildings.

Units kN, t, m, s throughout. Names are loaded where they are first used, so that importing the package is fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.deferred import attribute

_HOME = {
    "BoucWen": "pounding_sweep.model.scene",
    "Building": "pounding_sweep.model.scene",
    "Bumper": "pounding_sweep.model.scene",
    "ContactProperties": "pounding_sweep.model.scene",
    "Foundation": "pounding_sweep.model.scene",
    "Link": "pounding_sweep.model.scene",
    "Scene": "pounding_sweep.model.scene",
    "Wall": "pounding_sweep.model.scene",
    "rubber_bumper": "pounding_sweep.model.laws",
    "Law": "pounding_sweep.model.laws",
    "LAWS": "pounding_sweep.model.laws",
    "get_law": "pounding_sweep.model.laws",
    "hertz_stiffness": "pounding_sweep.model.laws",
    "Record": "pounding_sweep.records",
    "read_record": "pounding_sweep.records",
    "find_record": "pounding_sweep.records",
    "list_records": "pounding_sweep.records",
    "near_fault_record": "pounding_sweep.records",
    "pulse_record": "pounding_sweep.records",
    "synthetic_record": "pounding_sweep.records",
    "base_isolated": "pounding_sweep.model.presets",
    "get_preset": "pounding_sweep.model.presets",
    "Range": "pounding_sweep.spec.axes",
    "Sweep": "pounding_sweep.run.sweep",
    "load_sweep": "pounding_sweep.run.sweep",
    "simulate": "pounding_sweep.run.simulate",
    "open_cube": "pounding_sweep.output.netcdf",
    "tradeoff": "pounding_sweep.accuracy.tradeoff",
    "PoundingSweepError": "pounding_sweep.base.errors",
}

#: Packages that are public as they are.
_PACKAGES = ("analysis", "figures")

__all__ = [
    "LAWS",
    "BoucWen",
    "Building",
    "Bumper",
    "ContactProperties",
    "Foundation",
    "Law",
    "Link",
    "PoundingSweepError",
    "Range",
    "Record",
    "Scene",
    "Sweep",
    "Wall",
    "__version__",
    "analysis",
    "base_isolated",
    "figures",
    "find_record",
    "get_law",
    "get_preset",
    "hertz_stiffness",
    "list_records",
    "load_sweep",
    "near_fault_record",
    "open_cube",
    "pulse_record",
    "read_record",
    "rubber_bumper",
    "simulate",
    "synthetic_record",
    "tradeoff",
]

if TYPE_CHECKING:
    from pounding_sweep import analysis, figures
    from pounding_sweep.accuracy.tradeoff import tradeoff
    from pounding_sweep.base.errors import PoundingSweepError
    from pounding_sweep.model.laws import LAWS, Law, get_law, hertz_stiffness, rubber_bumper
    from pounding_sweep.model.presets import base_isolated, get_preset
    from pounding_sweep.model.scene import BoucWen, Building, Bumper, ContactProperties, Foundation, Link, Scene, Wall
    from pounding_sweep.output.netcdf import open_cube
    from pounding_sweep.records import (
        Record,
        find_record,
        list_records,
        near_fault_record,
        pulse_record,
        read_record,
        synthetic_record,
    )
    from pounding_sweep.run.simulate import simulate
    from pounding_sweep.run.sweep import Sweep, load_sweep
    from pounding_sweep.spec.axes import Range


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from pounding_sweep.output.dataset import package_version

        return package_version()
    if name in _PACKAGES:
        return import_module(f"{__name__}.{name}")
    return attribute(__name__, _HOME, name)


def __dir__() -> list[str]:
    return sorted(__all__)
