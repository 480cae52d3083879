"""Rows that are none, in Python: what is wrong, and what to give instead. Files are in `bad_sweeps`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernels_used import BUMPED
from kinds import TOWER_ABOVE, A, B

import pounding_sweep as ps
from pounding_sweep.base.errors import SceneError

PAD = BUMPED.bumpers[0]
#: What is made of the values of a test.
MAKE = {
    "building": lambda given: replace(A, **given),
    "smooth": lambda given: replace(A, **({"yield_strengths": [10.0, 10.0]} | given)),
    "link": lambda given: ps.Scene([A, B, ps.Wall()], [0.1, 0.1], links=[ps.Link(*given)]),
    "bumper": lambda given: replace(BUMPED, bumpers=[ps.Bumper(*given)]),
    "bumpers": lambda given: replace(BUMPED, bumpers=given),
    "isolated": lambda given: ps.base_isolated(
        **({"building": TOWER_ABOVE, "base_mass": 150.0, "period": 2.5, "damping_ratio": 0.05, "strength": 250} | given)
    ),
}
REFUSED = {
    "building": [
        ({"yield_strengths": [1.0, 1.0], "hardening": True}, "hardening: True won't do; it must be a valid number"),
        ({"dashpots": []}, "dashpots: 0 values for 2 masses; give one per storey"),
        ({"masses": [10**400, 1.0]}, r"masses\[0\]: 10{80}"),
        ({"damping_ratio": np.nan}, "damping_ratio: nan won't do; it must be greater than or equal to 0"),
    ],
    "smooth": [
        (
            {"hysteresis": {"law": "bouc_wen"}, "damping_stiffness": "tangent"},
            r"bouc_wen has no tangent stiffness that is one",
        )
    ],
    "link": [
        (("a-b", [3], 1.0), r"links\[0\]: there is no storey 3 of 'a'; give one of 1 to 2"),
        (("a-b", [(1, 0)], 1.0), r"links\[0\]: there is no storey 0 of 'b'; give one of 1 to 2"),
    ],
    "bumper": [
        (("a-b", "linear", True), "stiffness: True won't do; it must be a valid number"),
        (("a-b", "kelvin_voigt", 1e5, "x"), "restitution: 'x' won't do; it must be a valid number"),
        (("a-b", PAD.law, 1e5, 0.5, 0.2), r"thickness is 0.2 m beside the 0.009 m of its law; leave it out"),
        (("a-b", "linear", 1e5, None, None, [1, 1]), r"storey 1 of pair 'a-b' has several bumpers; give one"),
        (("a-b", {"key": "x", "exponent": 0.1}, 1e5), "law: Law 'x': exponent: 0.1 won't do"),
    ],
    "bumpers": [([PAD, replace(PAD, storeys=[2])], "storey 2 of pair 'a-b' has several bumpers")],
    "isolated": [
        ({"period": 0.0}, r"base_isolated: period: 0\.0 won't do; it must be greater than 0"),
        ({"strength": -1.0}, r"base_isolated: strength: -1\.0 won't do; it must be greater than or equal to 0"),
        ({"base_mass": "x"}, "base_isolated: base_mass: 'x' won't do; it must be a valid number"),
    ],
}


@pytest.mark.parametrize(
    ("kind", "given", "message"), [(kind, *case) for kind, cases in REFUSED.items() for case in cases]
)
def test_what_is_no_part_of_a_row_is_refused(kind, given, message):
    with pytest.raises(SceneError, match=message):
        MAKE[kind](given)
