"""Dashpots of single storeys, links between neighbours: against exact answers and the slow twin, and what sweeps do."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from against_twin import check_energy, check_order, errors, motion, simulate, truth, twins
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import LINKED, LINKING
from naive import NaiveBuilding, run
from scenes import EVERY, pair
from scipy.linalg import block_diag, eig, expm

import pounding_sweep as ps
from pounding_sweep.base.errors import SceneError
from pounding_sweep.engine.row_kernel import Numerics, RowKernel, kernel_shape
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.variants import Variants
from pounding_sweep.outputs.variables import Status, reducers_for
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.spec.overview import overview
from pounding_sweep.spec.spec import scene_data, scene_of

A, B = pair().buildings
#: More floors than one straight line of code holds; storeys that yield, links between floors of unequal numbers.
TOWER = ps.Scene(
    [
        ps.Building("tower", [100.0] * 7, [4.5e5] * 7, yield_strengths=np.linspace(900.0, 200.0, 7), hardening=0.02),
        ps.Building("annex", [120.0] * 5, [3.5e5] * 5, dashpots=[500.0, 0.0, 0.0, 200.0, 0.0]),
        ps.Building("twin", [90.0] * 5, [2.5e5] * 5, yield_strengths=[500.0] * 5),
    ],
    gaps=[0.004, 0.004],
    contact=pair().contact,
    links=[ps.Link("tower-annex", [2, (4, 3)], 1e4, 400.0), ps.Link("annex-twin", [5], 5e4)],
)
ROOT = Path(__file__).parents[1]


def matrices(scene):
    """M, C, K of a whole row, its links included, from the twin's buildings."""
    parts = zip(*(each.matrices() for each in twins(scene)), strict=True)
    m, c, k = (block_diag(*part) for part in parts)
    for link in scene.linked_floors:
        across = np.eye(len(m))[link.left] - np.eye(len(m))[link.right]
        c += link.damping * np.outer(across, across)
        k += link.stiffness * np.outer(across, across)
    return m, c, k


def exact(scene, record):
    """Displacements and velocities at the record's points without pounding: exp of the whole state."""
    (m, c, k), n = matrices(scene), scene.n_dof
    a = np.zeros((2 * n + 2, 2 * n + 2))
    a[:n, n : 2 * n] = np.eye(n)
    a[n : 2 * n, : 2 * n] = -np.linalg.solve(m, np.hstack([k, c]))
    a[n : 2 * n, 2 * n] = -1.0
    a[2 * n, 2 * n + 1] = 1.0
    step, x = expm(a * record.dt), np.zeros(2 * n)
    found = [x]
    for g0, g1 in zip(record.acceleration[:-1], record.acceleration[1:], strict=True):
        x = (step @ np.concatenate([x, [g0, (g1 - g0) / record.dt]]))[: 2 * n]
        found.append(x)
    return np.array(found)


# -- against exact answers and the twin --------------------------------------------------------------------------------


def test_the_twin_is_exact_without_pounding():
    """Non-classical damping and links: the twin itself against the exponential of the whole state."""
    record, want = motion(51, 1.5), exact(LINKED, motion(51, 1.5))
    found = truth(LINKED, "none", 51, 1.5)
    moved = np.concatenate(found["displacement"], axis=1)
    assert np.abs(moved - want[:, :4]).max() < 1e-9 * np.abs(want[:, :4]).max()
    shapes = eig(*(matrices(LINKED)[i] for i in (2, 0)))[1].real  # damping does couple the modes
    coupled = shapes.T @ matrices(LINKED)[1] @ shapes
    assert np.abs(coupled - np.diag(np.diag(coupled))).max() > 0.05 * np.diag(coupled).max()
    assert record.n_points == len(want)


