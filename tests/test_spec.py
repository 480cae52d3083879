"""Sweeps as data: `build_spec`, sweep files, and everything that can be wrong with them."""

import hashlib
import json
import math
import textwrap
from pathlib import Path

import bad_sweeps
import numpy as np
import pytest
from bad_sweeps import GOOD

from pounding_sweep.base.errors import SceneError, SweepError
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS, get_law
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.scene import ContactProperties, Scene, Wall
from pounding_sweep.records import Record, find_record, pulse_record, synthetic_record
from pounding_sweep.request.axes import Case, Range
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import SweepSpec, digest, to_json
from pounding_sweep.request.toml import line_finder, load_spec
from pounding_sweep.run.sweep import Sweep, load_sweep
from pounding_sweep.variables.registry import DEFAULT_OUTPUTS, VARIABLES

ROOT = Path(__file__).resolve().parent.parent
INF = float("inf")
PULSE = Record("pulse", dt=0.01, acceleration=[0.0, 1.0, -1.0, 0.0])
STEP = Record("step", dt=0.02, acceleration=[1.0, 1.0])


@pytest.fixture(autouse=True)
def no_record_folders(monkeypatch):
    monkeypatch.delenv("POUNDING_SWEEP_RECORDS", raising=False)


def build(**change):
    return build_spec(**{"scene": "mate2015", "records": PULSE, "laws": "linear", **change})


def test_every_message_is_as_it_was(tmp_path):
    """`python tests/bad_sweeps.py` writes the messages anew; a change of them is read in the diff."""
    assert bad_sweeps.report(tmp_path) == bad_sweeps.GOLDEN.read_text()


def only(**change):
    """Return the only fault of a sweep."""
    with pytest.raises(SweepError) as caught:
        build(**change)
    (problem,) = caught.value.problems
    assert str(caught.value) == problem
    return problem


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"masses": [1.0, -2.0]}, "masses[1]"),
        ({"masses": []}, "masses"),
        ({"yield_strengths": [3.0]}, "yield_strengths"),
        ({"slab_depths": [0.1, 3.0]}, "slab_depths[1]"),
        ({"dashpots": [-1.0, 0.0]}, "dashpots[0]"),
        ({"damping_ratio": 1.5}, "damping_ratio"),
        ({"damping_ratio": [0.2, 0.01]}, "damping_ratio"),
        ({"hardening": 0.1}, "hardening"),
        ({"damping_stiffness": "tan", "yield_strengths": [3.0, INF]}, "damping_stiffness"),
        ({"hysteresis": {"law": "bouc_wen", "n": 0.5}, "yield_strengths": [3.0, INF]}, "hysteresis.n"),
        ({"p_delta": True, "storey_heights": [1e-3, 3.0]}, "p_delta"),
        ({"foundation": {"mass": 0, "inertia": 1, "sway_stiffness": 1, "rocking_stiffness": 1}}, "foundation.mass"),
    ],
)
def test_files_and_python_say_the_same_of_buildings(change, place):
    given = {"name": "b", "masses": [1.0, 1.0], "stiffnesses": [1e3, 1e3], **change}
    with pytest.raises(SceneError) as caught:
        Building(**given)
    said = only(scene={"row": [given]})
    assert place in str(caught.value)
    assert said == str(caught.value).replace("Building 'b': ", "scene.row[0].")


# --- what a valid sweep becomes -------------------------------------------------------------------------------------


def test_defaults():
    spec = build()
    assert (spec.scene, spec.records, spec.laws, spec.cases) == (get_preset("mate2015"), (PULSE,), ("linear",), None)
    assert (spec.gaps, spec.stiffnesses, spec.stiffness_factors) == (None, None, (1.0,))
    assert (spec.restitutions, spec.scales, spec.outputs) == ((1.0,), (1.0,), DEFAULT_OUTPUTS)
    assert (spec.method, spec.dt, spec.locate, spec.force_unstable) == (None, None, True, False)
    assert (spec.beta, spec.gamma, spec.precision, spec.title) == (0.25, 0.5, None, "")
    assert spec.n_scenarios == 1
    assert list(spec.axes) == ["law", "gap", "stiffness_factor", "restitution", "record", "scale"]


