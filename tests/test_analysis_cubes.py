"""Comparisons of cubes made by hand, against plain loops and closed forms."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import xarray as xr
from analysis_cubes import LAWS, PGA, hand_cube, low_and_high, random_fill, sweep_attribute

import pounding_sweep.analysis as analysis
import pounding_sweep.figures as figures
from pounding_sweep.analysis.scenarios import interpolate
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.laws import get_law, realised_restitution
from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.outputs.variables import Status

AXES = {"law": LAWS, "gap": [0.01, 0.02], "restitution": [0.2, 0.6, 1.0], "record": list(PGA), "scale": [0.5, 1.0]}


def spoiled(seed, *names, **settings):
    """Return a random cube some scenarios of which are not ok."""
    rng = np.random.default_rng(seed)
    status = rng.choice([0, 0, 0, 0, int(Status.DIVERGED), int(Status.UNDER_RESOLVED_CONTACT)], (3, 2, 3, 3, 2))
    return hand_cube(AXES, random_fill(seed, *names), status=status, **settings)


def test_no_name_is_hidden_by_a_module_of_the_package():
    from importlib.resources import files

    modules = {entry.name.removesuffix(".py") for entry in files("pounding_sweep.analysis").iterdir()}
    assert not modules & set(dir(analysis))


def test_interpolation_is_between_neighbours_that_are_there():
    """Rounding is no range, a place itself needs no neighbour, and of equal places the first counts."""
    at, values = np.array([3.0, 1.0, 2.0, 2.0, 4.0]), np.array([[30.0, 10.0, 20.0, 99.0, np.nan]])
    found = interpolate(values, at, np.array([1.0 - 1e-10, 1.25, 2.0, 3.0, 3.5, 4.1, 0.9]))
    np.testing.assert_allclose(found, [[10.0, 12.5, 20.0, 30.0, np.nan, np.nan, np.nan]])


class TestAmplification:
    @pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.slow), 2])
    def test_ratios_by_a_plain_loop(self, seed):
        names = ["displacement_max", "displacement_min", "drift_max", "energy_input", "impact_count"]
        cube = spoiled(seed, *names)
        found = analysis.amplification(cube)
        assert list(found.law.values) == ["linear", "hertz_damped"]
        for name in names[:4]:
            for place in np.ndindex(2, 2, 3, 3, 2):
                law, rest = place[0] + 1, place[1:]
                ok = cube.status.values[(law, *rest)] == 0 and cube.status.values[(0, *rest)] == 0
                expected = cube[name].values[(law, *rest)] / cube[name].values[(0, *rest)]
                np.testing.assert_array_equal(
                    found[f"{name}_ratio"].values[place], expected if ok else expected * np.nan
                )

    def test_peak_displacement_is_the_larger_of_both_signs(self):
        fill = {"displacement_max": np.ones(1), "displacement_min": -np.ones(1)}
        fill["displacement_min"] = np.array([-4.0, -2.0, -6.0])[:, None, None]
        found = analysis.amplification(hand_cube({"law": LAWS}, fill))
        np.testing.assert_array_equal(found.displacement_peak_ratio.sel(building="a", storey=1), [0.5, 1.5])
        np.testing.assert_array_equal(found.displacement_max_ratio.sel(building="a", storey=1), [1.0, 1.0])

    def test_units_coordinates_and_missing_storeys(self):
        found = analysis.amplification(spoiled(3, "drift_max", "impact_count"))
        assert found.drift_max_ratio.attrs["units"] == "1"
        assert "largest interstorey drift" in found.drift_max_ratio.attrs["long_name"]
        assert found.gap.attrs["units"] == "m"
        assert np.isnan(found.drift_max_ratio.sel(building="b", storey=2)).all()

    def test_what_touches_and_rest_without_pounding(self):
        fill = {"drift_max": np.array([0.0, 1.0, 2.0])[:, None, None]}
        fill["impact_count"] = np.array([0, 0, 2])[:, None, None]
        found = analysis.amplification(hand_cube({"law": LAWS}, fill))
        np.testing.assert_array_equal(found.touches, [0.0, 1.0])
        assert found.drift_max_ratio.isnull().all()

    def test_listed_cases_are_compared_with_their_own_run_without_pounding(self):
        laws = ["none", "linear", "none", "linear", "hertz_damped"]
        records = ["one", "one", "two", "two", "three"]
        coords = {"law": (("case",), laws, {}), "record": (("case",), records, {})}
        drift = np.array([1.0, 3.0, 2.0, 10.0, 7.0])
        cube = hand_cube({"case": [1, 2, 3, 4, 5]}, {"drift_max": drift[:, None, None]}, coords=coords)
        found = analysis.amplification(cube)
        np.testing.assert_array_equal(found.case, [2, 4, 5])
        np.testing.assert_array_equal(found.drift_max_ratio.sel(building="a", storey=1), [3.0, 5.0, np.nan])

    def test_cubes_that_xarray_opened(self, tmp_path):
        """It reads the laws of cases as bytes, and those of an axis as objects."""
        of_cases = {"law": (("case",), ["none", "linear"], {})}
        axes = {"law": LAWS, "record": list(PGA), "scale": [1.0, 2.0]}
        cases = hand_cube({"case": [1, 2]}, random_fill(1, "drift_max", "impact_count"), coords=of_cases)
        for number, cube in enumerate((cases, hand_cube(axes, random_fill(2, "drift_max", "impact_count")))):
            path = write_cube(cube, tmp_path / f"{number}.nc")
            with xr.open_dataset(path) as opened:
                assert opened.law.dtype.kind in "OS"
                for compare in (analysis.amplification, analysis.impact_statistics):
                    xr.testing.assert_identical(compare(cube=opened), compare(cube))
                if "scale" in opened.dims:
                    assert figures.fragility(opened).axes

    def test_runs_without_pounding_that_some_gaps_of_a_merged_cube_lack(self):
        axes = {"law": LAWS, "gap": [0.01, 0.02], "record": list(PGA)}
        fill = random_fill(5, "drift_max")
        drift = hand_cube(axes, fill).drift_max.values
        drift[0, 0] = drift[0, 1]  # the law "none" ignores the gap
        status = np.zeros(drift.shape[:3], np.int8)
        whole = analysis.amplification(hand_cube(axes, {"drift_max": drift}))
        status[0, 0, 0] = status[0, 1, 1] = Status.NOT_RUN
        found = analysis.amplification(hand_cube(axes, {"drift_max": drift}, status=status))
        xr.testing.assert_identical(found, whole)

    def test_a_cube_from_a_file(self, tmp_path):
        cube = spoiled(4, "drift_max", "impact_count")
        path = write_cube(cube, tmp_path / "cube.nc")
        with open_cube(path) as opened:
            xr.testing.assert_allclose(analysis.amplification(opened), analysis.amplification(cube))


class TestSelections:
    """What is left of a cube after a selection is a cube."""

    NAMES = ("drift_max", "impact_count", "impact_force_max")

    def test_scalar_coordinates_stay_as_labels(self):
        cube = spoiled(11, *self.NAMES)
        part = cube.sel(gap=0.02, restitution=0.6, pair="a-b", storey=1)
        ratios = analysis.amplification(part)
        whole = analysis.amplification(cube).drift_max_ratio
        np.testing.assert_array_equal(ratios.drift_max_ratio, whole.sel(gap=0.02, restitution=0.6, storey=1))
        assert ratios.gap == 0.02
        compared = analysis.compare_laws(part, "linear")
        assert compared.basis.values.tolist() == ["nominal"]
        whole = analysis.compare_laws(cube, "linear").impact_force_max_ratio
        expected = whole.sel(basis=["nominal"], gap=0.02, restitution=0.6, pair="a-b", storey=1)
        np.testing.assert_array_equal(compared.impact_force_max_ratio, expected)
        touching = analysis.impact_statistics(part, ["record", "scale"]).touching
        whole = analysis.impact_statistics(cube, ["record", "scale"]).touching
        np.testing.assert_array_equal(touching, whole.sel(gap=0.02, restitution=0.6, pair="a-b", storey=1))
        curve = analysis.fragility(part.sel(law="linear"), confidence=None)
        assert curve.pair == "a-b"
        assert curve.law == "linear"
        whole = analysis.fragility(cube.sel(storey=[1]), confidence=None)
        same = whole.sel(law="linear", gap=0.02, restitution=0.6, pair="a-b")
        assert curve.fit_status == same.fit_status
        assert curve.trials == same.trials

    def test_figures_of_selections(self):
        from pounding_sweep.figures import FIGURES

        cube = hand_cube(AXES, random_fill(12, *self.NAMES))
        part = cube.sel(gap=0.02, pair="a-b", building="a", storey=1, record="one")
        for key in ("amplification", "law-comparison", "incremental", "fragility"):
            assert all(ax.has_data() for ax in FIGURES[key].draw(part).axes), key


class TestLaws:
    def test_nominal_ratios_by_a_plain_loop(self):
        cube = spoiled(5, "impact_force_max", "impact_count")
        found = analysis.compare_laws(cube, "linear").sel(basis="nominal")
        values, ok = cube.impact_force_max.values, cube.status.values == 0
        for place in np.ndindex(2, 2, 3, 3, 2):
            mine, base = (place[0] + 1, *place[1:]), (1, *place[1:])
            expected = values[mine] / values[base] if ok[mine] and ok[base] else values[mine] * np.nan
            np.testing.assert_array_equal(found.impact_force_max_ratio.values[place], expected)

    def test_realised_values_are_those_of_a_law_that_is_linear_in_it(self):
        """A response that is linear in the realised restitution is interpolated without error."""
        nominal = np.linspace(0.1, 1.0, 10)
        laws = ["hertz_damped", "kelvin_voigt_tension"]
        realised = np.array([realised_restitution(get_law(law), nominal) for law in laws])
        force = 1000.0 - 400.0 * realised
        cube = hand_cube({"law": laws, "restitution": nominal}, {"impact_force_max": force[:, :, None, None]})
        found = analysis.compare_laws(cube).sel(basis="realised", pair="a-b", storey=1)
        inside = (nominal >= realised.min(axis=1)[:, None]) & (nominal <= realised.max(axis=1)[:, None])
        expected = np.where(inside, 1000.0 - 400.0 * nominal, np.nan)
        np.testing.assert_allclose(found.impact_force_max_compared, expected, rtol=1e-9)
        assert inside[0].sum() < 10  # hertz_damped does not realise low restitutions
        np.testing.assert_allclose(
            found.impact_force_max_ratio,
            np.where(inside.all(axis=0), 1.0, np.nan)[None].repeat(2, 0) * np.where(inside, 1.0, np.nan),
        )

    def test_law_without_damping_realises_one_only(self):
        cube = hand_cube({"law": ["linear", "hertz_damped"], "restitution": [0.6, 1.0]}, random_fill(1, "impulse"))
        found = analysis.compare_laws(cube).impulse_compared.sel(basis="realised", law="linear", pair="a-b", storey=1)
        assert np.isnan(found.sel(restitution=0.6))
        assert found.sel(restitution=1.0) == cube.impulse.sel(law="linear", restitution=0.6, pair="a-b", storey=1)

    def test_reference_is_the_first_damped_law(self):
        cube = hand_cube({"law": LAWS, "restitution": [0.2, 0.6]}, random_fill(1, "impulse"))
        assert analysis.compare_laws(cube).attrs["reference_law"] == "hertz_damped"

    def test_one_restitution_says_why_there_is_no_second_basis(self):
        cube = hand_cube({"law": ["linear", "hertz"]}, random_fill(1, "impulse"))
        found = analysis.compare_laws(cube)
        assert found.basis.values.tolist() == ["nominal"]
        assert "one restitution" in found.attrs["realised_basis"]
        assert found.attrs["reference_law"] == "linear"


class TestImpacts:
    @pytest.mark.parametrize(
        "over", [None, ["record", "scale"], *(pytest.param(over, marks=pytest.mark.slow) for over in (["gap"], []))]
    )
    def test_statistics_by_a_plain_loop(self, over):
        cube = spoiled(6, "impact_count", "impact_force_max", "first_impact_time")
        found = analysis.impact_statistics(cube, over)
        taken = [dim for dim in AXES if dim != "law"] if over is None else over
        kept = [dim for dim in AXES if dim not in taken]
        part = cube.sel(law=["linear", "hertz_damped"])
        for place in itertools.product(*(range(part.sizes[dim]) for dim in kept)):
            here = dict(zip(kept, place, strict=True))
            cell, mine = found.isel(here), part.isel(here)
            scenarios = [dict(zip(taken, p, strict=True)) for p in np.ndindex(*(part.sizes[dim] for dim in taken))]
            ok = [s for s in scenarios if mine.status.isel(s) == 0]
            assert cell.scenarios == len(ok)
            assert cell.left_out == len(scenarios) - len(ok)
            hit = [s for s in ok if mine.impact_count.isel(s).sel(pair="a-b", storey=1) > 0]
            one = cell.sel(pair="a-b", storey=1)
            if not ok:
                assert np.isnan(one.touching)
                continue
            assert one.touching == one.pair_touching == len(hit)
            np.testing.assert_allclose(one.touching_share, len(hit) / len(ok))
            forces = [float(mine.impact_force_max.isel(s).sel(pair="a-b", storey=1)) for s in hit]
            expected = np.quantile(forces, [0.0, 0.16, 0.5, 0.84, 1.0]) if forces else [np.nan] * 5
            np.testing.assert_allclose(one.impact_force_max_fractiles, expected)

    def test_listed_cases_by_law(self):
        coords = {"law": (("case",), ["linear", "none", "hertz", "linear"], {})}
        count = np.array([2, 0, 0, 4])[:, None, None]
        found = analysis.impact_statistics(hand_cube({"case": [1, 2, 3, 4]}, {"impact_count": count}, coords=coords))
        np.testing.assert_array_equal(found.pair_touching_share.sel(pair="a-b"), [1.0, 0.0])
        np.testing.assert_array_equal(found.scenarios, [2, 1])
        assert found.impact_count_fractiles.sel(law="linear", pair="a-b", storey=1, quantile=0.5) == 3.0

    def test_touch_is_told_by_what_has_values(self):
        """A law whose velocities jump has no force."""
        fill = {"impact_force_max": np.full(1, np.nan), "approach_speed_max": np.array([0.0, 0.5])[:, None, None]}
        found = analysis.impact_statistics(hand_cube({"law": ["linear", "stereomechanical"]}, fill))
        np.testing.assert_array_equal(found.touching.sel(pair="a-b", storey=1), [0.0, 1.0])
        assert found.impact_force_max_fractiles.isnull().all()

    def test_pairs_that_never_meet_are_missing(self):
        scene = Scene(
            [Building("a", [1.0], [1.0], storey_heights=[3.0]), Building("b", [1.0], [1.0], storey_heights=[4.0])],
            gaps=[0.1],
            allow_unmet=True,
        )
        found = analysis.impact_statistics(
            hand_cube({"law": ["linear"]}, {"impact_count": np.full(1, -1)}, scene=scene)
        )
        assert found.pair_touching_share.isnull().all()


class TestEnergy:
    NAMES = ("energy_input", "energy_damping", "energy_kinetic", "energy_strain", "contact_work")

    def test_budget_by_a_plain_loop(self):
        cube = spoiled(7, *self.NAMES)
        found = analysis.energy_budget(cube)
        for place in np.ndindex(2, 2, 3, 3, 2):
            here = (place[0] + 1, *place[1:])
            given_, damping, kinetic, strain, work = (cube[name].values[here] for name in self.NAMES)
            bad = cube.status.values[here] != 0
            transfer = given_ - damping - kinetic - strain
            residual = transfer.sum() - work.sum()
            largest = max(np.abs(part).max() for part in (given_, damping, kinetic, strain, work))
            expected = {"energy_transfer": transfer, "residual": residual, "residual_relative": abs(residual) / largest}
            for name, value in expected.items():
                np.testing.assert_allclose(found[name].values[place], value * np.nan if bad else value, rtol=1e-12)
        assert found.attrs["largest_residual_relative"] == found.residual_relative.max()
        np.testing.assert_array_equal(found.transfer_sum, found.energy_transfer.sum("building", skipna=False))
        assert found.energy_transfer.attrs["units"] == "kN m"

    def test_single_building_has_no_contacts(self):
        single = Scene([Building("a", [1.0], [1.0])])
        found = analysis.energy_budget(hand_cube({"law": ["none"]}, random_fill(2, *self.NAMES[:4]), scene=single))
        np.testing.assert_allclose(found.residual, found.energy_transfer.sel(building="a"))

    @pytest.mark.parametrize("dim", ["building", "pair"])
    def test_a_part_of_the_row_has_no_balance(self, dim):
        row = Scene([Building(name, [1.0], [1.0]) for name in "abc"], [0.1, 0.1])
        attributes = sweep_attribute(row, "el_centro", laws="none")
        cube = hand_cube({"law": LAWS}, random_fill(1, *self.NAMES), scene=row, attributes=attributes)
        assert analysis.energy_budget(cube).sizes[dim] == cube.sizes[dim]
        with pytest.raises(InputError, match=f"has 1 of {cube.sizes[dim]} along '{dim}'"):
            analysis.energy_budget(cube.isel({dim: [0]}))


class TestSuites:
    def test_fractiles_by_a_plain_loop(self):
        cube = spoiled(8, "drift_max", "first_impact_time")
        found = analysis.fractiles(cube)
        for place in np.ndindex(3, 2, 3, 2):
            here = (*place[:3], slice(None), place[3])
            ok = cube.status.values[here] == 0
            rows = cube.drift_max.values[here][ok][:, 0, 0]
            mine = found.drift_max_fractiles.values[(slice(None), *place, 0, 0)]
            expected = np.quantile(rows, [0.16, 0.5, 0.84]) if rows.size else np.full(3, np.nan)
            np.testing.assert_allclose(mine, expected)
            assert found.drift_max_count.values[(*place, 0, 0)] == found.scenarios.values[place] == ok.sum()
            diverged = (cube.status.values[here] == int(Status.DIVERGED)).sum()
            assert found.left_out_diverged.values[place] == diverged
        assert found.drift_max_fractiles.attrs["units"] == "m"
        assert (found.drift_max_count.sel(building="b", storey=2) == 0).all()

    def test_incremental_curves_by_a_plain_loop(self):
        axes = {"law": ["linear"], "record": list(PGA), "scale": [2.0, 0.5, 1.0]}
        status = np.zeros((1, 3, 3))
        status[0, 1, 0] = int(Status.DIVERGED)
        cube = hand_cube(axes, random_fill(9, "drift_max"), status=status)
        levels = [0.9, 2.0, 3.3, 5.0, 8.0]
        found = analysis.incremental_curves(cube, ["drift_max"], levels=levels)
        np.testing.assert_array_equal(found.intensity, np.outer(list(PGA.values()), axes["scale"]))
        assert found.intensity.attrs["units"] == "m s-2"
        for i, level in enumerate(levels):
            there = []
            for record, pga in enumerate(PGA.values()):
                rows = sorted(
                    (pga * scale, float(cube.drift_max[0, record, j, 0, 0]), status[0, record, j])
                    for j, scale in enumerate(axes["scale"])
                )
                for (x0, y0, s0), (x1, y1, s1) in itertools.pairwise(rows):
                    if x0 <= level <= x1 and not (s0 or s1):
                        there.append(y0 + (y1 - y0) * (level - x0) / (x1 - x0))
                        break
            mine = found.sel(law="linear", building="a", storey=1).isel(level=i)
            assert mine.drift_max_count == len(there)
            expected = np.quantile(there, [0.16, 0.5, 0.84]) if there else [np.nan] * 3
            np.testing.assert_allclose(mine.drift_max_fractiles, expected)

    def test_incremental_curves_of_both_directions(self):
        """A record at negative scales is another motion: the fractiles are of twice as many curves."""
        scales = [-2.0, -1.0, 1.0, 2.0]
        levels = [2.0, 3.3, 5.0, 6.0]
        cube = hand_cube({"record": list(PGA), "scale": scales}, random_fill(4, "drift_max"))
        found = analysis.incremental_curves(cube, ["drift_max"], levels=levels)
        apart = []
        for way in ([1.0, 2.0], [-1.0, -2.0]):
            one = cube.sel(scale=way).assign_coords(record=[f"{name} {way[0]:g}" for name in PGA], scale=[1.0, 2.0])
            apart.append(one)
        suite = analysis.incremental_curves(xr.concat(apart, "record"), ["drift_max"], levels=levels)
        assert found.attrs["curves"] == suite.attrs["curves"] == 2 * len(PGA)
        assert int(found["drift_max_count"].max()) > len(PGA)
        for name in ("drift_max_fractiles", "drift_max_count"):
            np.testing.assert_array_equal(found[name], suite[name])

    def test_incremental_curves_against_another_intensity(self):
        cube = hand_cube({"record": ["one", "two"], "scale": [1.0, 2.0]}, random_fill(1, "drift_max"))
        sa = xr.DataArray([7.0, 5.0], dims="record", coords={"record": ["two", "one"]}, attrs={"units": "m s-2"})
        found = analysis.incremental_curves(cube, intensity=sa)
        np.testing.assert_array_equal(found.intensity, [[5.0, 10.0], [7.0, 14.0]])
        with pytest.raises(InputError, match="along 'record' alone"):
            analysis.incremental_curves(cube, intensity=sa.expand_dims("period"))
        with pytest.raises(InputError, match=r"unknown intensity 'sv'; valid: pga, pgv, sa\(PERIOD in s\)"):
            analysis.incremental_curves(cube, intensity="sv")


SINGLE = Scene([Building("a", [1.0], [1.0])])


def small(*names, scene=None, **axes):
    """Return a cube of the laws `LAWS` with these outputs and axes."""
    return hand_cube({"law": LAWS, **axes}, random_fill(1, *names), scene=scene)


@pytest.mark.parametrize(
    ("compare", "cube", "arguments", "message"),
    [
        (
            "amplification",
            small("drift_max", law=["linear"]),
            {},
            r"law 'none'.*it has linear\. Add 'none'",
        ),
        ("amplification", small("drift_max", law=["none"]), {}, "a law with contact, this cube has only 'none'"),
        ("amplification", small("drift_max"), {"responses": ["drift"]}, "did you mean 'drift_max'"),
        (
            "amplification",
            small("drift_max"),
            {"responses": ["storey_shear_max"]},
            "'storey_shear_max', which",
        ),
        ("energy_budget", small(*TestEnergy.NAMES).sel(building="a"), {}, "needs the axis 'building'"),
        ("energy_budget", small(*TestEnergy.NAMES[:4]), {}, "'contact_work', which this cube lacks"),
        ("compare_laws", small("impulse", law=["none", "linear"]), {}, "two laws with contact, this cube has linear"),
        ("compare_laws", small("impulse"), {"reference": "linaer"}, "did you mean 'linear'"),
        ("compare_laws", small("impulse"), {"outputs": ["force"]}, "unknown output"),
        (
            "compare_laws",
            small("impulse").rename(law="case").assign_coords(law=("case", LAWS)),
            {},
            "scenarios as cases",
        ),
        ("impact_statistics", small("drift_max", law=["linear"], scene=SINGLE), {}, "single building"),
        ("impact_statistics", small("impact_count", law=["none"]), {}, "only 'none'"),
        ("impact_statistics", small("drift_max"), {}, "'impact_count' or 'impact_force_max'"),
        ("impact_statistics", small("impact_count"), {"over": ["record"]}, "no axis 'record'"),
        ("impact_statistics", small("impact_count"), {"quantiles": [1.5]}, r"quantiles: 1.5 is not in \[0, 1\]"),
        ("fractiles", small("drift_max"), {}, "needs the axis 'record'; this cube's axes: law"),
        ("fractiles", small("drift_max", record=["one"]), {}, "several values of 'record', and this cube has one"),
        ("incremental_curves", small("drift_max", scale=[1.0]), {}, "several values of 'scale', and this cube has one"),
    ],
)
def test_what_a_comparison_needs_is_told(compare, cube, arguments, message):
    with pytest.raises(InputError, match=message):
        getattr(analysis, compare)(cube, **arguments)


def test_sweep_attribute_reads_back():
    """The rebuilt row is the row, whatever it is made of."""
    from pounding_sweep.analysis.rebuild import stored_sweep
    from pounding_sweep.spec.spec import scene_of

    for scene in (low_and_high(), Scene([Building("x", [1.0, 2.0], [3.0, 4.0], (0.02, 0.03), [4.0, 3.0])])):
        cube = hand_cube({"law": ["none"]}, random_fill(1, "drift_max"), scene=scene)
        cube.attrs |= sweep_attribute(scene, "el_centro", laws="none")
        assert scene_of(stored_sweep(cube)["scene"]) == scene