def test_two_masses_on_a_link_by_hand():
    """Two equal masses: one mode knows nothing of the link, the other has twice its stiffness and damping."""
    m, k, c, kl, cl = 50.0, 2.0e4, 40.0, 6.0e3, 120.0
    w = np.sqrt(k / m)
    one = ps.Building("a", [m], [k], c / (2.0 * m * w))
    scene = ps.Scene([one, replace(one, name="b")], [1.0], links=[ps.Link("a-b", [1], kl, cl)])
    frequencies, decay = Variants(scene, np.ones((1, 2)), np.ones((1, 2)), np.array([np.nan])).systems[0]
    np.testing.assert_allclose(frequencies[0], [w, np.sqrt((k + 2.0 * kl) / m)], rtol=1e-12)
    np.testing.assert_allclose(decay[0], [c / m, (c + 2.0 * cl) / m], rtol=1e-12)
    assert scene.linked_buildings == ((0, 1),)


@pytest.mark.parametrize(("method", "bound"), [("rk4", 2e-7), ("newmark", 2e-3)])
def test_every_variable_equals_the_twins(method, bound):
    dt = {"rk4": 5e-4, "newmark": 1e-3}[method]
    got, want = (
        simulate(LINKED, "kelvin_voigt", 101, 1.5, method=method, dt=dt),
        truth(LINKED, "kelvin_voigt", 101, 1.5),
    )
    assert int(got.status) == Status.OK
    assert sum(int(count) for each in want["impact_count"] for count in each) > 5
    found = errors(got, want, LINKED)
    assert max(found.values()) < 4.0 * bound, found
    moved = got.displacement.values[:: round(0.02 / dt)]
    for b in range(2):
        assert np.abs(moved[:, b] - want["displacement"][b]).max() < bound * np.abs(want["displacement"][b]).max()
    shown = np.abs(got.link_force).max("time")
    assert np.nanmax(np.abs(shown / got.link_force_max - 1.0)) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(("method", "dt", "bound"), [("rk4", 5e-4, 2e-6), ("newmark", 2e-4, 5e-3)])
@pytest.mark.parametrize("law", ["none", "kelvin_voigt"])
def test_a_long_row_equals_the_twin(law, method, dt, bound):
    got, want = simulate(TOWER, law, 51, 3.0, method=method, dt=dt), truth(TOWER, law, 51, 3.0)
    found = errors(got, want, TOWER)
    assert max(found.values()) < bound, found


@pytest.mark.slow
@pytest.mark.parametrize("law", ["none", "hertz_damped", "hysteretic", "stereomechanical"])
@pytest.mark.parametrize(
    ("method", "dt", "bound"), [("rk4", 5e-4, 2e-6), ("newmark", 2e-4, 2e-3), ("central_difference", 1e-4, 2e-3)]
)
def test_other_laws_and_schemes_equal_the_twin(law, method, dt, bound):
    found = errors(simulate(LINKED, law, 101, 1.5, method=method, dt=dt), truth(LINKED, law, 101, 1.5), LINKED)
    assert max(found.values()) < bound, found


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "newmark", "central_difference"])
def test_yielding_storeys_with_dashpots_links_and_columns_equal_the_twin(method):
    a = replace(A, yield_strengths=[220.0, np.inf], hardening=0.05, dashpots=[200.0, 0.0], damping_stiffness="tangent")
    scene = ps.Scene(
        [a, replace(B, dashpots=[0.0, 90.0]), ps.Wall()],
        [0.003, 0.004],
        pair().contact,
        links=[ps.Link("a-b", [2], 0, 150)],
    )
    dt = {"rk4": 5e-4}.get(method, 1e-4)
    got, want = simulate(scene, "kelvin_voigt", 101, 1.5, method=method, dt=dt), truth(scene, "kelvin_voigt", 101, 1.5)
    assert float(got.ductility_max.max()) > 1.5
    found = errors(got, want, scene)
    assert max(found.values()) < {"rk4": 1e-5}.get(method, 2e-3), found


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "newmark", "central_difference"])
def test_order_of_convergence(method):
    check_order(
        LINKED, method, ("displacement_max", "link_force_max", "energy_damping", "energy_links", "impact_force_max")
    )


