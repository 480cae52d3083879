"""Restrainers: links that act beyond a slack as floors move apart, or together, beside scipy and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import motions
from scipy.integrate import solve_ivp

import pounding_sweep as ps
from pounding_sweep.base.errors import SceneError, SweepError
from pounding_sweep.request.spec import digest, overview

pytestmark = pytest.mark.usefixtures("stub_by_day")

MASSES, STIFFNESSES, DAMPING = np.array([100.0, 80.0]), np.array([1e4, 2.5e4]), 0.03
LINK, CONTACT = 6e4, 2e5
STEPS = {"exact": 2e-3, "rk4": 1e-3, "newmark": 1e-4, "central_difference": 1e-4}


def scene(gap=0.02, slack=0.015, closing_slack=None, **more):
    """Two buildings of one storey, whose floors are restrained."""
    a, b = (ps.Building(name, [MASSES[i]], [STIFFNESSES[i]], DAMPING) for i, name in enumerate("ab"))
    link = ps.Restrainer("a-b", stiffness=LINK, slack=slack, closing_slack=closing_slack, **more)
    return ps.Scene([a, b], gap, ps.ContactProperties(linear_stiffness=CONTACT, restitution=0.5), restrainers=[link])


def solved(gap, slack, closing_slack):
    """Peaks by scipy, steps cut at each onset and end of a contact: forces of each label, displacements."""
    record = motions()[0]
    instants, motion = np.arange(record.n_points) * record.dt, record.acceleration
    damping = 2.0 * DAMPING * np.sqrt(STIFFNESSES * MASSES)
    # stiffness and onset by the displacement of the left floor less that of the right one, and its sign
    elements = [(CONTACT, gap, 1.0), (LINK, slack, -1.0)] + [(LINK, closing_slack, 1.0)] * (closing_slack is not None)

    def forces(u, closed):
        return np.array(
            [k * (sign * (u[0] - u[1]) - d) if on else 0.0 for (k, d, sign), on in zip(elements, closed, strict=True)]
        )

    def slope(t, y, closed):
        push = sum(sign * f for (*_, sign), f in zip(elements, forces(y[:2], closed), strict=True))
        pushes = np.array([-push, push]) - STIFFNESSES * y[:2] - damping * y[2:]
        return [*y[2:], *(pushes / MASSES - np.interp(t, instants, motion))]

    events = [lambda _t, y, _c, d=d, sign=sign: sign * (y[0] - y[1]) - d for _, d, sign in elements]
    for event in events:
        event.terminal = True
    t, y, closed, peaks, largest = 0.0, np.zeros(4), [False] * len(elements), np.zeros(len(elements)), np.zeros(2)
    onsets = np.zeros(len(elements))
    settings = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-13, "max_step": 2e-3, "dense_output": True}
    while t < instants[-1] - 1e-12:
        end = instants[np.searchsorted(instants, t, "right")]
        end = end if end - t > 1e-12 else instants[np.searchsorted(instants, t, "right") + 1]
        for event, on in zip(events, closed, strict=True):
            event.direction = -1.0 if on else 1.0
        part = solve_ivp(slope, (t, end), y, events=events, args=(closed,), **settings)
        states = part.sol(np.linspace(t, part.t[-1], 400))
        largest = np.maximum(largest, abs(states[:2]).max(axis=1))
        peaks = np.maximum(peaks, np.max([forces(u, closed) for u in states[:2].T], axis=0))
        t, y = part.t[-1], part.y[:, -1]
        for i, found in enumerate(part.t_events):
            if len(found):
                closed = [on is not (j == i) for j, on in enumerate(closed)]
                onsets[i] += closed[i]
    return peaks, onsets, largest


@pytest.mark.slow
@pytest.mark.parametrize("method", STEPS)
@pytest.mark.parametrize(("gap", "slack", "closing_slack"), [(0.02, 0.015, None), (5.0, 0.015, 0.01)])
def test_all_schemes_beside_scipy(method, gap, slack, closing_slack):
    peaks, onsets, largest = solved(gap, slack, closing_slack)
    row = scene(gap, slack, closing_slack)
    one = ps.simulate(row, motions()[0], law="linear", method=method, dt=STEPS[method], rest=0.0)
    assert list(one["pair"].values) == ["a-b", "a-b in tension", *["a-b in compression"] * (closing_slack is not None)]
    np.testing.assert_allclose(one["impact_force_max"].squeeze("storey"), peaks, rtol=1e-5)
    np.testing.assert_array_equal(one["impact_count"].squeeze("storey"), onsets)
    found = np.maximum(one["displacement_max"], -one["displacement_min"]).squeeze("storey")
    np.testing.assert_allclose(found, largest, rtol=1e-5)
    stretch = one["impact_force_max"].sel(pair="a-b in tension") / LINK
    np.testing.assert_allclose(one["penetration_max"].sel(pair="a-b in tension"), stretch, rtol=1e-6)
    force = one["contact_force"].sel(pair="a-b in tension").squeeze("storey")
    tension = (one["displacement"].sel(building="b") - one["displacement"].sel(building="a")).squeeze("storey")
    np.testing.assert_allclose(force, LINK * np.maximum(tension - slack, 0.0), atol=1e-6 * float(force.max()))


@pytest.mark.slow
@pytest.mark.parametrize("method", STEPS)
@pytest.mark.parametrize("wall", [0, 1])
def test_a_free_mass_is_caught_in_closed_form(method, wall):
    """A mass that leaves a wall at a speed stretches its link by v sqrt(m / k), for half a period of the two."""
    mass, speed, k, slack = 50.0, 0.3, 4e4, 0.02
    items = [ps.Wall(), ps.Building("m", [mass], [1e-3], 0.0)][:: 1 - 2 * wall]
    pair = f"{items[0].name}-{items[1].name}"
    row = ps.Scene(items, 1.0, restrainers=[ps.Restrainer(pair, stiffness=k, slack=slack)])
    still = ps.Record("still", 0.01, np.r_[np.zeros(40), 1e-9])
    one = ps.simulate(
        row,
        still,
        law="linear",
        stiffness=1e5,
        method=method,
        dt=STEPS[method],
        initial_velocity=[speed * (1 - 2 * wall)],
    )
    held = one.sel(pair=f"{pair} in tension").squeeze("storey")
    np.testing.assert_allclose(held["impact_force_max"], speed * math.sqrt(k * mass), rtol=1e-5)
    np.testing.assert_allclose(held["penetration_max"], speed * math.sqrt(mass / k), rtol=1e-5)
    np.testing.assert_allclose(held["first_impact_time"], slack / speed, rtol=1e-5)
    np.testing.assert_allclose(held["impulse"], 2.0 * mass * speed, rtol=1e-5)
    assert int(held["impact_count"]) == 1


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.3, 0.8])
def test_damped_links_rebound_by_their_restitution(e):
    mass, speed = 50.0, 0.3
    link = ps.Restrainer("wall-m", "kelvin_voigt", 4e4, e, slack=0.02)
    row = ps.Scene([ps.Wall(), ps.Building("m", [mass], [1e-3], 0.0)], 1.0, restrainers=[link])
    still = ps.Record("still", 0.01, np.r_[np.zeros(40), 1e-9])
    settings = {"stiffness": 1e5, "method": "rk4", "dt": 1e-3, "restitution_basis": "realised"}
    one = ps.simulate(row, still, law="linear", initial_velocity=[speed], **settings)
    rebound = -float(one["velocity"].squeeze(["building", "storey"]).sel(time=0.35, method="nearest"))
    assert rebound == pytest.approx(e * speed, rel=1e-4)


def test_files_and_python_agree(tmp_path):
    keys = "\n".join(
        f"{key} = {value}" for key, value in (("stiffness", LINK), ("slack", 0.015), ("closing_slack", 0.01))
    )
    rows = "".join(
        f'[[scene.row]]\nname = "{name}"\nmasses = [{m}]\nstiffnesses = [{k}]\ndamping_ratio = {DAMPING}\n'
        for name, m, k in zip("ab", MASSES, STIFFNESSES, strict=True)
    )
    text = (
        f'[scene]\ngaps = [0.02]\n{rows}[[scene.restrainers]]\npair = "a-b"\n{keys}\n'
        f"[scene.contact]\nlinear_stiffness = {CONTACT}\nrestitution = 0.5\n"
        '[sweep]\nrecords = ["el_centro"]\nlaws = ["linear"]\n[solver]\nmethod = "rk4"\n'
    )
    (tmp_path / "sweep.toml").write_text(text)
    job = ps.Sweep(scene(closing_slack=0.01), "el_centro", "linear", method="rk4")
    spec = ps.load_sweep(tmp_path / "sweep.toml").spec
    assert digest(spec) == digest(job.spec)
    assert ps.load_sweep(job.to_toml(tmp_path / "again.toml")).spec == spec
    (_, _, (name, said)) = overview(spec.scene)
    assert name == "a-b"
    assert "with restrainers 'linear': slack 15 mm apart, 10 mm together, k = 6e+04 kN m-1" in said


def test_labels_and_runs_that_never_touch():
    """Slacks count as gaps do: nothing acts where neither is closed."""
    job = ps.Sweep(
        scene(closing_slack=0.01), motions()[:1], ["none", "linear"], gaps=[0.02, 5.0], method="rk4", dt=0.005,
        outputs=["impact_force_max", "closing_max", "penetration_max"], audit=0.0,
    )  # fmt: skip
    cube = job.run(workers=1)
    assert list(cube["pair"].values) == ["a-b", "a-b in tension", "a-b in compression"]
    assert job.last_outcome.untouched == 0
    free = ps.Sweep(
        scene(slack=5.0), motions()[:1], ["linear"], gaps=[5.0, 6.0, 7.0, 8.0, 9.0], method="rk4", dt=0.005, audit=0.0
    )
    free.run(workers=1)
    assert free.last_outcome.untouched == 5


def test_faults_are_told():
    a, b = scene().buildings
    for link, fault in (
        ({"pair": "b-a", "stiffness": 1.0}, r"restrainers\[0\]: unknown pair 'b-a'"),
        ({"pair": "a-b", "stiffness": 1.0, "storeys": [2]}, r"restrainers\[0\]: there is no storey 2 of 'a'"),
        ({"pair": "a-b"}, "needs a stiffness"),
        ({"pair": "a-b", "stiffness": 1.0, "slack": -1.0}, "slack: -1.0"),
        ({"pair": "a-b", "stiffness": 1.0, "law": "stereomechanical"}, "no force"),
    ):
        with pytest.raises(SceneError, match=fault):
            ps.Scene([a, b], 0.02, restrainers=[ps.Restrainer(**link)])
    twice = [ps.Restrainer("a-b", stiffness=1.0), ps.Restrainer("a-b", stiffness=2.0)]
    with pytest.raises(SceneError, match="has several in tension"):
        ps.Scene([a, b], 0.02, restrainers=twice)
    with pytest.raises(SweepError, match="no force, as bumpers and restrainers have"):
        ps.Sweep(scene(), motions()[:1], "stereomechanical")


def test_storeys_may_differ():
    left, right = ps.Building("a", [1.0] * 3, [1e3] * 3), ps.Building("b", [1.0] * 2, [1e3] * 2)
    link = ps.Restrainer("a-b", stiffness=1.0, storeys=[1, (3, 2)])
    row = ps.Scene([left, right], 0.1, restrainers=[link])
    held = [contact for contact in row.contacts if contact.restrainer]
    assert [(contact.storey, contact.left, contact.right, contact.tension) for contact in held] == [
        (1, 0, 3, True), (3, 2, 4, True)
    ]  # fmt: skip
    assert held[1].ends == ((2, -1.0), (4, 1.0))
