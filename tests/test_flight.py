"""Exact flight: its tables, the bounds by which it leaves out windows, scenarios on their way through the lanes."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from naive import NaiveBuilding, modal_exact
from scenes import EVERY, motions, pair
from scipy.linalg import expm
from test_properties import scenes_of, some_variants, tall

import pounding_sweep as ps
from pounding_sweep.engine.flight import fixed_tables, flight_tables, stops_of
from pounding_sweep.engine.kernel import MARGIN, make_group, width
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.flight import ACCELERATION, HEAD, TOUCH, TURN, WIDE, Flight, Layout
from pounding_sweep.kernel.flight_tables import Blocks, Tables
from pounding_sweep.kernel.lanes import Ledger
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.scene import Building, Scene, Wall
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.outputs.variables import reducers_for


def view_of(layout, tables, name, points, row=0):
    """Numbers of a name in the tables of a row of buildings, an array."""
    table = tables if name in layout.shared else tables[layout.base(row, points) :]
    many = {**layout.shared, **layout.fixed}.get(name) or points * layout.timed[name]
    return table[layout.place(name, points) :][:many]


def kernel_of(scene, outputs=EVERY, law="kelvin_voigt", **numerics):
    return RowKernel(scene, get_law(law), Numerics("exact", 1e-3, **numerics), reducers_for(list(outputs)))


def layout_of(kernel):
    return Layout(make_group(kernel.shape, None, width(kernel.shape.precision), None))


def tables_of(scene, ground, h, outputs=EVERY):
    """Layout and tables of a scene or of variants, in double precision, before a kernel fills in their motions."""
    variants = variants_of(scene)
    kernel = kernel_of(variants.scene, outputs)
    layout = layout_of(kernel)
    fixed, decays = fixed_tables(layout, variants, ground, h, "float64")
    tables = flight_tables(layout, len(ground), fixed)
    flight = Flight(make_group(kernel.shape, None, width("float64"), None), tables, len(ground))
    for i in range(len(variants)):
        flight.base.now = layout.base(i, len(ground))
        flight.put_decays(None, decays, HEAD + len(ground) + i * len(layout.decays) * layout.wide_modes)
    return layout, tables


def filled(scene, ground, h):
    """Layout and tables of a scene, filled by the kernels' own source run as Python."""
    kernel = kernel_of(scene)
    group = make_group(kernel.shape, None, width("float64"), None)
    layout = layout_of(kernel)
    fixed, decays = fixed_tables(layout, variants_of(scene), ground, h, "float64")
    table = flight_tables(layout, len(ground), fixed)
    flight = Flight(group, table, len(ground))
    with np.errstate(all="ignore"):
        Tables(flight, decays, None, MARGIN["float64"]).fill(1)
    return layout, table


# -- what moves by itself ----------------------------------------------------------------------------------------------


def by_exponential(building, h):
    """exp(F h) of the whole building."""
    m, n = np.array(building.masses), building.n_storeys
    a, b = building.rayleigh
    big = np.zeros((2 * n, 2 * n))
    big[:n, n:] = np.eye(n)
    big[n:, :n] = -building.stiffness_matrix / m[:, None]
    big[n:, n:] = -a * np.eye(n) - b * building.stiffness_matrix / m[:, None]
    return expm(big * h)


storey = st.tuples(st.floats(10.0, 500.0), st.floats(1e3, 1e6))


@given(
    st.lists(storey, min_size=1, max_size=5),
    st.sampled_from([0.0, 0.02, 0.2, 0.7, 0.95]),  # beyond the first two modes, the last are over-damped
    st.floats(-2.5, 0.4),
    st.floats(0.3, 3.0),
)
def test_modes_decay_as_the_matrix_exponential_says(storeys, ratio, log_turn, factor):
    masses, stiffnesses = zip(*storeys, strict=True)
    scene = Scene([Building("a", masses, stiffnesses)])
    variants = Variants(scene, np.array([[1.0], [factor]]), np.ones((2, 1)), np.array([np.nan, ratio]))
    h = 10.0**log_turn / float(scene.buildings[0].frequencies[-1])
    layout, tables = tables_of(variants, np.zeros(5), h, ("displacement_max",))
    n = len(masses)
    for i, other in enumerate(scenes_of(variants)):
        advance = view_of(layout, tables, "advance", 5, i).reshape(layout.lanes + 1, 4, -1)[..., :n]
        floors, modal = (view_of(layout, tables, name, 5).reshape(n, -1)[:, :n] for name in ("floors", "modal"))
        w = float(other.buildings[0].frequencies[-1])
        for k, steps in ((1, 1), (3, 3), (layout.lanes, WIDE)):
            want = by_exponential(other.buildings[0], h * steps)
            for row, column in itertools.product(range(2), range(2)):
                found = floors.T @ np.diag(advance[k, 2 * row + column]) @ modal.T
                block = want[row * n : row * n + n, column * n : column * n + n]
                size = max(np.abs(block).max(), w ** (row - column))
                np.testing.assert_allclose(found, block, rtol=0, atol=1e-11 * steps * size)