def test_everything_given():
    settings = {"method": "newmark", "dt": 5e-4, "locate": False, "beta": 0.3, "gamma": 0.6, "title": "t"}
    spec = build(
        records=[PULSE, "el_centro"],
        laws=["hertz", "linear", "hertz_damped"],
        gaps=(0.02, 0.005),
        stiffness_factors=np.array([2, 1]),
        restitutions=iter([0.8, 0.5]),
        scales=range(1, 4),
        outputs=["impact_count", "drift_max"],
        force_unstable=np.bool_(True),
        **settings,
    )
    assert spec.laws == ("hertz", "linear", "hertz_damped")
    assert (spec.gaps, spec.stiffness_factors) == ((0.02, 0.005), (2.0, 1.0))  # as given, not sorted
    assert (spec.restitutions, spec.scales) == ((0.8, 0.5), (1.0, 2.0, 3.0))
    assert [r.name for r in spec.records] == ["pulse", "el_centro"]
    assert {name: getattr(spec, name) for name in settings} == settings
    assert spec.force_unstable is True
    assert spec.outputs == ("drift_max", "impact_count")
    assert spec.n_scenarios == 3 * 2 * 2 * 2 * 2 * 3 == math.prod(len(v) for v in spec.axes.values())
    assert spec.record("el_centro") == find_record("el_centro")
    with pytest.raises(KeyError):
        spec.record("nobody")
    assert all(type(v) is float for v in (*spec.stiffness_factors, *spec.scales))


def test_laws_by_group():
    assert build(laws="mate2015").laws == MATE2015_MODELS
    assert build(laws="all").laws == tuple(LAWS)
    assert build(laws=["mate2015", "gonthier"]).laws == (*MATE2015_MODELS, "gonthier")
    assert build(laws=get_law("hertz")).laws == ("hertz",)


def test_restitution_defaults_to_the_scene():
    assert build(laws="kelvin_voigt").restitutions == (0.6,)
    assert build(laws="kelvin_voigt", restitutions=0.3).restitutions == (0.3,)
    assert build(laws=["linear", "none", "hertz"]).restitutions == (1.0,)


def test_outputs():
    assert build(outputs="default").outputs == build(outputs=None).outputs == DEFAULT_OUTPUTS
    beside = ["default", "drift_max", "error_estimate"]
    assert set(build(outputs=beside).outputs) == {*DEFAULT_OUTPUTS, "drift_max", "error_estimate"}
    assert build(outputs="all").outputs == tuple(VARIABLES)
    assert build(outputs="impulse").outputs == ("impulse",)


def test_ranges():
    assert Range(0.002, 0.024, 12).values() == tuple(round(0.002 * i, 3) for i in range(1, 13))
    assert Range(1.0, 1000.0, 4, "log").values() == (1.0, 10.0, 100.0, 1000.0)
    assert Range(0.5, 0.5, 1).values() == (0.5,)
    assert Range(-0.3, 0.3, 7).values() == (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)
    assert build(gaps=Range(0.03, 0.01, 3)).gaps == (0.03, 0.02, 0.01)


def cases(*listed, **change):
    return {"laws": None, "cases": listed, **change}


def test_cases_are_filled_in():
    spec = build(
        **cases(
            Case("none"),
            Case("linear", gap=0.02),
            {"law": "hertz_damped", "gap": [0.01, 0.03], "restitution": 0.5, "scale": 2},
            Case("linear", gap=0.02, stiffness=1e5),
            Case("hertz", stiffness_factor=3),
            Case("kelvin_voigt", record="pulse"),
        )
    )
    assert spec.cases == (
        Case("none", record="pulse"),
        Case("linear", 0.02, None, 1.0, None, "pulse", 1.0),
        Case("hertz_damped", (0.01, 0.03), None, 1.0, 0.5, "pulse", 2.0),
        Case("linear", 0.02, 1e5, None, None, "pulse", 1.0),
        Case("hertz", None, None, 3.0, None, "pulse", 1.0),
        Case("kelvin_voigt", None, None, 1.0, 0.6, "pulse", 1.0),
    )
    assert spec.laws == ("none", "linear", "hertz_damped", "hertz", "kelvin_voigt")
    assert (spec.gaps, spec.stiffnesses, spec.stiffness_factors, spec.restitutions, spec.scales) == (
        None, None, None, (), (),
    )  # fmt: skip
    assert spec.n_scenarios == 6
    assert spec.axes == {}


# --- JSON and digest ------------------------------------------------------------------------------------------------


