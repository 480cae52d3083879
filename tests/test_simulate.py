"""`simulate`: its arguments, its histories, extremes that must stay finite, and random scenes."""

from __future__ import annotations

import re

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from kernels_used import LAW_OF, SIMULATED

import pounding_sweep as ps
from pounding_sweep.base.errors import InputError, PoundingSweepError, StabilityError
from pounding_sweep.model.laws import LAWS
from pounding_sweep.request.spec import METHODS
from pounding_sweep.run.histories import HISTORIES, peak_share
from pounding_sweep.run.simulate import NOT_OF_ONE
from pounding_sweep.variables.registry import DIMS, INTEGER_FILL, OUTPUT_NAMES, VARIABLES, Status

pytestmark = pytest.mark.usefixtures("pair_kernels")

CONTACT_LAWS = [law for law in LAWS if LAWS[law].exponent is not None]  # those with a contact force
A = ps.Building("a", [120.0, 90.0], [1.5e5, 1.2e5])
B = ps.Building("b", [80.0, 110.0], [2.4e5, 2.0e5], damping_ratio=0.03)
PAIR = ps.Scene([A, B], gaps=[0.006])


def shaking(seconds=2.0, seed=5):
    return ps.synthetic_record(seed, duration=seconds, dt=0.02, pga=4.0)


SHAKING = shaking()


def shake(law="kelvin_voigt", scene=PAIR, record=SHAKING, *, e=0.6, k=None, **options):
    k = k or (8e5 if LAWS[law].exponent == 1.0 else 7.5e6)
    return ps.simulate(
        scene,
        record,
        law=law,
        stiffness=k if LAWS[law].has_contact else None,
        restitution=e if LAWS[law].takes_restitution else None,
        **{"method": "rk4", "rest": 0.0, **options},
    )


def with_gap(gap):
    return ps.Scene([A, B], gaps=[gap])


def assert_finite(got):
    """Everything that is there is a finite number; only an impact that never was is missing."""
    for name, values in got.variables.items():
        if values.dtype.kind == "f" and name not in ("first_impact_time", "steps_per_contact"):
            assert np.isfinite(values.values).all(), name
    assert np.array_equal(np.isnan(got.first_impact_time), got.impact_count == 0)


# -- what comes back ---------------------------------------------------------------------------------------------------


def test_every_variable_and_history_is_there_with_its_units():
    got = shake()
    missing = {name for name, variable in VARIABLES.items() if variable.of_yielding or not variable.exists_in(PAIR)}
    assert set(VARIABLES) - set(NOT_OF_ONE) - missing == set(VARIABLES) & set(got.data_vars)
    for name, (per, units, long_name) in HISTORIES.items():
        if per in ("link", "base") or name in ("storey_drift", "plastic_drift", "storey_shear", "hysteretic"):
            assert name not in got  # all is elastic, and nothing is linked
        elif name != "given_to_links":
            assert got[name].dims == ("time", *DIMS[per]), name
            assert got[name].attrs == {"units": units, "long_name": long_name}, name
    assert got.time.values[[0, -1]] == pytest.approx([0.0, SHAKING.duration])
    assert got.sizes["time"] == (SHAKING.n_points - 1) * 20 + 1
    assert (got.building.values.tolist(), got.pair.values.tolist()) == (["a", "b"], ["a-b"])


def test_an_output_step_is_the_time_between_instants():
    """Longer than the step it leaves instants out, and changes nothing; shorter, the run takes steps as short."""
    whole, thin, fine = (shake("hertz_damped", dt=1e-3, output_step=s) for s in (None, 4.5e-3, 2.5e-4))
    whole.attrs["history"] = thin.attrs["history"]  # made a moment apart
    xr.testing.assert_identical(thin.isel(time=slice(1, None)), whole.isel(time=slice(4, None, 4)))
    np.testing.assert_allclose(np.diff(fine.time), 2.5e-4)
    assert fine.attrs["time_step"] == pytest.approx(2.5e-4)
    xr.testing.assert_identical(fine, shake("hertz_damped", dt=2.5e-4).assign_attrs(fine.attrs))
    assert peak_share(thin) < peak_share(whole) < peak_share(fine) <= 1.0 + 1e-9
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match=r"output_step is .*; it must be a positive number of seconds"):
            shake("linear", output_step=bad)


