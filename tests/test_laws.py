"""The registry of contact laws: formulas, slopes, damping numbers, validity and sources."""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest
import reference
from hypothesis import example, given
from hypothesis import strategies as st

from pounding_sweep.base.errors import LawError
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS, Law, get_law, hertz_stiffness

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
