"""Contact laws: of the registry, and of a user's own."""

from __future__ import annotations

import itertools
import json
import math
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
import reference
import xarray as xr
from hypothesis import example, given
from hypothesis import strategies as st
from kernels_used import own_law
from scenes import OUTPUTS, call, motions, pair

import pounding_sweep as ps
from pounding_sweep.accuracy.law_check import LawCheck, check_law, solved_restitution
from pounding_sweep.base.errors import InputError, LawError, SweepError
from pounding_sweep.kernel.group import _FUNCTIONS
from pounding_sweep.model import formula as formulas
from pounding_sweep.model.laws import (
    LAWS,
    MATE2015_MODELS,
    Law,
    find_law,
    get_law,
    hertz_stiffness,
    realised_restitution,
)
from pounding_sweep.output.merge import merge_cubes
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.request.spec import digest, to_json
from pounding_sweep.resume import identity_of
from pounding_sweep.variables.registry import relative_errors

NAN, INF = float("nan"), float("inf")


def value(text, d, k=3.0e6, c=2.0e3):
    return eval(text, {"sqrt": math.sqrt, "max": max}, {"k": k, "c": c, "d": d, "r": math.sqrt(max(d, 0.0))})


@pytest.mark.parametrize("key", [key for key, law in reference.LAWS.items() if not law.yields])
@given(d=st.floats(1e-6, 0.1), v=st.floats(-1.0, 1.0), k=st.floats(1e5, 1e8), m=st.floats(10.0, 500.0))
@example(d=0.01, v=0.5, k=1e6, m=80.0)
def test_formulas_are_those_of_the_twin(key, d, v, k, m):
    """With the damping of a restitution of 0.6, at an approach of 0.8 m/s."""
    law, rule, e, v0 = LAWS[key], reference.LAWS[key], 0.6, 0.8
    pulls = rule.damper is not None and not (rule.clip or rule.approach_only)
    assert (law.approach_only, law.tension) == (rule.approach_only, pulls)
    force, want = value(law.elastic, d, k), reference.elastic_force(rule, k, d)
    if rule.damper:
        c = float(law.damping_coefficient(e, k, m)) / (v0 if law.damping == "elastic" else 1.0)
        force += value(law.damper, d, k, c) * v
        want += reference.damper_force(rule, k, d, v, m, v0, reference.damping_coefficient(key, e))
    assert force == pytest.approx(want, rel=1e-12, abs=1e-9)


def test_every_source_can_be_found():
    """Each names its year, and the journal with volume and pages, the conference or the publisher."""
    for law in LAWS.values():
        for source in law.reference.split("; "):
            if source not in ("-", "Newton's impact law"):
                assert re.search(r"\((18|19|20)\d\d\)", source), source
                assert re.search(r" \d+(\(\w+\))?, \d+-\d+$|Conference|Edward Arnold", source), source
    assert "Earthq. Eng. Eng. Vib. 8(3)" in LAWS["modified_kelvin"].reference
    assert "Earthquake Eng. Struct. Dyn. 38, 1135" in LAWS["ye_hertz"].reference
    assert "Wijeyewickrema" in LAWS["modified_kelvin_voigt"].reference


def test_registry_is_complete():
    assert list(LAWS) == [law.key for law in LAWS.values()]
    assert len(LAWS) == 15
    for law in LAWS.values():
        assert law.title
        assert law.formula
        assert law.reference
        assert law.impulsive == (law.exponent is None and law.has_contact)
        assert law.takes_restitution == (law.damping != "none") == bool(law.number_text)
        assert bool(law.damper or law.yields) == (law.takes_restitution and not law.impulsive)
        assert law.exponent in (None, 1.0, 1.5)
        assert law.stiffness_unit == {None: "", 1.0: "kN m-1", 1.5: "kN m-1.5"}[law.exponent]
    assert [LAWS[key].model for key in MATE2015_MODELS] == ["I", "II", "III", "IV", "V", "VI", "VII"]
    assert [law.key for law in LAWS.values() if law.tension] == ["kelvin_voigt_tension"]