def test_json_is_canonical_and_complete():
    spec = build(laws="mate2015", gaps=[0.1, 0.01], records=[PULSE], title="ü")
    text = to_json(spec)
    data = json.loads(text)
    assert text == json.dumps(data, sort_keys=True, separators=(",", ":"))
    assert set(data) == {"format", *SweepSpec.__dataclass_fields__}
    assert data["gaps"] == [0.1, 0.01]
    assert data["laws"] == list(MATE2015_MODELS)
    assert data["records"] == [
        {"name": "pulse", "sha256": PULSE.sha256, "pga": 1.0, "dt": 0.01, "n_points": 4, "scale": 1.0, "source": ""}
    ]
    assert [row["name"] for row in data["scene"]["row"]] == ["left", "middle", "right"]
    assert data["scene"]["row"][0]["masses"] == [173.331, 173.331, 133.956]
    assert data["scene"]["contact"] == {"linear_stiffness": 2e6, "hertz_stiffness": 1.88e7, "restitution": 0.6}
    assert digest(spec) == hashlib.sha256(text.encode()).hexdigest()


def test_digest_is_the_same_however_the_sweep_was_written():
    one = build(gaps=[0.01, 0.02], outputs=["drift_max", "impulse"], scales=1, records=[PULSE])
    two = build(
        gaps=np.array([0.01, 0.02]),
        outputs=("impulse", "drift_max"),
        scene=get_preset("mate2015"),
        records=iter([Record("pulse", 0.01, np.array([0, 1, -1, 0]))]),
        laws=[get_law("linear")],
    )
    assert digest(one) == digest(two)


@pytest.mark.parametrize(
    "change",
    [
        {"scene": Scene(get_preset("mate2015").row, [0.01, 0.02], get_preset("mate2015").contact)},
        {"records": STEP},
        {"records": PULSE.renamed("other")},
        {"laws": "hertz"},
        {"gaps": [0.01]},
        {"stiffness_factors": [1.0 + 2**-52]},
        {"stiffnesses": [1.0]},
        {"restitutions": [0.5]},
        {"scales": [2.0]},
        {"method": "newmark"},
        {"dt": 2e-3},
        {"locate": False},
        {"outputs": ["impulse"]},
        {"force_unstable": True},
        {"title": "t"},
        {"laws": None, "cases": [Case("linear")]},
    ],
    ids=lambda change: next(iter(change)),
)
def test_digest_sees_every_change(change):
    assert digest(build(**change)) != digest(build())


# --- sweep files ----------------------------------------------------------------------------------------------------


@pytest.fixture
def write(tmp_path):
    (tmp_path / "x.csv").write_text("0.1\n0.2\n-0.3\n")

    def make(text, name="sweep.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8", newline="")
        return path

    return make


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_load_spec(write, newline):
    path = write(GOOD.replace("\n", newline))
    raw = Record("x", 0.01, np.array([0.1, 0.2, -0.3]) * 9.81, "x.csv")
    expected = build_spec(
        title="a sweep",
        scene=Scene(
            [Building("left", [10.0, 8.0], [4e3, 3e3], (0.05, 0.06), [3.0, 3.5]), Wall("moat wall")],
            [0.01],
            ContactProperties(2e6, 1.88e7, 0.6),
        ),
        records=[
            "el_centro",
            raw.scaled(2.0),
            raw.renamed("y").scaled_to(3.0),
            synthetic_record(1, duration=2.0, pga=3.0),
            pulse_record("half_sine", amplitude=4.0, period=0.5, dt=0.01),
            find_record("el_centro").scaled_to(2.0).renamed("el_centro_2"),
        ],
        laws=["linear", "hertz_damped"],
        gaps=[0.002, 0.004, 0.006],
        stiffness_factors=[0.1, 1.0, 10.0],
        restitutions=[0.4, 0.6],
        scales=[1, 2],
        method="newmark",
        dt=2e-3,
        locate=False,
        beta=0.3,
        gamma=0.6,
        force_unstable=True,
        outputs=["drift_max", "impulse"],
    )
    spec = load_spec(path)
    assert spec == expected
    assert digest(spec) == digest(expected)
    assert digest(load_spec(str(path))) == digest(spec)