def test_arguments_in_other_words():
    """A preset by its name, its reference stiffness, a law that is an object, one gap and one velocity for all."""
    quiet = ps.Record("quiet", 0.02, np.zeros(3))
    one = shake(record=quiet, initial_velocity=[0.2, [0.0, -0.1]], gaps=0.03)
    assert one.velocity[0].values.tolist() == [[0.2, 0.2], [0.0, -0.1]]
    assert one.pair_gap.values.tolist() == [0.03]
    law = LAWS["kelvin_voigt"]
    xr.testing.assert_equal(
        shake(law.key), ps.simulate(PAIR, SHAKING, law=law, stiffness=8e5, restitution=0.6, method="rk4", rest=0.0)
    )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"law": None}, "simulate needs law=, one of none, linear"),
        ({"gaps": [0.01, 0.02]}, "2 gaps for a row of 2; give 1"),
        ({"law": "lineal"}, "linear"),
        ({"law": "linear"}, "stiffness"),  # the scene has no reference
        ({"law": "linear", "stiffness": -1.0}, "stiffness"),
        ({"law": "kelvin_voigt", "stiffness": 8e5, "restitution": 1.5}, "restitution"),
        ({"law": "gonthier", "stiffness": 8e5, "restitution": 0.0}, "restitution"),
        ({"method": "euler"}, "rk4"),
        ({"dt": 0.0}, "dt"),
        ({"dt": float("nan")}, "dt"),
        ({"initial_velocity": [0.1]}, "give one entry per building"),
        ({"initial_velocity": [[0.1, 0.2, 0.3], 0.0]}, "one for each of its storeys, bottom first (2 of"),
        ({"initial_velocity": [[0.1, float("nan")], 0.0]}, "one for each of its storeys, bottom first (2 of"),
    ],
)
def test_bad_arguments_are_named(options, says):
    with pytest.raises(PoundingSweepError, match=re.escape(says)):
        ps.simulate(PAIR, SHAKING, **{"law": "none", **options})


# -- the stability limit -----------------------------------------------------------------------------------------------


def test_a_step_beyond_the_stability_limit_is_refused_with_the_largest_step():
    stiff = 2e9
    with pytest.raises(StabilityError) as info:
        shake(k=stiff, dt=0.02)
    limit = float(re.search(r"dt <= ([0-9.e+-]+) s", str(info.value))[1])
    with pytest.raises(StabilityError):
        shake(k=stiff, dt=1.5 * limit)
    got = shake(k=stiff, dt=limit)
    assert int(got.status) in (Status.OK, Status.UNDER_RESOLVED_CONTACT)
    assert_finite(got)
    assert_finite(shake("hertz_damped", k=stiff, dt=0.02, method="newmark"))  # has no limit


def test_a_diverged_run_reports_no_finite_peak():
    stiff = ps.Scene([ps.Building("a", [1.0, 1.0], [1e7, 1e7]), B], gaps=[0.006])
    with pytest.raises(StabilityError):
        shake(scene=stiff, dt=0.02)
    got = shake(scene=stiff, dt=0.02, force_unstable=True)
    assert int(got.status) == Status.DIVERGED
    assert "displacement" not in got
    for name, variable in VARIABLES.items():
        if name in got and not variable.flag_values:
            values = got[name].values
            missing = np.isnan(values) if values.dtype.kind == "f" else values == INTEGER_FILL
            assert missing.all(), name


# -- extremes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", CONTACT_LAWS)
@pytest.mark.parametrize("method", METHODS)
def test_buildings_that_touch_at_rest(method, law):
    got = shake(law, with_gap(0.0), method=method)
    assert_finite(got)
    settles = OUTPUT_NAMES[int(got.unsettled_output)] in ("none", "impact_count")  # which has no meaning here
    assert settles
    assert int(got.status) in (Status.OK, Status.UNDER_RESOLVED_CONTACT, Status.UNSETTLED)
    assert int(got.impact_count.min()) >= 1
    assert float(got.impact_force_max.max()) < 1e5
    assert float(got.energy_residual) < 0.02


@pytest.mark.parametrize("law", CONTACT_LAWS)
@pytest.mark.parametrize("method", METHODS)
def test_a_touch_that_has_hardly_any_speed(method, law):
    free = ps.Scene([ps.Building(n, [100.0, 100.0], [1e-7, 1e-7], damping_ratio=0.0) for n in "ab"], gaps=[1e-9])
    quiet = ps.Record("quiet", 0.02, np.zeros(26))
    got = shake(law, free, quiet, method=method, initial_velocity=[[0.0, 1e-7], [0.0, 0.0]])
    assert_finite(got)
    assert int(got.impact_count[0, 1]) == 1
    assert 0 < float(got.impact_force_max[0, 1]) < 1.0
    assert float(abs(got.velocity).max()) <= 1.00001e-7