def test_damping_coefficients_of_many_contacts():
    k, m = np.array([1e6, 2e6]), np.array([[50.0], [60.0], [70.0]])
    for law in LAWS.values():
        c = law.damping_coefficient(0.6, k, m)
        want = [[float(law.damping_coefficient(0.6, *one)) for one in itertools.product(k, row)] for row in m]
        np.testing.assert_array_equal(c, want, err_msg=law.key)
        assert c.any() == law.takes_restitution
    coefficients = {
        key: float(LAWS[key].damping_coefficient(0.6, 1e6, 50.0)) for key in ("stereomechanical", "hysteretic")
    }
    assert coefficients == {"stereomechanical": 0.6, "hysteretic": 0.64}


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.key)
def test_validity_of_restitution(law):
    for e in (1e-6, 0.5, 1.0):
        law.check_restitution(e)
    if not law.takes_restitution:
        law.check_restitution(None)
        law.check_restitution(-3.0)  # ignored
        assert "takes none" in law.validity
        return
    for e in (-0.1, 1.1, NAN, INF):
        with pytest.raises(LawError, match=f"outside the validity of law '{law.key}'; give {law.validity}"):
            law.check_restitution(e)
    with pytest.raises(LawError, match="needs a coefficient of restitution"):
        law.check_restitution(None)
    if law.zero_restitution:
        law.check_restitution(0.0)
    else:
        with pytest.raises(LawError, match="0 < e <= 1"):
            law.check_restitution(0.0)


def test_get_law():
    law = get_law("hertz")
    assert isinstance(law, Law)
    assert get_law(law) is law
    with pytest.raises(LawError, match=r"unknown contact law 'herz'; did you mean 'hertz'\? Valid: gonthier"):
        get_law("herz")
    for bad in (None, ["hertz"], {}):
        with pytest.raises(LawError, match="unknown contact law"):
            get_law(bad)


def test_hertz_stiffness():
    r = [(3 * m / (4 * math.pi * 2.5)) ** (1 / 3) for m in (133.956, 136.286)]
    by_masses = hertz_stiffness(133.956, 136.286)
    assert by_masses == pytest.approx(1.88e7, rel=2e-3)
    assert by_masses == pytest.approx(hertz_stiffness(radii=tuple(r)), rel=1e-14)
    # two equal spheres of steel against the textbook: 4/3 E* sqrt(R*), E* = E / (2 (1 - nu^2))
    expected = 4 / 3 * 210e6 / (2 * (1 - 0.09)) * math.sqrt(0.5)
    assert hertz_stiffness(radii=(1.0, 1.0), young_modulus=210e6, poisson_ratio=0.3) == pytest.approx(expected)


def test_bad_hertz_stiffness():
    for arguments in ({}, {"mass_1": 1.0}):
        with pytest.raises(LawError, match="two masses"):
            hertz_stiffness(**arguments)
    with pytest.raises(LawError, match="hertz_stiffness: density: nan won't do; it must be greater than 0"):
        hertz_stiffness(1.0, 1.0, density=NAN)


MINE = """
from pounding_sweep import Law
my_law = Law(key="my_law", exponent=1.25, damper="c*d**1.25", damping="elastic", number="{number}*(1 - e)",
             reference_stiffness=6e6)
"""


def law(**given):
    return Law(**{"key": "mine", "exponent": 1.0, **given})


def law_file(folder, text=None, number=1.5, name="mylaws.py"):
    path = folder / name
    path.write_text(MINE.format(number=number) if text is None else text)
    return path


def sweep(path, **more):
    given = {"scene": pair(), "records": motions()[0], "laws": f"{path}:my_law", "gaps": [0.001, 0.004], "dt": 0.005}
    return ps.Sweep(**given | {"restitutions": [0.6], "outputs": OUTPUTS} | more)


