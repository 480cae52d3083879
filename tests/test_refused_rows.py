"""Rows that are none: what is wrong, and what to give instead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernels_used import BUMPED
from kinds import SOFT, TOWER_ABOVE, A, B

import pounding_sweep as ps
from pounding_sweep.base.errors import SceneError, SweepError
from pounding_sweep.model.scene import BoucWen

PAD = BUMPED.bumpers[0]
#: What is made of the values of a test.
MAKE = {
    "building": lambda given: replace(A, **given),
    "smooth": lambda given: replace(A, **({"yield_strengths": [10.0, 10.0]} | given)),
    "leaning": lambda given: replace(A, **({"stiffnesses": [6e3, 4e3], "p_delta": True} | given)),
    "founded": lambda given: replace(A, foundation=vars(SOFT) | given),
    "link": lambda given: ps.Scene([A, B, ps.Wall()], [0.1, 0.1], links=[ps.Link(*given)]),
    "links": lambda given: ps.Scene([A, B], [0.1], links=given),
    "bumper": lambda given: replace(BUMPED, bumpers=[ps.Bumper(*given)]),
    "bumpers": lambda given: replace(BUMPED, bumpers=given),
    "isolated": lambda given: ps.base_isolated(
        **({"building": TOWER_ABOVE, "base_mass": 150.0, "period": 2.5, "damping_ratio": 0.05, "strength": 250} | given)
    ),
}
REFUSED = {
    "building": [
        ({"yield_strengths": [-1.0, 2.0]}, r"yield_strengths of storey 1 is -1.0 kN; it must be a positive number"),
        ({"yield_strengths": [1.0, np.nan]}, r"yield_strengths of storey 2 is nan kN"),
        ({"yield_strengths": [1.0]}, r"1 yield_strengths for 2 masses; give one value per storey"),
        ({"yield_strengths": [1.0, 1.0], "hardening": 1.0}, r"hardening is 1.0; it must be in \[0, 1\)"),
        ({"yield_strengths": [1.0, 1.0], "hardening": -0.1}, r"hardening is -0.1; it must be in \[0, 1\)"),
        ({"yield_strengths": [1.0, 1.0], "hardening": True}, r"hardening is True; it must be in \[0, 1\)"),
        (
            {"yield_strengths": [1.0, 1.0], "hardening": [0.1]},
            "1 values of hardening for 2 masses; give one number for",
        ),
        (
            {"yield_strengths": [1.0, 1.0], "hardening": [0.1, 1]},
            r"hardening of storey 2 is 1.0; it must be in \[0, 1\)",
        ),
        (
            {"yield_strengths": [1.0, 1.0], "hardening": ["x", 0]},
            r"hardening must be a list of numbers \(in \[0, 1\)\)",
        ),
        ({"hardening": [0.1, 0.0]}, "building 'a': hardening is that of storeys that yield"),
        ({"hardening": 0.1}, r"building 'a': hardening is that of storeys that yield; give yield_strengths too"),
        ({"damping_stiffness": "tangent"}, r"damping_stiffness is that of storeys that yield"),
        ({"yield_strengths": [1.0, 1.0], "damping_stiffness": "tan"}, r"unknown damping_stiffness 'tan'"),
        (
            {"dashpots": [-1.0, 2.0]},
            r"building 'a': dashpots of storey 1 is -1.0 kN s/m; it must be zero or a positive number",
        ),
        ({"dashpots": [1.0, np.nan]}, r"dashpots of storey 2 is nan kN s/m"),
        ({"dashpots": [1.0]}, r"1 dashpots for 2 masses; give one value per storey, 0 where it has none"),
        ({"dashpots": [1.0, "x"]}, r"dashpots must be a list of numbers \(kN s/m\)"),
        ({"dashpots": []}, r"0 dashpots for 2 masses"),
        ({"foundation": 3.0}, "building 'a': foundation is .*; give a Foundation of mass, inertia, "),
        ({"foundation": "soft"}, "building 'a': foundation is .*; give a Foundation of mass, inertia, "),
        ({"foundation": {"mass": 1.0}}, "building 'a': foundation is .*; give a Foundation of mass, inertia, "),
        (
            {"foundation": {**vars(SOFT), "colour": 1.0}},
            "building 'a': foundation is .*; give a Foundation of mass, inertia, ",
        ),
    ],
    "smooth": [
        ({"bouc_wen": BoucWen(0.5)}, r"building 'a': n of bouc_wen is 0.5; it must be in \[1, 100\]"),
        ({"bouc_wen": {"gamma": 0.7}}, r"gamma of bouc_wen is 0.7 beside beta 0.5; it must be above -beta"),
        ({"bouc_wen": {"beta": 0.3, "gamma": -0.3}}, r"gamma of bouc_wen is -0.3 beside beta 0.3"),
        ({"bouc_wen": {"alpha": 1.0}}, r"bouc_wen is {'alpha': 1.0}; give n, beta and gamma, each a number"),
        ({"bouc_wen": [1.0, "x", 0.5]}, r"beta of bouc_wen is 'x'; it must be a number"),
        ({"bouc_wen": 3}, r"bouc_wen is 3; give n, beta and gamma"),
        ({"bouc_wen": BoucWen(), "yield_strengths": None}, r"bouc_wen is that of storeys that yield"),
        ({"bouc_wen": BoucWen(), "damping_stiffness": "tangent"}, r"bouc_wen has no tangent stiffness that is one"),
    ],
    "leaning": [
        (
            {"stiffnesses": [1e3, 200.0]},
            r"storey 2 of stiffness 200 kN/m does not stand .* is 1.47, .* give it a stiffness above P / h = 294.3 kN",
        ),
        ({"p_delta": "yes"}, r"p_delta is 'yes'; it must be true or false"),
        (
            {"yield_strengths": [1.0, 1.0], "damping_stiffness": "tangent"},
            r"with p_delta the tangent stiffness .* may be negative.*give damping_stiffness = \"initial\"",
        ),
    ],
    "founded": [
        ({"mass": 0.0}, r"mass is 0.0 t; it must be a positive number, as the base has its own equation of motion"),
        ({"inertia": 0}, r"inertia is 0 t m2; it must be a positive number, as the base has its own"),
        ({"sway_stiffness": 0.0}, r"sway_stiffness is 0.0 kN/m; .* number, as nothing else holds the base"),
        ({"rocking_stiffness": np.inf}, r"rocking_stiffness is inf .* number; leave the foundation out where"),
        ({"mass": -3.0}, r"mass is -3.0 t; it must be a positive number$"),
        ({"sway_damping": -1.0}, r"sway_damping is -1.0 kN s/m; it must be zero or a positive number"),
        ({"rocking_damping": "x"}, r"rocking_damping is 'x' kN m s/rad"),
        ({"inertia": True}, r"inertia is True t m2"),
    ],
    "link": [
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
    "links": [
        ([3], "links must be Link objects, not 3"),
    ],
    "bumper": [
        (("a-x", "linear", 1e5), r"unknown pair in bumpers 'a-x'; did you mean"),
        (("a-b", "nobody", 1e5), r"bumper of pair 'a-b': unknown contact law 'nobody'"),
        (("a-b", 3, 1e5), r"unknown contact law 3"),
        (("a-b", "stereomechanical", 1e5, 0.5), r"law 'stereomechanical' has no force that a bumper could have"),
        (("a-b", "linear"), r"law 'linear' needs a stiffness \(kN m-1\)"),
        (("a-b", "linear", -1.0), r"stiffness is -1.0 kN/m\*\*exponent; it must be a positive number"),
        (("a-b", "linear", True), r"stiffness is True"),
        (("a-b", "linear", 1e5, 0.5), r"law 'linear' takes no restitution; leave it out"),
        (("a-b", "kelvin_voigt", 1e5), r"law 'kelvin_voigt' needs a coefficient of restitution"),
        (("a-b", "kelvin_voigt", 1e5, "x"), r"restitution 'x' is no number; give 0 <= e <= 1"),
        (("a-b", "kelvin_voigt", 1e5, 1.2), r"restitution 1.2 is outside the validity"),
        (("a-b", "linear", 1e5, None, -1.0), r"thickness is -1.0 m; it must be zero or a positive number"),
        (("a-b", "rubber_bumper", 1e5, 0.5), r"law 'rubber_bumper' needs the thickness of the rubber"),
        (("a-b", PAD.law, 1e5, 0.5, 0.2), r"thickness is 0.2 m beside the 0.009 m of its law; leave it out"),
        (("a-b", "linear", 1e5, None, None, [3]), r"no floors meet at storey 3; give some of 1, 2"),
        (("a-b", "linear", 1e5, None, None, [1, 1]), r"storey 1 of pair 'a-b' has several bumpers; give one"),
        (("a-b", "linear", 1e5, None, None, [1.5]), r"storeys are \[1.5\]; give a list of whole numbers"),
        (("a-b", {"key": "x", "exponent": 0.1}, 1e5), r"bumper of pair 'a-b': law 'x': its exponent is 0.1"),
    ],
    "bumpers": [
        ([3], "bumpers must be Bumper objects, not 3"),
        ([PAD, replace(PAD, storeys=[2])], "storey 2 of pair 'a-b' has several bumpers"),
    ],
    "isolated": [
        ({"period": 0.0}, "isolators of 'tower': period is 0.0 s; it must be a positive number"),
        ({"strength": -1.0}, "strength is -1.0 kN; it must be zero or a positive number"),
        ({"damping_ratio": np.nan}, "damping_ratio is nan of critical; it must be zero"),
        ({"base_mass": "x"}, "base_mass is 'x' t"),
    ],
}


@pytest.mark.parametrize(
    ("kind", "given", "message"), [(kind, *case) for kind, cases in REFUSED.items() for case in cases]
)
def test_what_is_no_part_of_a_row_is_refused(kind, given, message):
    with pytest.raises(SceneError, match=message):
        MAKE[kind](given)


@pytest.mark.parametrize(
    ("keys", "messages"),
    [
        ("yield_strengths = [9.0]\nbouc_wen = { n = 0.1 }", ["scene.row[0].bouc_wen: n of bouc_wen is 0.1"]),
        ("yield_strengths = [9.0]\nbouc_wen = { m = 3 }", ["scene.row[0].bouc_wen.m: unknown key 'm'"]),
        ("yield_strengths = [9.0]\nbouc_wen = { n = 'x' }", ["scene.row[0].bouc_wen.n"]),
        (
            "p_delta = true\n[[scene.row]]\nname = 'b'\nmasses = [120.0]\nstiffnesses = [1e4]\np_delta = 3",
            ["storey 1 of stiffness 100 kN/m does not stand", "scene.row[1].p_delta"],
        ),
    ],
)
def test_a_file_says_where_it_is_wrong(keys, messages, tmp_path):
    path, row = tmp_path / "sweep.toml", "[scene]\ngaps = [0.01]\n[[scene.row]]\nname = 'a'\nmasses = [120.0]\n"
    path.write_text(f"{row}stiffnesses = [100.0]\n{keys}\n[sweep]\nrecords = ['el_centro']\nlaws = ['none']\n")
    with pytest.raises(SweepError) as caught:
        ps.load_sweep(path)
    assert all(message in str(caught.value) for message in messages)