def test_critical_damping_is_no_special_case():
    w, h = 10.0, 0.05
    for ratio in (1.0 - 1e-7, 1.0, 1.0 + 1e-7):
        # one storey with c = a m: a = 2 zeta w
        spring = Building("a", [1.0], [w**2], damping_ratio=0.5)
        variants = Variants(Scene([spring]), np.ones((1, 1)), np.ones((1, 1)), np.array([ratio]))
        layout, tables = tables_of(variants, np.zeros(3), h)
        found = view_of(layout, tables, "advance", 3).reshape(layout.lanes + 1, 4, -1)[1, :, 0].reshape(2, 2)
        free = expm(np.array([[0.0, 1.0], [-(w**2), -2.0 * ratio * w]]) * h)
        np.testing.assert_allclose(found, free, rtol=1e-12)


def test_motions_without_pounding_are_those_of_the_modes():
    """At the points of the grid, and their extremes in windows and up to each point, against finer points."""
    scene, record = Scene([*tall().row[:2]], tall().gaps[:1]), motions()[0]
    ground = np.array(record.acceleration)[:80]
    points = len(ground)
    layout, table = filled(scene, ground, record.dt)
    fine = np.interp(np.arange(32 * (points - 1) + 1) / 32, np.arange(points), ground)
    alone = [NaiveBuilding(list(b.masses), list(b.stiffnesses), rayleigh=b.rayleigh) for b in scene.buildings]
    u, v = (
        np.concatenate(part, axis=1)
        for part in zip(*(modal_exact(b, fine, record.dt / 32)[:2] for b in alone), strict=True)
    )
    floors = view_of(layout, table, "floors", points).reshape(layout.modes, -1)[:, : layout.modes].T
    q = view_of(layout, table, "q", points).reshape(points, -1)[:, : layout.modes]
    np.testing.assert_allclose(q @ floors.T, u[::32], rtol=0, atol=1e-10 * np.abs(u).max())
    still = [i for i, each in enumerate(layout.watched) if each.kind != ACCELERATION]
    x = u @ np.array([layout.watched[i].weights for i in still]).T
    size = 3e-4 * np.abs(x).max(axis=0)
    for name, length, best in (("most", 7, np.max), ("widest", WIDE, np.max), ("least", 7, np.min)):
        found = view_of(layout, table, name, points).reshape(points, -1)[:, still]
        want = np.array([best(x[32 * t : 32 * (t + length) + 1], axis=0) for t in range(points)])
        assert (np.abs(found - want) <= size).all(), name
    rates = v @ np.array([layout.watched[i].weights for i in still]).T * record.dt
    bulge, missed = (view_of(layout, table, name, points)[still] for name in ("bulge0", "missed0"))
    slack, share = 1e-9 * np.abs(x).max(axis=0), np.linspace(0.0, 1.0, 33)[:, None]
    for t in range(points - 1):  # beyond chords, and beyond hulls of cubics
        part, ends = x[32 * t : 32 * t + 33], rates[[32 * t, 32 * t + 32]]
        assert (np.abs(part - part[0] - (part[-1] - part[0]) * share) <= bulge + slack).all()
        assert (out_of_hull(part, ends) <= missed + slack).all()
    peaks = view_of(layout, table, "peak", points).reshape(points, -1)[:, still]
    want = np.array([x[: 32 * t + 1].max(axis=0) for t in range(points)])
    assert (np.abs(peaks - want) <= size).all()


