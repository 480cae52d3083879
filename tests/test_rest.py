"""An answer is that of the motion followed by rest: zeros that are appended to a record change nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import reference
from against_reference import buildings_of, motion
from kernels_used import FOUNDED, LEANING_YIELDS, LINKED, SMOOTH
from kinds import KINDS
from scenes import EVERY, OUTPUTS, pair, row, yielding_pair

import pounding_sweep as ps
from pounding_sweep.base.errors import SweepError
from pounding_sweep.engine.postprocess import energy_limit, phase_error
from pounding_sweep.engine.row_kernel import REST_PERIODS, Numerics, RowKernel, longest_rest
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.labels import global_attributes
from pounding_sweep.output.results import Outcome
from pounding_sweep.plan.advice import approach_speeds
from pounding_sweep.request.build import build_spec
from pounding_sweep.variables.registry import VARIABLES, Status, reducers_for, relative_errors

PAIR = pair()
#: Half a sine after which the ground stops at once, before any floors of the pair have met.
PULSE = ps.Record("pulse", 0.01, 4.0 * np.sin(np.pi * np.arange(15) / 20.0))
#: What tells of the last point of the record.
OF_THE_RECORD = {"energy_kinetic", "energy_strain"}


def followed(record, seconds):
    """The record with so many seconds of zeros."""
    zeros = np.zeros(round(seconds / record.dt))
    return ps.Record("followed", record.dt, np.append(record.acceleration, zeros))


def differences(got, want):
    """Largest relative error of each output but those of the last point of the record."""
    names = [n for n in got.data_vars if n in VARIABLES and VARIABLES[n].error and n not in OF_THE_RECORD]
    values = ({n: one[n].values[None] for n in names} for one in (got, want))
    return {name: float(error[0]) for name, error in relative_errors(names, *values).items()}


@pytest.mark.parametrize(
    ("method", "law"), [("rk4", "kelvin_voigt"), ("exact", "kelvin_voigt"), ("newmark", "hertz_damped")]
)
def test_late_touches_are_those_of_an_independent_solution(method, law):
    scene = replace(PAIR, gaps=[0.004])
    k = scene.contact.reference(LAWS[law].exponent)
    want = reference.run(buildings_of(scene), scene.gaps, PULSE.acceleration, PULSE.dt, law, k, 0.6, rest=3.0)
    one = ps.simulate(scene, PULSE, law=law, method=method, dt=1e-4)
    assert int(ps.simulate(scene, PULSE, law=law, method=method, dt=1e-4, rest=0.0).impact_count.sum()) == 0
    assert one.impact_count.values.ravel().tolist() == np.concatenate(want["impact_count"]).tolist()
    assert one.impact_count.sum() >= 2
    bound = 1e-3 if method == "newmark" else 2e-6
    for name in (
        "displacement_max",
        "displacement_min",
        "drift_max",
        "acceleration_max",
        "energy_input",
        "energy_damping",
    ):
        np.testing.assert_allclose(one[name].values.ravel(), np.ravel(want[name]), rtol=bound, err_msg=name)
    for name in ("impact_force_max", "impulse", "approach_speed_max", "contact_time"):
        theirs = np.concatenate(want[name])
        np.testing.assert_allclose(one[name].values.ravel(), theirs, atol=bound * theirs.max(), err_msg=name)
    for name, other in (("energy_kinetic", "kinetic_final"), ("energy_strain", "strain_final")):
        np.testing.assert_allclose(one[name], want[other], rtol=bound, err_msg=name)
    np.testing.assert_allclose(one.energy_held, 0.0, atol=1e-12)


DAMPED = {
    "elastic": (PAIR, "kelvin_voigt", ("rk4", "exact")),
    "by stages": (PAIR, "hertz_damped", ("newmark",)),
    "jumps": (PAIR, "stereomechanical", ("exact",)),
    "yielding": (yielding_pair(), "kelvin_voigt", ("rk4", "exact")),
    "linked": (LINKED, "kelvin_voigt", ("exact",)),
    "founded": (FOUNDED, "kelvin_voigt", ("rk4", "exact")),
    "leaning": (LEANING_YIELDS, "kelvin_voigt", ("rk4",)),
    "Bouc and Wen": (SMOOTH, "none", ("exact",)),
}


@pytest.mark.parametrize(
    ("kind", "method"), [(kind, method) for kind, (*_, methods) in DAMPED.items() for method in methods]
)
def test_zeros_appended_to_a_record_change_nothing(kind, method):
    scene, law, _ = DAMPED[kind]
    check_zeros(scene, law, motion(41, 1.5), method, 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "method"), [(kind, method) for kind, item in KINDS.items() for method in {**item.slow, **item.runs}]
)
def test_zeros_change_nothing_of_any_kind(kind, method):
    item = KINDS[kind]
    # floors that come to rest on each other go on pressing
    resting = {"impulse", "contact_time"} if kind == "linked and yielding" else set()
    check_zeros(item.scene, item.law, motion(41, item.scale), method, {**item.slow, **item.runs}[method][0], resting)


def check_zeros(scene, law, record, method, dt, resting=frozenset()):
    one, more = (ps.simulate(scene, each, law=law, method=method, dt=dt) for each in (record, followed(record, 60.0)))
    found = differences(one, more)
    assert max(error for name, error in found.items() if name not in resting) < 2e-5, found
    assert int(one.status) == int(more.status) == Status.OK
    grown = differences(ps.simulate(scene, record, law=law, method=method, dt=dt, rest=0.0), one)
    assert max(grown.values()) > 1e-3  # else the record was too long to show anything


@pytest.mark.parametrize("method", ["rk4", "exact"])
def test_a_rest_of_some_seconds_is_so_many_zeros(method):
    record, given = motion(41, 1.5), {"law": "kelvin_voigt", "method": method, "dt": 1e-3}
    one = ps.simulate(PAIR, record, rest=0.5, **given)
    want = ps.simulate(PAIR, followed(record, 0.5), rest=0.0, **given)
    assert max(differences(one, want).values()) < 1e-12
    for name in ("displacement", "contact_force", "ground_acceleration", "transfer"):
        np.testing.assert_allclose(one[name], want[name], rtol=0, atol=1e-9 * float(abs(want[name]).max()))
    at_end = round(record.duration / 1e-3)
    for name, history in (("energy_kinetic", "kinetic"), ("energy_strain", "strain")):
        np.testing.assert_allclose(one[name], one[history][at_end], rtol=1e-9)


@pytest.mark.parametrize("method", ["rk4", "exact"])
def test_histories_go_on_as_the_run_does(method):
    one = ps.simulate(PAIR, motion(41, 1.5), law="kelvin_voigt", method=method, dt=1e-3)
    assert one.time.values[-1] > motion(41).duration + 0.1
    np.testing.assert_allclose(np.diff(one.time), 1e-3)
    late = one.time.values > motion(41).duration + motion(41).dt
    assert not one.ground_acceleration.values[late].any()
    # nothing that is reported was still to come
    np.testing.assert_allclose(
        abs(one.displacement).max("time"), np.maximum(one.displacement_max, -one.displacement_min), rtol=0.02
    )


@pytest.mark.parametrize("method", ["rk4", "exact"])
def test_an_initial_velocity_is_a_motion_too(method):
    given = {"law": "kelvin_voigt", "method": method, "dt": 1e-3, "initial_velocity": [0.4, 0.0]}
    still, long = (ps.Record("still", 0.02, np.zeros(n)) for n in (2, 500))
    one, more = (ps.simulate(PAIR, record, **given) for record in (still, long))
    assert one.impact_count.sum() > 2
    assert max(differences(one, more).values()) < 1e-8


@pytest.mark.parametrize("method", ["rk4", "exact"])
def test_rows_without_damping_end_with_the_record(method):
    free = replace(PAIR, row=[replace(b, damping_ratio=0.0) for b in PAIR.row])
    one = ps.simulate(free, motion(41), law="kelvin_voigt", method=method, dt=1e-3)
    assert one.time.values[-1] == pytest.approx(motion(41).duration)
    np.testing.assert_allclose(one.energy_held, one.energy_kinetic + one.energy_strain, rtol=1e-12)
    assert longest_rest(free)[0] == 0.0
    assert longest_rest(PAIR)[0] == pytest.approx(REST_PERIODS * max(b.periods[0] for b in PAIR.buildings))


@pytest.mark.parametrize(
    ("method", "law", "scene", "outputs"), [("rk4", "linear", row(), OUTPUTS), ("exact", "kelvin_voigt", PAIR, EVERY)]
)
def test_what_ends_beside_others_is_what_ends_alone(method, law, scene, outputs):
    """To the last bit: lanes end one by one."""
    kernel = RowKernel(scene, LAWS[law], Numerics(method, 1e-3, rest=np.inf), reducers_for(outputs))
    gaps = np.repeat(np.geomspace(1e-4, 0.05, 20)[:, None], len(scene.gaps), axis=1)

    def run(rows):
        n = len(rows)
        given = {"scale": np.ones(n), "stiffness": np.full(n, 8e5), "restitution": np.full(n, 0.6)}
        return kernel.run(motion(41, 1.5), gaps=gaps[rows], **given)

    beside = run(np.arange(20))
    for i in (0, 7, 19):
        for name, values in run(np.array([i])).items():
            assert np.array_equal(values[0], beside[name][i]), name


def test_a_sweep_runs_what_touches_late_only():
    sweep = {
        "scene": PAIR,
        "records": PULSE,
        "laws": "hertz_damped",
        "gaps": [0.004],
        "outputs": EVERY,
        "method": "rk4",
        "dt": 1e-3,
        "audit": 0.0,
    }
    late, cut = (ps.Sweep(**sweep, rest=rest).run() for rest in ("auto", 0.0))
    assert int(late.impact_count.sum()) >= 2
    assert int(cut.impact_count.sum()) == 0
    assert (late.attrs["rest"], cut.attrs["rest"]) == ("auto", 0.0)


def test_estimates_are_of_the_motion_with_its_rest():
    scene = ps.Scene([ps.Building("a", [100.0], [987.0]), ps.Building("b", [100.0], [2742.0])], [0.02])
    speed = approach_speeds(scene, PULSE)[0, 0]
    long = followed(PULSE, 20.0).acceleration
    left, right = (reference.modal_exact(building, long, PULSE.dt)[1][:, 0] for building in buildings_of(scene))
    closing = np.abs(left - right)
    assert closing.max() <= speed <= 1.5 * closing.max()  # as if both were fastest at once
    assert closing[: PULSE.n_points].max() < 0.9 * closing.max()
    short, long = (phase_error(scene, PULSE, Numerics("newmark", 0.01, rest=rest)) for rest in (0.0, np.inf))
    w = np.sqrt(27.42)  # of the faster one
    assert long[0] / short[0] == pytest.approx(1.0 / (0.05 * w) / PULSE.duration, rel=0.02)
    times = []
    for record in (PULSE, ps.find_record("el_centro")):
        for rest in ("auto", 0.0):
            plan = ps.Sweep(scene, record, "none", method="rk4", dt=1e-3, rest=rest).plan()
            times.append(plan.scenario_seconds(0, 1))
    assert times[0] / times[1] == pytest.approx(1.0 + np.log(20.0) / (0.05 * np.sqrt(9.87)) / PULSE.duration, rel=0.01)
    assert 1.0 <= times[2] / times[3] < 1.3
    stopped = ps.Record("stopped", 1.0, [0.0, 2.0])  # 1 m/s until the last point, 2 m/s when the ground is at rest
    assert energy_limit(scene, stopped, np.ones(1))[0] == pytest.approx(0.5 * 200.0 * 2.0**2)


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf, "long", None, 2e4])
def test_a_rest_that_is_none_is_refused(bad):
    with pytest.raises(SweepError, match=r'rest: .*must be .*"auto" or a rest after the record in s'):
        build_spec(scene=PAIR, records=PULSE, laws="linear", rest=bad)


def test_cubes_say_which_scenarios_end_before():
    free = replace(PAIR, row=[replace(PAIR.row[0], damping_ratio=0.0), PAIR.row[1]])
    notes = []
    for scene, gap, rest in ((PAIR, 0.01, "auto"), (PAIR, 0.0, "auto"), (free, 0.01, "auto"), (free, 0.0, 0.0)):
        plan = ps.Sweep(scene, PULSE, "linear", gaps=[gap], method="rk4", dt=1e-3, rest=rest).plan()
        notes.append(global_attributes(plan, Outcome(None, np.ones(1, bool)))["rest_note"])
    undamped, touching = "rows without damping end with the record", "floors without a gap are followed"
    assert notes[0] is notes[3] is None
    assert notes[1].startswith(touching)
    assert notes[2] == undamped
