"""The small rows, motions and outputs that several test modules share, so that their kernels are compiled once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from typer.testing import CliRunner

from pounding_sweep.cli.app import app
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import ContactProperties, Scene
from pounding_sweep.output import dataset
from pounding_sweep.records import Record
from pounding_sweep.request.spec import case_variants
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.variables.registry import VARIABLES

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
