"""Cubes of one study put together: against the cube of the whole, and everything that must not be mixed."""

from __future__ import annotations

import hashlib
import json
import math
import re

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import OUTPUTS, call, motions, row

from pounding_sweep import Sweep
from pounding_sweep.base.errors import InputError
from pounding_sweep.output import merge as merging
from pounding_sweep.output import netcdf as writing
from pounding_sweep.output.describe import describe
from pounding_sweep.output.merge import merge_cubes
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.request.spec import digest, to_json
from pounding_sweep.variables.registry import ORIGINS, Status

pytestmark = pytest.mark.usefixtures("stub_module")

LAWS = ["linear", "none", "kelvin_voigt"]
GAPS = [0.0005, 0.002, 0.01, 0.02]
WHOLE = {"laws": LAWS, "gaps": GAPS, "restitutions": [0.3, 0.7], "records": motions(), "scales": [1.0, 1.5]}


def sweep(**changes):
    settings = {"stiffness_factors": 1.0, "method": "rk4", "dt": 0.005, "outputs": OUTPUTS, "audit": 0.5}
    return Sweep(row(), **{**settings, **WHOLE, **changes})


@pytest.fixture(scope="module")
def whole():
    """The cube of the whole study, with an audit."""
    return sweep().run(workers=1)


def telling(cube, spec):
    """Return a cube that says it was made by that sweep, as JSON."""
    text = json.dumps(spec)
    return cube.assign_attrs(sweep=text, sweep_sha256=hashlib.sha256(text.encode()).hexdigest())


def part(whole, **values):
    """Return what a run over those values of the axes would have made, without an audit."""
    names = {"law": "laws", "gap": "gaps", "restitution": "restitutions", "scale": "scales"}
    spec = json.loads(whole.attrs["sweep"])
    spec |= {names[axis]: list(v) for axis, v in values.items() if axis in names}
    records = json.loads(whole.attrs["records"])
    if "record" in values:
        spec["records"], records = (
            [r for name in values["record"] for r in listed if r["name"] == name]
            for listed in (spec["records"], records)
        )
    found = whole.drop_dims(["audit", "output"]).sel({axis: list(v) for axis, v in values.items()})
    steps = [{"one": 0.005, "two": 0.005}[r["name"]] for r in records]
    return telling(found, spec).assign_attrs(records=json.dumps(records), time_step=np.array(steps))


def saved(folder, *cubes):
    """Write cubes as ``a.nc``, ``b.nc``, ..."""
    return [
        write_cube(cube, folder / f"{name}.nc", overwrite=True) for name, cube in zip("abcdef", cubes, strict=False)
    ]


def merged(folder, *cubes, **more):
    found = merge_cubes(saved(folder, *cubes), folder / "all.nc", overwrite=True, **more)
    with open_cube(found.path) as cube:
        return found, cube.load()


def same(found, expected):
    """Compare values, coordinates and their attributes, and whatever the sweep is known by."""
    expected = expected.drop_dims(["audit", "output"], errors="ignore")
    found = found.drop_dims(["audit", "output"], errors="ignore")
    assert set(found.variables) == set(expected.variables)
    for name in expected.variables:
        if name in ("origin", "run"):
            own, same_run = in_order(expected)
            xr.testing.assert_equal(found[name], {"origin": own, "run": same_run}[name])
            continue
        xr.testing.assert_equal(found[name].variable, expected[name].variable)
        a, b = found[name].dtype, expected[name].dtype
        assert a == b or a.kind == b.kind == "U", name  # texts may be stored in any length
        about = {key: v for key, v in expected[name].attrs.items() if not key.startswith("audit_")}
        np.testing.assert_equal({k: v for k, v in found[name].attrs.items() if not k.startswith("audit_")}, about)


def in_order(cube):
    """Return origin and run of scenarios, numbered as they come."""
    origin, run = (cube[name].copy(deep=True) for name in ("origin", "run"))
    numbers, has_own = {0: 0}, {0}
    for i, number in enumerate(cube["run"].values.ravel().tolist()):
        run.values.flat[i] = numbers.setdefault(number, len(numbers))
        if origin.values.flat[i] < 2:
            origin.values.flat[i] = int(number in has_own)
            has_own.add(number)
    return origin, run