@pytest.mark.parametrize("law", ["none", "linear", "kelvin_voigt", "hertz_damped"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("gap", [0.0, 0.01])
def test_no_motion_gives_no_answer_but_zero(law, method, gap):
    got = shake(law, with_gap(gap), ps.Record("still", 0.02, np.zeros(11)), method=method)
    assert_finite(got)
    assert int(got.status) == Status.OK
    for name, values in got.data_vars.items():
        if name not in ("first_impact_time", "steps_per_contact", "status"):
            assert not values.values.any(), name


@pytest.mark.parametrize("method", METHODS)
def test_a_record_of_one_point(method):
    got = shake(LAW_OF[method], record=ps.Record("point", 0.02, [3.0]), method=method)
    assert got.sizes["time"] == 1
    assert int(got.status) == Status.OK
    assert_finite(got)
    assert not got.displacement.values.any()
    assert not got.impact_count.values.any()


@pytest.mark.parametrize("method", METHODS)
def test_a_constant_record_pushes_to_the_static_answer(method):
    """Long enough for the motion to die out; both buildings lean the same way and never meet."""
    damped = [ps.Building(b.name, b.masses, b.stiffnesses, damping_ratio=0.3) for b in (A, B)]
    got = shake(LAW_OF[method], ps.Scene(damped, gaps=[0.1]), ps.Record("lean", 0.02, np.full(251, 2.0)), method=method)
    for b in damped:
        static = np.linalg.solve(b.system_matrix, -2.0 * np.asarray(b.masses))
        np.testing.assert_allclose(got.displacement[-1].sel(building=b.name), static, rtol=1e-6)
    np.testing.assert_allclose(got.acceleration[-1], 2.0, rtol=1e-5)  # they move with the ground


def test_too_few_steps_in_a_contact_are_told():
    got = shake(k=1e8, e=1.0, dt=5e-3, locate=False, method="newmark")
    assert int(got.status) == Status.UNDER_RESOLVED_CONTACT
    assert float(got.steps_per_contact) < 8
    fine = shake(k=1e8, e=1.0, dt=1e-4, locate=False, method="newmark")
    assert int(fine.status) == Status.OK
    # the contact of one free pair lasts pi sqrt(m / k)
    short = min(120 * 80 / 200.0, 90 * 110 / 200.0)
    assert float(fine.steps_per_contact) == pytest.approx(np.pi * np.sqrt(short / 1e8) / 1e-4, rel=0.2)


# -- random scenes -----------------------------------------------------------------------------------------------------

masses = st.floats(20.0, 300.0)
stiffnesses = st.floats(2e4, 4e5)
scenes = st.builds(
    lambda m, k, z, gap: ps.Scene(
        [ps.Building("a", m[:2], k[:2], z[0]), ps.Building("b", m[2:], k[2:], z[1])], gaps=[gap]
    ),
    st.lists(masses, min_size=4, max_size=4),
    st.lists(stiffnesses, min_size=4, max_size=4),
    st.tuples(st.floats(0.0, 0.1), st.floats(0.0, 0.1)),
    st.floats(0.0, 0.03),
)
stiffness_factors = st.floats(0.2, 5.0)
restitutions = st.floats(0.15, 1.0)
records = st.builds(
    lambda seed, pga: ps.synthetic_record(seed, duration=1.0, dt=0.02, pga=pga),
    st.integers(0, 1000),
    st.floats(0.5, 8.0),
)
RANDOM = settings(
    deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow], print_blob=False
)


@given(
    scene=scenes,
    factor=stiffness_factors,
    e=restitutions,
    record=records,
    # the contacts of exact flight are RK4's
    law_and_method=st.sampled_from(
        [(law, method) for method, laws in SIMULATED.items() for law in sorted(laws & set(CONTACT_LAWS))]
    ),
)
@settings(RANDOM)
def test_random_scenes_obey_mechanics(scene, factor, e, record, law_and_method):
    law, method = law_and_method
    k = factor * (8e5 if LAWS[law].exponent == 1.0 else 7.5e6)
    got = shake(law, scene, record, k=k, e=e, method=method, dt=5e-4)
    assert_finite(got)
    assert int(got.status) in (Status.OK, Status.UNDER_RESOLVED_CONTACT, Status.UNDER_RESOLVED_MOTION)
    assert float(got.energy_residual) < (1e-2 if method == "newmark" else 1e-3)
    touched = got.impact_count.values > 0
    for name in ("impact_force_max", "penetration_max"):
        assert np.array_equal(got[name].values > 0, touched), name
    assert not got.approach_speed_max.values[~touched].any()
    if not LAWS[law].tension:
        assert float(got.contact_force.min()) >= 0.0
        assert float(got.impulse.min()) >= 0.0
    # contacts take energy and never give any (but for the little an undamped one errs)
    assert float(got.contact_work.min()) >= -1e-3 * max(float(abs(got.energy_input).max()), 1e-12)
    # histories come near the peaks, which lie between their instants, and never pass them
    for sign, peak in ((1.0, got.displacement_max), (-1.0, -got.displacement_min)):
        seen, most = (sign * got.displacement).max("time"), float(peak.max())
        assert float((seen - peak).max()) <= 1e-12 * most
        assert float((peak - seen).max()) < 0.02 * most
    # of a building that hardly damps, rounding is all there is
    assert bool((got.energy_damping >= -1e-10 * abs(got.energy_input).max()).all())


def test_central_difference_has_a_limit_and_names_its_own_remedy():
    """beta = 0 is explicit; the remedy is not the scheme that is already used."""
    with pytest.raises(StabilityError, match=r"limit of newmark .* dt <= .* beta >= ") as caught:
        ps.simulate("mate2015", "el_centro", law="linear", stiffness=2e6, method="newmark", beta=0.0, dt=0.02)
    assert "the newmark scheme" not in str(caught.value)