@pytest.mark.parametrize("alike", [pytest.param(False, marks=pytest.mark.slow), True])
def test_blocks_bound_what_is_watched_in_them(alike):
    """Motions of several rows of buildings at once, their bounds in blocks, and one of them point by point."""
    scene, record, substeps = Scene([*tall().row[:2]], tall().gaps[:1]), motions()[0], 6
    variants = some_variants(scene, 10)
    if alike:  # one building is the same in all, and moved once
        variants.period_factor[:, 1] = 1.0
        variants.damping_ratio[:] = np.nan
    motion = np.array(record.acceleration)[:61]
    points, h = (len(motion) - 1) * substeps + 1, record.dt / substeps
    ground = np.interp(np.arange(points) / substeps, np.arange(len(motion)), motion)
    outputs = [name for name in EVERY if "energy" not in reducers_for([name])]
    kernel = replace(kernel_of(scene, outputs), varied=True, windows=False)
    layout = layout_of(kernel)
    fixed, decays = fixed_tables(layout, variants, ground, h, "float64", substeps)
    stops = stops_of(layout, points, substeps)
    tables = flight_tables(layout, stops, fixed)
    flight = Flight(make_group(kernel.shape, None, width("float64"), None), tables, points)
    flight.blocks = blocks = Blocks(flight, decays, None, MARGIN["float64"], len(variants), Ledger().cell)
    with np.errstate(all="ignore"):
        blocks.fill()
    assert (blocks.stride, blocks.length, blocks.blocks) == (3, 27, stops)
    shaken = np.array([each.kind == ACCELERATION for each in layout.watched])
    weights = np.array([each.weights for each in layout.watched])
    fine = np.interp(np.arange(4 * (points - 1) + 1) / 4, np.arange(points), ground)
    for i, each in enumerate(scenes_of(variants)):
        alone = [NaiveBuilding(list(b.masses), list(b.stiffnesses), rayleigh=b.rayleigh) for b in each.buildings]
        u, v = (
            np.concatenate(part, axis=1) for part in zip(*(modal_exact(b, fine, h / 4) for b in alone), strict=True)
        )
        forces, at = [], 0
        for b in alone:
            mass, damping, stiffness = b.matrices()
            own = slice(at, at := at + len(mass))
            forces.append(-np.linalg.solve(mass, damping @ v[:, own].T + stiffness @ u[:, own].T).T)
        x = np.where(shaken, np.concatenate(forces, axis=1) @ weights.T, u @ weights.T)
        bounds = {
            name: view_of(layout, tables, name, stops, i).reshape(stops, -1)[:, : len(shaken)]
            for name in ("most", "least")
        }
        swell = view_of(layout, tables, "bulge0", stops, i)[: len(shaken)] / blocks.per_square
        for block in range(stops):
            here = x[4 * block * blocks.length : 4 * (block + 1) * blocks.length + 1]
            room = 2.0 * swell + 1e-9 * np.abs(x).max(axis=0)
            assert (here.max(axis=0) <= bounds["most"][block]).all()
            assert (here.min(axis=0) >= bounds["least"][block]).all()
            assert (bounds["most"][block] <= here.max(axis=0) + room).all()
            assert (bounds["least"][block] >= here.min(axis=0) - room).all()
        flight.base.now = layout.base(i, stops)
        floors = view_of(layout, tables, "floors", stops).reshape(layout.modes, -1)[:, : layout.modes]
        for block in (stops - 1, 0):
            blocks.know(block)
            many = min(blocks.length, points - 1 - block * blocks.length) + 1
            free = np.array([[flight.rows.number("free_x", m * 40 + k) for m in range(5)] for k in range(many)])
            want = u[4 * block * blocks.length :: 4][:many]
            np.testing.assert_allclose(free @ floors, want, rtol=0, atol=1e-10 * np.abs(u).max())


# -- bounds ------------------------------------------------------------------------------------------------------------


def out_of_hull(x, rates):
    """How far motions, and their rates times the step at both ends of it, are beyond the hull of the cubic."""
    hull = np.array([x[0], x[0] + rates[0] / 3.0, x[-1] - rates[-1] / 3.0, x[-1]])
    return np.maximum(x - hull.max(axis=0), hull.min(axis=0) - x)