def test_parts_that_were_run_apart_make_the_cube_of_the_whole(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(writing, "SLAB_BYTES", 2000)
    for name, gaps in (("a.nc", GAPS[2:]), ("b.nc", GAPS[:2])):
        sweep(gaps=gaps).run(tmp_path / name, workers=1).close()
    found = merge_cubes([tmp_path / "a.nc", tmp_path / "b.nc"], tmp_path / "all.nc")
    assert (found.scenarios, found.missing, found.overlapping) == (whole.status.size, 0, 0)
    with open_cube(found.path) as cube, open_cube(tmp_path / "a.nc") as a, open_cube(tmp_path / "b.nc") as b:
        same(cube.load(), whole)
        assert cube.attrs["sweep"] == whole.attrs["sweep"]
        assert cube.attrs["sweep_sha256"] == whole.attrs["sweep_sha256"]
        assert cube.attrs["records"] == whole.attrs["records"]
        np.testing.assert_array_equal(cube.attrs["time_step"], whole.attrs["time_step"])
        parts, told = (a.attrs, b.attrs), json.loads(cube.attrs["merged_from"])
        assert [item["sweep_sha256"] for item in told] == [part["sweep_sha256"] for part in parts]
        assert cube.sizes["audit"] == a.sizes["audit"] + b.sizes["audit"] == cube.attrs["audit_scenarios"]
        assert cube.audit_gap.values.tolist() == a.audit_gap.values.tolist() + b.audit_gap.values.tolist()
        steady = cube.audit_error.where(cube.audit_undecided == 0)
        for name in cube.output.values.tolist():
            assert cube[name].attrs["audit_error_max"] == steady.sel(output=name).max().item()
            assert cube[name].attrs["audit_error_median"] == steady.sel(output=name).median().item()
        assert f"all {cube.attrs['audit_touching']} touching scenarios, all laws, compared with exact" in describe(cube)
        for key in ("scenarios_run", "scenarios_never_touching", "audit_touching"):
            assert cube.attrs[key] == sum(part[key] for part in parts)
        shares, weights = ([part[f"audit_{key}"] for part in parts] for key in ("share", "touching"))
        assert cube.attrs["audit_share"] == pytest.approx(np.average(shares, weights=weights))
    # runs and audited scenarios that several parts hold count once: a glob picks the last merge with its parts
    again = merge_cubes(sorted(tmp_path.glob("*.nc")), tmp_path / "again.nc")
    with open_cube(again.path) as repeated:
        same(repeated, cube)
        xr.testing.assert_equal(repeated.audit_error, cube.audit_error)
        counts = [key for key in cube.attrs if key.startswith(("scenarios_", "audit_"))]
        assert {key: repeated.attrs[key] for key in counts} == {key: cube.attrs[key] for key in counts}


def test_missing_combinations_are_not_run_and_named(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(writing, "SLAB_BYTES", 3000)
    monkeypatch.setattr(writing, "BLOCK_BYTES", 500)
    parts = part(whole, law=LAWS[:2], gap=GAPS[1:]), part(whole, law=LAWS[2:], gap=GAPS[:2])
    found, cube = merged(tmp_path, *parts)
    there = (cube.law != "kelvin_voigt") & (cube.gap >= GAPS[1]) | (cube.law == "kelvin_voigt") & (cube.gap < 0.01)
    same(cube.where(there, drop=False)[["impact_force_max"]], whole.where(there)[["impact_force_max"]])
    assert (cube.status.values == np.where(there.broadcast_like(cube.status), whole.status, Status.NOT_RUN)).all()
    assert found.missing == (cube.status == Status.NOT_RUN).sum() == 4 * 8
    assert found.named[0] == "law=linear gap=0.0005 restitution=0.3 record=one scale=1.0"
    assert len(found.named) == merging.NAMED
    assert cube.attrs["sweep"] == whole.attrs["sweep"]
    assert bool(np.isnan(cube.impact_count.where(~there)).all())
    assert ((cube.run == 0) == ~there).all()
    assert ((cube.origin == ORIGINS.index("not_run")) == ~there).all()


AXIS_VALUES = {"law": LAWS, "gap": GAPS, "restitution": [0.3, 0.7], "record": ["one", "two"], "scale": [1.0, 1.5]}
SUBSETS = st.fixed_dictionaries(
    {axis: st.lists(st.sampled_from(v), min_size=1, unique=True) for axis, v in AXIS_VALUES.items()}
)


@settings(max_examples=2, deadline=None)
@given(st.lists(SUBSETS, min_size=2, max_size=3))
def test_any_boxes(whole, tmp_path_factory, boxes):
    """Overlapping or not, in any order: each scenario is what the whole has, where some part has it."""
    found, cube = merged(tmp_path_factory.mktemp("boxes"), *(part(whole, **box) for box in boxes))
    count = xr.zeros_like(whole.status, dtype=int)
    for box in boxes:
        count.loc[box] += 1
    count = count.sel({axis: cube[axis].values for axis in AXIS_VALUES})
    expected = whole.sel({axis: cube[axis].values for axis in AXIS_VALUES})
    for name in (*OUTPUTS, "steps_per_contact"):
        xr.testing.assert_equal(cube[name].variable, expected[name].where(count > 0).variable)
    assert (cube.status.values == np.where(count > 0, expected.status, Status.NOT_RUN)).all()
    assert found.missing == int((count == 0).sum())
    assert found.overlapping == int((count - 1).clip(0).sum())
    for axis, v in AXIS_VALUES.items():
        assert set(cube[axis].values.tolist()) == {value for box in boxes for value in box[axis]} <= set(v)


def test_a_scenario_that_one_part_failed_to_run_is_taken_from_the_other(whole, tmp_path):
    a, b = part(whole, gap=GAPS[:3]), part(whole, gap=GAPS[1:])
    failed = a.copy(deep=True)
    failed["status"][:, 1] = int(Status.NOT_RUN)
    for name in OUTPUTS:
        failed[name][:, 1] = np.nan
    for order in ((failed, b), (b, failed)):
        found, cube = merged(tmp_path, *order)
        same(cube, whole)
        assert found.missing == 0
        assert found.overlapping == whole.status[:, 2].size


def test_different_results_of_a_scenario_are_named(whole, tmp_path):
    a, b = part(whole, gap=GAPS[:3]), part(whole, gap=GAPS[1:])
    changed = b.copy(deep=True)
    spot = {"law": 2, "gap": 0, "restitution": 1, "record": 0, "scale": 0}
    at = tuple(spot.get(dim, 0) for dim in b.impact_force_max.dims)
    before = float(b.impact_force_max.values[at])
    assert before > 0
    changed["impact_force_max"][at] = before * (1 + 1e-3)
    with pytest.raises(InputError) as caught:
        merged(tmp_path, a, changed)
    text = str(caught.value)
    assert "different results of 1 scenarios or more" in text
    assert "law=kelvin_voigt gap=0.002 restitution=0.7 record=one scale=1.0: impact_force_max" in text
    assert f"{before!r} in {str(tmp_path / 'a.nc')!r}" in text
    assert f"{before * (1 + 1e-3)!r} in {str(tmp_path / 'b.nc')!r}" in text
    assert not (tmp_path / "all.nc").exists()
    _, cube = merged(tmp_path, a, changed, tolerance=1e-2)
    same(cube, whole)
    _, cube = merged(tmp_path, changed, a, tolerance=1e-2)  # the first part's is taken
    assert (cube.impact_force_max != whole.impact_force_max).sum() >= 1
    changed["impact_count"][0, 0] += 1  # counts are compared exactly
    with pytest.raises(InputError, match=r"impact_count \d+ in .*, \d+ in "):
        merged(tmp_path, a, changed, tolerance=0.5)
    changed["status"][:] = 2
    with pytest.raises(
        InputError, match=rf"different results of {changed.status[:, :2].size} scenarios or more.*and \d+ more"
    ):
        merged(tmp_path, a, changed, tolerance=1e-2)


def changed_spec(cube, **changes):
    return telling(cube, json.loads(cube.attrs["sweep"]) | changes)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda c: changed_spec(c, dt=0.001), r"study: dt is 0\.005 in the first and 0\.001 in the second"),
        pytest.param(lambda c: changed_spec(c, scene={}), r"study: scene is \{", marks=pytest.mark.slow),
        (lambda c: c.assign_attrs(precision="float32"), r"attribute 'precision' is 'float64' .* 'float32'"),
        (
            lambda c: c.assign_attrs(pounding_sweep_version="9"),
            r"a\.nc' and '.*b\.nc' are not .*: pounding_sweep_version is '\S+' in the first and '9' in the second\. "
            r"The same scenario may have another result with each: run one again .* the installed package",
        ),
        (lambda c: c.drop_vars("impact_count"), r"the list of variables is"),
        (
            lambda c: c.isel(scale=0, drop=True),
            r"b\.nc' has the axes law, .* record, its sweep had law, .* record, scale",
        ),
        pytest.param(
            lambda c: c.assign_coords(building=["a", "b", "d"]),
            r"the list of buildings is \['a', 'b', 'c'\]",
            marks=pytest.mark.slow,
        ),
        (
            lambda c: changed_spec(
                c, records=[{**r, "sha256": "0"} for r in json.loads(c.attrs["sweep"])["records"]]
            ).assign_attrs(records=json.dumps([{**r, "sha256": "0"} for r in json.loads(c.attrs["records"])])),
            r"record 'one' is \['[0-9a-f]+', 0\.02, 150",
        ),
        (
            lambda c: c.assign_coords(pair_gap=c.pair_gap + 1),
            r"or one was changed: conflicting values for variable 'pair_gap' of the same place",
        ),
        (
            lambda c: changed_spec(
                c.assign_coords(gap=c.gap * (1 + 1e-12)), gaps=(c.gap * (1 + 1e-12)).values.tolist()
            ),
            r"gap has the values .* the same but for rounding",
        ),
        (lambda c: c.drop_attrs(deep=False).assign_attrs(pounding_sweep_version="1"), r"is no cube of a sweep"),
        (lambda c: c.assign(more=c.status), r"the list of variables is"),
    ],
)
def test_what_is_not_of_one_study_is_refused(whole, tmp_path, change, says):
    a, b = part(whole, gap=GAPS[:2]), change(part(whole, gap=GAPS[1:]))
    with pytest.raises(InputError, match=says):
        merged(tmp_path, a, b)
    assert not (tmp_path / "all.nc").exists()