@pytest.mark.slow
def test_peaks_of_forces_in_steps_of_stages_are_of_their_order():
    """A link's force is largest where that quintic of the motion turns which other peaks are read from."""
    a, b = ps.Building("a", [120.0, 90.0], [1.5e4, 1.2e4]), ps.Building("b", [80.0, 110.0], [1.4e4, 1.0e4])
    scene = ps.Scene([a, b], [0.05], LINKED.contact, links=[ps.Link("a-b", [2], damping=50.0)])
    gaps = 0.05 * np.linspace(0.2, 1.0, 64)[:, None]
    *found, want = (
        _link_forces(scene, "hertz_damped", "exact", dt, "float64", gaps, 1e6, 2e7) for dt in (1e-3, 5e-4, 1.25e-4)
    )
    early, late = (np.quantile(np.abs(each / want - 1.0), 0.95) for each in found)
    assert late < 2e-10
    assert early / late > 2.0**4.5


@pytest.mark.parametrize("method", ["rk4", "newmark"])
def test_energy_closes(method):
    """What buildings give to links is what springs hold and dashpots have lost, and the rest of the balance stands."""
    for one in check_energy(LINKED, method, "given_to_links"):
        assert np.allclose(one.given_to_links.values[-1], one.energy_links.values)
        assert float(np.abs(one.energy_links).max()) > 0.05 * float(one.energy_input.max())


@pytest.mark.slow
def test_the_energy_budget_of_linked_buildings_closes():
    names = ["energy_input", "energy_damping", "energy_kinetic", "energy_strain", "energy_links", "contact_work"]
    cube = ps.Sweep(LINKED, motion(151, 1.5), "kelvin_voigt", dt=1e-3, outputs=names).run()
    budget = ps.analysis.energy_budget(cube)
    assert budget.attrs["largest_residual_relative"] < 1e-6
    assert float(np.abs(budget.energy_links).max()) > 0.05 * float(budget.energy_input.max())
    assert float(budget.work_sum.max()) > 1e-3 * float(budget.energy_input.max())
    labels = [text.get_text() for text in ps.figures.energy_budget(cube).legends[0].get_texts()]
    assert "given to links" in labels
    assert "lost in yielding" not in labels


# -- invariants --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", LINKING)
def test_a_ground_that_moves_the_other_way_mirrors_the_motion_to_the_last_bit(method):
    far = replace(LINKED, gaps=[1e3])
    one, other = (simulate(far, "kelvin_voigt", 101, scale, method=method, dt=1e-3) for scale in (1.5, -1.5))
    assert np.array_equal(one.displacement, -other.displacement)
    for name in ("link_force_max", "energy_links", "storey_shear_max"):
        assert np.array_equal(one[name], other[name], equal_nan=True), name


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "newmark"])
def test_a_mirrored_row_moves_as_its_image(method):
    image = ps.Scene(LINKED.row[::-1], LINKED.gaps, LINKED.contact, links=[replace(LINKED.links[0], pair="b-a")])
    one, other = (
        simulate(s, "kelvin_voigt", 101, x, method=method, dt=1e-3) for s, x in ((LINKED, 1.5), (image, -1.5))
    )
    assert int(one.impact_count.sum()) == int(other.impact_count.sum()) > 0
    for name in ("link_force_max", "impact_force_max"):
        np.testing.assert_allclose(other[name].values, one[name].values, rtol=1e-7, err_msg=name)
    for name in ("energy_links", "storey_shear_max", "displacement_max"):
        twin, sign = ("displacement_min", -1.0) if name == "displacement_max" else (name, 1.0)
        np.testing.assert_allclose(other[name].values[::-1], sign * one[twin].values, rtol=1e-7, err_msg=name)


@pytest.mark.slow
def test_dashpots_in_the_shares_of_stiffness_are_rayleighs():
    """c = b k in every storey is the damping b K, of which the exact scheme flies."""
    bare = [replace(each, damping_ratio=0.0) for each in (A, B)]
    b = 1e-3
    dashed = ps.Scene([replace(x, dashpots=[b * k for k in x.stiffnesses]) for x in bare], [1.0])
    got = simulate(dashed, "none", 101, 1.0, dt=5e-4)
    rows = [NaiveBuilding(list(x.masses), list(x.stiffnesses), rayleigh=(0.0, b)) for x in bare]
    record = motion(101, 1.0)
    want = run(rows, [1.0], record.acceleration, record.dt, "none")
    np.testing.assert_allclose(got.displacement_max.values, want["displacement_max"], rtol=1e-7)