# -- formulas ----------------------------------------------------------------------------------------------------------

FORMULAS = st.recursive(
    st.sampled_from(["d", "r", "k", "2.5", "(d + 0.3)"]),
    lambda inner: st.one_of(
        st.builds("({} + {})".format, inner, inner),
        st.builds("({} - {})".format, inner, inner),
        st.builds("({} * {})".format, inner, inner),
        st.builds("({} / (1.5 + {}**2))".format, inner, inner),
        st.builds("sqrt({0} * {0} + d)".format, inner),
        st.builds("(({0} * {0} + d)**{1})".format, inner, st.sampled_from(["2", "0.75", "1.3", "(5/4)", "-0.5", "0"])),
        st.builds("(-{})".format, inner),
    ),
    max_leaves=6,
)


@given(FORMULAS, st.floats(0.01, 0.9))
def test_slopes_are_derivatives(text, d):
    formulas.check(text, formulas.FORCE_NAMES)
    at = {"k": 1.7, "c": 1.0}
    step = 1e-6 * d

    def value(x):
        return float(formulas.on_arrays(text, d=np.float64(x), **at))

    rise = (value(d + step) - value(d - step)) / (2.0 * step)
    size = max(abs(value(d)) / d, abs(rise), 1.0)
    assert float(formulas.on_arrays(formulas.slope(text), d=np.float64(d), **at)) == pytest.approx(
        rise, abs=1e-4 * size
    )


@given(st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.3, 1.5, 2.0, 2.75, 4.0, 5.0, -0.5]), st.floats(1e-6, 10.0))
def test_powers_in_kernels_are_powers(exponent, x):
    found = _FUNCTIONS["pow"](np.full(3, x), exponent)
    np.testing.assert_allclose(found * np.ones(3), x**exponent, rtol=4e-15)


def test_a_law_that_is_complete_stays_as_it_is():
    mine = law(exponent=1.25, damper="c*d**1.25", damping="elastic", number="1.5*(1 - e)")
    assert replace(mine) == mine == Law(**json.loads(json.dumps(mine.described)))
    assert pickle.loads(pickle.dumps(mine)) == mine
    assert mine.sha256 != replace(mine, number="1.6*(1 - e)").sha256
    assert mine.sha256 == replace(mine, source="elsewhere.py:mine").sha256


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"elastic": "k*w"}, "'w' at column 3 is not allowed in a contact-law formula; allowed: numbers, d, r, k,"),
        ({"elastic": "k*d**d"}, r"'d \*\* d' at column 3 is not allowed in a contact-law formula"),
        ({"elastic": "k*exp(d)"}, r"'exp\(d\)' at column 3 is not allowed in a contact-law formula"),
        ({"elastic": "__import__('os').getpid()*k*d"}, "at column 1 is not allowed in a contact-law formula"),
        ({"elastic": "k*"}, "the formula 'k\\*' is no formula: invalid syntax"),
        ({"elastic": "d"}, "elastic 'd' must be proportional to k, which carries the unit"),
        ({"elastic": "k*d*(0.2 - d)"}, "elastic 'k\\*d\\*\\(0.2 - d\\)' is -.* at d = .* it must be > 0"),
        ({"elastic": "k*d/(1 + 100*d*d)"}, "must grow with d"),
        ({"elastic": "k*d*r"}, r"elastic 'k\*d\*r' begins as d\^1\.5, and the exponent is 1"),
        ({"elastic": "k*d", "elastic_slope": "2*k"}, r"elastic_slope '2\*k' is not the derivative of 'k\*d' by d"),
        ({"elastic": "k*max(d, 0.5*d)"}, "the slope of 'max\\(d, 0.5 \\* d\\)' is not known"),
        ({"damper": "c"}, "damper and damping belong together"),
        ({"number": "1 - e"}, "damper and damping belong together"),
        ({"damper": "c*r", "damping": "viscous"}, "number is missing, and no closed form is known of the rebound"),
        ({"damping": "viscuous"}, "unknown damping 'viscuous'; did you mean 'viscous'"),
        ({"damper": "c", "damping": "viscous", "number": "log(e)"}, "damping number 'log\\(e\\)' at e = 0.05"),
        (
            {"damper": "c", "damping": "viscous", "number": "1 - x"},
            r"'x' at column 5 is not allowed in a contact-law formula; allowed: numbers, e, pi, \+",
        ),
        ({"damper": "c", "damping": "viscous", "number": "1 - e", "relation": "aproach"}, "unknown relation 'aproach'"),
    ],
)
def test_a_law_that_is_none_says_why(given, said):
    with pytest.raises(LawError, match=said):
        law(**given)