def test_cubes_of_two_makers(whole, tmp_path):
    """Refused with both files, and what made them, unless it is asked for; then the cube says which is of which."""
    key, here, other = "package_sha256", whole.attrs["package_sha256"], "f" * 64
    a, b = part(whole, gap=GAPS[:2]), part(whole, gap=GAPS[1:]).assign_attrs({key: other})
    with pytest.raises(InputError) as caught:
        merged(tmp_path, a, b)
    text = str(caught.value)
    assert re.search(rf"a\.nc' and '.*b\.nc' .*: {key} is '{here}' in the first and '{other}' in the second\.", text)
    assert "allow both: mix_sources=True, on the command line --mix-sources" in str(caught.value)
    found, cube = merged(tmp_path, a, b, mix_sources=True)
    same(cube, whole)
    assert (found.sources, found.overlapping) == (2, whole.status[:, 1].size)
    files, told = [str(tmp_path / f"{name}.nc") for name in "ab"], json.loads(cube.attrs["merged_from"])
    assert [(item["file"], item[key]) for item in told] == list(zip(files, (here, other), strict=True))
    assert key not in cube.attrs  # so that nothing takes its results for those of one maker
    for shared in {"package_sha256", "numba_version", "llvmlite_version", "numpy_version"} - {key}:
        assert cube.attrs[shared] == whole.attrs[shared]
    changed = b.copy(deep=True)
    changed["impact_force_max"][-1, 0] *= 1.001  # the same scenario has to have the same result all the same
    with pytest.raises(InputError, match="different results of"):
        merged(tmp_path, a, changed, mix_sources=True)