@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.05, 0.3, 0.9]), st.floats(-2.0, 0.3))
def test_free_decay_keeps_within_its_bounds(seed, ratio, log_turn):
    """What is watched, its excursion from a chord, and from the hull of a cubic, of any free motion."""
    rng = np.random.default_rng(seed)
    scene = tall()
    variants = some_variants(scene, 3, seed)[np.array([2])]
    variants.damping_ratio[:] = ratio
    h = 10.0**log_turn / max(float(variants.frequencies[b].max()) for b in range(2))
    layout, table = tables_of(variants, np.zeros(3), h)
    n, count = layout.modes, len(layout.watched)
    assert {each.kind for each in layout.watched} == {TOUCH, TURN, ACCELERATION}
    view = {name: view_of(layout, table, name, 3) for name in (*layout.shared, *layout.fixed)}
    shape = view["shape"].reshape(count, n)
    bound, bulge, missed = (
        sum(view[name].reshape(n, -1)[:, :count] * (view[factor][:n, None] if factor else 1.0) for name, factor in each)
        for each in (layout.bounds, layout.bulges, layout.misses)
    )
    w, c = np.sqrt(view["square"][:n]) / h, view["damping"][:n] / h
    q, p = (
        rng.standard_normal(n) * 10.0 ** rng.uniform(-3, 3, n) / w,
        rng.standard_normal(n) * 10.0 ** rng.uniform(-3, 3, n),
    )
    amplitude = np.hypot(q, p * view["slowness"][:n])
    reach, high = amplitude @ bound, amplitude @ bulge
    t = np.linspace(0.0, 20.0, 1001) * h
    states = np.empty((len(t), 2, n))
    step = expm(np.moveaxis(np.array([[0.0 * w, 1.0 + 0.0 * w], [-(w**2), -c]]), 2, 0) * t[1])
    states[0] = q, p
    for k in range(1, len(t)):
        states[k] = np.einsum("mij,jm->im", step, states[k - 1])
    shaken = np.array([each.kind == ACCELERATION for each in layout.watched])
    value = states[:, 0] @ shape.T
    value[:, shaken] = (-(states[:, 0] * w**2) - states[:, 1] * c) @ shape[shaken].T
    slack, rates = 1e-9 * np.abs(value).max(axis=0), states[:, 1] @ shape.T * (50 * t[1])
    assert (np.abs(value) <= reach + slack).all()
    for k in range(0, 1000, 50):  # one step of h
        part = value[k : k + 51]
        share = np.linspace(0.0, 1.0, 51)[:, None]
        chord = part[0] + (part[-1] - part[0]) * share
        assert (np.abs(part - chord) <= high + slack).all()
        beyond = out_of_hull(part, rates[[k, k + 50]])[:, ~shaken]
        assert (beyond <= (amplitude @ missed + slack)[~shaken]).all()


@pytest.mark.slow
def test_a_graze_is_a_touch_and_a_near_miss_is_none():
    """The gap that is just closed, and peaks that nearly equal each other, to all digits but the last few."""
    scene, record = pair(), motions()[1]
    still = kernel_of(scene, ("closing_max",), "none")
    one = {"scale": np.ones(1), "stiffness": np.ones(1), "restitution": np.ones(1)}
    closing = float(still.run(record, gaps=np.zeros((1, 1)), **one)["closing"].max())
    kernel = kernel_of(scene)
    gaps = closing * (1.0 + np.array([-1e-3, -1e-6, -1e-8, 1e-12, 1e-8, 1e-3]))
    n = len(gaps)
    many = {"scale": np.ones(n), "stiffness": np.full(n, 8e5), "restitution": np.full(n, 0.6)}
    found = kernel.run(record, gaps=gaps[:, None], **many)
    assert (found["count"].sum(axis=1) > 0).tolist() == [True] * 3 + [False] * 3


# -- scenarios in the lanes --------------------------------------------------------------------------------------------


def some_scenarios(n=70):
    rng = np.random.default_rng(3)
    return {
        "scale": rng.choice([-1.5, -1.0, 0.0, 0.7, 1.0, 1.3], n),
        "gaps": rng.choice([0.0, 0.001, 0.002, 0.004, 0.02], (n, 1)),
        "stiffness": 8e5 * 10.0 ** rng.uniform(-1.0, 1.0, n),
        "restitution": rng.uniform(0.2, 1.0, n),
    }


def test_tables_that_stay_are_those_of_their_record():
    kernel, (first, second), given = kernel_of(pair()), motions()[:2], some_scenarios()
    second = ps.Record("second", first.dt, second.acceleration[: first.n_points])

    def run(record):
        return kernel.run(record, **given)

    for record in (first, first, second, first):
        found = run(record)
        with ThreadPoolExecutor(1) as other:  # that has no tables yet
            alone = other.submit(run, record).result()
        for name, values in alone.items():
            np.testing.assert_array_equal(found[name], values, err_msg=name)


def test_a_negative_scale_is_the_record_upside_down():
    kernel, record, given = kernel_of(pair()), motions()[0], some_scenarios()
    other = {**given, "scale": -given["scale"]}
    found, want = kernel.run(record, **given), kernel.run(record.scaled(-1.0), **other)
    np.testing.assert_array_equal(found["count"], want["count"])
    for name in ("umax", "umin", "fmax", "acc", "e_in"):
        np.testing.assert_allclose(found[name], want[name], rtol=1e-9, atol=1e-12 * np.abs(want[name]).max())


