"""What every kind of row must do: equal the reference, converge, keep its energy, know its image, come back from files.

The kinds, with their steps and bounds, are in `kinds.py`; what is particular to one is in a module of its own.
"""

from __future__ import annotations

import itertools
import json
import pickle
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from against_reference import buildings_of, check_energy, check_order, check_reference, motion, simulate
from kinds import FEATURES, INVARIANT, KINDS, SWEEPS, mirrored, varied
from scenes import EVERY, pair, scene_of_case

import pounding_sweep as ps
from pounding_sweep.engine.row_kernel import Numerics, kernel_shape
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.request.axes import Case
from pounding_sweep.request.spec import json_data, scene_of
from pounding_sweep.variables.registry import Status, reducers_for


def cases(runs, slow=lambda *_: False):
    return [pytest.param(*case, marks=[pytest.mark.slow] * slow(*case)) for case in runs]


BY_DAY = [(name, kind.law, method) for name, kind in KINDS.items() for method in kind.runs]
NIGHTLY = [(name, *case) for name, kind in KINDS.items() for case in itertools.product(kind.laws, kind.slow)]


@pytest.mark.parametrize(("name", "law", "method"), cases([*BY_DAY, *NIGHTLY], lambda *case: case not in BY_DAY))
def test_every_variable_equals_the_reference(name, law, method):
    kind = KINDS[name]
    dt, bound = kind.runs[method] if (name, law, method) in BY_DAY else kind.slow[method]
    loose = kind.loose if law == "stereomechanical" else ()
    got = check_reference(kind.scene, law, bound, kind.points, kind.scale, loose, method=method, dt=dt)
    assert law != kind.law or kind.acts(got)
    # peaks are those of the histories, or between their steps
    for of, largest in (("acceleration", "acceleration_max"), ("link_force", "link_force_max"),
                        ("foundation_sway", "foundation_sway_max"), ("penetration", "penetration_max")):  # fmt: skip
        if of in got and law == kind.law and dt < 5e-3:
            assert np.nanmax(np.abs(np.abs(got[of]).max("time") / got[largest].where(got[largest] > 0) - 1.0)) < 2e-2


@pytest.mark.parametrize(
    ("name", "method"),
    cases(
        [(name, m) for name, kind in KINDS.items() if kind.order for m in {**kind.runs, **dict.fromkeys(kind.nightly)}],
        lambda name, method: method in KINDS[name].nightly,
    ),
)
def test_errors_fall_at_the_order_of_the_scheme(name, method):
    check_order(KINDS[name].scene, method, KINDS[name].order, KINDS[name].law)


@pytest.mark.parametrize(
    ("name", "method"),
    [
        *((name, method) for name in ("yields", "linked", "founded", "smooth") for method in INVARIANT[name][2]),
        *(("the pair", "rk4"), ("the pair", "exact")),
    ],
)
def test_energy_closes(name, method):
    scene, law, _ = INVARIANT[name]
    stores = KINDS[name].stores if name in KINDS else ()
    for one in check_energy(scene, method, *stores, law=law):
        for history, end in (("strain", "energy_strain"), ("kinetic", "energy_kinetic"),
                             ("hysteretic", "hysteretic_energy"), ("given_to_links", "energy_links")):  # fmt: skip
            if end in one and history in one:
                assert np.allclose(one[history].values[-1], one[end].values), history
        if "hysteretic" in one:
            assert (np.diff(one.hysteretic.values, axis=0) >= -1e-12).all()
    for store in stores:  # else the balance would close without it
        assert float(np.abs(one[store]).max()) > 0.05 * float(one.energy_input.max())


SIGNS = {"displacement_max": "displacement_min", "displacement_min": "displacement_max", "residual_drift": None}
SEEN = (
    *("displacement_max", "drift_max", "storey_shear_max", "ductility_max", "residual_drift", "foundation_sway_max"),
    *("foundation_rotation_max", "energy_damping", "energy_links", "hysteretic_energy"),
)


def image(one, name):
    return -one[SIGNS[name] or name] if name in SIGNS else one[name]


@pytest.mark.parametrize(
    ("name", "method"),
    [(name, method) for name, (*_, methods) in INVARIANT.items() if name != "staggered" for method in methods],
)
def test_a_ground_that_moves_the_other_way_mirrors_the_motion_to_the_last_bit(name, method):
    scene, law, _ = INVARIANT[name]
    far = replace(scene, gaps=[1e3] * len(scene.gaps))
    one, other = (simulate(far, law, 101, scale, method=method, dt=1e-3) for scale in (1.5, -1.5))
    assert np.array_equal(one.displacement, -other.displacement, equal_nan=True)
    for each in (each for each in (*SEEN, "displacement_min", "link_force_max") if each in one):
        assert np.array_equal(other[each], image(one, each), equal_nan=True), each