def test_a_file_given_twice_is_refused(whole, tmp_path, monkeypatch):
    """By whatever path it is reached; a copy of it is another file."""
    a, b = saved(tmp_path, part(whole, gap=GAPS[:2]), part(whole, gap=GAPS[2:]))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "soft.nc").symlink_to(a)
    (tmp_path / "copy.nc").write_bytes(a.read_bytes())
    with pytest.raises(InputError, match="at least two cubes"):
        merge_cubes([a], "all.nc")
    for other in (a, "a.nc", "soft.nc"):
        with pytest.raises(InputError, match=r"^'.*/a\.nc' is given twice; give each cube once$"):
            merge_cubes([a, b, other], "all.nc")
    assert not (tmp_path / "all.nc").exists()
    assert merge_cubes([a, b, "copy.nc"], "all.nc").overlapping == whole.status[:, :2].size


def test_records_left_out_of_a_part_that_another_has_are_there(whole, tmp_path):
    one, two = part(whole, record=["one"]), part(whole, record=["two"])
    for missing, left, turn in ((["two"], [], 1), (["two", "three"], ["three"], -1)):  # in either order
        less = changed_spec(one, records_left_out=missing).assign_attrs(records_left_out=json.dumps(missing))
        found, cube = merged(tmp_path, *(less, two)[::turn])
        assert found.missing == 0
        assert [r["name"] for r in json.loads(cube.attrs["records"])] == ["one", "two"][::turn]
        same(cube, whole.sel(record=["one", "two"][::turn]))
        assert cube.record_pga.values.tolist() == [r.pga for r in motions()[::turn]]
        assert json.loads(cube.attrs["sweep"])["records_left_out"] == left
        assert json.loads(cube.attrs.get("records_left_out", "[]")) == left


