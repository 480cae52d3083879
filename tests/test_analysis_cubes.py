"""Comparisons of cubes made by hand, against plain loops and closed forms, and of a real sweep."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import xarray as xr
from scenes import AXES as SWEPT
from scenes import LAWS, PGA, hand_cube, motions, random_fill, row, sweep_attribute

import pounding_sweep.analysis as analysis
import pounding_sweep.figures as figures
from pounding_sweep import Record, Sweep
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import get_law, realised_restitution
from pounding_sweep.model.scene import Scene
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.variables.registry import Status

AXES = {"law": LAWS, "gap": [0.01, 0.02], "restitution": [0.2, 0.6, 1.0], "record": list(PGA), "scale": [0.5, 1.0]}
ENERGIES = ("energy_input", "energy_damping", "energy_held", "contact_work")
AT = {"pair": "a-b", "storey": 1}


def spoiled(seed, *names):
    """Return a random cube some scenarios of which are not ok."""
    rng = np.random.default_rng(seed)
    status = rng.choice([0, 0, 0, 0, int(Status.DIVERGED), int(Status.UNDER_RESOLVED_CONTACT)], (3, 2, 3, 3, 2))
    return hand_cube(AXES, random_fill(seed, *names), status=status)


def of_storeys(*values):
    """Values along the first axis, the same at all floors."""
    return np.array(values)[:, None, None]


def over_base(cube, name, base):
    """Values over those of the law at `base`, by a plain loop, where both are ok."""
    ok, values = cube.status.values == 0, cube[name].values
    expected = np.full((2, *values.shape[1:]), np.nan)
    for law, *rest in np.ndindex(2, *ok.shape[1:]):
        here, there = (law + 1, *rest), (base, *rest)
        if ok[here] and ok[there]:
            expected[law, *rest] = values[here] / values[there]
    return expected


# -- amplification -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_amplification_by_a_plain_loop(seed):
    names = ["displacement_max", "displacement_min", "drift_max", "energy_input"]
    cube = spoiled(seed, *names, "impact_count")
    ratios = analysis.amplification(cube)
    assert list(ratios.law.values) == ["linear", "hertz_damped"]
    for name in names:
        np.testing.assert_array_equal(ratios[f"{name}_ratio"], over_base(cube, name, 0))
    assert ratios.drift_max_ratio.attrs["units"] == "1"
    assert "largest interstorey drift" in ratios.drift_max_ratio.attrs["long_name"]
    assert np.isnan(ratios.drift_max_ratio.sel(building="b", storey=2)).all()


def test_peak_displacement_is_the_larger_of_both_signs():
    fill = {"displacement_max": np.ones(1), "displacement_min": of_storeys(-4.0, -2.0, -6.0)}
    ratios = analysis.amplification(hand_cube({"law": LAWS}, fill)).sel(building="a", storey=1)
    np.testing.assert_array_equal(ratios.displacement_peak_ratio, [0.5, 1.5])
    np.testing.assert_array_equal(ratios.displacement_max_ratio, [1.0, 1.0])


def test_what_touches_and_rest_without_pounding():
    fill = {"drift_max": of_storeys(0.0, 1.0, 2.0), "impact_count": of_storeys(0, 0, 2)}
    ratios = analysis.amplification(hand_cube({"law": LAWS}, fill))
    np.testing.assert_array_equal(ratios.touches, [0.0, 1.0])
    assert ratios.drift_max_ratio.isnull().all()


def test_listed_cases_are_compared_with_their_own_run_without_pounding():
    laws, records = ["none", "linear", "none", "linear", "hertz_damped"], ["one", "one", "two", "two", "three"]
    coords = {"law": (("case",), laws, {}), "record": (("case",), records, {})}
    cube = hand_cube({"case": [1, 2, 3, 4, 5]}, {"drift_max": of_storeys(1.0, 3.0, 2.0, 10.0, 7.0)}, coords=coords)
    ratios = analysis.amplification(cube)
    np.testing.assert_array_equal(ratios.case, [2, 4, 5])
    np.testing.assert_array_equal(ratios.drift_max_ratio.sel(building="a", storey=1), [3.0, 5.0, np.nan])


def test_cubes_that_xarray_opened(tmp_path):
    """It reads the laws of cases as bytes, and those of an axis as objects."""
    axes = {"law": LAWS, "record": list(PGA), "scale": [1.0, 2.0]}
    fill = random_fill(1, "drift_max", "impact_count")
    cases = hand_cube({"case": [1, 2]}, fill, coords={"law": (("case",), ["none", "linear"], {})})
    for number, cube in enumerate((cases, hand_cube(axes, fill))):
        path = write_cube(cube, tmp_path / f"{number}.nc")
        with xr.open_dataset(path) as opened, open_cube(path) as own:
            assert opened.law.dtype.kind in "OS"
            for compare in (analysis.amplification, analysis.impacts):
                xr.testing.assert_identical(compare(cube=opened), compare(cube))
                xr.testing.assert_allclose(compare(own), compare(cube))
            if "scale" in opened.dims:
                assert figures.fragility(opened).axes


def test_runs_without_pounding_that_some_gaps_of_a_merged_cube_lack():
    axes = {"law": LAWS, "gap": [0.01, 0.02], "record": list(PGA)}
    drift = hand_cube(axes, random_fill(5, "drift_max")).drift_max.values
    drift[0, 0] = drift[0, 1]  # the law "none" ignores the gap
    status = np.zeros(drift.shape[:3], np.int8)
    whole = analysis.amplification(hand_cube(axes, {"drift_max": drift}))
    status[0, 0, 0] = status[0, 1, 1] = Status.NOT_RUN
    xr.testing.assert_identical(analysis.amplification(hand_cube(axes, {"drift_max": drift}, status=status)), whole)


def test_what_is_left_of_a_cube_after_a_selection_is_a_cube():
    """Scalar coordinates stay as labels."""
    cube = spoiled(11, "drift_max", "impact_count", "impact_force_max")
    at = {"gap": 0.02, "restitution": 0.6, "storey": 1}
    part = cube.sel(at).sel(pair="a-b")
    ratios = analysis.amplification(part)
    np.testing.assert_array_equal(ratios.drift_max_ratio, analysis.amplification(cube).drift_max_ratio.sel(at))
    assert ratios.gap == 0.02
    at["pair"] = "a-b"
    compared = analysis.laws(part, "linear").impact_force_max_ratio
    whole = analysis.laws(cube, "linear").impact_force_max_ratio.sel(basis=["nominal"])
    np.testing.assert_array_equal(compared, whole.sel(at))
    over = ["record", "scale"]
    touching = analysis.impacts(part, over).touching
    np.testing.assert_array_equal(touching, analysis.impacts(cube, over).touching.sel(at))
    curve = analysis.fragility(part.sel(law="linear"), confidence=None)
    whole = analysis.fragility(cube.sel(storey=[1]), confidence=None).sel(law="linear", gap=0.02, restitution=0.6)
    assert (curve.pair, curve.law) == ("a-b", "linear")
    assert (curve.fit_status, curve.trials) == (whole.sel(pair="a-b").fit_status, whole.sel(pair="a-b").trials)


# -- laws --------------------------------------------------------------------------------------------------------------


def test_nominal_ratios_by_a_plain_loop():
    cube = spoiled(5, "impact_force_max", "impact_count")
    ratios = analysis.laws(cube, "linear").sel(basis="nominal").impact_force_max_ratio
    np.testing.assert_array_equal(ratios, over_base(cube, "impact_force_max", 1))


def test_realised_values_are_those_of_a_law_that_is_linear_in_it():
    """A response that is linear in the realised restitution is interpolated without error."""
    nominal = np.linspace(0.1, 1.0, 10)
    laws = ["hertz_damped", "kelvin_voigt_tension"]
    realised = np.array([realised_restitution(get_law(law), nominal) for law in laws])
    force = 1000.0 - 400.0 * realised
    cube = hand_cube({"law": laws, "restitution": nominal}, {"impact_force_max": force[:, :, None, None]})
    compared = analysis.laws(cube).sel(basis="realised", **AT)
    inside = (nominal >= realised.min(axis=1)[:, None]) & (nominal <= realised.max(axis=1)[:, None])
    expected = np.where(inside, 1000.0 - 400.0 * nominal, np.nan)
    np.testing.assert_allclose(compared.impact_force_max_compared, expected, rtol=1e-9)
    assert inside[0].sum() < 10  # hertz_damped does not realise low restitutions
    ratios = np.where(inside & inside.all(axis=0), 1.0, np.nan)
    np.testing.assert_allclose(compared.impact_force_max_ratio, ratios)


def test_law_without_damping_realises_one_only():
    cube = hand_cube({"law": ["linear", "hertz_damped"], "restitution": [0.6, 1.0]}, random_fill(1, "impulse"))
    compared = analysis.laws(cube)
    assert compared.attrs["reference_law"] == "hertz_damped"  # the first damped one
    part = compared.impulse_compared.sel(basis="realised", law="linear", **AT)
    assert np.isnan(part.sel(restitution=0.6))
    assert part.sel(restitution=1.0) == cube.impulse.sel(law="linear", restitution=0.6, **AT)


def test_one_restitution_says_why_there_is_no_second_basis():
    compared = analysis.laws(hand_cube({"law": ["linear", "hertz"]}, random_fill(1, "impulse")))
    assert compared.basis.values.tolist() == ["nominal"]
    assert "one restitution" in compared.attrs["realised_basis"]
    assert compared.attrs["reference_law"] == "linear"


# -- impacts -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "over", [None, ["record", "scale"], *(pytest.param(over, marks=pytest.mark.slow) for over in (["gap"], []))]
)
def test_impact_statistics_by_a_plain_loop(over):
    cube = spoiled(6, "impact_count", "impact_force_max", "first_impact_time")
    statistics = analysis.impacts(cube, over).sel(AT)
    together = [dim for dim in AXES if dim != "law"] if over is None else over
    apart = [dim for dim in AXES if dim not in together]
    part = cube.sel(law=["linear", "hertz_damped"]).sel(AT)
    part = part[["status", "impact_count", "impact_force_max"]].transpose(*apart, *together)
    for place in itertools.product(*(range(part.sizes[dim]) for dim in apart)):
        cell = statistics.isel(dict(zip(apart, place, strict=True)))
        status, count, force = (part[name].values[place].ravel() for name in part)
        ok = status == 0
        hit = ok & (count > 0)
        assert (cell.scenarios, cell.left_out) == (ok.sum(), (~ok).sum())
        if not ok.any():
            assert np.isnan(cell.touching)
            continue
        assert cell.touching == cell.pair_touching == hit.sum()
        np.testing.assert_allclose(cell.touching_share, hit.sum() / ok.sum())
        expected = np.quantile(force[hit], [0.0, 0.16, 0.5, 0.84, 1.0]) if hit.any() else [np.nan] * 5
        np.testing.assert_allclose(cell.impact_force_max_fractiles, expected)


def test_impacts_of_listed_cases_by_law():
    coords = {"law": (("case",), ["linear", "none", "hertz", "linear"], {})}
    cube = hand_cube({"case": [1, 2, 3, 4]}, {"impact_count": of_storeys(2, 0, 0, 4)}, coords=coords)
    statistics = analysis.impacts(cube)
    np.testing.assert_array_equal(statistics.pair_touching_share.sel(pair="a-b"), [1.0, 0.0])
    np.testing.assert_array_equal(statistics.scenarios, [2, 1])
    assert statistics.impact_count_fractiles.sel(law="linear", quantile=0.5, **AT) == 3.0


def test_touch_is_told_by_what_has_values():
    """A law whose velocities jump has no force; pairs that never meet have nothing."""
    fill = {"impact_force_max": np.full(1, np.nan), "approach_speed_max": of_storeys(0.0, 0.5)}
    statistics = analysis.impacts(hand_cube({"law": ["linear", "stereomechanical"]}, fill))
    np.testing.assert_array_equal(statistics.touching.sel(AT), [0.0, 1.0])
    assert statistics.impact_force_max_fractiles.isnull().all()
    a, b = (Building(name, [1.0], [1.0], storey_heights=[height]) for name, height in (("a", 3.0), ("b", 4.0)))
    scene = Scene([a, b], [0.1], allow_unmet=True)
    statistics = analysis.impacts(hand_cube({"law": ["linear"]}, {"impact_count": [-1]}, scene=scene))
    assert statistics.pair_touching_share.isnull().all()


# -- energies ----------------------------------------------------------------------------------------------------------


def test_energy_budget_by_a_plain_loop():
    cube = spoiled(7, *ENERGIES)
    budget = analysis.energy(cube)
    for place in np.ndindex(2, 2, 3, 3, 2):
        here = (place[0] + 1, *place[1:])
        parts = [cube[name].values[here] for name in ENERGIES]
        transfer = parts[0] - parts[1] - parts[2]
        residual = transfer.sum() - parts[3].sum()
        relative = abs(residual) / max(np.abs(part).max() for part in parts)
        bad = np.nan if cube.status.values[here] else 1.0
        for name, value in (("energy_transfer", transfer), ("residual", residual), ("residual_relative", relative)):
            np.testing.assert_allclose(budget[name].values[place], value * bad, rtol=1e-12)
    assert budget.attrs["largest_residual_relative"] == budget.residual_relative.max()
    np.testing.assert_array_equal(budget.transfer_sum, budget.energy_transfer.sum("building", skipna=False))
    assert budget.energy_transfer.attrs["units"] == "kN m"


def test_single_building_has_no_contacts():
    single = Scene([Building("a", [1.0], [1.0])])
    budget = analysis.energy(hand_cube({"law": ["none"]}, random_fill(2, *ENERGIES[:3]), scene=single))
    np.testing.assert_allclose(budget.residual, budget.energy_transfer.sel(building="a"))


@pytest.mark.parametrize("dim", ["building", "pair"])
def test_a_part_of_the_row_has_no_balance(dim):
    row = Scene([Building(name, [1.0], [1.0]) for name in "abc"], [0.1, 0.1])
    attributes = sweep_attribute(row, "el_centro", laws="none")
    cube = hand_cube({"law": LAWS}, random_fill(1, *ENERGIES), scene=row, attributes=attributes)
    assert analysis.energy(cube).sizes[dim] == cube.sizes[dim]
    with pytest.raises(InputError, match=f"has 1 of {cube.sizes[dim]} along '{dim}'"):
        analysis.energy(cube.isel({dim: [0]}))


# -- suites ------------------------------------------------------------------------------------------------------------


def test_fractiles_by_a_plain_loop():
    cube = spoiled(8, "drift_max", "first_impact_time")
    result = analysis.fractiles(cube)
    for place in np.ndindex(3, 2, 3, 2):
        here = (*place[:3], slice(None), place[3])
        status = cube.status.values[here]
        rows = cube.drift_max.values[here][status == 0][:, 0, 0]
        expected = np.quantile(rows, [0.16, 0.5, 0.84, 1.0]) if rows.size else np.full(4, np.nan)
        np.testing.assert_allclose(result.drift_max_fractiles.values[(slice(None), *place, 0, 0)], expected)
        assert result.drift_max_count.values[(*place, 0, 0)] == result.scenarios.values[place] == rows.size
        assert result.left_out_diverged.values[place] == (status == int(Status.DIVERGED)).sum()
    assert result.drift_max_fractiles.attrs["units"] == "m"
    assert (result.drift_max_count.sel(building="b", storey=2) == 0).all()


def test_incremental_curves_by_a_plain_loop():
    scales, levels = [2.0, 0.5, 1.0], [0.9, 2.0, 3.3, 5.0, 8.0]
    status = np.zeros((1, 3, 3))
    status[0, 1, 0] = int(Status.DIVERGED)
    axes = {"law": ["linear"], "record": list(PGA), "scale": scales}
    cube = hand_cube(axes, random_fill(9, "drift_max"), status=status)
    curves = analysis.incremental(cube, ["drift_max"], levels=levels)
    np.testing.assert_array_equal(curves.intensity, np.outer(list(PGA.values()), scales))
    assert curves.intensity.attrs["units"] == "m s-2"
    curves = curves.sel(law="linear", building="a", storey=1)
    for i, level in enumerate(levels):
        values = []
        for record, pga in enumerate(PGA.values()):
            drift = cube.drift_max.values[0, record, :, 0, 0]
            rows = sorted(zip(pga * np.array(scales), drift, status[0, record], strict=True))
            for (x0, y0, s0), (x1, y1, s1) in itertools.pairwise(rows):
                if x0 <= level <= x1 and not (s0 or s1):
                    values.append(y0 + (y1 - y0) * (level - x0) / (x1 - x0))
                    break
        assert curves.drift_max_count[i] == len(values)
        expected = np.quantile(values, [0.16, 0.5, 0.84]) if len(values) > 1 else [np.nan] * 3  # half of three
        np.testing.assert_allclose(curves.drift_max_fractiles[:, i], expected)


def test_incremental_fractiles_go_as_far_as_half_of_the_records_reach():
    """Records of unlike peaks at the same scales, from 1 to 2: half of four curves reach 2 to 6 m/s2."""
    peaks, scales = np.array([1.0, 2.0, 3.0, 4.0]), [1.0, 1.5, 2.0]
    drift = (np.outer(peaks, scales))[..., None, None]  # that of each record is its intensity
    coords = {"record_pga": (("record",), peaks, {"units": "m s-2"})}
    cube = hand_cube({"record": list("abcd"), "scale": scales}, {"drift_max": drift}).assign_coords(coords)
    curves = analysis.incremental(cube, quantiles=[0.5]).sel(building="a", storey=1)
    np.testing.assert_allclose(curves["level"][[0, -1]], [2.0, 6.0])
    level = curves["level"].where(curves["drift_max_count"] >= 2)  # one record alone reaches 2 to 3
    assert level.count() == 20
    np.testing.assert_allclose(curves["drift_max_fractiles"].sel(quantile=0.5), level)
    assert "no_fractiles" not in curves.attrs
    apart = cube.assign_coords(record_pga=("record", [1.0, 10.0, 100.0, 1000.0], {"units": "m s-2"}))
    assert "half of the 4 curves" in analysis.incremental(apart).attrs["no_fractiles"]


def test_incremental_curves_of_both_directions():
    """A record at negative scales is another motion: the fractiles are of twice as many curves."""
    settings = {"outputs": ["drift_max"], "levels": [2.0, 3.3, 5.0, 6.0]}
    cube = hand_cube({"record": list(PGA), "scale": [-2.0, -1.0, 1.0, 2.0]}, random_fill(4, "drift_max"))
    curves = analysis.incremental(cube, **settings)
    apart = [
        cube.sel(scale=way).assign_coords(record=[f"{name} {way[0]}" for name in PGA], scale=[1.0, 2.0])
        for way in ([1.0, 2.0], [-1.0, -2.0])
    ]
    suite = analysis.incremental(xr.concat(apart, "record"), **settings)
    assert curves.attrs["curves"] == suite.attrs["curves"] == 2 * len(PGA)
    assert int(curves["drift_max_count"].max()) > len(PGA)
    for name in ("drift_max_fractiles", "drift_max_count"):
        np.testing.assert_array_equal(curves[name], suite[name])


def test_incremental_curves_against_another_intensity():
    cube = hand_cube({"record": ["one", "two"], "scale": [1.0, 2.0]}, random_fill(1, "drift_max"))
    sa = xr.DataArray([7.0, 5.0], dims="record", coords={"record": ["two", "one"]}, attrs={"units": "m s-2"})
    curves = analysis.incremental(cube, intensity=sa)
    np.testing.assert_array_equal(curves.intensity, [[5.0, 10.0], [7.0, 14.0]])
    with pytest.raises(InputError, match="along 'record' alone"):
        analysis.incremental(cube, intensity=sa.expand_dims("period"))


# -- what can not be compared ------------------------------------------------------------------------------------------

SINGLE = Scene([Building("a", [1.0], [1.0])])


def small(*names, scene=None, **axes):
    """Return a cube of the laws `LAWS` with these outputs and axes."""
    return hand_cube({"law": LAWS, **axes}, random_fill(1, *names), scene=scene)


def listed():
    return small("impulse").rename(law="case").assign_coords(law=("case", LAWS))


@pytest.mark.parametrize(
    ("compare", "cube", "arguments", "message"),
    [
        ("amplification", small("drift_max", law=["linear"]), {}, r"law 'none'.*it has linear\. Add 'none'"),
        ("amplification", small("drift_max", law=["none"]), {}, "a law with contact, this cube has only 'none'"),
        ("amplification", small("drift_max"), {"responses": ["drift"]}, "did you mean 'drift_max'"),
        ("amplification", small("drift_max"), {"responses": ["storey_shear_max"]}, "'storey_shear_max', which"),
        ("energy", small(*ENERGIES).sel(building="a"), {}, "needs the axis 'building'"),
        ("energy", small(*ENERGIES[:3]), {}, "'contact_work', which this cube lacks"),
        ("laws", small("impulse", law=["none", "linear"]), {}, "two laws with contact, this cube has linear"),
        ("laws", small("impulse"), {"reference": "linaer"}, "did you mean 'linear'"),
        ("laws", small("impulse"), {"outputs": ["force"]}, "unknown output"),
        ("laws", listed(), {}, "scenarios as cases"),
        ("impacts", small("drift_max", law=["linear"], scene=SINGLE), {}, "single building"),
        ("impacts", small("impact_count", law=["none"]), {}, "only 'none'"),
        ("impacts", small("drift_max"), {}, "'impact_count' or 'impact_force_max'"),
        ("impacts", small("impact_count"), {"over": ["record"]}, "no axis 'record'"),
        ("impacts", small("impact_count"), {"quantiles": [1.5]}, r"quantiles: 1.5 is not in \[0, 1\]"),
        ("fractiles", small("drift_max"), {}, "needs the axis 'record'; this cube's axes: law"),
        ("fractiles", small("drift_max", record=["one"]), {}, "several values of 'record', and this cube has one"),
        ("incremental", small("drift_max", scale=[1.0]), {}, "several values of 'scale', and this cube has one"),
    ],
)
def test_what_a_comparison_needs_is_told(compare, cube, arguments, message):
    with pytest.raises(InputError, match=message):
        getattr(analysis, compare)(cube, **arguments)


# -- of a real sweep, against other runs of the same engine ------------------------------------------------------------

NOMINAL = np.linspace(0.1, 1.0, 19).round(3).tolist()


@pytest.fixture(scope="module")
def cube():
    """Make the cube of three laws at many restitutions, by the published damping formulas."""
    settings = SWEPT | {"restitutions": NOMINAL, "gaps": [0.002, 0.5], "stiffness_factors": 1.0}
    return Sweep(row(), motions(), **settings).run(workers=1)


def test_equal_realised_restitution_is_what_a_sweep_on_that_basis_gives(cube):
    """Interpolated values are those of runs whose damping realises the restitution exactly."""
    wanted = [0.5, 0.7, 0.9]
    settings = SWEPT | {"laws": ["kelvin_voigt"], "restitutions": wanted, "gaps": [0.002], "stiffness_factors": 1.0}
    exact = Sweep(row(), motions(), **settings, restitution_basis="realised").run(workers=1)
    here = {"law": ["kelvin_voigt"], "gap": [0.002], "restitution": wanted}
    found = analysis.laws(cube, "kelvin_voigt").sel(basis="realised", **here)
    for name in ("impact_force_max", "displacement_max", "displacement_min"):
        error = abs(found[f"{name}_compared"] / exact[name] - 1.0).max()
        nominal = abs(cube[name].sel(here) / exact[name] - 1.0).max()
        assert float(error) < 0.004
        assert float(nominal) > 0.015  # at equal nominal restitution they are others


def test_response_without_pounding_is_proportional_to_its_spectral_acceleration():
    """Of a one-storey building, displacement over Sa is the same for every record: (T / 2 pi)^2."""
    scene = row()
    records = [Record(r.name, r.dt, np.append(r.acceleration, np.zeros(200))) for r in motions()]  # to rest
    settings = {key: SWEPT[key] for key in ("dt", "outputs")} | {"method": "rk4"}
    still = Sweep(scene, records, "none", scales=[0.5, 1.0, 2.0], **settings).run(workers=1)
    period = float(scene.buildings[0].periods[0])
    sa = analysis.response_spectrum(records, [period], 0.05).pseudo_acceleration.squeeze("period")
    curves = analysis.incremental(still, ["displacement_max", "displacement_min"], intensity=sa)
    peak = np.maximum(curves.displacement_max, -curves.displacement_min).sel(building="a", storey=1)
    slope = (peak / curves.intensity).values
    np.testing.assert_allclose(slope, (period / (2.0 * np.pi)) ** 2, rtol=2e-3)
