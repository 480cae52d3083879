"""One scenario of a sweep: which it is, what of it may be chosen, and how fine its histories are; nothing is run."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import figure_data as made
import numpy as np
import pytest
import xarray as xr
from scenes import scene_of_case
from test_cli import cli

import pounding_sweep as ps
from pounding_sweep.analysis.rebuild import stored_spec
from pounding_sweep.base.errors import InputError, SweepError
from pounding_sweep.request.axes import Case
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import to_json
from pounding_sweep.request.toml import load_spec
from pounding_sweep.run.histories import instants_in_contact, peak_share
from pounding_sweep.run.simulate import scenario_of, simulate_finely, simulate_one


@pytest.fixture
def asked(monkeypatch):
    """What `simulate` is asked for; nothing is run."""
    calls = []

    def simulate(*args, **more):
        calls.append((args, more))
        return xr.Dataset()

    monkeypatch.setattr("pounding_sweep.run.simulate.simulate", simulate)
    return calls


def pulses(*names):
    return [ps.pulse_record("sine", amplitude=1.0, period=0.5, dt=0.01, name=name) for name in names]


def test_the_scenario_in_the_middle(asked):
    spec = build_spec(
        scene=made.scene(),
        records=pulses("one", "two", "three"),
        laws=["none", "kelvin_voigt", "linear"],
        gaps=[0.01, 0.02, 0.03, 0.04],
        stiffness_factors=[0.5, 2.0, 4.0],
        restitutions=[0.4, 0.6],
        scales=[1.0, 2.0],
        period_factors={"b": [1.0, 1.5, 2.0]},
        mass_factors={"a": [3.0]},
        damping_ratios=[0.02, 0.04],
        method="newmark",
        dt=2e-3,
        gamma=0.6,
        beta=0.35,
    )
    values = {"law": "kelvin_voigt", "gap": 0.02, "stiffness_factor": 2.0, "restitution": 0.4, "record": "two"}
    assert scenario_of(spec) == values | {
        "scale": 1.0, "period_factor_b": 1.5, "mass_factor_a": 3.0, "damping_ratio": 0.02,
    }  # fmt: skip
    properties = "period factor of b 1.5; damping ratio 0.02"
    one = simulate_one(spec)
    assert one.attrs["scenario"] == f"stiffness factor 2; restitution 0.4; scale 1; {properties}"
    one = simulate_one(spec, gap=0.5, law="linear", record="one", scale=3.0, stiffness_factor=0.1)
    assert one.attrs["scenario"] == f"stiffness factor 0.1; scale 3; {properties}"  # linear takes no restitution
    (scene, record), first = asked[0]
    assert (first["law"].key, first["stiffness"], first["restitution"]) == ("kelvin_voigt", 2e6, 0.4)
    assert (first["method"], first["dt"], first["beta"], first["gamma"]) == ("newmark", 2e-3, 0.35, 0.6)
    assert record == spec.record("two")
    case = Case("kelvin_voigt", period_factors={"b": 1.5}, mass_factors={"a": 3.0}, damping_ratio=0.02)
    assert scene == scene_of_case(made.scene().with_gaps([0.02]), case)
    (scene, record), second = asked[1]
    assert (scene.gaps, second["law"].key, second["stiffness"]) == ((0.5,), "linear", 1e5)
    np.testing.assert_allclose(record.acceleration, 3.0 * spec.record("one").acceleration)


def test_a_listed_case(asked):
    cases = [{"law": "none"}, {"law": "hertz", "gap": [0.01, 0.03], "stiffness": 3e6}, {"law": "linear"}]
    spec = build_spec(scene=made.scene(right_wall=True), records=pulses("one"), cases=cases)
    for number in (None, 2):
        assert simulate_one(spec, case=number).attrs["scenario"] == "case 2; stiffness 3e+06 kN/m^1.5"
        (scene, _), given_ = asked[-1]
        assert (scene.gaps, given_["law"].key, given_["stiffness"]) == ((0.01, 0.03), "hertz", 3e6)
    simulate_one(spec, case=1)
    assert asked[-1][1]["stiffness"] is None
    with pytest.raises(InputError, match="cases 1 to 3"):
        simulate_one(spec, case=4)


def test_a_stiffness_is_not_taken_in_another_unit(asked):
    product = build_spec(
        scene=made.scene(), records=pulses("one"), laws=["kelvin_voigt", "none"], stiffnesses=[1e6, 2e6, 4e6]
    )
    listed = build_spec(scene=made.scene(), records=pulses("one"), cases=[{"law": "linear", "stiffness": 2e6}])
    words = r"2e\+06 kN/m, is that of law '{}', and law 'hertz' takes kN/m\^1.5; give a stiffness \(kN/m\^1.5\)"
    for spec, own in ((product, "kelvin_voigt"), (listed, "linear")):
        with pytest.raises(InputError, match=words.format(own)):
            simulate_one(spec, law="hertz")
        assert not asked
        for law in ("none", "stereomechanical", "linear"):
            simulate_one(spec, law=law)
        assert [more["stiffness"] for _, more in asked] == [None, None, 2e6]
        simulate_one(spec, law="hertz", stiffness=3e7)
        simulate_one(spec, law="hertz", stiffness_factor=2.0)
        assert [more["stiffness"] for _, more in asked[3:]] == [3e7, 2e7]
        asked.clear()


def test_every_axis_may_be_chosen(asked):
    row = made.scene(right_wall=True)
    axes = {"pgas": [1.0, 2.0], "period_factors": {"b": [1.0, 1.5]}, "damping_ratios": [0.02, 0.05]}
    spec = build_spec(scene=row, records=pulses("one"), laws="linear", **axes)
    choice = {"pga": 3.0, "period_factor_b": 2.0, "mass_factor_a": 4.0, "damping_ratio": 0.1, "gap": [0.01, 0.03]}
    one = simulate_one(spec, **choice)
    (scene, record), _ = asked[0]
    assert record.pga == pytest.approx(3.0)
    case = Case("linear", period_factors={"b": 2.0}, mass_factors={"a": 4.0}, damping_ratio=0.1)
    assert scene == scene_of_case(row.with_gaps([0.01, 0.03]), case)
    assert one.attrs["scenario"] == "pga 3; period factor of b 2; mass factor of a 4; damping ratio 0.1"
    assert simulate_one(spec, mass_factor_a=1.0).attrs["scenario"].endswith("mass factor of a 1; damping ratio 0.02")


def test_histories_are_run_finer_until_they_show_their_peaks(monkeypatch):
    """By default; a step that is asked for is the one that is taken."""
    taken = []

    def simulate(*args, output_step=None, **more):
        taken.append(output_step)
        step = output_step or 8e-3
        shown = 100.0 * (1.0 - step**2 / 4e-4)
        values = {"impact_force_max": ("pair", [100.0]), "contact_force": (("time", "pair"), [[0.0], [shown]])}
        return xr.Dataset(values, attrs={"time_step": step})

    monkeypatch.setattr("pounding_sweep.run.simulate.simulate", simulate)
    spec = build_spec(scene=made.scene(), records=pulses("one"), laws="linear")
    assert peak_share(simulate_finely(spec)) == pytest.approx(0.99)
    assert taken == [None, 4e-3, 2e-3]
    simulate_finely(spec, 5e-3)
    assert taken[3:] == [5e-3]


def test_histories_are_run_finer_until_they_show_a_contact(monkeypatch):
    """A contact of 0.05 s, of the floor that penetrates deepest."""

    def simulate(*args, output_step=None, **more):
        time = np.arange(0.0, 0.2, output_step or 4e-3)
        deep = np.where((time > 0.1) & (time < 0.15), 1e-3, 0.0)
        depth = np.stack([deep, np.minimum(deep, 5e-4), np.full_like(deep, np.nan)], axis=1)
        return xr.Dataset({"penetration": (("time", "storey", "pair"), depth[..., None])}, attrs={"time_step": time[1]})

    monkeypatch.setattr("pounding_sweep.run.simulate.simulate", simulate)
    one = simulate_finely(build_spec(scene=made.scene(), records=pulses("one"), laws="linear"))
    assert one.attrs["time_step"] == 1e-3
    assert 40 <= instants_in_contact(one) < 60
    assert instants_in_contact(one.where(one["penetration"] > 1.0)) == np.inf


@pytest.mark.parametrize(
    ("choice", "text"),
    [
        ({"case": 1}, "product of axes"),
        ({"record": "ono"}, "did you mean 'one'"),
        ({"stiffness": 1.0, "stiffness_factor": 1.0}, "exclude each other"),
        ({"gaps": 1.0}, "did you mean 'gap'"),
        ({"period_factor_c": 1.0}, "did you mean 'period_factor_b'"),
        ({"mass_factor_a": -1.0}, "-1.0 won't do; it must be a factor on masses, at least 0.001 and at most 1000"),
        ({"damping_ratio": 1.5}, "damping_ratio: 1.5 won't do"),
    ],
)
def test_choices_are_checked(asked, choice, text):
    spec = build_spec(scene=made.scene(), records=pulses("one"), laws="linear")
    with pytest.raises(InputError, match=text):
        simulate_one(spec, **choice)
    assert not asked
    simulate_one(spec, stiffness=0.0)  # not the scene's: which `simulate` refuses
    assert asked[-1][1]["stiffness"] == 0.0


def shipped():
    return sorted((Path(__file__).parent.parent / "sweeps").glob("*.toml"))


@pytest.mark.parametrize("path", shipped(), ids=lambda path: path.stem)
def test_a_cube_carries_its_whole_sweep(path, stub_engine):
    """Rows, bumpers, laws of one's own, cases, axes and settings; of a design its cases."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            spec = replace(load_spec(path), design=None)
        except SweepError as error:
            if "record" not in str(error):
                raise
            pytest.skip("a record is not at hand")
    assert stored_spec(xr.Dataset(attrs={"sweep": to_json(spec)})) == spec