def test_values_that_one_part_has_side_by_side_are_meant(tmp_path):
    """However close: they are two, in a cube merged of it too. A third, of another part, may be a slip."""

    def made(*gaps):
        return sweep(laws="linear", restitutions=0.7, scales=1.0, audit=0.0, gaps=gaps).run(workers=1)

    near, third = math.nextafter(0.002, 1.0), math.nextafter(0.002, 0.0)
    whole = made(0.01, near, 0.002)
    _, cube = merged(tmp_path, made(0.01), made(near, 0.002))
    same(cube, whole)
    again, cube = merged(tmp_path, cube, made(0.002))
    same(cube, whole)
    assert again.overlapping == 2
    with pytest.raises(InputError, match=rf"gap has the values {third} and 0\.002, the same but for rounding"):
        merged(tmp_path, made(third, 0.01), cube)


def test_command(whole, tmp_path):
    files = saved(tmp_path, part(whole, law=LAWS[:1], gap=GAPS[:1]), part(whole, law=LAWS[1:]))
    asked = ("merge", *files, "-o", tmp_path / "all.nc")
    said = call(*asked).stdout
    assert "missing    24 (status not_run): law=linear gap=0.002 " in said
    assert said.splitlines()[-1] == str(tmp_path / "all.nc")
    call(*asked, code=2)
    call(*asked, "--overwrite", "--tolerance", "0")
    write_cube(part(whole, law=LAWS[1:]).assign_attrs(package_sha256="f" * 64), files[1], overwrite=True)
    assert "package_sha256 is " in call(*asked, "--overwrite", code=2).stderr
    mixed = call(*asked, "--overwrite", "--mix-sources").stdout
    assert "sources    2, by source, numba, llvmlite and numpy (see merged_from)" in mixed


#: Listed cases, with and without building properties; the third and the last are the same scenario in two spellings.
CASES = [
    {"law": "kelvin_voigt", "record": "one", "gap": 0.002, "period_factors": {"a": 1.1}},
    {"law": "kelvin_voigt", "record": "two", "gap": [0.002, 0.01], "restitution": 0.3, "mass_factors": {"b": 2.0}},
    {"law": "kelvin_voigt", "record": "two", "scale": 1.5},
    {"law": "linear", "record": "one", "gap": 0.0005},
    {"law": "linear", "record": "one", "gap": 0.0005, "stiffness": 1e5},
    {"law": "none", "record": "one", "damping_ratio": 0.02},
    {"law": "kelvin_voigt", "record": "two", "scale": 1.5, "gap": [0.01, 0.02], "stiffness": 2e5},
]


def listed(cases, **changes):
    settings = {"records": motions(), "method": "rk4", "dt": 0.005, "outputs": OUTPUTS, "audit": 0.0}
    return Sweep(row(), **{**settings, "cases": cases, **changes})


