"""Buildings from modes, from a model of OpenSees, and of which little is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from against_reference import check_reference, simulate
from kernels_used import MATRICES, MATRIX
from scenes import pair
from scipy.optimize import brentq

import pounding_sweep as ps
from benchmarks.frames import FLOORS, build_frame, difference, fitted_chain
from pounding_sweep.model.frames import cantilever_flexibility

MASSES = [120.0, 110.0, 90.0, 70.0]


def flexible(n=4, seed=3):
    """A stiffness matrix (kN/m) that is no chain of storeys."""
    root = np.random.default_rng(seed).normal(size=(n, n))
    chain = np.diag(np.full(n, 2e5)) - np.diag(np.full(n - 1, 1e5), 1) - np.diag(np.full(n - 1, 1e5), -1)
    return chain + 2e3 * root @ root.T


def modes_of(masses, stiffness):
    root = 1.0 / np.sqrt(masses)
    values, vectors = np.linalg.eigh(stiffness * np.outer(root, root))
    return 2.0 * math.pi / np.sqrt(values), vectors * root[:, None]


@pytest.mark.parametrize(("digits", "within"), [(None, 1e-12), (4, 2e-3)])
def test_modes_give_the_matrix_back(digits, within):
    stiffness = flexible()
    periods, shapes = modes_of(MASSES, stiffness)
    shapes = shapes * [3.0, -0.2, 7.0, 1.0] / np.abs(shapes).max()
    shapes = shapes if digits is None else shapes.round(digits)
    building = ps.building_from_modes("a", MASSES, periods[::-1], shapes[:, ::-1], damping_ratio=0.02)
    assert np.allclose(building.stiffness_matrix, stiffness, rtol=0, atol=within * stiffness.max())
    assert building.periods == pytest.approx(periods, rel=1e-12)
    assert building.damping_ratio == 0.02


def test_shapes_that_are_nearly_orthogonal_are_made_so_with_a_word():
    periods, shapes = modes_of(MASSES, flexible())
    tilted = shapes + 0.003 * np.abs(shapes).max() * np.eye(4)[:, ::-1]
    with pytest.warns(UserWarning, match="are made orthogonal, slowest first: 0.00"):
        building = ps.building_from_modes("a", MASSES, periods, tilted)
    assert building.periods == pytest.approx(periods, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, phi: (t[:2], phi[:, :2]), "export all 4 modes"),
        (lambda t, phi: (t, phi + 0.05 * np.abs(phi).max() * np.eye(4)[:, ::-1]), "shapes 2 and 4"),
        (lambda t, phi: ([*t[:3], 0.0], phi), "period 0 s"),
    ],
)
def test_modes_that_are_none_of_a_building_are_refused(change, words):
    periods, shapes = change(*modes_of(MASSES, flexible()))
    with pytest.raises(ps.PoundingSweepError, match=words):
        ps.building_from_modes("a", MASSES, periods, shapes)


@pytest.mark.parametrize("alpha", [0.5, 1.5, 5.0, 20.0])
def test_typical_buildings_have_the_periods_of_the_cantilever(alpha):
    """Roots of the characteristic equation of Miranda and Taghavi, with many thin storeys in place of a continuum."""

    def characteristic(gamma):
        beta = math.hypot(alpha, gamma)
        first = (2.0 + alpha**4 / (gamma * beta) ** 2) * math.cos(gamma)
        second = alpha**2 / (gamma * beta) * math.sin(gamma) * math.tanh(beta)
        return 2.0 / math.cosh(beta) + first + second

    grid = np.arange(0.5, 12.0, 0.01)
    changes = [k for k in range(len(grid) - 1) if characteristic(grid[k]) * characteristic(grid[k + 1]) < 0]
    roots = [brentq(characteristic, grid[k], grid[k + 1]) for k in changes[:3]]
    paces = [gamma * math.hypot(gamma, alpha) for gamma in roots]
    n = 240
    heights = (np.arange(n) + 1.0) / n
    values = np.linalg.eigvalsh(cantilever_flexibility(heights, alpha))[:-4:-1]
    assert np.sqrt(values[0] / values) == pytest.approx(np.divide(paces, paces[0]), rel=5e-3)


def test_a_typical_building_needs_four_numbers():
    building = ps.typical_building("a", storeys=10, period=1.1, floor_mass=300.0)
    assert building.periods[0] == pytest.approx(1.1, rel=1e-12)
    assert building.masses == (300.0,) * 10
    assert building.levels[-1] == 30.0
    frame, dual, walls = (ps.typical_building("a", 8, 0.9, 300.0, kind=kind) for kind in ("frame", "dual", "walls"))
    assert frame.periods[1] > dual.periods[1] > walls.periods[1] > 0.142
    assert ps.typical_building("a", 4, "asce7", 1.0, 3.0).periods[0] == pytest.approx(0.0466 * 12**0.9)
    assert ps.typical_building("a", 4, "eurocode8", 1.0, 3.0, "walls").periods[0] == pytest.approx(0.05 * 12**0.75)
    for wrong, words in [
        ({"kind": "frames"}, "did you mean 'frame'"),
        ({"period": "asce"}, "asce7"),
        ({"kind": 0}, "alpha"),
    ]:
        with pytest.raises(ps.PoundingSweepError, match=words):
            ps.typical_building(**{"name": "a", "storeys": 3, "period": 0.5, "floor_mass": 1.0} | wrong)


@pytest.fixture
def frame():
    """A frame of OpenSees, 3 bays and 6 storeys, its floors tied; with walls of its own where it is asked for."""
    ops = pytest.importorskip("openseespy.opensees")

    def build(walls=False):
        build_frame(ops, walls)
        ops.timeSeries("Linear", 1)
        ops.pattern("Plain", 1, 1)
        ops.load(60, 100.0, 0.0, 0.0)
        return ops

    yield build
    ops.wipe()


@pytest.mark.parametrize("walls", [False, True])
def test_a_model_of_opensees_becomes_its_building(frame, walls):
    ops = frame(walls)
    building = ps.building_from_opensees(ops, FLOORS, name="frame")
    assert (ops.getTime(), ops.nodeDisp(60), ops.getPatterns()) == (0.0, [0.0, 0.0, 0.0], [1])
    squares = np.array(ops.eigen("-fullGenLapack", 6))
    assert building.periods == pytest.approx(2.0 * np.pi / np.sqrt(squares), rel=1e-10)
    assert (building.storey_heights, building.masses) == ((3.5,) * 6, (120.0,) * 5 + (96.0,))
    ops.wipeAnalysis()
    for command, *words in [("system", "BandGen"), ("numberer", "RCM"), ("constraints", "Transformation")]:
        getattr(ops, command)(*words)
    ops.integrator("LoadControl", 1.0)
    ops.algorithm("Linear")
    ops.analysis("Static")
    assert ops.analyze(1) == 0  # under the load that stood before
    assert ops.nodeDisp(60, 1) == pytest.approx(100.0 * np.linalg.inv(building.stiffness_matrix)[5, 5], rel=1e-9)
    with pytest.raises(ps.PoundingSweepError, match="has moved"):
        ps.building_from_opensees(ops, FLOORS)


def test_the_fitted_chain_has_the_first_mode():
    building = ps.typical_building("a", 6, 0.9, 100.0, kind="walls")
    chain = fitted_chain(building)
    assert chain.periods[0] == pytest.approx(building.periods[0], rel=1e-9)
    assert abs(chain.modes[1][:, 0]) == pytest.approx(abs(building.modes[1][:, 0]), rel=1e-9)
    assert chain.periods[1] > 1.5 * building.periods[1]


@pytest.mark.slow
@pytest.mark.parametrize(("walls", "beside", "most"), [(False, False, 1e-4), (True, True, 1e-3)])
def test_histories_are_those_of_opensees(frame, walls, beside, most):
    record = ps.find_record("el_centro")
    cut = ps.Record("cut", record.dt, record.acceleration[:250])
    assert difference(frame(), walls, beside, cut)[0] < most


def test_models_of_opensees_that_are_refused(frame):
    ops = frame()
    with pytest.raises(ps.PoundingSweepError, match="of the nodes' mass lies outside"):
        ps.building_from_opensees(ops, {floor: nodes for floor, nodes in FLOORS.items() if floor < 6})
    with pytest.raises(ps.PoundingSweepError, match=r"no nodes \[77\]"):
        ps.building_from_opensees(ops, {1: 77})
    with pytest.raises(ps.PoundingSweepError, match="floor 1 has no mass"):
        ps.building_from_opensees(ops, {0: [0, 1], **FLOORS})


@pytest.mark.parametrize("method", [*MATRICES, pytest.param("central_difference", marks=pytest.mark.slow)])
def test_a_chain_as_its_own_matrix_is_the_chain(method):
    law = MATRICES.get(method, "hertz_damped")
    chain, matrix = (simulate(scene, law, method=method, rest="auto") for scene in (pair(), MATRIX))
    assert int(chain.status) == int(matrix.status) == 0
    assert chain.impact_count.max() > 2
    for name, values in chain.data_vars.items():
        if values.dtype.kind == "f" and name != "energy_residual":
            xr.testing.assert_allclose(values, matrix[name], rtol=0.0, atol=1e-10 * float(abs(values).max()))


def test_a_file_of_a_matrix_lies_beside_the_sweep_file(tmp_path):
    np.savetxt(tmp_path / "floors.csv", [[3e5, -1e5], [-1e5, 1e5]], delimiter=",")
    building = '[[scene.row]]\nname = "a"\nmasses = [100.0, 80.0]\nstiffness_matrix = "floors.csv"\n'
    text = f'[scene]\n{building}[sweep]\nrecords = ["el_centro"]\nlaws = ["none"]\n'
    (tmp_path / "sweep.toml").write_text(text, "utf-8")
    (read,) = ps.load_sweep(tmp_path / "sweep.toml").spec.scene.buildings
    assert read.stiffness_matrix == ((3e5, -1e5), (-1e5, 1e5))


def test_a_matrix_that_is_no_chain_beside_the_reference():
    left = replace(MATRIX.buildings[0], stiffness_matrix=[[2.5e5, -1.6e5], [-1.6e5, 1.5e5]], name="a")
    scene = replace(MATRIX, row=[left, MATRIX.buildings[1]], gaps=(0.004,))
    check_reference(scene, "kelvin_voigt", 1e-8, method="exact")


def row(law_scene=None, second=None, **properties):
    """A building by its matrix beside a chain of storeys."""
    first = ps.Building("a", MASSES, stiffness_matrix=flexible(), **properties)
    second = second or ps.Building("b", [150.0, 130.0, 110.0], [1.6e5, 1.3e5, 1e5], damping_ratio=0.03)
    contact = ps.ContactProperties(linear_stiffness=8e5, hertz_stiffness=8e6, restitution=0.6)
    return ps.Scene([first, second], gaps=[0.01], contact=contact, **(law_scene or {}))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stiffness_matrix": [[2.0, -1.0], [-0.9, 1.0]]}, "not symmetric: entries 1, 2 and 2, 1 are -1 and -0.9"),
        ({"stiffness_matrix": [[1.0, 2.0], [2.0, 1.0]]}, "not positive definite: its lowest eigenvalue is -1 kN/m"),
        ({"stiffness_matrix": [[1.0]]}, "is 1 x 1 for 2 masses"),
        ({"stiffness_matrix": "absent.csv"}, "'absent.csv' could not be read"),
        ({"stiffnesses": 1e5}, "comes beside stiffnesses"),
        ({"yield_strengths": 100.0}, "storeys that yield, or infill, need stiffnesses"),
        ({"p_delta": True, "stiffness_matrix": [[90.0, -40.0], [-40.0, 30.0]]}, "does not stand under its weight"),
        ({"damping_matrix": [[1.0, 2.0], [2.0, 1.0]]}, "would feed energy in"),
        ({"modal_damping": [0.05]}, "1 ratios for 2 modes"),
        ({"modal_damping": 0.05, "damping_matrix": np.eye(2)}, "comes beside modal_damping"),
    ],
)
def test_matrices_that_are_refused(change, words):
    arguments = {"stiffness_matrix": [[3e5, -1e5], [-1e5, 1e5]], **change}
    with pytest.raises(ps.PoundingSweepError, match=words):
        ps.Building("a", [100.0, 80.0], **arguments)


def test_struck_columns_of_a_matrix_need_a_stiffness():
    with pytest.raises(ps.PoundingSweepError, match="give column_stiffnesses"):
        row({"contacts": "floors and columns"}, storey_heights=3.4)


def test_a_period_scales_all_stiffnesses_once():
    chain = ps.Building("a", MASSES, 1e5, period=0.8, p_delta=True, foundation=None)
    assert replace(chain, p_delta=False).periods[0] == pytest.approx(0.8, rel=1e-12)
    assert replace(chain, stiffnesses=[2.0 * k for k in chain.stiffnesses], p_delta=False).periods[0] < 0.6


SOIL = ps.Foundation(170.0, 5900.0, 1.17e6, 3.5e7, 2.7e3, 3.8e4)
DAMPING = 4.0 * np.diag(MASSES) / 100.0 * 20.0 + 1e-3 * flexible(seed=5)
ROWS = {
    "rayleigh": row(),
    "modal": row(modal_damping=[0.05, 0.04, 0.03, 0.1]),
    "a damping matrix": row(damping_matrix=DAMPING),
    "dashpots": row(dashpots=[300.0, 0.0, 200.0, 100.0]),
    "a foundation": row(foundation=SOIL),
    "a foundation and modal damping": row(foundation=SOIL, modal_damping=0.04),
    "p_delta": row(p_delta=True),
    "a link": row({"links": [ps.Link("a-b", [2], 2e4, 300.0)]}),
    "a bumper": row({"bumpers": [ps.Bumper("a-b", "hunt_crossley", 4e6, 0.7, storeys=[3])]}),
    "struck columns": row({"contacts": "floors and columns"}, storey_heights=3.4, column_stiffnesses=9e4),
    "a chain of modal damping": row(
        second=ps.Building("b", [150.0, 130.0, 110.0], [1.6e5, 1.3e5, 1e5], modal_damping=[0.02, 0.05, 0.05])
    ),
    "a chain that yields": row(
        second=ps.Building("b", [150.0, 130.0], [1.6e5, 1.3e5], yield_strengths=[500.0, 400.0], hardening=0.05)
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ROWS)
def test_every_kind_of_row_beside_the_reference(kind):
    law = "linear" if kind == "struck columns" else "kelvin_voigt"
    check_reference(ROWS[kind], law, 1e-8, method="exact", loose=["acceleration_max"])


def test_ratios_of_an_axis_are_those_of_all_modes_where_damping_is_modal(stub_engine):
    """Whatever Rayleigh's ratio is that such a building has by default, and none of a damping matrix."""
    building = ps.Building("a", MASSES, stiffness_matrix=flexible(), modal_damping=0.1)
    cube = ps.Sweep(ps.Scene([building]), "el_centro", "none", damping_ratios=[0.02, 0.05]).run()
    assert cube.first_damping_ratio.values.ravel() == pytest.approx([0.02, 0.05])
    scene = ps.Scene([replace(building, modal_damping=None, damping_matrix=DAMPING)])
    with pytest.raises(ps.PoundingSweepError, match="damping_matrix, which ratios do not change"):
        ps.Sweep(scene, "el_centro", "none", damping_ratios=[0.02])