def test_a_rigid_link_makes_neighbours_one():
    """Periods of two equal towers, stiffly linked at every floor, are those of one."""
    twin = ps.Scene([A, replace(A, name="b")], [0.01], links=[ps.Link("a-b", [1, 2], 1e12)])
    apart = [2.0 * np.pi / np.sqrt(2.0 * 1e12 / m) for m in sorted(A.masses, reverse=True)]
    periods = ", ".join(f"{t:.3g}" for t in [*A.periods, *apart])
    assert dict(overview(twin))["a + b"] == f"linked, periods as one {periods} s"


# -- stability ---------------------------------------------------------------------------------------------------------


def radius(method, h, m, c, k):
    """Spectral radius of an explicit step."""
    n, a = len(m), np.zeros((2 * len(m),) * 2)
    a[:n, n:] = np.eye(n)
    a[n:] = -np.linalg.solve(m, np.hstack([k, c]))
    if method == "rk4":
        x = h * a
        step = np.eye(2 * n) + x @ (np.eye(2 * n) + x @ (np.eye(2 * n) / 2 + x @ (np.eye(2 * n) / 6 + x / 24)))
    else:  # velocity Verlet, dampers by the predicted velocity
        first = a[n:]
        u = np.hstack([np.eye(n), h * np.eye(n)]) + 0.5 * h * h * first
        predicted = np.hstack([np.zeros((n, n)), np.eye(n)]) + h * first
        second = -np.linalg.solve(m, k @ u + c @ predicted)
        step = np.vstack([u, np.hstack([np.zeros((n, n)), np.eye(n)]) + 0.5 * h * (first + second)])
    return np.abs(np.linalg.eigvals(step)).max()


@given(
    st.lists(st.floats(0.0, 1e5), min_size=4, max_size=4),
    st.floats(0.0, 1e6),
    st.floats(0.0, 1e5),
    st.sampled_from(["rk4", "central_difference"]),
)
def test_steps_at_the_limit_do_not_grow(dashpots, stiffness, damping, method):
    links = [ps.Link("a-b", [(1, 2), 2], stiffness, damping)] if stiffness or damping else []
    a, b = (replace(each, dashpots=own) for each, own in zip((A, B), (dashpots[:2], dashpots[2:]), strict=True))
    scene = ps.Scene([a, b], [1.0], links=links)
    limit = float(largest_step(scene, LAWS["none"], np.zeros(1), np.ones(1), method=method)[0])
    assert radius(method, limit, *matrices(scene)) < 1.0 + 1e-9
    assert np.isinf(largest_step(scene, LAWS["none"], np.zeros(1), np.ones(1), method="newmark")[0])


def test_the_limit_of_a_stiff_link_is_its_own():
    """Two masses: undamped, the bound by row sums is within a factor of the exact limit."""
    stiff = replace(LINKED, links=[ps.Link("a-b", [2], 1e8)])
    limit = float(largest_step(stiff, LAWS["none"], np.zeros(1), np.ones(1), method="central_difference")[0])
    m, _, k = matrices(stiff)
    fastest = np.sqrt(eig(k, m)[0].real.max())
    assert 0.5 * 2.0 / fastest < limit < 2.0 / fastest


# -- what is compiled, described and planned ---------------------------------------------------------------------------