@pytest.fixture(scope="module")
def cases():
    """The cube of all listed cases."""
    return listed(CASES).run(workers=1)


def some(cases, chosen):
    """Return what a run of the cases at those places would have made."""
    spec = listed([CASES[i] for i in chosen]).spec
    found = cases.isel(case=list(chosen)).assign_coords(case=np.arange(1, len(chosen) + 1, dtype=np.int32))
    found.case.attrs = cases.case.attrs
    return found.assign_attrs(sweep=to_json(spec), sweep_sha256=digest(spec))


def labelled(cases, chosen):
    """The same with labels: "c0" is the case at place 0."""
    found = some(cases, chosen)
    return found.assign_coords(case=("case", [f"c{i}" for i in chosen], found.case.attrs))


def test_cases_that_were_run_apart_make_the_cube_of_all(cases, tmp_path):
    listed(CASES[:3], audit=0.5).run(tmp_path / "a.nc", workers=1).close()
    listed(CASES[2:6], audit=0.5).run(tmp_path / "b.nc", workers=1).close()
    found = merge_cubes([tmp_path / "a.nc", tmp_path / "b.nc"], tmp_path / "all.nc")
    assert (found.scenarios, found.missing, found.overlapping) == (6, 0, 1)
    with open_cube(found.path) as cube, open_cube(tmp_path / "a.nc") as a, open_cube(tmp_path / "b.nc") as b:
        same(cube.load(), cases.isel(case=slice(6)))
        spec = listed(CASES[:6], audit=0.5).spec
        assert (cube.attrs["sweep"], cube.attrs["sweep_sha256"]) == (to_json(spec), digest(spec))
        assert cube.sizes["audit"] == a.sizes["audit"] + b.sizes["audit"] - 1  # one of them is in both
        assert cube.attrs["scenarios_asked"] == 6
        assert "6 scenarios asked" in describe(cube)


def test_labels_of_cases_are_kept(cases, tmp_path):
    found, cube = merged(tmp_path, labelled(cases, [3, 0]), labelled(cases, [1, 3]))
    assert cube.case.values.tolist() == ["c3", "c0", "c1"]
    assert (found.scenarios, found.overlapping) == (3, 1)
    same(cube, labelled(cases, [3, 0, 1]))
    numbered = some(cases, [1, 3]).assign_coords(case=[11, 13])
    _, cube = merged(tmp_path, some(cases, [0]), numbered)
    assert cube.case.values.tolist() == [1, 11, 13]
    # two labels of one scenario are two cases
    found, cube = merged(tmp_path, labelled(cases, [2, 0]), labelled(cases, [0, 6]))
    assert cube.case.values.tolist() == ["c2", "c0", "c6"]
    assert found.overlapping == 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda c: labelled(c, [0, 1]).assign_coords(case=["c3", "c1"]),
            r"case 'c3' is law=linear record=one .*pair_gap=0\.0005 .* in '.*a\.nc', and law=kelvin_voigt .* in "
            r"'.*b\.nc'; give one of them another label",
        ),
        (lambda c: some(c, [0, 1]).isel(case=[1, 0]), r"'.*b\.nc' has other cases than its sweep"),
        (
            lambda c: some(c, [2, 4]).drop_vars(["period_factor", "mass_factor"]),
            "study: whether building properties vary, in kernels of their own, is True in the first and False",
        ),
    ],
)
def test_cases_that_do_not_fit_are_refused(cases, tmp_path, change, says):
    with pytest.raises(InputError, match=says):
        merged(tmp_path, labelled(cases, [3, 2]), change(cases))
    assert not (tmp_path / "all.nc").exists()


def test_cases_and_axes_do_not_mix(whole, cases, tmp_path):
    with pytest.raises(InputError, match=r"the list of axes is \['case'\] in the first and \['law', 'gap'"):
        merged(tmp_path, some(cases, [0]), part(whole))
    files = saved(tmp_path, some(cases, [1]), some(cases, [0]).assign_attrs(sweep="{"))
    assert "its attribute 'sweep' is damaged" in call("merge", *files, "-o", tmp_path / "none.nc", code=2).output
