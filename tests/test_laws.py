"""The text of the laws: the slopes that implicit schemes and events need are those of the formulas."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pounding_sweep.model.laws import LAWS


def value(text, d):
    return eval(text, {"math": math, "max": max}, {"k": 3.0e6, "c": 2.0e3, "d": d, "r": math.sqrt(max(d, 0.0))})


@pytest.mark.parametrize("law", [law for law in LAWS.values() if law.has_contact], ids=lambda law: law.key)
@given(d=st.floats(1e-6, 0.1))
def test_slopes_are_those_of_the_formulas(law, d):
    for force, slope in ((law.elastic, law.elastic_slope), (law.damper, law.damper_slope)):
        if force:
            step = 1e-4 * d
            rise = (value(force, d + step) - value(force, d - step)) / (2.0 * step)
            assert value(slope, d) == pytest.approx(rise, rel=1e-6, abs=1e-3)


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
