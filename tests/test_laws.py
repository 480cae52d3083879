"""The text of the laws: the slopes that implicit schemes and events need are those of the formulas."""

from __future__ import annotations

import math
import re

import naive
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pounding_sweep.model.laws import LAWS


def value(text, d, k=3.0e6, c=2.0e3):
    return eval(text, {"sqrt": math.sqrt, "max": max}, {"k": k, "c": c, "d": d, "r": math.sqrt(max(d, 0.0))})


@pytest.mark.parametrize("law", [law for law in LAWS.values() if law.has_contact], ids=lambda law: law.key)
@given(d=st.floats(1e-6, 0.1))
def test_slopes_are_those_of_the_formulas(law, d):
    for force, slope in ((law.elastic, law.elastic_slope), (law.damper, law.damper_slope)):
        if force:
            step = 1e-4 * d
            rise = (value(force, d + step) - value(force, d - step)) / (2.0 * step)
            assert value(slope, d) == pytest.approx(rise, rel=1e-6, abs=1e-3)


@pytest.mark.parametrize("key", [key for key, law in naive.LAWS.items() if not law.yields])
@given(d=st.floats(1e-6, 0.1), v=st.floats(-1.0, 1.0), k=st.floats(1e5, 1e8), m=st.floats(10.0, 500.0))
@example(d=0.01, v=0.5, k=1e6, m=80.0)
def test_formulas_are_those_of_the_twin(key, d, v, k, m):
    """With the damping of a restitution of 0.6, at an approach of 0.8 m/s."""
    law, rule, e, v0 = LAWS[key], naive.LAWS[key], 0.6, 0.8
    pulls = rule.damper is not None and not (rule.clip or rule.approach_only)
    assert (law.approach_only, law.tension) == (rule.approach_only, pulls)
    force, want = value(law.elastic, d, k), naive.elastic_force(rule, k, d)
    if rule.damper:
        c = float(law.damping_coefficient(e, k, m)) / (v0 if law.damping == "elastic" else 1.0)
        force += value(law.damper, d, k, c) * v
        want += naive.damper_force(rule, k, d, v, m, v0, naive.damping_coefficient(key, e))
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