def test_preset_with_changes(write):
    path = write(
        '[scene]\npreset = "mate2015"\ngaps = [0, 0.02]\n[scene.contact]\nrestitution = 0.5\n'
        'hertz = { radii = [2.0, 3] }\n[sweep]\nrecords = ["x.csv", "el_centro"]\nlaws = "linear"\n'
    )
    (path.parent / "x.csv").write_text("time (s),acc (m/s2)\n0,1\n0.01,2\n0.02,1\n")
    spec = load_spec(path)
    assert spec.scene.gaps == (0.0, 0.02)
    assert spec.scene.row == get_preset("mate2015").row
    assert spec.scene.contact.linear_stiffness == 2e6
    assert spec.scene.contact.restitution == 0.5
    assert spec.scene.contact.hertz_stiffness == pytest.approx(1.8803e7 * math.sqrt(1.2) / 1.0, rel=0.2)
    assert [r.name for r in spec.records] == ["x", "el_centro"]


def test_the_quickstart_sweep():
    spec = load_spec(ROOT / "sweeps" / "quickstart.toml")
    assert spec.n_scenarios == math.prod(map(len, spec.axes.values())) == 7 * 12 * 3 * 4
    assert spec == build_spec(
        title=spec.title,
        scene="mate2015",
        records="el_centro",
        laws="mate2015",
        gaps=[round(0.002 * i, 3) for i in range(1, 13)],
        stiffness_factors=[0.5, 1.0, 2.0],
        restitutions=[0.4, 0.5, 0.6, 0.8],
        accuracy=1e-3,
    )


def test_record_paths_start_from_the_file(write, tmp_path, monkeypatch):
    path = write('[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["sub/a.csv"]\nlaws = "linear"\n')
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.csv").write_text("time (s),acc (g)\n0,0.1\n0.1,0.2\n0.2,0.1\n")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert load_spec(path).records[0].name == "a"
    assert digest(load_spec(Path("..") / "sweep.toml")) == digest(load_spec(path))


# --- lines ----------------------------------------------------------------------------------------------------------


def test_lines_of_places():
    text = textwrap.dedent('''\
        # comment with [brackets] and "quotes"
        a = 1
        b.c = "x # no comment ]"
        "quoted key" = 'lit [ '
        d = """
        e = 1
        ""\\"
        """
        f = [ # comment ]
          1, [2,
          3],
          { g = 1, h.i = "}" },
        ]
        when = 1979-05-27 07:32:00

        [t]
        u = 2
        [[t.list]]
        v = [1, 2]
        [[t.list]]
        v = 3
        [t.list.sub]
        w = 4
        [ t . "x.y" ]
        z = 5
        ''')
    expected = {
        ("a",): 2, ("b",): 3, ("b", "c"): 3, ("quoted key",): 4, ("d",): 5, ("f",): 9, ("f", 0): 10, ("f", 1): 10,
        ("f", 1, 0): 10, ("f", 1, 1): 11, ("f", 2): 12, ("f", 2, "g"): 12, ("f", 2, "h"): 12, ("f", 2, "h", "i"): 12,
        ("when",): 14, ("t",): 16, ("t", "u"): 17, ("t", "list"): 18, ("t", "list", 0): 18, ("t", "list", 0, "v"): 19,
        ("t", "list", 0, "v", 0): 19, ("t", "list", 0, "v", 1): 19, ("t", "list", 1): 20, ("t", "list", 1, "v"): 21,
        ("t", "list", 1, "sub"): 22, ("t", "list", 1, "sub", "w"): 23, ("t", "x.y"): 24, ("t", "x.y", "z"): 25,
        ("t", "list", 1, "nothing", 3): 20, ("nothing",): 1, (): 1,
    }  # fmt: skip
    line = line_finder(text)
    assert {place: line(place) for place in expected} == expected


MADE = Sweep("mate2015", [PULSE.scaled(1 / 3), STEP.renamed("é 2/3")], "mate2015", gaps=[0.1, 1 / 3], title="“a\\b")
FILES = ("bouc_wen", "bumpers", "bumpers_of_a_pair", "columns", "foundations", "linked", "two_buildings_and_wall")


@pytest.mark.parametrize("sweep", [MADE, *FILES, "what_matters"], ids=str)
def test_a_sweep_is_written_as_a_file(sweep, tmp_path):
    sweep = load_sweep(ROOT / "sweeps" / f"{sweep}.toml") if isinstance(sweep, str) else sweep
    again = load_sweep(sweep.to_toml(tmp_path / "made.toml"))
    assert again.spec == sweep.spec
    assert [record.name for record in again.spec.records] == [record.name for record in sweep.spec.records]
