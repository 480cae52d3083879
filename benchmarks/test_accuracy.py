"""What an accuracy costs: the engine's schemes beside each other and beside other tools, on the same work."""

from __future__ import annotations

import pytest

from benchmarks.compare import measure
from benchmarks.engine import SCHEMES
from benchmarks.peers import all_peers
from benchmarks.reference import converged, force_errors, independent
from benchmarks.work import ERROR_GAPS, Peaks

#: A peer at its short setting, and any impact material of it, is this accurate.
SAME_WORK = 0.03


@pytest.fixture(scope="module")
def reference(short_work):
    """Return the converged solution by law."""
    known = {}

    def find(law):
        if law not in known:
            known[law] = converged(short_work.under(law))
        return known[law]

    return find


@pytest.fixture(scope="module")
def exact(short_work, reference):
    """Return error and cost of the engine's exact scheme."""
    return measure(SCHEMES[:1], short_work, reference("linear"), short=True, rounds=3, notify=lambda line: None)[0]


def test_two_programs_converge_to_the_same_peaks(short_work, reference):
    one = Peaks(*(getattr(reference("linear"), name)[:1] for name in Peaks.__dataclass_fields__))
    assert force_errors(independent(short_work, float(ERROR_GAPS[0])), one).max() < 1e-7


def test_exact_flight_is_cheaper_than_steps_through_flight(short_work, reference, benchmark):
    """At an error below 1e-4, steps as long as the motion allows cost less than Runge-Kutta all along."""
    tools = [scheme for scheme in SCHEMES if scheme.key in ("exact", "rk4")]
    points = measure(tools, short_work, reference("linear"), short=True, rounds=5, notify=lambda line: None)
    cost = {(p.key, p.setting): p.milliseconds for p in points}
    assert all(p.error < 1e-4 for p in points)
    ratio = cost["exact", 2.5e-3] / cost["rk4", 2.5e-3]
    benchmark.extra_info["exact_over_rk4"] = ratio
    benchmark.pedantic(lambda: tools[0].prepare(short_work, 2.5e-3)(ERROR_GAPS), rounds=3)
    assert ratio < 0.8


@pytest.mark.parametrize("key", all_peers())
def test_peers_do_the_same_work_slower(key, short_work, reference, exact, benchmark):
    """Every tool that sees contacts finds the engine's peaks, and takes over ten times as long for no better ones."""
    peer = all_peers()[key]
    if peer.missing():
        pytest.skip(f"{peer.missing()}; pip install pounding-sweep[peers]")
    point = measure([peer], short_work, reference("linear"), short=True, rounds=3, notify=lambda line: None)[0]
    benchmark.extra_info |= {"error": point.error, "times_the_engine": point.milliseconds / exact.milliseconds}
    run = peer.prepare(short_work, point.setting)
    found = benchmark.pedantic(lambda: run(ERROR_GAPS), rounds=1)
    if key == "heyoka-plain":  # what its flight alone takes: without events it sees no corner of the force
        assert point.error > SAME_WORK
    else:
        assert (found.onsets == reference("linear").onsets).all()
        assert exact.error < point.error < SAME_WORK
    assert point.milliseconds > 10.0 * exact.milliseconds


@pytest.mark.parametrize("law", ["hertz_damped", "nonlinear_viscoelastic"])
def test_impact_materials_of_opensees_are_the_engines_laws(law, short_work, reference):
    peer = all_peers()["opensees"]
    if peer.missing():
        pytest.skip(f"{peer.missing()}; pip install pounding-sweep[peers]")
    found = peer.prepare(short_work.under(law), 2e-4)(ERROR_GAPS)
    assert force_errors(found, reference(law)).max() < SAME_WORK
    assert (found.onsets == reference(law).onsets).all()
