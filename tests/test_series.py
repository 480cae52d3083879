"""Steps of exact flight beside contacts whose forces are polynomials: exact at any step, whatever happens within it."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from scenes import motions, pair
from test_columns import buildings_of

import pounding_sweep as ps
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.scene import Scene
from pounding_sweep.variables.registry import Status, reducers_for

POLYNOMIAL = [
    "linear",
    "kelvin_voigt",
    "kelvin_voigt_tension",
    "linear_viscoelastic",
    "modified_kelvin",
    "modified_kelvin_voigt",
]
OUTPUTS = ["displacement_max", "drift_max", "acceleration_max", "impact_force_max", "impact_count"]
OUTPUTS += ["penetration_max", "impulse", "contact_time", "energy_input", "energy_damping", "contact_work"]
OUTPUTS += ["energy_transfer_max", "energy_transfer_min"]


def found(scene, law, record, stiffness, restitution, outputs=OUTPUTS):
    """What the kernels' own source, run as Python, finds at the record's own step."""
    numerics = Numerics("exact", record.dt)
    kernel = RowKernel(scene, LAWS[law], numerics, reducers_for(outputs))
    assert kernel.shape.series > 0
    n, gaps = len(stiffness), np.tile(scene.gaps, (len(stiffness), 1))
    given = {"stiffness": np.array(stiffness), "restitution": np.array(restitution)}
    assert n <= LANES
    return kernel.run(record, scale=np.ones(n), gaps=gaps, **given, twin=True)


def test_which_laws_have_series():
    def order(law, precision):
        numerics = Numerics("exact", 0.01, precision=precision)
        return RowKernel(pair(), LAWS[law], numerics, reducers_for(OUTPUTS)).shape.series

    assert {law for law in LAWS if order(law, "float64")} == set(POLYNOMIAL)
    assert order("linear", "float32") < order("linear", "float64")


@pytest.mark.parametrize(
    "law", [law if law == "kelvin_voigt" else pytest.param(law, marks=pytest.mark.slow) for law in POLYNOMIAL]
)
def test_contacts_are_exact_at_the_step_of_the_record(law):
    scene, record = pair(0.003), motions()[0]
    record = ps.Record("short", record.dt, 2.0 * record.acceleration[:31])
    k, e = 1.5e6, 0.5
    ours = found(scene, law, record, [k], [e])
    other = reference.run(
        buildings_of(scene), scene.gaps, record.acceleration, record.dt, law, k, e, rtol=1e-12, atol=1e-14
    )
    assert other["impact_count"][0].sum() > 1
    np.testing.assert_array_equal(ours["count"][0], other["impact_count"][0])
    for name, want in (
        ("fmax", other["impact_force_max"][0]),
        ("dmax", other["penetration_max"][0]),
        ("impulse", other["impulse"][0]),
        ("tclosed", other["contact_time"][0]),
        ("e_in", other["energy_input"]),
        ("e_damp", other["energy_damping"]),
        ("work", other["contact_work"][0]),
        ("tmax", other["energy_transfer_max"]),
        ("tmin", other["energy_transfer_min"]),
    ):
        atol = 1e-8 * np.abs(other["energy_input"]).max() if name == "work" else 1e-8 * np.abs(want).max()
        np.testing.assert_allclose(ours[name][0], want, rtol=1e-7, atol=atol, err_msg=name)
    for name, key in (("acc", "acceleration_max"), ("drift", "drift_max"), ("umax", "displacement_max")):
        np.testing.assert_allclose(ours[name][0], np.concatenate(other[key]), rtol=1e-5, err_msg=name)


def storey(period, mass):
    return Building(f"T = {period} s", [mass], [mass * (2.0 * np.pi / period) ** 2], 0.05)


@pytest.mark.parametrize(
    ("right", "stiffness", "points"),
    [(storey(0.3, 100.0), 1e9, 31), (storey(0.3, 0.01), 1e5, 31), (storey(0.02, 100.0), 1e6, 61)],
    ids=["stiff contact", "mass ratio", "short period"],
)
def test_rows_that_are_right_at_any_step_are_ok(right, stiffness, points):
    """Neither contacts much shorter than the step nor a period of four steps make series err."""
    scene, record = Scene([storey(0.44, 100.0), right], [1e-3]), motions()[0]
    ground, outputs = 2.0 * record.acceleration[:points], ["impact_force_max", "impact_count", "impulse"]
    kernel = RowKernel(scene, LAWS["kelvin_voigt"], Numerics("exact", 5e-3), reducers_for(outputs))
    given = {"gaps": np.array([scene.gaps]), "stiffness": np.array([stiffness]), "restitution": np.array([0.6])}
    record = ps.Record("short", record.dt, ground)
    ours = variables_of(kernel, kernel.run(record, scale=np.ones(1), twin=True, **given), outputs, record)
    assert ours["status"].tolist() == [Status.OK]
    other = reference.run(
        buildings_of(scene), scene.gaps, ground, record.dt, "kelvin_voigt", stiffness, 0.6, rtol=1e-12, atol=1e-15
    )
    assert other["impact_count"][0].sum() > 1
    for name in outputs:
        np.testing.assert_allclose(ours[name].ravel(), other[name][0], rtol=1e-7, err_msg=name)


@pytest.mark.slow
def test_a_force_that_ends_and_returns_within_a_step():
    """Two floors part so fast that the damper would pull, and are pressed together again before the step ends."""
    scene = Scene(
        [Building("a", [100.0], [4e4]), Building("b", [150.0], [6e4]), Building("c", [90.0], [3e4])], [1e-4] * 2
    )
    t = np.arange(60) * 0.02
    record = ps.Record("hard", 0.02, 6.0 * np.sin(9.0 * t) + 4.0 * np.sin(23.0 * t))
    ours = found(scene, "kelvin_voigt", record, [3e4, 2e5, 1e6], [0.2, 0.3, 0.5])
    for i, (k, e) in enumerate(((3e4, 0.2), (2e5, 0.3), (1e6, 0.5))):
        other = reference.run(
            buildings_of(scene), scene.gaps, record.acceleration, 0.02, "kelvin_voigt", k, e, rtol=1e-12, atol=1e-14
        )
        want = {name: np.concatenate(other[name]) for name in ("impulse", "contact_time", "impact_count")}
        np.testing.assert_array_equal(ours["count"][i], want["impact_count"])
        np.testing.assert_allclose(ours["impulse"][i], want["impulse"], rtol=1e-7)
        np.testing.assert_allclose(ours["tclosed"][i], want["contact_time"], rtol=1e-6)
