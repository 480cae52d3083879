"""Cubes made by hand for the tests of comparisons: labelled as sweeps label them, with numbers of the test's own."""

from __future__ import annotations

import numpy as np
from scenes import CubeAxis, assemble

from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import get_law, realised_restitution
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import to_json
from pounding_sweep.variables.registry import VARIABLES, inner_shape, scatter_contact, scatter_dof

LAWS = ["none", "linear", "hertz_damped"]
MODES = ("fundamental_period", "first_damping_ratio")
PGA = {"one": 3.0, "two": 2.0, "three": 4.0}


def low_and_high():
    """Two storeys beside one, and a wall: a storey that does not exist, a pair that meets at one floor only."""
    return Scene(
        [Building("a", [100.0, 80.0], [2e4, 1e4]), Building("b", [90.0], [3e4], 0.02), Wall()], gaps=[0.01, 0.02]
    )


def hand_cube(axes, fill, *, scene=None, status=None, coords=None, attributes=None):
    """Return a cube; `axes` maps names to values, `fill` variables to arrays or functions of a shape."""
    scene = scene or low_and_high()
    units = {"gap": "m", "law": "", "record": "", "case": "1"}
    listed = [CubeAxis(name, values, units.get(name, "1")) for name, values in axes.items()]
    outer = tuple(len(values) for values in axes.values())
    arrays = {}
    for name, given in fill.items():
        shape = (*outer, *inner_shape(name, scene))
        values = np.broadcast_to(given(shape) if callable(given) else given, shape)
        arrays[name] = np.where(_there(name, scene), values, VARIABLES[name].fill).astype(VARIABLES[name].dtype)
    arrays["status"] = np.zeros(outer, np.int8) if status is None else np.asarray(status, np.int8)
    arrays["steps_per_contact"] = np.full(outer, np.nan)
    extra = dict(coords or {})
    modes = ([b.periods[0] for b in scene.buildings], [np.ravel(b.damping_ratio)[0] for b in scene.buildings])
    extra |= {n: (("building",), np.array(m), {}) for n, m in zip(MODES, modes, strict=True) if n not in extra}
    if {"law", "restitution"} <= {*axes}:
        realised = [realised_restitution(get_law(law), np.array(axes["restitution"])) for law in axes["law"]]
        extra["restitution_realised"] = (("law", "restitution"), np.array(realised), {})
    if "record" in axes:
        pga = [PGA.get(name, 1.0) for name in axes["record"]]
        extra["record_pga"] = (("record",), np.array(pga), {"units": "m s-2"})
    return assemble(scene, listed, arrays, attributes, extra)


def _there(name, scene):
    """Tell which floors or contacts exist."""
    dims = VARIABLES[name].dims
    if dims == ("building", "storey"):
        return scatter_dof(np.ones(scene.n_dof, int), scene) == 1
    if dims == ("pair", "storey"):
        return scatter_contact(np.ones(len(scene.contacts), int), scene) == 1
    return True


def random_fill(seed, *names, low=0.1, high=2.0):
    """Return positive numbers for those variables, whole ones for counts."""
    rng = np.random.default_rng(seed)
    fill = {}
    for name in names:
        whole = VARIABLES[name].dtype == "i4"
        fill[name] = (
            (lambda shape: rng.integers(0, 4, shape)) if whole else (lambda shape: rng.uniform(low, high, shape))
        )
    return fill


def sweep_attribute(scene, records, **axes):
    """Return what a cube of such a sweep carries of it."""
    return {"sweep": to_json(build_spec(scene=scene, records=records, **axes))}