# -- files -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1\ny = 1 / 0\n", r"mylaws\.py:2: ZeroDivisionError: division by zero"),
        ("x = (1\n", r"mylaws\.py:1: SyntaxError: '\(' was never closed"),
        (
            "from pounding_sweep import Law\n\nLaw(key='a',\n    exponent=0)\n",
            r"mylaws\.py:3: LawError: Law 'a': exponent: 0 won't do",
        ),
        ("from pounding_sweep import Law\na = b = Law(key='a', exponent=2)\n", "no 'my_law'; laws in it: a, b"),
        ("my_law = 3\n", "my_law is 3, no Law; laws in it: none"),
        ("from pounding_sweep import LAWS as L\nmy_law = L['stereomechanical']\n", None),
        (
            "import dataclasses, pounding_sweep as ps\nmy_law = dataclasses.replace(ps.LAWS['linear'], key='hertz')\n",
            "has the key of a law or group that is there already",
        ),
        (
            "import dataclasses, pounding_sweep as ps\nmy_law = dataclasses.replace(ps.LAWS['hysteretic'], key='g')\n",
            "a law of your own has a force",
        ),
    ],
)
def test_a_law_file_that_is_none_says_where(tmp_path, text, said):
    path = law_file(tmp_path, text)
    if said is None:  # one of the registry under another name is that one
        assert find_law(f"{path}:my_law") is LAWS["stereomechanical"]
        return
    with pytest.raises(LawError, match=said):
        find_law(f"{path}:my_law")


def test_a_law_file_is_looked_for_beside_the_sweep(tmp_path):
    text = '[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\nlaws = ["linear",\n  "mylaws.py:my_law"]\n'
    (tmp_path / "one.toml").write_text(text)
    with pytest.raises(SweepError, match=r"one\.toml:6: sweep\.laws\[1\]: law file '.*mylaws\.py' does not exist"):
        ps.load_sweep(tmp_path / "one.toml")
    path = law_file(tmp_path)
    found = ps.load_sweep(tmp_path / "one.toml").spec
    assert found.laws == ("linear", "my_law")
    assert found.law("my_law").source == f"{path}:my_law"
    (tmp_path / "two.toml").write_text(
        '[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\n'
        + "".join(f'[[sweep.cases]]\nlaw = "mylaws.py:my_law"\ngap = {gap}\n' for gap in (0.01, 0.02))
    )
    assert ps.load_sweep(tmp_path / "two.toml").spec.user_laws == found.user_laws
    path.write_text(MINE.format(number=1.5).replace("6e6", "None"))
    with pytest.raises(SweepError, match=r"a reference stiffness for force ~ d\^1.25 \(kN/m\^1.25\) is missing"):
        ps.load_sweep(tmp_path / "two.toml")
    path.write_text("1/0")
    with pytest.raises(SweepError, match=r"one\.toml:6: sweep\.laws\[1\]: law file .*mylaws\.py:1: ZeroDivisionError"):
        ps.load_sweep(tmp_path / "one.toml")


