"""The small rows, motions, outputs and hand-made cubes that several test modules share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from typer.testing import CliRunner

from pounding_sweep.cli.app import app
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import get_law, realised_restitution
from pounding_sweep.model.scene import ContactProperties, Scene, Wall
from pounding_sweep.output import dataset
from pounding_sweep.records import Record
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import case_variants, to_json
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.variables.registry import VARIABLES, inner_shape, scatter_contact, scatter_dof

OUTPUTS = ["displacement_max", "displacement_min", "impact_force_max", "impact_count", "first_impact_time"]
#: Outputs that need every reducer but the closing displacement: those of `simulate`.
EVERY = [name for name, variable in VARIABLES.items() if variable.needs - {"closing"} and name != "energy_residual"]
#: Axes of a small sweep of three laws.
AXES = {
    "laws": ["linear", "none", "kelvin_voigt"],
    "gaps": [0.0005, 0.5, 0.002, 0.01, 0.02],
    "stiffness_factors": [1.0, 0.5],
    "restitutions": [0.3, 0.5, 0.7],
    "method": "rk4",
    "dt": 0.005,
    "rest": 0.0,
    "outputs": OUTPUTS,
}

#: A sweep of two buildings in a file, to which its gaps and the seconds of its record are added.
TOML_PAIR = """\
[scene]
gaps = [0.006]
contact = {{ linear_stiffness = 8e5, restitution = 0.6 }}
row = [
    {{ name = "a", masses = [120.0, 90.0], stiffnesses = [1.5e5, 1.2e5] }},
    {{ name = "b", masses = [80.0, 110.0], stiffnesses = [2.4e5, 2.0e5] }},
]
[sweep]
records = [{{ pulse = "sine", amplitude = 4.0, period = 0.6, dt = 0.02, duration = {seconds} }}]
laws = ["kelvin_voigt", "none"]
"""


def row(gaps=(0.01, 0.02)):
    """Three buildings of one storey with periods 0.63, 0.36 and 0.63 s."""
    return Scene(
        [Building("a", [100.0], [1.0e4]), Building("b", [80.0], [2.5e4]), Building("c", [120.0], [1.2e4])],
        gaps=gaps,
        contact=ContactProperties(linear_stiffness=2e5, hertz_stiffness=1e6, restitution=0.5),
    )


def make(**changes):
    """The small sweep of that row."""
    return Sweep(**{"scene": row(), "records": motions(), **AXES, **changes})


def same(found, expected):
    """Compare two cubes bit for bit."""
    assert list(found.data_vars) == list(expected.data_vars)
    assert set(found.coords) == set(expected.coords)
    for name in expected.variables:
        a, b = found[name], expected[name]
        assert (a.dims, a.dtype) == (b.dims, b.dtype), name
        assert a.values.tobytes() == b.values.tobytes(), name


def pair(gap=0.006):
    """Two buildings of two storeys with periods 0.27 and 0.22 s."""
    return Scene(
        [Building("a", [120.0, 90.0], [1.5e5, 1.2e5]), Building("b", [80.0, 110.0], [2.4e5, 2.0e5])],
        gaps=[gap],
        contact=ContactProperties(linear_stiffness=8e5, hertz_stiffness=7.5e6, restitution=0.6),
    )


def yielding_pair(gap=0.003):
    """The pair with storeys that yield, but for a roof; without hardening and with dampers that soften on the right."""
    a, b = pair().buildings
    return Scene(
        [
            replace(a, yield_strengths=[220.0, 120.0], hardening=0.05),
            replace(b, yield_strengths=[180.0, np.inf], damping_stiffness="tangent"),
        ],
        gaps=[gap],
        contact=pair().contact,
    )


def motions():
    """A fading and a steady sine, of different steps and lengths, in numbers that all processors agree on."""
    t = np.arange(150) * 0.02
    return [
        Record("one", 0.02, np.round(3.0 * np.sin(7.0 * t) * np.exp(-0.3 * t), 9)),
        Record("two", 0.01, np.round(2.0 * np.sin(5.5 * t), 9)),
    ]


def run_in_any_company(kernel, record, given):
    """Run 70 scenarios, then in another order and in parts: no result may tell it; return the first."""
    room = np.zeros(((record.n_points - 1) * kernel.numerics.steps(record) + 1, 100)) if kernel.history else None
    found = kernel.run(record, **given, history=room)
    order = np.random.default_rng(1).permutation(70)
    for some in (order, slice(0, 1), slice(5, 22), slice(30, 31)):
        again = kernel.run(record, **{name: values[some] for name, values in given.items()}, history=room)
        for name, values in found.items():
            np.testing.assert_array_equal(again[name], values[some], err_msg=name)
    return found


def call(*words, code=0):
    """Run the command line in this process; returns what it printed, its exit code checked."""
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == code, done.output
    return done


def scene_of_case(scene, case):
    """The scene with the building properties of a case."""
    variants, index = case_variants(scene, [case])
    return variants.scene_of(index[0])


class CubeAxis(NamedTuple):
    """One dimension of a cube that is made by hand."""

    name: str
    values: Sequence[Any]
    units: str = ""
    long_name: str = ""

    @property
    def size(self) -> int:
        return len(self.values)


def assemble(scene, axes, arrays, attributes=None, extra=None):
    """Label results along axes."""
    labels = {a.name: ((a.name,), a.values, {"units": a.units, "long_name": a.long_name or a.name}) for a in axes}
    return dataset.assemble(scene, labels, arrays, attributes, extra)


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