@pytest.mark.parametrize(
    ("name", "method"),
    cases(
        [(name, method) for name, (*_, methods) in INVARIANT.items() for method in methods],
        lambda name, _: "pair" not in name,
    ),
)
def test_a_mirrored_row_moves_as_its_image(name, method):
    """Not to the last bit: a step that floors of one row cut at a touch may be cut elsewhere in the other."""
    scene, law, _ = INVARIANT[name]
    seen, pairs = mirrored(scene)
    one, other = (simulate(s, law, 101, x, method=method, dt=1e-3) for s, x in ((scene, 1.5), (seen, -1.5)))
    assert int(one.impact_count.sum()) == int(other.impact_count.sum()) > 0
    for each in (each for each in SEEN if each in one and one[each].notnull().any()):
        want = image(one, each).sel(building=other.building).values
        np.testing.assert_allclose(other[each].values, want, rtol=1e-7, atol=1e-7 * np.nanmax(abs(want)), err_msg=each)
    for each in (
        *("impact_force_max", "penetration_max", "impulse", "approach_speed_max", "contact_work", "link_force_max"),
        *("column_shear_top_max", "column_shear_bottom_max"),
    ):
        for pair_name, name_there in pairs.items() if each in one else ():
            mine, theirs = one[each].sel(pair=pair_name), other[each].sel(pair=name_there)
            # an elastic contact takes no work
            away = {"rtol": 1e-7, "atol": 1e-7 * float(abs(one[each]).max()) + 1e-12}
            np.testing.assert_allclose(theirs.values, mine.values, **away, err_msg=each)


@pytest.mark.parametrize("name", FEATURES)
def test_a_scene_without_it_asks_for_the_kernel_that_it_had(name):
    scene, none, shape, reducers = FEATURES[name]
    for law, method in itertools.product(("none", "linear"), ("rk4", "exact")):
        asked = [kernel_shape(s, LAWS[law], Numerics(method, 1e-3), reducers_for(EVERY)) for s in (none, pair())]
        assert asked[0] == asked[1]
        assert not any(getattr(asked[0], each) for each in shape if each not in ("n_moving", "p_delta"))
        assert not reducers & asked[0].reducers
    asked = kernel_shape(scene, LAWS["linear"], Numerics("rk4", 1e-3), reducers_for(EVERY))
    assert {each: getattr(asked, each) for each in shape} == shape
    assert reducers <= asked.reducers
    few = kernel_shape(scene, LAWS["linear"], Numerics("rk4", 1e-3), reducers_for(["displacement_max"]))
    assert not reducers & few.reducers


@pytest.mark.parametrize("name", [*KINDS, "smooth"])
def test_a_row_comes_back_from_files(name, tmp_path):
    scene = KINDS[name].scene if name in KINDS else INVARIANT[name][0]
    again = [scene_of(json.loads(json.dumps(json_data(scene), allow_nan=False)))]
    if not scene.bumpers:  # whose laws a sweep file names, and a pickle can't hold
        path = ps.Sweep(scene, "el_centro", "linear").to_toml(tmp_path / "sweep.toml")
        again += [pickle.loads(pickle.dumps(scene)), ps.load_sweep(path).spec.scene]
    for each in again:
        assert each == scene
        assert hash(each) == hash(scene)
        assert each.contacts.kind == scene.contacts.kind