def test_a_scene_without_them_asks_for_the_kernel_that_it_had():
    """Dashpots of zero are none; nothing of links is in its shape or results."""
    none = ps.Scene([replace(each, dashpots=[0.0, 0.0]) for each in pair().row], [0.006])
    mine, plain = (
        kernel_shape(scene, LAWS["linear"], Numerics("rk4", 1e-3), reducers_for(EVERY)) for scene in (none, pair())
    )
    assert mine == plain
    assert mine.dashpots == mine.links == ()
    assert not {"links", "link_force"} & mine.reducers
    asked = kernel_shape(LINKED, LAWS["linear"], Numerics("rk4", 1e-3), reducers_for(EVERY))
    assert (asked.dashpots, asked.links) == ((0,), ((1, 3),))
    assert {"links", "link_force"} <= asked.reducers
    only = kernel_shape(LINKED, LAWS["linear"], Numerics("rk4", 1e-3), reducers_for(["displacement_max"]))
    assert not {"links", "link_force"} & only.reducers
    assert "links" not in scene_data(pair())
    assert "dashpots" not in json.dumps(scene_data(pair()))


def test_a_row_comes_back_from_its_json():
    text = json.dumps(scene_data(TOWER), allow_nan=False)
    assert scene_of(json.loads(text)) == TOWER


def test_a_file_describes_them(tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(
        """
[scene]
preset = "mate2015"
[[scene.links]]
pair = "left-middle"
storeys = [1, [2, 3]]
damping = 500.0
[[scene.links]]
pair = "middle-right"
storeys = [3]
stiffness = 2e4
[sweep]
records = ["el_centro"]
laws = ["linear"]
[solver]
accuracy = 1e-3
[output]
variables = ["link_force_max", "energy_links"]
"""
    )
    sweep = ps.load_sweep(path)
    assert [link.floors for link in sweep.spec.scene.links] == [((1, 1), (2, 3)), ((3, 3),)]
    assert [(x.left, x.right) for x in sweep.spec.scene.linked_floors] == [(0, 3), (1, 5), (5, 8)]
    assert sweep.plan().numerics.scheme.refuses(sweep.spec.scene) is None  # chosen for the accuracy
    assert sweep.spec.scene.linked_buildings == ((0, 1, 2),)


def test_outputs_of_links_are_of_linked_rows_only(stub_engine):
    del stub_engine
    cube = ps.Sweep(LINKED, motion(51), "kelvin_voigt", dt=2e-3, outputs=["link_force_max", "energy_links"]).run()
    assert cube.link_force_max.dims[-2:] == ("pair", "storey")
    cube = ps.Sweep(pair(), motion(51), "kelvin_voigt", dt=2e-3, outputs=["link_force_max", "impact_count"]).run()
    assert "link_force_max" not in cube


def test_factors_keep_the_damping_of_dashpots():
    """Times stretched by f: stiffness / f^2 and dashpots / f; mass factors leave the motion alone as it is."""
    given = Variants(LINKED, np.array([[2.0, 1.0]]), np.array([[3.0, 1.0]]), np.array([np.nan]))
    assert given.dashpots[0].tolist() == [450.0, 0.0, 0.0, 0.0]
    single = ps.Scene([LINKED.buildings[0]])
    _, c, k = matrices(single)
    stretched = replace(single.buildings[0], stiffnesses=[x / 4.0 for x in A.stiffnesses], dashpots=[150.0, 0.0])
    _, slow, soft = matrices(ps.Scene([stretched]))
    np.testing.assert_allclose(slow, c / 2.0)
    np.testing.assert_allclose(soft, k / 4.0)


def test_linked_variants_have_the_modes_of_linked_matrices():
    rng = np.random.default_rng(2)
    period, mass, ratio = (
        rng.uniform(0.5, 2.0, (5, 2)),
        rng.uniform(0.5, 2.0, (5, 2)),
        np.array([0.02, np.nan] * 2 + [0.1]),
    )
    (found,) = Variants(LINKED, period, mass, ratio).systems
    for i in range(5):
        row = [
            replace(
                each,
                masses=[mass[i, b] * x for x in each.masses],
                stiffnesses=[mass[i, b] / period[i, b] ** 2 * x for x in each.stiffnesses],
                dashpots=[mass[i, b] / period[i, b] * x for x in each.dashpots or (0.0, 0.0)],
                damping_ratio=each.damping_ratio if np.isnan(ratio[i]) else ratio[i],
            )
            for b, each in enumerate(LINKED.buildings)
        ]
        m, c, k = matrices(replace(LINKED, row=row))
        values, shapes = eig(k, m)
        order = np.argsort(values.real)
        shapes = shapes[:, order].real / np.sqrt(np.diag(shapes[:, order].T.real @ m @ shapes[:, order].real))
        np.testing.assert_allclose(found[0][i], np.sqrt(values.real[order]), rtol=1e-9)
        np.testing.assert_allclose(found[1][i], np.diag(shapes.T @ c @ shapes), rtol=1e-8)


# -- refusals ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([-1.0, 2.0], r"building 'a': dashpots of storey 1 is -1.0 kN s/m; it must be zero or a positive number"),
        ([1.0, np.nan], r"dashpots of storey 2 is nan kN s/m"),
        ([1.0], r"1 dashpots for 2 masses; give one value per storey, 0 where it has none"),
        ([1.0, "x"], r"dashpots must be a list of numbers \(kN s/m\)"),
        ([], r"0 dashpots for 2 masses"),
    ],
)
def test_bad_dashpots_are_refused(given, message):
    with pytest.raises(SceneError, match=message):
        replace(A, dashpots=given)