def test_two_laws_of_one_key_are_refused(tmp_path):
    one, two = law_file(tmp_path), law_file(tmp_path, number=1.4, name="more.py")
    with pytest.raises(SweepError, match=r"laws\[1\]: 'my_law' repeats value"):
        sweep(one, laws=[f"{one}:my_law", f"{two}:my_law"])
    cases = [{"law": f"{path}:my_law", "gap": 0.01} for path in (one, two)]
    with pytest.raises(SweepError, match=r"cases\[1\]\.law: law 'my_law' is another one than that of the same key"):
        ps.Sweep(pair(), motions()[0], cases=cases)


# -- what sweeps and cubes know a law by -------------------------------------------------------------------------------


def test_a_law_belongs_to_the_sweep_and_to_its_chunks(tmp_path):
    path = law_file(tmp_path)
    before, same = sweep(path).spec, sweep(path).spec
    law_file(tmp_path, number=1.4)
    after = sweep(path).spec
    assert digest(before) == digest(same) != digest(after)
    told = json.loads(to_json(before))["user_laws"]["my_law"]
    assert told["sha256"] == before.user_laws[0].sha256
    keys = [{chunk.key for chunk in make_plan(each).chunks(np.arange(2))} for each in (before, same, after)]
    assert keys[0] == keys[1]
    assert not keys[0] & keys[2]
    named = [identity_of(make_plan(each))["law my_law"] for each in (before, same, after)]
    assert named[0] == named[1] != named[2]
    assert json.loads(to_json(sweep(path, laws="linear").spec))["user_laws"] == {}


@pytest.mark.usefixtures("stub_engine")
def test_a_changed_law_is_refused_wherever_results_are_used_again(tmp_path):
    path = law_file(tmp_path)
    earlier, bigger = sweep(path), {"gaps": [0.001, 0.004, 0.008]}
    cube = earlier.run(tmp_path / "old.nc", scheduler="synchronous")
    assert cube["law"].values.tolist() == ["my_law"]
    assert cube["law_title"].values.tolist() == ["My law"]
    cube.close()
    grown = sweep(path, **bigger).run(tmp_path / "new.nc", scheduler="synchronous", extend=tmp_path / "old.nc")
    assert json.loads(grown.attrs["extended_from"])["scenarios_taken"] == 2
    grown.close()
    other = sweep(path, laws=["linear", f"{path}:my_law"], gaps=[0.008], stiffness_factors=1.0)
    other.run(tmp_path / "other.nc", scheduler="synchronous").close()
    merge_cubes([tmp_path / "new.nc", tmp_path / "other.nc"], tmp_path / "both.nc")
    with ps.open_cube(tmp_path / "both.nc") as both:
        assert both["law"].values.tolist() == ["my_law", "linear"]
        assert json.loads(both.attrs["sweep"])["user_laws"]["my_law"]["sha256"] == earlier.spec.user_laws[0].sha256
    law_file(tmp_path, number=1.4)
    changed = sweep(path, **bigger)
    with pytest.raises(
        InputError, match=r"old\.nc' and this sweep are not parts of one study: law 'my_law' as SHA-256 is '\w+' in"
    ):
        changed.run(tmp_path / "more.nc", scheduler="synchronous", extend=tmp_path / "old.nc")
    changed.run(tmp_path / "more.nc", scheduler="synchronous").close()
    with pytest.raises(InputError, match=r"are not parts of one study: law 'my_law' as SHA-256 is '\w+' in the first"):
        merge_cubes([tmp_path / "new.nc", tmp_path / "more.nc"], tmp_path / "none.nc")


# -- kernels -----------------------------------------------------------------------------------------------------------