def test_only_the_record_of_the_scenario_is_looked_for(tmp_path):
    """By its digest in a folder, whatever its file is called there; another motion of that name is refused."""
    motion = 0.01 * np.sin(np.arange(200.0))
    shaking = [ps.Record(name, dt=0.01, acceleration=factor * motion) for name, factor in (("A", 1.0), ("B", 2.0))]
    cases = [{"law": "linear", "gap": 0.01, "record": name} for name in "AB"]
    product = build_spec(scene=made.scene(), records=shaking, laws="linear")
    listed = build_spec(scene=made.scene(), records=shaking, cases=cases)
    folder = tmp_path / "records"
    folder.mkdir()
    text = "time (s),acceleration (m/s2)\n" + "".join(f"{0.01 * i!r},{a!r}\n" for i, a in enumerate(motion.tolist()))
    (folder / "mailed.csv").write_text(text)
    for spec, choice in ((product, {"record": "A"}), (listed, {"case": 1})):
        cube = xr.Dataset(attrs={"sweep": to_json(spec)})
        assert stored_spec(cube, [folder], **choice).records == (shaking[0],)
        with pytest.raises(InputError, match=r"'A' \(none of that name\).*--records FOLDER"):
            stored_spec(cube, [], **choice)
    with pytest.raises(InputError, match=r"'B' \(none of that name\)"):
        stored_spec(xr.Dataset(attrs={"sweep": to_json(product)}), [folder])
    (folder / "B.csv").write_text(text)
    with pytest.raises(InputError, match=r"'B' \(the record found by that name is another motion\)"):
        stored_spec(xr.Dataset(attrs={"sweep": to_json(product)}), [folder], record="B")
    with pytest.raises(InputError, match="record of this cube 'C'"):
        stored_spec(xr.Dataset(attrs={"sweep": to_json(product)}), [folder], record="C")


def test_a_cube_replays_its_scenarios(tmp_path, stub_engine):
    """As the sweep file does, which who gets a cube does not have."""
    sweep, cube, one, other = (tmp_path / name for name in ("s.toml", "cube.nc", "one.nc", "other.nc"))
    cli("init", sweep)
    cli("run", sweep, "-o", cube, "--law", "linear", "--law", "hertz")
    choice = ("--at", "law=hertz", "--at", "gap=0.004", "--at", "stiffness_factor=2.0", "--at", "record=el_centro")
    cli("simulate", cube, *choice, "-o", one)
    cli("simulate", sweep, *choice, "-o", other)
    with ps.open_cube(one) as of_cube, ps.open_cube(other) as of_file:
        assert (of_cube.attrs["law"], of_cube.attrs["scenario"]) == ("hertz", of_file.attrs["scenario"])
        xr.testing.assert_equal(of_cube, of_file)
