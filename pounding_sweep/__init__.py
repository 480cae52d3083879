"""Parametric sweeps of seismic pounding between adjacent buildings.

Units kN, t, m, s throughout. Names are loaded where they are first used, so that importing the package is fast.
"""

# ruff: noqa: F401  the names for type checkers are those of `_HOME`
from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pounding_sweep.base import attribute

_HOME = {
    name: f"pounding_sweep.{module}"
    for module, names in {
        "accuracy.tradeoff": "tradeoff",
        "analysis.pushover": "backbone_from_pushover",
        "base.errors": "PoundingSweepError",
        "model.building": "Building Foundation Infill",
        "model.frames": "building_from_modes building_from_opensees typical_building",
        "model.laws": "LAWS Law get_law hertz_stiffness rubber_bumper",
        "model.presets": "base_isolated get_preset",
        "model.scene": "Bumper ContactProperties Link Restrainer Scene Wall",
        "output.netcdf": "open_cube",
        "pages.report": "report",
        "pages.view": "view",
        "records": "Record find_record list_records near_fault_record pulse_record read_record synthetic_record",
        "run.cyclic": "cyclic_test",
        "run.simulate": "simulate",
        "run.sweep": "Sweep load_sweep",
        "request.axes": "Range",
    }.items()
    for name in names.split()
}
#: Packages that are public as they are.
_PACKAGES = ("analysis", "figures")

__all__ = ["__version__", *_PACKAGES, *_HOME]  # noqa: PLE0604  all are

if TYPE_CHECKING:
    from pounding_sweep import analysis, figures
    from pounding_sweep.accuracy.tradeoff import tradeoff
    from pounding_sweep.analysis.pushover import backbone_from_pushover
    from pounding_sweep.base.errors import PoundingSweepError
    from pounding_sweep.model.building import Building, Foundation, Infill
    from pounding_sweep.model.frames import building_from_modes, building_from_opensees, typical_building
    from pounding_sweep.model.laws import LAWS, Law, get_law, hertz_stiffness, rubber_bumper
    from pounding_sweep.model.presets import base_isolated, get_preset
    from pounding_sweep.model.scene import Bumper, ContactProperties, Link, Restrainer, Scene, Wall
    from pounding_sweep.output.netcdf import open_cube
    from pounding_sweep.pages.report import report
    from pounding_sweep.pages.view import view
    from pounding_sweep.records import (
        Record,
        find_record,
        list_records,
        near_fault_record,
        pulse_record,
        read_record,
        synthetic_record,
    )
    from pounding_sweep.request.axes import Range
    from pounding_sweep.run.cyclic import cyclic_test
    from pounding_sweep.run.simulate import simulate
    from pounding_sweep.run.sweep import Sweep, load_sweep


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from pounding_sweep.output.dataset import package_version

        return package_version()
    if name in _PACKAGES:
        return import_module(f"{__name__}.{name}")
    return attribute(__name__, _HOME, name)


def __dir__() -> list[str]:
    return sorted(__all__)