@pytest.mark.parametrize("name", cases([(name,) for name in SWEEPS], lambda name: name != "yields"))
def test_a_sweep_equals_its_scenarios_one_by_one(name):
    """What the planner shares, leaves out and broadcasts, against scenarios on their own."""
    given, near = SWEEPS[name]
    sweep = ps.Sweep(**given)
    cube, rng, touched = sweep.run(), np.random.default_rng(1), 0
    assert (cube.status == Status.OK).all()
    varied_dims = [dim for dim in cube.status.dims if dim in cube.coords]
    for _ in range(25):
        place = {dim: int(rng.integers(cube.sizes[dim])) for dim in varied_dims}
        at = {dim: cube[dim].values[i] for dim, i in place.items()}
        record = next(each for each in sweep.spec.records if each.name == at.get("record", each.name))
        law = "kelvin_voigt" if at["law"] == "none" else str(at["law"])
        options = {each: given[each] for each in ("method", "dt", "rest") if each in given}
        one = ps.simulate(varied(given["scene"], at), record.scaled(float(at.get("scale", 1.0))), law=law, **options)
        for each in (each for each in given["outputs"] if each in cube and each in one):
            want = one[each].values
            mine = cube[each].isel({dim: i for dim, i in place.items() if dim in cube[each].dims}).values
            away = {"rtol": near, "atol": near * np.nanmax(np.abs(want), initial=1e-12)}
            np.testing.assert_allclose(mine.reshape(want.shape), want, **away, err_msg=f"{each} {at}")
        touched += bool(one.impact_count.sum() > 0)
    assert touched >= 3


@pytest.mark.parametrize("name", ["linked", "founded", "staggered"])
def test_factors_of_buildings_are_built_in(name):
    """Into the row of one scenario, and what a kernel is given of it."""
    scene = KINDS[name].scene
    factors = {"period_factors": {"a": 1.3, "b": 0.7}, "mass_factors": {"a": 0.5, "b": 1.5}}
    at = {f"{kind[:-1]}_{b}": x for kind, values in factors.items() for b, x in values.items()}
    want = varied(scene, at | {"law": "linear", "gap": scene.gaps[0], "damping_ratio": 0.06})
    one = scene_of_case(scene, Case("linear", damping_ratio=0.06, **factors))
    given = Variants(scene, np.array([[1.3, 0.7]]), np.array([[0.5, 1.5]]), np.array([0.06]))
    own, stiffness = variants_of(want), np.array([8e5])
    for row in (variants_of(one), given):
        for each in ("masses", "stiffnesses", "dashpots", "contact_masses"):
            np.testing.assert_allclose(getattr(row, each)[0], getattr(own, each)[0], rtol=1e-12, err_msg=each)
        np.testing.assert_allclose(row.contact_stiffnesses(stiffness), own.contact_stiffnesses(stiffness), rtol=1e-12)
    for b, building in enumerate(want.buildings):
        assert one.buildings[b].rayleigh == pytest.approx(building.rayleigh)
        assert [float(x[0]) for x in given.rayleigh(b)] == pytest.approx(building.rayleigh)
        if building.foundation:
            for each in ("masses", "stiffnesses", "dashpots"):
                np.testing.assert_allclose(
                    getattr(one.buildings[b].foundation, each), getattr(building.foundation, each)
                )
                np.testing.assert_allclose(getattr(given, f"base_{each}")[0], getattr(building.foundation, each))


@pytest.mark.parametrize(
    ("name", "outputs"),
    [
        ("linked", ["link_force_max", "energy_links"]),
        ("founded", ["foundation_sway_max", "foundation_rotation_max"]),
        ("staggered", ["column_shear_bottom_max", "column_shear_top_max"]),
    ],
)
def test_outputs_of_it_are_of_rows_with_it_only(name, outputs, stub_engine):
    del stub_engine
    settings = {"method": "rk4", "dt": 2e-3, "outputs": [*outputs, "impact_count"]}
    cubes = [ps.Sweep(scene, motion(51), "kelvin_voigt", **settings).run() for scene in (KINDS[name].scene, pair())]
    assert [set(outputs) <= set(cube) for cube in cubes] == [True, False]
    assert not set(outputs) & set(cubes[1])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "newmark"])
@pytest.mark.parametrize("name", ["bumped", "staggered"])
def test_steps_that_are_not_split_find_the_same_impacts(name, method):
    given = {"law": "kelvin_voigt", "method": method, "dt": 5e-5}
    got, want = (simulate(KINDS[name].scene, **given, locate=located) for located in (False, True))
    assert got.impact_count.equals(want.impact_count)
    np.testing.assert_allclose(got.impact_force_max, want.impact_force_max, rtol=0.02)


def test_what_the_reference_does_not_know_is_refused():
    @dataclass(frozen=True)
    class Turning(ps.Building):
        turns: float = field(default=0.0, kw_only=True)

    row = [Turning("a", [1.0], [1.0], turns=turns) for turns in (0.0, 2.0)]
    assert buildings_of(ps.Scene(row[:1]))[0].masses == [1.0]
    with pytest.raises(ValueError, match="knows no turns of buildings"):
        buildings_of(ps.Scene(row[1:]))