def test_equal_buildings_never_touch():
    a, b = (Building(name, [100.0, 80.0], [1e5, 9e4]) for name in "ab")
    kernel = kernel_of(Scene([a, b], gaps=[1e-9]))
    one = {"scale": np.ones(1), "stiffness": np.full(1, 8e5), "restitution": np.ones(1)}
    found = kernel.run(motions()[0], gaps=np.full((1, 1), 1e-9), **one)
    assert found["count"].sum() == 0
    assert found["umax"].max() > 1e-3


BLOCKS = [name for name in EVERY if "energy" not in reducers_for([name])]


@pytest.mark.parametrize(("windows", "outputs"), [(True, EVERY), (False, BLOCKS)])
@pytest.mark.parametrize(
    ("ground", "dt"),
    [([-200.0, 200.0], 0.01), ([100.0, -300.0], 0.01), ([-1.2, 0.8, 1.8, -2.9, 2.3, 0.8, 2.3], 0.02)],
)
def test_a_motion_that_goes_and_comes_back_in_a_step_has_its_peaks(ground, dt, windows, outputs):
    """From rest, or with two turns, so that its rate changes no sign from one end of the step to the other."""
    scene, record = pair(), ps.Record("few", dt, ground)
    kernel = replace(kernel_of(scene, outputs), windows=windows)
    one = {"scale": np.ones(1), "stiffness": np.full(1, 8e5), "restitution": np.ones(1)}
    found = kernel.run(record, gaps=np.ones((1, 1)), **one, twin=True)
    last = len(ground) - 1
    fine = np.interp(np.arange(2000 * last + 1) / 2000, np.arange(last + 1), ground)
    alone = [NaiveBuilding(list(b.masses), list(b.stiffnesses), rayleigh=b.rayleigh) for b in scene.buildings]
    moved = [modal_exact(b, fine, record.dt / 2000)[0] for b in alone]
    drifted = [np.abs(np.diff(u, axis=1, prepend=0.0)) for u in moved]
    for name, values, best in (("umax", moved, np.max), ("umin", moved, np.min), ("drift", drifted, np.max)):
        want = best(np.concatenate(values, axis=1), axis=0)
        np.testing.assert_allclose(found[name][0], want, rtol=1e-5, atol=1e-7 * np.abs(want).max(), err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize(("windows", "outputs"), [(True, EVERY), (False, EVERY), (False, BLOCKS)])
def test_variants_side_by_side_are_those_of_their_own(windows, outputs, monkeypatch):
    """Tables of several rows of buildings in one call, and handed over in parts."""
    scene, record = Scene([Building("a", [100.0], [9e4]), Wall("w")], gaps=[0.004]), motions()[0]
    variants = some_variants(scene, 40)
    kernel = RowKernel(
        scene, get_law("linear"), Numerics("exact", 1e-3), reducers_for(list(outputs)), varied=True, windows=windows
    )
    rows = np.arange(80) % 40
    given = {"scale": np.ones(80), "gaps": np.full((80, 1), 0.004), "stiffness": np.full(80, 2e5)}
    given["restitution"] = np.ones(80)
    substeps = int(kernel.flight_substeps(record, variants).max())
    monkeypatch.setattr(RowKernel, "flight_substeps", lambda self, record, row=None: np.array([substeps]))
    found = kernel.run(record, **given, variants=variants[rows])
    assert 10 < (found["count"] > 0).sum() < 80
    monkeypatch.setattr("pounding_sweep.engine.row_kernel.TABLE_BYTES", 1)
    again = kernel.run(record, **given, variants=variants[rows])
    for name, values in found.items():
        np.testing.assert_array_equal(again[name], values, err_msg=name)
    for i in (0, 1, 7, 25):
        part = {name: values[[i]] for name, values in given.items()}
        alone = kernel.run(record, **part, variants=variants[[i]])
        for name, values in alone.items():
            np.testing.assert_array_equal(values[0], found[name][i], err_msg=name)


def test_a_history_is_that_of_the_scenario():
    """Motion, energies and force of one scenario, step by step, against its peaks."""
    one = ps.simulate(pair(0.002), motions()[0], law="kelvin_voigt", method="exact", dt=1e-3)
    assert int(one.impact_count.sum()) > 1
    top = one.displacement.max("time") / one.displacement_max
    assert float(top.min()) > 0.999
    assert float(top.max()) <= 1.0 + 1e-9