@pytest.mark.parametrize(
    ("link", "message"),
    [
        (("a-b", [3], 1.0), r"pair 'a-b' is linked at storey 3 of 'a', which is not there; give one of 1 to 2"),
        (("a-b", [(1, 0)], 1.0), r"pair 'a-b' is linked at storey 0 of 'b', which is not there"),
        (("a-c", [1], 1.0), r"unknown pair in links 'a-c'"),
        (("b-wall", [1], 1.0), r"pair 'b-wall' has a wall; links join floors of two buildings"),
        (("a-b", [1], -1.0), r"link: stiffness is -1.0 kN/m; it must be zero or a positive number"),
        (("a-b", [1], 0.0, np.inf), r"link: damping is inf kN s/m"),
        (("a-b", [1]), r"link of pair 'a-b': stiffness and damping are zero"),
        (("a-b", [], 1.0), r"link: storeys are \[\]; give a list of whole numbers"),
        (("a-b", [1.5], 1.0), r"link: storeys are \[1.5\]"),
        (("a-b", 1, 1.0), r"link: storeys are 1;"),
        (("a-b", [1, 1], 1.0), r"storey 1 of 'a' has 2 links to 'b'; give one, of their sum"),
    ],
)
def test_bad_links_are_refused(link, message):
    with pytest.raises(SceneError, match=message):
        ps.Scene([A, B, ps.Wall()], [0.1, 0.1], links=[ps.Link(*link)])
    with pytest.raises(SceneError, match="links must be Link objects, not 3"):
        ps.Scene([A, B], [0.1], links=[3])


# -- isolated buildings ------------------------------------------------------------------------------------------------

TOWER_ABOVE = ps.Building("tower", [150.0] * 3, [3e5] * 3, 0.02, storey_heights=[3.5] * 3)