def test_the_page_about_own_laws_runs():
    """Its cube, beside forces of an independent solver of the law: at one touch of free masses they agree."""
    job = ps.load_sweep(own_law())
    cube = job.run(workers=1)
    assert cube["law"].values.tolist() == ["hertz_damped", "my_law"]
    assert (cube["status"] == 0).all()
    mine, hertz = (cube["impact_force_max"].sel(law=key).max("storey") for key in ("my_law", "hertz_damped"))
    assert (mine > 0).all()
    assert abs(mine / hertz - 1.0).max() > 0.05
    np.testing.assert_allclose(
        cube["restitution_realised"].sel(law="my_law"),
        [solved_restitution(job.spec.law("my_law"), e) for e in (0.4, 0.6)],
        rtol=1e-9,
    )
    one = cube.sel(law="my_law", restitution=0.6, gap=0.005).squeeze()
    k, n = 6e6, 1.25
    deepest, force = (one[name].max().item() for name in ("penetration_max", "impact_force_max"))
    # the damper presses on approach and lifts on rebound: the peak lies between the spring's and that at its fastest
    assert k * deepest**n <= force <= 1.6 * k * deepest**n


@pytest.mark.parametrize("e", [0.2, pytest.param(0.6, marks=pytest.mark.slow), 0.95])
@pytest.mark.parametrize(
    "given",
    [
        {"exponent": 2.0, "damper": "c*d**0.5", "damping": "viscous", "number": "(1 - e)/e"},
        {"exponent": 3.0, "damper": "0.5*c*d", "damping": "viscous", "number": "1 - e", "tension": True},
        {"exponent": 1.25, "damper": "2*c*d**1.25", "damping": "elastic", "number": "1 - e**2", "approach_only": True},
        {"elastic": "k*d + 50*k*d**2", "damper": "c*(d + 50*d**2)", "damping": "elastic", "number": "(1 - e**2)/e"},
    ],
    ids=["clipped", "tension", "approach", "hardening"],
)
def test_relations_that_follow_are_those_of_a_solver(given, e):
    mine = law(**given)
    assert solved_restitution(mine, e) == pytest.approx(float(realised_restitution(mine, e)), abs=1e-10)
    assert solved_restitution(mine, e, basis="realised") == pytest.approx(e, abs=1e-10)


@pytest.mark.parametrize(
    "given",
    [
        {"exponent": 2.0, "damper": "c*d**0.5", "damping": "viscous"},
        pytest.param(
            {"exponent": 1.25, "damper": "c*d**1.25", "damping": "elastic", "approach_only": True},
            marks=pytest.mark.slow,
        ),
        {"damper": "c", "damping": "viscous", "tension": True},
    ],
    ids=["clipped", "approach", "tension"],
)
def test_a_number_that_is_left_out_is_solved(given):
    mine = law(**given)
    assert mine.number == "solved"
    assert mine == Law(**json.loads(json.dumps(mine.described)))
    for e in (0.1, 0.6, 0.95):
        assert solved_restitution(mine, e) == pytest.approx(e, abs=1e-10)
        assert float(realised_restitution(mine, e)) == pytest.approx(e, rel=1e-12)
    assert mine.zero_restitution == bool(mine.tension)


def test_a_law_whose_rebound_depends_on_its_speed_has_no_relation():
    mine = law(exponent=1.3, damper="c*d*r", damping="viscous", number="1 - e", approach_only=True)
    assert mine.relation == ""
    with pytest.raises(LawError, match="its damping has no known relation to the realised"):
        mine.check_restitution(0.5, "realised")


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [1.25, 3.0])
def test_an_accuracy_is_reached(exponent):
    """Of a law that nobody measured: against runs in tiny steps."""
    damped = {"damper": f"c*d**{exponent}", "damping": "elastic", "number": "1.5*(1 - e)"}
    own = law(exponent=exponent, **damped, reference_stiffness=3e3 * 1e3**exponent)
    axes = {"gaps": [0.001, 0.002, 0.004], "restitutions": [0.4, 0.8], "stiffness_factors": [0.1, 1.0]}
    given = {"scene": pair(), "records": motions(), "laws": [own], "outputs": OUTPUTS, "audit": 0.0, **axes}
    found, exact = ps.Sweep(**given, accuracy=1e-3).run(), ps.Sweep(**given, method="rk4", dt=2e-5).run()
    assert (found["status"] == 0).all()
    assert float(found["impact_count"].max()) > 3.0
    shape = exact["status"].size
    values, right = (
        {name: each[name].values.reshape(shape, *each[name].shape[exact["status"].ndim :]) for name in OUTPUTS}
        for each in (found, exact)
    )
    for name, error in relative_errors(OUTPUTS, values, right).items():
        assert error.max() <= 1e-3, name


