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
        ({"yield_strengths": [-1.0, 2.0]}, r"yield_strengths\[0\]: -1\.0 won't do; it must be greater than 0"),
        ({"yield_strengths": [1.0, np.nan]}, r"yield_strengths\[1\]: nan won't do; it must be greater than 0"),
        ({"yield_strengths": [1.0]}, "yield_strengths: 1 values for 2 masses; give one per storey"),
        ({"yield_strengths": [1.0, 1.0], "hardening": 1.0}, r"hardening: 1\.0 won't do; it must be less than 1"),
        (
            {"yield_strengths": [1.0, 1.0], "hardening": -0.1},
            r"hardening: -0\.1 won't do; it must be greater than or equal to 0",
        ),
        ({"yield_strengths": [1.0, 1.0], "hardening": True}, "hardening: True won't do; it must be a valid number"),
        (
            {"yield_strengths": [1.0, 1.0], "hardening": [0.1]},
            "hardening: 1 values for 2 masses; give one per storey",
        ),
        (
            {"yield_strengths": [1.0, 1.0], "hardening": [0.1, 1]},
            r"hardening\[1\]: 1 won't do; it must be less than 1",
        ),
        (
            {"yield_strengths": [1.0, 1.0], "hardening": ["x", 0]},
            r"hardening\[0\]: 'x' won't do; it must be a valid number",
        ),
        (
            {"hardening": [0.1, 0.0]},
            "hardening: hardening is that of storeys that yield; give yield_strengths too, or leave it out",
        ),
        (
            {"hardening": 0.1},
            "hardening: hardening is that of storeys that yield; give yield_strengths too, or leave it out",
        ),
        ({"damping_stiffness": "tangent"}, r"damping_stiffness is that of storeys that yield"),
        ({"yield_strengths": [1.0, 1.0], "damping_stiffness": "tan"}, r"unknown damping_stiffness 'tan'"),
        (
            {"dashpots": [-1.0, 2.0]},
            r"dashpots\[0\]: -1\.0 won't do; it must be greater than or equal to 0",
        ),
        ({"dashpots": [1.0, np.nan]}, r"dashpots\[1\]: nan won't do; it must be greater than or equal to 0"),
        ({"dashpots": [1.0]}, "dashpots: 1 values for 2 masses; give one per storey"),
        ({"dashpots": [1.0, "x"]}, r"dashpots\[1\]: 'x' won't do; it must be a valid number"),
        ({"dashpots": []}, "dashpots: 0 values for 2 masses; give one per storey"),
        (
            {"foundation": 3.0},
            "foundation: must be a Foundation or a table of mass, inertia, sway_stiffness, rocking_stiffness",
        ),
        (
            {"foundation": "soft"},
            "foundation: must be a Foundation or a table of mass, inertia, sway_stiffness, rocking_stiffness",
        ),
        (
            {"foundation": {"mass": 1.0}},
            r"foundation\.inertia: is missing; give Mass moment of inertia \(t m2\) of the base about its own ce",
        ),
        (
            {"foundation": {**vars(SOFT), "colour": 1.0}},
            r"foundation\.colour: unknown key 'colour'; valid: inertia, mass, rocking_damping, rocking_stiffne",
        ),
    ],
    "smooth": [
        ({"bouc_wen": {"n": 0.5}}, r"bouc_wen\.n: 0\.5 won't do; it must be greater than or equal to 1"),
        (
            {"bouc_wen": {"gamma": 0.7}},
            r"bouc_wen: gamma is 0\.7 beside beta 0\.5; it must be above -beta, so that z stays bounded, and at",
        ),
        (
            {"bouc_wen": {"beta": 0.3, "gamma": -0.3}},
            r"bouc_wen: gamma is -0\.3 beside beta 0\.3; it must be above -beta, so that z stays bounded, and a",
        ),
        ({"bouc_wen": {"alpha": 1.0}}, r"bouc_wen\.alpha: unknown key 'alpha'; valid: beta, gamma, n"),
        ({"bouc_wen": [1.0, "x", 0.5]}, "bouc_wen: BoucWen 'x': beta: 'x' won't do; it must be a valid number"),
        ({"bouc_wen": 3}, "bouc_wen: must be a BoucWen or a table of n, beta, gamma, not 3"),
        ({"bouc_wen": BoucWen(), "yield_strengths": None}, r"bouc_wen is that of storeys that yield"),
        ({"bouc_wen": BoucWen(), "damping_stiffness": "tangent"}, r"bouc_wen has no tangent stiffness that is one"),
    ],
    "leaning": [
        (
            {"stiffnesses": [1e3, 200.0]},
            r"storey 2 of stiffness 200 kN/m does not stand .* is 1.47, .* give it a stiffness above P / h = 294.3 kN",
        ),
        ({"p_delta": "yes"}, "p_delta: 'yes' won't do; it must be a valid boolean"),
        (
            {"yield_strengths": [1.0, 1.0], "damping_stiffness": "tangent"},
            r"with p_delta the tangent stiffness .* may be negative.*give damping_stiffness = \"initial\"",
        ),
    ],
    "founded": [
        ({"mass": 0.0}, r"foundation\.mass: 0\.0 won't do; it must be greater than 0"),
        ({"inertia": 0}, r"foundation\.inertia: 0 won't do; it must be greater than 0"),
        ({"sway_stiffness": 0.0}, r"foundation\.sway_stiffness: 0\.0 won't do; it must be greater than 0"),
        ({"rocking_stiffness": np.inf}, r"foundation\.rocking_stiffness: inf won't do; it must be a finite number"),
        ({"mass": -3.0}, r"foundation\.mass: -3\.0 won't do; it must be greater than 0"),
        ({"sway_damping": -1.0}, r"foundation\.sway_damping: -1\.0 won't do; it must be greater than or equal to 0"),
        ({"rocking_damping": "x"}, r"foundation\.rocking_damping: 'x' won't do; it must be a valid number"),
        ({"inertia": True}, r"foundation\.inertia: True won't do; it must be a valid number"),
    ],
    "link": [
        (("a-b", [3], 1.0), r"links\[0\]: there is no storey 3 of 'a'; give one of 1 to 2"),
        (("a-b", [(1, 0)], 1.0), r"links\[0\]: there is no storey 0 of 'b'; give one of 1 to 2"),
        (("a-c", [1], 1.0), r"links\[0\]: unknown pair 'a-c'; did you mean 'a-b'\? Valid: a-b, b-wall"),
        (("b-wall", [1], 1.0), r"pair 'b-wall' has a wall; links join floors of two buildings"),
        (("a-b", [1], -1.0), r"stiffness: -1\.0 won't do; it must be greater than or equal to 0"),
        (("a-b", [1], 0.0, np.inf), "damping: inf won't do; it must be a finite number"),
        (("a-b", [1]), "stiffness and damping are zero; give one of them, or leave it out"),
        (("a-b", [], 1.0), r"storeys: \[\] won't do; it must have at least 1 item after validation, not 0"),
        (("a-b", [1.5], 1.0), r"storeys\[0\]: 1\.5 won't do; it must be a valid integer"),
        (("a-b", 1, 1.0), "storeys: must be a list, not 1"),
        (("a-b", [1, 1], 1.0), r"links\[0\]: storey 1 has 2 links; give one, of their sum"),
    ],
    "links": [
        ([3], r"links\[0\]: must be a Link or a table of pair, storeys, stiffness, damping, not 3"),
    ],
    "bumper": [
        (("a-x", "linear", 1e5), r"bumpers\[0\]: unknown pair 'a-x'; did you mean 'a-b'\? Valid: a-b, b-c, c-wall"),
        (
            ("a-b", "nobody", 1e5),
            "law: unknown contact law 'nobody'; valid: gonthier, hertz, hertz_damped, hunt_crossley, hystere",
        ),
        (("a-b", 3, 1e5), r"unknown contact law 3"),
        (("a-b", "stereomechanical", 1e5, 0.5), r"law 'stereomechanical' has no force that a bumper could have"),
        (("a-b", "linear"), r"law 'linear' needs a stiffness \(kN m-1\)"),
        (("a-b", "linear", -1.0), r"stiffness: -1\.0 won't do; it must be greater than 0"),
        (("a-b", "linear", True), "stiffness: True won't do; it must be a valid number"),
        (("a-b", "linear", 1e5, 0.5), r"law 'linear' takes no restitution; leave it out"),
        (("a-b", "kelvin_voigt", 1e5), r"law 'kelvin_voigt' needs a coefficient of restitution"),
        (("a-b", "kelvin_voigt", 1e5, "x"), "restitution: 'x' won't do; it must be a valid number"),
        (("a-b", "kelvin_voigt", 1e5, 1.2), r"restitution 1.2 is outside the validity"),
        (("a-b", "linear", 1e5, None, -1.0), r"thickness: -1\.0 won't do; it must be greater than or equal to 0"),
        (("a-b", "rubber_bumper", 1e5, 0.5), r"law 'rubber_bumper' needs the thickness of the rubber"),
        (("a-b", PAD.law, 1e5, 0.5, 0.2), r"thickness is 0.2 m beside the 0.009 m of its law; leave it out"),
        (("a-b", "linear", 1e5, None, None, [3]), r"bumpers\[0\]: no floors meet at storey 3; they do at: 1, 2"),
        (("a-b", "linear", 1e5, None, None, [1, 1]), r"storey 1 of pair 'a-b' has several bumpers; give one"),
        (("a-b", "linear", 1e5, None, None, [1.5]), r"storeys\[0\]: 1\.5 won't do; it must be a valid integer"),
        (
            ("a-b", {"key": "x", "exponent": 0.1}, 1e5),
            "law: Law 'x': exponent: 0.1 won't do",
        ),
    ],
    "bumpers": [
        ([3], r"bumpers\[0\]: must be a Bumper or a table of pair, law, stiffness, restitution, thickness, storey"),
        ([PAD, replace(PAD, storeys=[2])], "storey 2 of pair 'a-b' has several bumpers"),
    ],
    "isolated": [
        ({"period": 0.0}, r"base_isolated: period: 0\.0 won't do; it must be greater than 0"),
        ({"strength": -1.0}, r"base_isolated: strength: -1\.0 won't do; it must be greater than or equal to 0"),
        (
            {"damping_ratio": np.nan},
            "base_isolated: damping_ratio: nan won't do; it must be greater than or equal to 0",
        ),
        ({"base_mass": "x"}, "base_isolated: base_mass: 'x' won't do; it must be a valid number"),
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
        (
            "yield_strengths = [9.0]\nbouc_wen = { n = 0.1 }",
            ["scene.row[0].bouc_wen.n: 0.1 won't do; it must be greater than or equal to 1"],
        ),
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
