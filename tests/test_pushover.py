"""Backbones from pushover curves: known ones are found again, smooth ones by the rule's own conditions."""

from __future__ import annotations

import numpy as np
import pytest

import pounding_sweep as ps
from pounding_sweep.base.errors import InputError

K, STRENGTH = 4e4, 200.0


def known(hardening, slope, residual):
    """Corners of a backbone: yield, cap at six yield drifts, residual, and an end."""
    dy, cap = STRENGTH / K, 6.0 * STRENGTH / K
    top = STRENGTH * (1.0 + 5.0 * hardening)
    corners = [(0.0, 0.0), (dy, STRENGTH), (cap, top)]
    if slope:
        least = residual * STRENGTH
        at = cap + (top - least) / (-slope * K)
        corners += [(at, least), (at + 4.0 * dy, least)] if residual else [(at, 0.0)]
    return np.transpose(corners)


def sampled(corners, points=241):
    d = np.unique(np.concatenate([np.linspace(0.0, corners[0, -1], points), corners[0]]))
    return d, np.interp(d, *corners)


FORMS = {
    "heading": (1e3, 1.0, ",", "Step,Drift (mm),Base shear (kN)"),
    "line of units": (1e2, 1e-3, "\t", "Step\tdisp\tforce\n\tcm\tMN"),
    "pairs": (1.0 / 0.0254, 1.0 / 4.4482216152605, ";", "No;top_in;V [kip]"),
}


def write(path, d, v, form="heading"):
    length, force, mark, heading = FORMS[form]
    rows = [mark.join(f"{x:.10g}" for x in row) for row in zip(range(len(d)), length * d, force * v, strict=True)]
    text = "\n".join([heading, *rows])
    path.write_text(text.replace(".", ",") if mark == ";" else text)
    return path


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("hardening", "slope", "residual"),
    [(0.05, -0.1, 0.3), (0.02, -0.3, 0.8), (0.1, -0.05, 0.0), (0.0, -0.1, 0.2), (0.05, 0.0, 0.0), (0.0, 0.0, 0.0)],
)
def test_a_known_backbone_is_found_again(tmp_path, capsys, hardening, slope, residual, form):
    d, v = sampled(known(hardening, slope, residual))
    fit = ps.backbone_from_pushover(write(tmp_path / "curve.csv", -d, -v, form), law="flag")
    values = fit.stiffness, fit.yield_strength, fit.hardening
    assert values == pytest.approx((K, STRENGTH, hardening), rel=1e-6, abs=1e-7)
    wanted = {"cap_drift": 6.0 * STRENGTH / K, "post_cap": slope} if slope else {}
    wanted |= {"residual": residual} if residual else {}
    assert fit.hysteresis.pop("law") == "flag"
    assert fit.hysteresis == pytest.approx(wanted, rel=1e-5)
    assert fit.error < 1e-5
    printed = capsys.readouterr().out
    assert f"hardening       {hardening:.3g}" in printed
    assert ("residual" in printed) == bool(residual)


def test_noise_moves_it_by_its_size(tmp_path):
    d, v = sampled(known(0.1, -0.1, 0.3))
    noisy = v + 0.003 * STRENGTH * np.random.default_rng(3).standard_normal(len(v)) * (d > 0.0)
    fit = ps.backbone_from_pushover(write(tmp_path / "curve.csv", d, noisy))
    values = fit.stiffness, fit.yield_strength, fit.hardening, *list(fit.hysteresis.values())[1:]
    assert values == pytest.approx((K, STRENGTH, 0.1, 0.03, -0.1, 0.3), rel=0.05)
    assert 0.002 < fit.error < 0.02


def test_a_smooth_curve_meets_the_conditions_of_the_rule(tmp_path):
    """The secant at 0.6 Vy, equal areas to the cap, the post-cap line through 0.6 Vy, the residual of its end."""
    d = np.linspace(0.0, 0.15, 1501)
    v = 300.0 * np.tanh(d / 0.008) * (0.2 + 0.8 / (1.0 + (d / 0.09) ** 6))
    fit = ps.backbone_from_pushover(write(tmp_path / "curve.csv", d, v))
    x, y = fit.curve.corner_drift.values, fit.curve.corner_shear.values
    assert (len(x), fit.hysteresis["cap_drift"], x[2], y[2]) == (
        5,
        x[2],
        pytest.approx(d[v.argmax()]),
        pytest.approx(v.max()),
    )
    assert np.interp(0.6 * fit.yield_strength / fit.stiffness, d, v) == pytest.approx(0.6 * fit.yield_strength)
    part = d < x[2] + 1e-9
    assert np.trapezoid(y[:3], x[:3]) == pytest.approx(np.trapezoid(v[part], d[part]), rel=1e-7)
    assert v[-1] < fit.hysteresis["residual"] * fit.yield_strength < 1.1 * v[-1]
    falls = np.interp(-0.6 * fit.yield_strength, -v[v.argmax() :], d[v.argmax() :])
    slope = (0.6 * fit.yield_strength - y[2]) / (falls - x[2]) / fit.stiffness
    assert fit.hysteresis["post_cap"] == pytest.approx(slope)
    assert fit.error < 0.12
    short = ps.backbone_from_pushover(tmp_path / "curve.csv", target_drift=0.02)
    assert short.curve.corner_drift.values[2] == 0.02


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("a,b\n0,0\n1,2\n2,3", {}, "no column of drift whose unit is known, its headings being a, b"),
        ("a,b\n0,0\n1,2\n2,3", {"units": ("mm", "t")}, "no column of shear whose unit is known.*valid for shear: kn"),
        ("d (mm),V (kN)\n0,0\n1,2\n2,3", {"shear": "moment"}, "no column of shear"),
        ("d (mm),V (kN)\n0,0\n1,0\n2,0", {}, "shears do not rise with the drift"),
        ("d (mm),V (kN)\n0,0\n1,2\n2,3", {"target_drift": 1e-4}, "it must be beyond the first drift, 0.001 m"),
        ("", {}, "no column of drift"),
    ],
)
def test_curves_that_cannot_be_read_are_refused(tmp_path, text, options, message):
    file = tmp_path / "curve.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        ps.backbone_from_pushover(file, **options)
    with pytest.raises(InputError, match="could not be read"):
        ps.backbone_from_pushover(tmp_path / "none.csv")