@pytest.mark.slow
@pytest.mark.parametrize("key", ["mine", "hertz", "kelvin_voigt_tension"])
def test_a_law_is_checked_by_kernels_solver_and_twin(key):
    mine = law(exponent=1.3, damper="c*d**0.15", damping="viscous", number="(1 - e)/e", approach_only=True)
    found = check_law(mine if key == "mine" else key, [0.3, 0.8])
    assert found.faults == []
    assert found.impacts > 0
    wrong = replace(found, certificate=found.certificate.assign(solved=found.certificate.solved + 1e-5))
    assert len(wrong.faults) == 2
    assert "kernel and twin differ in fmax by 1.0e-03" in replace(found, twin={"fmax": 1e-3}).faults[0]


@pytest.mark.parametrize(("measured", "said", "fault"), [(0.13, "", False), (0.2, "0.20", False), (0.82, "0.82", True)])
def test_a_law_that_does_not_realise_the_restitution_is_told(measured, said, fault):
    asked = {"law": ["x"], "basis": ["published"], "restitution": [0.1, 0.6]}
    dims = tuple(asked)
    table = xr.DataArray([[[measured, 0.61]]], asked, dims)
    certificate = xr.Dataset({"measured": table, "solved": table, "analytic": table})
    wording = f"does not realise the restitution: its damping number gives {said} where 0.1 is asked"
    for checked in (
        law(damper="c*d", damping="elastic", number="1 - e"),
        LAWS["hertz_damped"],
    ):  # of a user's own, and as published
        check = LawCheck(checked, certificate, {"fmax": 0.0}, 3)
        assert (wording in check.missed[1]) == bool(said)
        assert bool(check.faults) == (fault and checked.key not in LAWS)
    assert (
        not fault
        or wording
        in LawCheck(law(damper="c*d", damping="elastic", number="1 - e"), certificate, {"fmax": 0.0}, 3).faults[0]
    )


@pytest.mark.slow
def test_the_command_checks_a_law(tmp_path):
    path = law_file(tmp_path)
    got = call("laws", "--check", f"{path}:my_law", "--e", "0.6")
    assert f"from {path}:my_law, Python of your own that was run" in got.stderr
    assert "All agree" in got.stdout
    assert re.search(r"published +0\.6 +0\.6 +0\.71195\d+ +0\.71195\d+ +0\.71195\d+", got.stdout)


@pytest.mark.usefixtures("stub_engine")
def test_commands_say_which_file_they_run(tmp_path):
    path = law_file(tmp_path)
    file = tmp_path / "one.toml"
    file.write_text('[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\nlaws = "linear"\n')
    for words in (("plan", file, "--json"), ("run", file, "-o", tmp_path / "c.nc", "--json")):
        got = call(*words, "--law", f"{path}:my_law", "--law", "hertz")
        assert f"law 'my_law' from {path}:my_law, Python of your own that was run (SHA-256 " in got.stderr
        assert list(json.loads(got.stdout)["user_laws"]) == ["my_law"]
    refused = call("plan", file, "--law", f"{path}:mylaw", code=2).stderr
    assert "there is no 'mylaw'; laws in it: my_law" in refused
