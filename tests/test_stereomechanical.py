"""Velocity jumps: what Newton's impact law must do, and what happens where bounces would never end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from against_reference import both, errors, simulate, truth
from scenes import EVERY, OUTPUTS, motions, row

import pounding_sweep as ps
from pounding_sweep.output.merge import merge_cubes
from pounding_sweep.request.spec import METHODS
from pounding_sweep.variables.registry import Status

#: Schemes, those of the default run first.
BY_DAY = ["newmark", "exact", pytest.param("rk4", marks=pytest.mark.slow)]
FREE = 1e-9  # kN/m: so soft that the building does not notice


def masses(*values, gaps, floors=1):
    buildings = [ps.Building(f"m{i}", [m] * floors, [FREE] * floors, damping_ratio=0.0) for i, m in enumerate(values)]
    return ps.Scene(buildings, gaps=gaps)


def quiet(seconds):
    return ps.Record("quiet", 0.01, np.zeros(round(seconds / 0.01) + 1))


def end_velocities(scene, velocities, e, method="rk4", seconds=0.5):
    """What is run from these velocities of the lowest floors, and their velocities at its end."""
    one = ps.simulate(
        scene,
        quiet(seconds),
        law="stereomechanical",
        restitution=e,
        method=method,
        initial_velocity=[[v, *np.zeros(b.n_storeys - 1)] for v, b in zip(velocities, scene.buildings, strict=True)],
    )
    assert int(one.status) == Status.OK
    return one, one.velocity.isel(time=-1, storey=0).values


@pytest.mark.parametrize("method", BY_DAY)
@pytest.mark.parametrize("e", [0.0, 0.35, 1.0])
def test_two_masses_part_at_exactly_e(e, method):
    scene = masses(30.0, 70.0, gaps=[0.02], floors=2)  # the upper floors stay where they are
    one, (left, right) = end_velocities(scene, [0.4, -0.1], e, method)
    assert right - left == pytest.approx(e * 0.5, abs=1e-9)
    assert 30.0 * left + 70.0 * right == pytest.approx(30.0 * 0.4 - 70.0 * 0.1, rel=1e-9)
    assert float(one.impulse.sum()) == pytest.approx((1 + e) * 21.0 * 0.5, rel=1e-9)
    assert float(one.contact_work.sum()) == pytest.approx(0.5 * 21.0 * 0.25 * (1 - e * e), rel=1e-7, abs=1e-12)
    assert float(one.approach_speed_max.max()) == pytest.approx(0.5, rel=1e-9)
    assert float(one.first_impact_time.min()) == pytest.approx(0.04, rel=1e-6)
    for peak in (one.impact_force_max, one.penetration_max):  # no such thing in a velocity jump
        assert peak.isnull().values.tolist() == [[True, False]]
        assert float(peak.max()) == 0.0  # and none where nothing touched


@pytest.mark.slow
def test_a_cradle_hands_its_motion_on():
    one, found = end_velocities(masses(50.0, 50.0, 50.0, gaps=[0.02, 0.0]), [0.3, 0.0, 0.0], 1.0)
    np.testing.assert_allclose(found, [0.0, 0.0, 0.3], atol=1e-9)
    assert one.impact_count.values.ravel().tolist() == [1.0, 1.0]


@pytest.mark.slow
def test_impacts_from_both_sides_at_once_are_taken_one_after_the_other():
    _, found = end_velocities(masses(50.0, 50.0, 50.0, gaps=[0.02, 0.02]), [0.3, 0.0, -0.3], 1.0)
    np.testing.assert_allclose(found, [-0.3, 0.0, 0.3], atol=1e-9)
    # with losses the order shows: the left pair comes first
    _, found = end_velocities(masses(50.0, 50.0, 50.0, gaps=[0.02, 0.02]), [0.3, 0.0, -0.3], 0.5)
    assert found.sum() == pytest.approx(0.0, abs=1e-9)
    assert found[0] < found[1] < found[2]
    assert np.square(found).sum() < 2 * 0.3**2


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_a_building_pushed_against_a_wall_comes_to_rest_on_it(e, method):
    """Infinitely many bounces in a finite time: they end where they are too slow to bounce, and the floors rest."""
    building = ps.Building("b", [100.0], [4.0e4], damping_ratio=0.0)
    scene = ps.Scene([building, ps.Wall()], gaps=[0.0])
    push = ps.Record("push", 0.01, np.full(301, -2.0))  # m/s2, towards the wall
    one = ps.simulate(scene, push, law="stereomechanical", restitution=e, method=method, initial_velocity=[[-0.2]])
    assert int(one.status) == Status.OK
    first = float(one.approach_speed_max.max())  # and each is e times as fast as the one before
    bounces = 1 if e == 0.0 else 1 + np.ceil(np.log(1e-3 / (e * first)) / np.log(e))
    assert float(one.impact_count.max()) == bounces
    if e == 0.0:
        np.testing.assert_allclose(one.contact_time.max(), 3.0 - one.first_impact_time.max(), rtol=1e-9)
    last = one.sel(time=slice(2.8, 3.0))
    assert float(abs(last.displacement).max()) < 1e-8
    assert float(abs(last.velocity).max()) < 1e-15
    np.testing.assert_allclose(last.contact_force + 4.0e4 * last.displacement, 200.0, rtol=1e-9)  # m a
    kinetic = float(one.kinetic.max())
    assert kinetic < 0.5 * 100.0 * 0.5**2  # no bounce makes energy
    assert float(one.contact_work.sum()) == pytest.approx(0.5 * 100.0 * 0.2**2, rel=1e-4)  # all of it is lost here


def test_a_sweep_asks_for_no_stiffness(stub_engine):
    sweep = ps.Sweep(
        row(),
        records=motions()[0],
        laws=["stereomechanical"],
        gaps=[0.002],
        stiffness_factors=[0.5, 1.0, 2.0],
        restitutions=[0.4, 0.8],
        outputs=OUTPUTS,
    )
    assert len(sweep.plan().unique) == 2
    cube = sweep.run()
    assert cube.contact_stiffness.isnull().all()
    assert (cube.impact_count.max(("pair", "storey")) > 0).all()
    assert (cube.status == Status.OK).all()


@pytest.mark.parametrize("method", BY_DAY)
@pytest.mark.parametrize("e", [0.0, 0.3, 0.8, 1.0])
def test_floors_that_start_side_by_side(e, method):
    """No gap at all under an earthquake: impacts, chatter and rest at two floors, and no energy made."""
    row = [ps.Building("a", [120.0, 90.0], [1.5e5, 1.2e5]), ps.Building("b", [80.0, 110.0], [2.4e5, 2.0e5])]
    shaking = ps.synthetic_record(5, duration=2.0, dt=0.02, pga=4.0)
    one = ps.simulate(ps.Scene(row, gaps=[0.0]), shaking, law="stereomechanical", restitution=e, method=method, dt=5e-4)
    assert int(one.status) == Status.OK
    assert np.isfinite(one.displacement).all()
    assert np.isfinite(one.velocity).all()
    assert int(one.impact_count.min()) >= 1
    assert float(one.contact_work.min()) >= -1e-6 * float(one.energy_input.max())
    assert float(one.energy_residual) < 0.01
    apart = one.displacement.sel(building="b") - one.displacement.sel(building="a")
    assert float(apart.min()) > -1e-9  # rigid: they don't pass through each other


def alike(name, n, mass, stiffness):
    return ps.Building(name, [mass] * n, [stiffness] * n)


#: Rows, restitutions and record points; in each of them floors bounce, rest and part many times.
SCENES = {
    "wall": (ps.Scene([alike("a", 1, 100.0, 4.0e4), ps.Wall()], gaps=[0.001]), 0.3, 100),
    "1-1": (ps.Scene([alike("a", 1, 100.0, 9.0e3), alike("b", 1, 60.0, 3.0e4)], gaps=[0.002]), 0.8, 150),
    "2-1": (ps.Scene([alike("a", 2, 120.0, 9.0e4), alike("b", 1, 200.0, 5.0e4)], gaps=[0.0]), 0.4, 100),
    "3-3-3": (
        ps.Scene(
            [alike("a", 3, 100.0, 9.0e4), alike("b", 3, 150.0, 2.2e5), alike("c", 3, 80.0, 6.0e4)], gaps=[0.002, 0.001]
        ),
        0.4,
        75,
    ),
    "between walls": (
        ps.Scene(
            [ps.Wall("v"), alike("b", 9, 150.0, 6.0e5), alike("c", 9, 80.0, 1.0e5), ps.Wall("w")], [2e-3, 5e-4, 1e-3]
        ),
        0.2,
        25,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("method", "within"), [("rk4", 1e-3), ("newmark", 2e-2), ("exact", 1e-3)])
@pytest.mark.parametrize("name", SCENES)
def test_floors_that_bounce_rest_and_part_move_like_the_slow_twin(name, method, within):
    scene, e, points = SCENES[name]
    scene = replace(scene, contact=ps.ContactProperties(restitution=e))
    one, want = (
        simulate(scene, "stereomechanical", points, method=method, dt=1e-3),
        truth(scene, "stereomechanical", points),
    )
    assert int(one.status) == Status.OK
    counts, expected = both(one, want, scene)["impact_count"]
    assert abs(counts - expected).max() <= (1 if method == "newmark" else 0)
    assert expected.max() > 5
    found = errors(one, want, scene)
    del found["impact_count"]
    # which of several floors that are hardly pressed is open for a moment between walls is a matter of rounding
    assert found.pop("contact_time") < (within if name != "between walls" else 5.0 * within)
    assert max(found.values()) < within, found


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_floor_at_rest_that_is_struck_hands_the_blow_on(method):
    """A mass flies into one that is pressed against a wall: it is thrown back, and the other bounces off the wall."""
    two = [ps.Building("a", [50.0], [FREE], damping_ratio=0.0), ps.Building("b", [50.0], [1.0e4], damping_ratio=0.0)]
    scene = ps.Scene([*two, ps.Wall()], gaps=[0.05, 0.0])
    push = ps.Record("push", 0.01, np.full(31, -1.0))
    one = ps.simulate(
        scene, push, law="stereomechanical", restitution=0.5, method=method, dt=1e-3, initial_velocity=[[0.4], [0.0]]
    )
    assert int(one.status) == Status.OK
    v = one.approach_speed_max.values.ravel()
    assert v[0] == pytest.approx(np.sqrt(0.4**2 + 2 * 1.0 * 0.05), rel=1e-6)
    assert v[1] == pytest.approx(0.75 * v[0], rel=1e-6)  # what the first impact gave it
    early = one.sel(time=slice(0.02, 0.08)).contact_force.sel(pair=one.pair[1])
    np.testing.assert_allclose(early, 50.0, rtol=1e-6)  # at rest: m a
    assert float(one.contact_work.min()) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("method", "within"), [("rk4", 1e-3), ("exact", 1e-4)])
def test_accelerations_of_floors_that_rest_on_each_other_are_those_of_one(method, within):
    """A free mass that a constant push g keeps on a building: together they move by g (1 - cos(w t)) at most 2 g."""
    row = [ps.Building("a", [60.0], [FREE], damping_ratio=0.0), ps.Building("b", [40.0], [1.0e4], damping_ratio=0.0)]
    w, g, found = np.sqrt(1.0e4 / 100.0), 2.0, []
    for turn in (0.35, 0.175):  # in a step: none ends at half a period, the last before they part
        push = ps.Record("push", turn / w, np.full(int(2.0 * np.pi / turn), -g))
        how = {"law": "stereomechanical", "restitution": 0.0, "method": method, "dt": push.dt}
        one = ps.simulate(ps.Scene(row, [0.0]), push, **how)
        assert int(one.status) == Status.OK
        found.append(abs(one.acceleration_max.values / (2.0 * g) - 1.0).max())
    assert found[0] < within
    assert found[1] < 0.1 * found[0]


def test_force_and_penetration_mean_the_same_however_a_scenario_was_answered(stub_engine, tmp_path):
    """Missing where floors touched, 0 where they did not: by their own run, or by that without pounding."""
    files, cubes = [], []
    for name, gaps in (("far", [0.5, 0.6, 0.7, 0.8]), ("near", [0.5, 0.002])):
        files.append(tmp_path / f"{name}.nc")
        sweep = ps.Sweep(
            row(), records=motions()[0], laws="stereomechanical", gaps=gaps, restitutions=[0.4], outputs=EVERY, dt=2e-3
        )
        cubes.append(sweep.run(files[-1]))
    far, near = cubes
    touched = near.impact_count.sel(gap=0.002) > 0
    assert touched.any()
    for name in ("impact_force_max", "penetration_max"):
        np.testing.assert_array_equal(near[name].sel(gap=0.5), far[name].sel(gap=0.5))
        assert float(far[name].max()) == 0.0
        assert near[name].sel(gap=0.002).where(touched).isnull().all()
    assert merge_cubes(files, tmp_path / "all.nc").scenarios == 5