def test_an_isolated_building_has_the_numbers_that_were_asked_for():
    made = ps.base_isolated(TOWER_ABOVE, 150.0, 2.5, 0.05, 250.0, 0.01)
    total, k1, r = 600.0, made.stiffnesses[0], made.hardening
    assert 2.0 * np.pi * np.sqrt(total / (r * k1)) == pytest.approx(2.5)
    assert (made.yield_strengths[0] / k1, made.yield_strengths[0] * (1.0 - r)) == pytest.approx((0.01, 250.0))
    assert made.yields == (True, False, False, False)
    assert made.dashpots[0] / (2.0 * total * 2.0 * np.pi / 2.5) == pytest.approx(0.05)
    assert made.rayleigh == (0.0, 0.0)
    fixed = replace(TOWER_ABOVE, damping_ratio=0.0, dashpots=made.dashpots[1:])
    ((frequencies, _),) = Variants(ps.Scene([fixed]), *np.ones((2, 1, 1)), np.array([np.nan])).systems
    m, c, _ = matrices(ps.Scene([fixed]))
    shape = TOWER_ABOVE.modes[1][:, 0]
    assert shape @ c @ shape / (2.0 * frequencies[0, 0]) == pytest.approx(0.02)
    assert np.allclose(np.diag(m), 150.0)
    yielding = replace(TOWER_ABOVE, yield_strengths=[9.0, 8.0, np.inf], hardening=0.1)
    both = ps.base_isolated(yielding, 150.0, 2.5, 0.05, 250.0, 0.01)
    assert both == replace(
        made, yield_strengths=[made.yield_strengths[0], 9.0, 8.0, np.inf], hardening=[r, 0.1, 0.1, 0.1]
    )
    linear = ps.base_isolated(TOWER_ABOVE, 150.0, 2.5, 0.05)
    assert (linear.yield_strengths, linear.hardening) == (None, 0.0)
    assert linear.periods[0] == pytest.approx(2.5, rel=0.02)  # but for what the building above gives


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"period": 0.0}, "isolators of 'tower': period is 0.0 s; it must be a positive number"),
        ({"strength": -1.0}, "strength is -1.0 kN; it must be zero or a positive number"),
        ({"damping_ratio": np.nan}, "damping_ratio is nan of critical; it must be zero"),
        ({"base_mass": "x"}, "base_mass is 'x' t"),
    ],
)
def test_bad_isolators_are_refused(given, message):
    usual = {"building": TOWER_ABOVE, "base_mass": 150.0, "period": 2.5, "damping_ratio": 0.05, "strength": 250.0}
    with pytest.raises(SceneError, match=message):
        ps.base_isolated(**(usual | given))


def test_the_example_is_that_building():
    sweep = ps.load_sweep(ROOT / "sweeps" / "isolated.toml")
    (mine,) = sweep.spec.scene.buildings
    made = ps.base_isolated(TOWER_ABOVE, 150.0, period=2.5, damping_ratio=0.05, strength=250.0, yield_drift=0.01)
    for name in ("masses", "stiffnesses", "yield_strengths", "hardening", "dashpots", "storey_heights"):
        np.testing.assert_allclose(getattr(mine, name), getattr(made, name), rtol=1e-4, err_msg=name)
    assert [(c.pair, c.storey) for c in sweep.spec.scene.contacts] == [(0, 1), (1, 1)]
    plan = sweep.plan()
    assert plan.n_asked == 96 * 2 // 2
    assert plan.numerics.method == "exact"


@pytest.mark.slow
def test_an_isolated_building_in_its_moat_equals_the_twin():
    made = ps.base_isolated(TOWER_ABOVE, 150.0, 2.5, 0.05, 250.0, 0.01)
    scene = ps.Scene([made, ps.Wall()], [0.03], storeys={"tower-wall": [1]})
    record = motion(201, 2.0)
    one = ps.simulate(scene, record, law="kelvin_voigt", stiffness=5e5, restitution=0.6, dt=1e-3)
    want = run(
        twins(scene), [0.03], record.acceleration, record.dt, "kelvin_voigt", 5e5, 0.6, only={0: [1]}, rtol=1e-11
    )
    assert int(want["impact_count"][0][0]) == int(one.impact_count.sum()) >= 2
    assert float(one.ductility_max.max()) > 3.0
    for name in ("acceleration_max", "drift_max", "displacement_max", "storey_shear_max"):
        np.testing.assert_allclose(one[name].values[0], want[name][0], rtol=2e-5, err_msg=name)
    np.testing.assert_allclose(one.impact_force_max.values[0, 0], want["impact_force_max"][0][0], rtol=2e-5)


# -- sweeps ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_sweep_is_its_scenarios_one_by_one(precision):
    """Masses alone change nothing of a building by itself, but all of linked ones."""
    given = {"period_factors": {"b": [1.0, 1.3]}, "mass_factors": {"a": [0.5, 1.0]}, "scales": [1.0, 2.0]}
    outputs = ["displacement_max", "drift_max", "link_force_max", "energy_links", "energy_residual", "impact_count"]
    sweep = ps.Sweep(
        LINKED,
        motion(101),
        ["none", "kelvin_voigt"],
        gaps=[0.002, 0.006],
        dt=1e-3,
        precision=precision,
        outputs=outputs,
        **given,
    )
    cube = sweep.run()
    assert (cube.status == Status.OK).all()
    a, b = LINKED.buildings
    for f, m, scale, gap in [
        (1.0, 1.0, 1.0, 0.002),
        (1.3, 0.5, 2.0, 0.002),
        (1.3, 1.0, 2.0, 0.006),
        (1.0, 0.5, 1.0, 0.006),
    ]:
        row = [
            replace(
                a,
                masses=[m * x for x in a.masses],
                stiffnesses=[m * x for x in a.stiffnesses],
                dashpots=[m * x for x in a.dashpots],
            ),
            replace(b, stiffnesses=[x / f**2 for x in b.stiffnesses]),
        ]
        for law in ("none", "kelvin_voigt"):
            one = simulate(replace(LINKED, row=row, gaps=[gap]), law, 101, scale, dt=1e-3)
            mine = cube.sel(period_factor_b=f, mass_factor_a=m, scale=scale, gap=gap, law=law).squeeze()
            for name in ("displacement_max", "drift_max", "link_force_max", "energy_links"):
                want, tolerance = one[name].values, 1e-8 if precision == "float64" else 2e-3
                got = mine[name].values.reshape(want.shape)
                np.testing.assert_allclose(got, want, rtol=tolerance, atol=tolerance * np.nanmax(np.abs(want)))
    assert cube.impact_count.sum() > 10
    still = cube.sel(law="none").isel(gap=0, period_factor_b=0)
    twice = still.link_force_max.sel(scale=2.0) / still.link_force_max.sel(scale=1.0)
    np.testing.assert_allclose(twice.values[np.isfinite(twice.values)], 2.0, rtol=1e-3)


def _link_forces(scene, law, method, dt, precision, gaps, soft=1e7, stiff=1e9):
    """Largest forces of the only link over 64 scales, stiffnesses and restitutions."""
    kernel = RowKernel(scene, LAWS[law], Numerics(method, dt, precision=precision), reducers_for(["link_force_max"]))
    n = len(gaps)
    given = {"scale": np.linspace(0.3, 2.0, n), "stiffness": np.geomspace(soft, stiff, n)}
    return kernel.run(motion(121, 1.5), gaps=gaps, restitution=np.linspace(0.3, 0.9, n), **given)["link_force"][:, 0]


@pytest.mark.slow
def test_single_precision_finds_forces_of_links_in_the_shortest_sub_steps():
    """In which floors move by little more than rounding."""
    soft = ps.Building("a", [120.0, 90.0], [1.5e4, 1.2e4])
    scene = ps.Scene([soft, B], [0.0], links=[ps.Link("a-b", [1], stiffness=100.0, damping=200.0)])
    gaps = np.where(np.arange(64) % 4, 0.003 * np.linspace(0.0, 1.0, 64), 0.0)[:, None]
    single, double = (
        _link_forces(scene, "nonlinear_viscoelastic", "rk4", 1e-3, precision, gaps)
        for precision in ("float32", "float64")
    )
    np.testing.assert_allclose(single, double, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "dt"), [("exact", 5e-3), ("rk4", 1e-3)])
def test_the_force_of_a_link_just_after_a_velocity_jump_counts(method, dt):
    a, b = ps.Building("a", [120.0, 90.0], [1.5e4, 1.2e4]), ps.Building("b", [80.0, 110.0], [1.4e4, 1.0e4])
    scene = ps.Scene([a, b, ps.Wall()], [0.5, 0.0], links=[ps.Link("a-b", [2], damping=50.0)])
    gaps = np.stack([np.full(64, 0.5), 0.05 * np.linspace(0.1, 1.0, 64)], axis=1)
    found, want = (
        _link_forces(scene, "stereomechanical", *each, "float64", gaps) for each in ((method, dt), ("rk4", 1e-4))
    )
    np.testing.assert_allclose(found, want, rtol=1e-6)
