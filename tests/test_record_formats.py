"""Record files of every format and quirk, and the refusal of bad ones, by messages kept word for word."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from record_files import (
    COLUMNS,
    COMPONENTS,
    CSMIP,
    NETWORKS,
    NGA,
    NIED,
    OLD,
    USC,
    VALUES,
    at2,
    cosmos,
    csmip,
    fortran,
    geonet,
    in_rows,
    knet,
    save,
    smc,
)

from pounding_sweep.base.errors import RecordError
from pounding_sweep.plan.sanity import record_doubts
from pounding_sweep.records import MAX_FILE_BYTES, UNITS, list_records, read_record, reader, resolve_records
from pounding_sweep.records import STANDARD_GRAVITY as G

#: Every message of a bad file; `python tests/test_record_formats.py` writes them anew.
MESSAGES = Path(__file__).with_name("golden") / "record_messages.json"
#: Time and acceleration, and acceleration alone.
ROWS = "".join(f"{i * 0.01:.2f},{v}\n" for i, v in enumerate(VALUES))
COLUMN = "".join(f"{v}\n" for v in VALUES)
THREE = "".join(f"{i * 0.01:.2f},{v},{2 * v},{3 * v}\n" for i, v in enumerate(VALUES))


def refused(path, message=None, **arguments):
    """Read a file that must be refused; returns the message."""
    with pytest.raises(RecordError, match=message) as caught:
        read_record(path, **arguments)
    return str(caught.value)


# --- what is read: text, arguments, step (s), acceleration (m/s2) -------------------------------------------------

AT2 = [
    at2(),
    at2(header=OLD, dt=".01000"),
    *(at2(end=end) for end in ("\r\n", "\r")),
    at2(blanks=" " * 20),
    *(
        at2(points=line)
        for line in (
            "NPTS=      7, DT=   .0100 SEC,                            ",
            "NPTS=7,DT=0.010000SEC",
            "NPTS= 7, DT= 1.D-02 SEC",
            "     7   0.0100   NPTS, DT",
            "    7    .0100    NPTS, DT",
            "npts = 7 , dt = 0.01 s",
            "NPTS= 7\nDT= .0100 SEC",
            "DT= .0100 SEC\nNPTS= 7",
            # the last line of several is that of the values
            "RSPMATCH, 800     DT =      .0050 SEC\nNPTS= 7, DT= .0100 SEC, SCALED BY 1.000",
            "RESAMPLED FROM DT=0.005 TO 0.01\nNPTS= 7, DT= .0100 SEC",
            "NPTS= 9, DT= .005 SEC\nNPTS= 7, DT= .01 SEC",
            "NPTS= 7, DT= 10 MSEC",
        )
    ),
    *(at2(per_line=count) for count in (1, 7)),
    *(at2() + end for end in ("\n\n   \n", "\x1a", "*** End Data ***\n1 2 3\n")),
    at2().rstrip("\n"),
    at2().replace("E", "D").replace("STD", "STE").replace("SDC", "SEC"),
    at2().replace("E-0", "e-0"),
    "\n" + at2(),
    at2(header=NGA.replace("Station", "Stación")),
    b"\xef\xbb\xbf" + at2().encode(),
    ("\ufeff" + at2()).encode("utf-16-le"),
]


@pytest.mark.parametrize("text", AT2)
def test_at2_quirks(tmp_path, text):
    record = read_record(save(tmp_path, text))
    assert (record.dt, record.name) == (0.01, "file")
    np.testing.assert_allclose(record.acceleration, np.array(VALUES) * G, rtol=1e-7)
    assert record.source.endswith("(file.AT2)")


TENTHS, HALVES = [0.1 * G, 0.2 * G], [0, 0.5 * G, -0.25 * G]
READ = [
    (
        NGA + "NPTS= 9, DT= .01 SEC\n-.1234E-02-.5678E-03 .1000E+00-.2E0\n-12.345-67.890+1.5 -.1D-1-.2D-1\n",
        *({}, 0.01),
        [v * G for v in (-0.1234e-2, -0.5678e-3, 0.1, -0.2, -12.345, -67.89, 1.5, -0.01, -0.02)],
    ),
    (at2([0.5], header="Somewhere\n"), {}, 0.01, [0.5 * G]),
    (at2([0.5], header="Somewhere\n"), {"units": "cm/s2"}, 0.01, [0.005]),
    (at2([0.5], points="NPTS= 1"), {"dt": 0.02}, 0.02, [0.5 * G]),
    (at2([0.5]), {"dt": 0.01}, 0.01, [0.5 * G]),
    *(
        (at2([0.5], header=NGA.replace("OF G", f"OF {unit}")), {}, 0.01, [0.5 * size])
        for unit, size in (("g.", G), ("CM/S/S", 0.01), ("CM/SEC/SEC", 0.01), ("CM/SEC**2", 0.01), ("M/S^2", 1.0))
    ),
    # columns, however they are apart
    ("time,acc (g)\n0,0\n0.01,0.5\n0.02,-0.25\n", {}, 0.01, HALVES),
    ("time,acc (g)\r\n0,0\r\n0.01,0.5\r\n0.02,-2.5E-01\r\n\r\n", {}, 0.01, HALVES),
    ("time (s);acc [g]\n0;0\n0,01;0,5\n0,02;-0,25\n", {}, 0.01, HALVES),
    ("t\tacc_g\n0\t0\n0.01\t0.5\n0.02\t-0.25\n", {}, 0.01, HALVES),
    ("# Station X\n# units: g\n  0.00   0.0\n  0.01   0.5  \n  0.02  -0.25", {}, 0.01, HALVES),
    ("% acceleration in g\n0.00 0.0D0\n0.01 5.0D-1\n# remark\n0.02 -0.25", {}, 0.01, HALVES),
    ('"time","acc (g)"\n"0.00","0"\n"0.01","0.5"\n"0.02","-0.25"\n', {}, 0.01, HALVES),
    ("time,acc (g)\n5.00,0,\n5.01,0.5,\n5.02,-0.25,\n", {}, 0.01, HALVES),
    ("units of g\n0.00 0.0\n0.01+.5\n0.02-.25\n", {}, 0.01, HALVES),
    ("\ufefftime,acc (g)\n0,0\n0.01,0.5\n0.02,-0.25\n".encode(), {}, 0.01, HALVES),
    ("\ufefftime,acc (g)\n0,0\n0.01,0.5\n0.02,-0.25\n".encode("utf-16-le"), {}, 0.01, HALVES),
    ("temps,accél (g)\n0,0\n0.01,0.5\n0.02,-0.25\n", {}, 0.01, HALVES),
    ("t,acc (g)\n0,0\n0.01,0.5\n0.02,\u22120.25\n".encode(), {}, 0.01, HALVES),  # a typographic minus
    ("Zeit [s]\tBeschl. [m/s\xb2]\n" + ROWS.replace(",", "\t").replace(".", ","), {}, 0.01, VALUES),
    # what is time, and what is none
    ("time,acc_m_s2\n0,0\n0.05,2\n", {}, 0.05, [0, 2]),
    ("t acc_cm/s2\n0 0\n0.05 2\n", {}, 0.05, [0, 0.02]),
    ("0.0\n 0.5\n-0.25\n", {"dt": 0.005, "units": "m/s2"}, 0.005, [0, 0.5, -0.25]),
    ("# dt = 0.02 s, acceleration (cm/s2)\n0.0\n50\n", {}, 0.02, [0, 0.5]),
    ("3.5\n", {"dt": 0.1, "units": "m/s2"}, 0.1, [3.5]),
    ("0 0.1\n1 0.2\n", {"dt": 1, "units": "m/s2"}, 1.0, [0.1, 0.2]),
    ("# dt = 0.02\n# n, acc (g)\n0 0.1\n1 0.2\n", {"units": "g"}, 0.02, TENTHS),
    ("time (s),acc (g)\n0,0.1\n1,0.2\n", {"dt": 1}, 1.0, TENTHS),
    (",acc (g)\n0.00,0.1\n0.01,0.2\n", {}, 0.01, TENTHS),  # a time index that lost its name
    ("0 0.1\n2 0.2\n4 0.3\n", {"units": "m/s2", "dt": 2.0}, 2.0, [0.1, 0.2, 0.3]),
    ("acc (g),time (s)\n0.1,0\n0.2,0.01\n", {}, 0.01, TENTHS),
    ("acc (g);t\n0,1;0\n0,2;0,01\n", {}, 0.01, TENTHS),
    ("# a logger\nacc (g) time (s)\n0.1 0\n0.2 0.01\n", {}, 0.01, TENTHS),
    ("accel_g\tTime_s\n0.1\t5.00\n0.2\t5.01\n", {}, 0.01, TENTHS),
    *(
        (f"{head},acc (g)\n0,0.1\n0.05,0.2\n", {}, 0.05, TENTHS)
        for head in ("Time_s", "t (s)", "time in s", "Time (sec)", "t", "seconds", "s", "times")
    ),
    ("0.000000000000 1\n0.009999999776 1\n0.019999999553 1\n0.029999999329 2\n", {"units": "m/s2"}, 0.01, [1, 1, 1, 2]),
    # a first line of points and step
    *(
        (f"{first}\n{in_rows(VALUES, '{:12.7f}', per_line)}", {"units": "m/s2"}, 0.01, VALUES)
        for first, per_line in (
            *(("7 0.01", 1), ("7 0.01", 2), ("7 0.01", 5)),
            *(("title\n7 0.0100 3", 5), ("title\n0.01 7", 1), ("NPTS DT\n7, 0.01", 1)),
        )
    ),
    ("7 0.01\n" + ROWS.replace(",", " "), {"units": "m/s2"}, 0.01, VALUES),
    (in_rows(VALUES, "{:10.7f}", 3), {"units": "m/s2", "dt": 0.01, "layout": "rows"}, 0.01, VALUES),
]


@pytest.mark.parametrize(("text", "arguments", "dt", "acceleration"), READ)
def test_read(tmp_path, monkeypatch, text, arguments, dt, acceleration):
    """At once and row by row, whatever the ending of the file."""
    for name in ("x.AT2", "x.AT2" if "NPTS" in str(text) else "x"):
        record = read_record(save(tmp_path, text, name), **arguments)
        assert (record.dt, record.name) == (pytest.approx(dt, rel=1e-6), "x")
        np.testing.assert_allclose(record.acceleration, acceleration, rtol=1e-15 if "E" not in str(text) else 1e-7)
        monkeypatch.setattr(reader, "_PLAIN", reader.RUN)


@pytest.mark.parametrize(
    ("units", "factor"),
    [
        *[("g", G), (" G ", G), ("m/s2", 1), ("m/s^2", 1), ("m/s**2", 1), ("m/s/s", 1), ("m/s²", 1), ("m s-2", 1)],
        *[("cm/s2", 0.01), ("cm/s^2", 0.01), ("cm/s/s", 0.01), ("gal", 0.01), ("Gal", 0.01), ("cm/sec2", 0.01)],
    ],
)
def test_units(tmp_path, units, factor):
    plain = save(tmp_path, "0 0\n0.05 2\n", "x.txt")
    assert read_record(plain, units=units).acceleration.tolist() == [0, 2 * factor]
    for header in (f"time (s), acc ({units})", f"time,a [{units}]", f"# units: {units}\nt,a"):
        headed = save(tmp_path, (header + "\n0,0\n0.05,2\n").encode(), "y.csv")
        assert read_record(headed).pga == read_record(headed, units=units).pga == 2 * factor


@pytest.mark.parametrize(
    ("dt", "form"),
    [
        *[(0.02, "{:.2f}"), (0.005, "{:.3f}"), (0.005, "{:.5g}"), (0.01, "{:.4E}"), (1 / 128, "{:.3f}")],
        *[
            (1 / 256, "{:.4f}"),
            (0.02, "{:.9f}"),
            (0.0024, "{:.4f}"),
            (0.01, "{!r}"),
            (1 / 30, "{:.3f}"),
            (0.1, "{:.1f}"),
        ],
    ],
)
@pytest.mark.parametrize("start", [0.0, 3.0])
def test_rounded_times(tmp_path, dt, form, start):
    times = start + np.arange(2000) * dt
    text = "".join(f"{form.format(float(t))},{i % 7}\n" for i, t in enumerate(times))
    assert read_record(save(tmp_path, text, "x.csv"), units="m/s2").dt == pytest.approx(dt, rel=1e-12)


def test_times_of_single_precision(tmp_path):
    times = np.float32(-113.17) + np.float32(0.01) * np.arange(12000, dtype=np.float32)
    path = save(tmp_path, "".join(f"{float(t):.6f} {i % 7}\n" for i, t in enumerate(times)))
    assert read_record(path, units="g").dt == 0.01


def test_arguments(tmp_path, monkeypatch):
    path = save(tmp_path, at2())
    assert read_record(path, scale=2).pga == pytest.approx(G, rel=1e-7)
    assert read_record(path, scale=2).scale == 2.0
    assert read_record(path, pga=2.5).pga == pytest.approx(2.5, rel=1e-15)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert read_record(str(path)) == read_record(path) == read_record("~/file.AT2")


# --- time, unit and step: only where they stand -------------------------------------------------------------------


@pytest.mark.parametrize("head", ["", "index", "Index", "#", "n", "no.", "Unnamed: 0", "sample", "unknown"])
@pytest.mark.parametrize("start", [0, 1])
def test_an_index_is_no_time(tmp_path, head, start):
    path = save(tmp_path, f"{head},acc (g)\n" + "".join(f"{start + i},{a}\n" for i, a in enumerate((0.1, 0.2, -0.3))))
    refused(path, r"counts by ones: points, or seconds\? Give dt= in seconds")
    record = read_record(path, dt=0.01)
    assert record.dt == 0.01
    np.testing.assert_array_equal(record.acceleration, np.array([0.1, 0.2, -0.3]) * G)


@pytest.mark.parametrize(
    "head",
    [
        *("Time_ms", "t_ms", "time in ms", "Time (millisec)", "time [msec]", "T(ms)", "t/ms", "ms"),
        *("TIME (milliseconds)", "time (µs)", "time (us)", "Time (min)", "time, acc\ntime ms"),
    ],
)
def test_times_in_other_units_are_refused(tmp_path, head):
    for text in (f"{head},acc (g)\n0,0.1\n10,0.2\n20,0.1\n", f"{head};acc (g)\n0;0,1\n10;0,2\n20;0,1\n"):
        refused(save(tmp_path, text), r"times are not in seconds .*; convert them")


@pytest.mark.parametrize(
    ("header", "unit", "where"),
    [
        ("t,acc_g", "g", "'acc_g', line 1"),
        ("t,a_g (g)", "g", "'a_g (g)', line 1"),
        ("t (s),a_g (mm/s2)", "mm/s2", "'a_g (mm/s2)', line 1"),
        ("t,acc_g (m/s2)", "m/s2", "'acc_g (m/s2)', line 1"),
        ("time_s,accel_m_s2", "m/s2", "'accel_m_s2', line 1"),
        ("t,acc_x_g", "g", "'acc_x_g', line 1"),
        ("t,acc (%g)", "%g", "'acc (%g)', line 1"),
        ("t,acc_mg", "mg", "'acc_mg', line 1"),
        ("t,Acceleration [m·s⁻²]", "m/s2", "line 1"),
        ("time,Aceleración (cm/sec/sec)", "cm/s2", "line 1"),
        ("time (s),ground acceleration in g", "g", "line 1"),
        ("s,m/s2", "m/s2", "'m/s2', line 1"),
        ("(s),(g)", "g", "'(g)', line 1"),
        ("# Units: s, g\nt,a", "g", "'Units: s, g', line 1"),
        ("# Accelerations are in units of g\nt,a", "g", "'in units of g', line 1"),
        ("# data in gal\nt,a", "cm/s2", "'in gal', line 1"),
        ("# acceleration (cm/s2), station X\nt,a", "cm/s2", "line 1"),
        ("# converted from g\nt,acc (m/s2)", "m/s2", "'acc (m/s2)', line 2"),
        ("# PGA 0.3 (g)\nt,acc (m/s2)", "m/s2", "'acc (m/s2)', line 2"),
        ("t,acc (m/s2)\n# remark", "m/s2", "'acc (m/s2)', line 1"),
        ("t,acc, g", "g", "line 1"),
    ],
)
def test_a_unit_where_it_stands(tmp_path, header, unit, where):
    record = read_record(save(tmp_path, f"{header}\n{ROWS}".encode()))
    assert (record.reading.unit, record.reading.unit_from[-len(where) :]) == (unit, where)
    assert record.pga == 0.5 * UNITS[unit]


NO_UNIT = [
    *("t,a_g", "t,ag", "t,g", "t,x_g", "Time,Channel G", "time,acc_Building G", "t,accelerometer G", "Building G\nt,a"),
    *("# PGA = 0.3 (g)\nt,acc", "# Peak acceleration (g): 0.3\nt,acc", "# Accel range (g) 4\nt,a"),
    *("t,acc converted from (g) to m/s2", "t,acc. [g] x 9.81", "# acceleration in g, converted to m/s2\nt,acc"),
    *("# originally in g\nt,acc", "# 1 g = 9.81 m/s2\nt,acc", "# gain in g\nt,acc", "# Earthquake, roof G\nt,acc"),
]


@pytest.mark.parametrize("header", NO_UNIT)
def test_what_is_no_unit_of_the_values(tmp_path, header):
    path = save(tmp_path, f"{header}\n{ROWS}")
    message = refused(path, r"its units are not known; its header says .*give units= one of")
    assert header.rpartition("\n")[2].rpartition(",")[2] in message
    assert read_record(path, units="mm/s2").pga == 5e-4


@pytest.mark.parametrize("header", ["# units: g\nt,acc (m/s2)", "# units: ft/s2\nt,acc (g)"])
def test_two_units_are_shown_and_units_wins(tmp_path, header):
    path = save(tmp_path, f"{header}\n{ROWS}")
    refused(path, r"states several units: .* \('acc \(.*, line 2\) and .* line 1\); give units=")
    with pytest.warns(UserWarning, match=r"units='cm/s2' is given, in place of .*line"):
        record = read_record(path, units="cm/s2")
    assert record.pga == 5e-3
    assert "in place of" in record.reading.unit_from


@pytest.mark.parametrize(
    ("header", "kind"),
    [
        *[(f"t,{name}", "velocity") for name in ("v_g (m/s)", "vg", "velocity (cm/s)", "a (m/s)", "Geschwindigkeit")],
        *[(f"t,{name}", "displacement") for name in ("u_g [m]", "d_g", "disp", "displacement (cm)", "a (mm)")],
        ("# ground velocity, station X\nt,a", "velocity"),
        ("# units: cm\nt,a", "displacement"),
        ("VELOCITY TIME SERIES IN UNITS OF CM/S\nt,a", "velocity"),
    ],
)
def test_velocity_and_displacement_are_refused(tmp_path, header, kind):
    for units in (None, "g"):
        refused(save(tmp_path, f"{header}\n{ROWS}"), f"holds {kind}, not acceleration", units=units)


@pytest.mark.parametrize(
    ("remark", "dt"),
    [
        *[("DT: 0.02", 0.02), ("dt (ms): 5", 0.005), ("time step 0.02 sec", 0.02), ("sampling interval: 20 ms", 0.02)],
        *[("SampleRate(Hz): 50", 0.02), ("200 muestras/s", 0.005), ("sampled at 100 Hz", 0.01), ("100 sps", 0.01)],
        *[("VEL. DE MUESTREO (muestras/s): 100", 0.01), ("dt=0.01\n# sampling rate 100 Hz", 0.01)],
        *[("resampled from DT=0.005 s, now 0.01 s", None), ("dt=0.01 (originally 0.005)", None)],
        *[("low-pass 25 Hz", None), ("dt=0.01\n# sampling rate: 200 Hz", None)],
    ],
)
def test_a_step_in_a_remark(tmp_path, remark, dt):
    path = save(tmp_path, f"# {remark}\n# acc (g)\n{COLUMN}")
    if dt is not None:
        assert read_record(path).dt == dt
    else:
        refused(path, r"has no time step|states several time steps: .* and .*; give dt=")
    assert read_record(path, dt=0.03).dt == 0.03  # a remark gives way


def test_rounded_times_that_a_given_step_explains(tmp_path):
    rounded = "".join(f"{i * 0.005:.2f},{i % 9}\n" for i in range(400))
    path = save(tmp_path, f"t,acc (g)\n{rounded}")
    assert read_record(path, dt=0.005).reading.step_from == "given, and explains the times"
    for dt in (None, 0.01, 0.0051):
        refused(path, "its time does not increase", dt=dt)


@pytest.mark.parametrize(
    ("header", "column", "factor", "unit"),
    [
        *[("time (s),acc_x (g),acc_y (m/s2),vel", column, 2, "m/s2") for column in ("acc_y", "ACC_Y (m/s2)", 3, "3")],
        ("# units: gal\nt,NS,EW,UD", "UD", 3, "cm/s2"),
        ("t,NS(g),EW(g),UD(g)\n# remark", "NS", 1, "g"),
        ("# acceleration in g", 4, 3, "g"),
    ],
)
def test_one_of_several_components(tmp_path, header, column, factor, unit):
    path = save(tmp_path, f"{header}\n{THREE}")
    record = read_record(path, column=column)
    np.testing.assert_allclose(record.acceleration, factor * UNITS[unit] * np.array(VALUES), rtol=1e-12)
    assert record.dt == 0.01
    refused(path, r"has 3 components: '.*' \(2\), '.*' \(3\)|4 columns without headings")
    for wrong in ("z", 1, 5):
        refused(path, r"has no column", column=wrong)


# --- networks ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NETWORKS)
def test_networks(tmp_path, name):
    path = save(tmp_path, NETWORKS[name], name)
    column = COLUMNS.get(name)
    record = read_record(path, column=column)
    factor = 1e-3 if name.endswith("V2A") else 0.01
    np.testing.assert_allclose(record.acceleration, factor * np.array(VALUES), atol=factor * 5.1e-5)
    assert record.dt == pytest.approx(0.01, rel=1e-12)
    assert read_record(path, column=column, dt=0.01) == record
    if column:
        refused(path, "has 3 components")
    refused(path, r"0\.01 s, dt=0\.02 was given", column=column, dt=0.02)


@pytest.mark.parametrize("name", ["esm.ASC", "csmip.V1", "csmnc.dat", "unam.191", "usc.s0a", "nsmn.txt", "geonet.V2A"])
def test_a_peak_that_the_values_do_not_reach(tmp_path, name):
    """In the unit of the values, and in one of its own."""
    stated = {"csmip.V1": "0.001 g", "geonet.V2A": " 0.5 mm", "usc.s0a": " .50000"}.get(name, "0.50")
    wrong = NETWORKS[name].replace(stated, stated.replace("0.", "9.").replace(" .", "9."), 1)
    assert wrong != NETWORKS[name]
    message = r"states a peak of .* \(.*line \d+\), its values reach"
    refused(save(tmp_path, wrong, name), message, column=COLUMNS.get(name))


def test_a_peak_in_another_unit_than_the_values(tmp_path):
    """Units that the caller gives are checked too; what is not given is that of the peak."""
    path = save(tmp_path, NETWORKS["nsmn.txt"])
    refused(path, "states a peak of 0.0005097 g .*, its values reach 0.5 g", column="N-S", units="g")
    assert read_record(path, column="N-S").reading.unit_from.startswith("'RAW PGA VALUES (gal)")
    assert read_record(save(tmp_path, USC)).reading.unit_from.startswith("'PEAK ACCELERATION = .50000 CMS/SEC/SEC")
    refused(save(tmp_path, csmip(peak=0.05)), "states a peak of 0.05 g", units="g")


def test_several_columns_of_networks(tmp_path):
    """Their peaks are stated in one line; NIED's are what is above the offset of the recorder."""
    for name, factor in (("unam.191", 2), ("nsmn.txt", 2), ("nied.csv", 2), ("jma.csv", 2)):
        column = {"unam.191": "N00E", "nsmn.txt": "E-W", "nied.csv": "E-W", "jma.csv": "EW"}[name]
        record = read_record(save(tmp_path, NETWORKS[name]), column=column)
        np.testing.assert_allclose(record.acceleration, 0.01 * factor * np.array(VALUES), atol=1e-8)
    numbered = save(tmp_path, NIED.replace("N-S", "4").replace("E-W", "3").replace("U-D", "5"))
    assert read_record(numbered, column="4").reading.column == "4(gal)"  # a heading comes first, but a number
    assert read_record(numbered, column=4).reading.column == "3(gal)"
    traces = NETWORKS["slist.txt"] + NETWORKS["slist.txt"].replace("HNE", "HNN").replace("+5.0", "-9.0")
    refused(save(tmp_path, traces), r"has 2 components: 'XX_A__HNE_D' \(1\), 'XX_A__HNN_D' \(2\)")
    assert read_record(save(tmp_path, traces), column="XX_A__HNN_D").pga == pytest.approx(0.009)


# --- steps, spectra, units and headers that mislead -----------------------------------------------------------------


@pytest.mark.parametrize(
    "step", ["DT= 100.0 HZ", "DT= 100 SPS", "DT= .01", "DT= .01 SEC", "DT= 10 MSEC", "DT= .01, 100 SPS"]
)
def test_a_step_in_hertz_is_inverted(tmp_path, step):
    assert read_record(save(tmp_path, at2(points=f"NPTS= 7, {step}"))).dt == pytest.approx(0.01)
    assert read_record(save(tmp_path, f"# {step}\n# acc (g)\n{COLUMN}")).dt == pytest.approx(0.01)


@pytest.mark.parametrize("times", ["0,1\n0.5,2\n1,3\n", "0,1\n1e-5,2\n2e-5,3\n"])
def test_steps_have_bounds_unless_given(tmp_path, times):
    path = save(tmp_path, f"time (s),acc (g)\n{times}")
    refused(path, r"time step is .* s \('time \(s\)', line 1\); files have steps of 0\.0001 to 0\.1 s: give dt=")
    dt = float(times.split("\n")[1].split(",")[0])
    assert read_record(path, dt=dt).dt == dt
    doubts = record_doubts(read_record(path, dt=dt))
    assert any("lasts 2e-05 s: is it a whole record" in text for text in doubts) == (dt < 0.1)


def test_marks_of_what_is_missing_in_smc(tmp_path):
    path = save(tmp_path, smc(rate=1.7e38))
    refused(path, "has no time step; give dt= in seconds")
    assert read_record(path, dt=0.01) == read_record(save(tmp_path, smc(), "x.smc"))
    no_counts = smc()
    for count in (2, len(VALUES)):
        no_counts = no_counts.replace(f"{count:10d}", f"{-32768:10d}", 1)
    assert no_counts != smc()
    assert read_record(save(tmp_path, no_counts, "y.smc")) == read_record(tmp_path / "x.smc")
    refused(save(tmp_path, smc("1 UNCORRECTED ACCELEROGRAM", rate=1.7e38)), "film record, digitised at uneven times")
    assert read_record(save(tmp_path, smc("1 UNCORRECTED ACCELEROGRAM"))).dt == 0.01
    refused(save(tmp_path, smc("5 RESPONSE SPECTRA")), "holds a spectrum")
    refused(
        save(tmp_path, smc().replace("*  text", "epicentral dist = 66.0  pk acc = -80.2", 1)), "states a peak of 80.2"
    )


@pytest.mark.parametrize(
    "head",
    [
        *("Frequency (Hz),Amplitude (m/s2)", "Period [sec],Sa [g]", "T (s),Sa (g)", "T(s),PSA(g)", "Period,Acc (g)"),
        *("f (Hz),FAS (cm/s)", "Freq. Fourier", "T Sa", "period (s);Sa (g)", "T (s),Spectral acceleration (g)"),
        *(
            "T_n (s),Sv (cm/s)",
            "T (s),Sd (cm)",
            "Response spectrum, 5 % damping\nx,acc (g)",
            "t (s),Fourier amplitude (g)",
        ),
    ],
)
def test_spectra_are_refused(tmp_path, head):
    sign = ";" if ";" in head else "," if "," in head else " "
    for rows in ("0.02,0.1\n0.05,0.3\n0.5,0.5\n", ROWS):  # whatever the first column looks like
        refused(save(tmp_path, f"{head}\n{rows.replace(',', sign)}"), "holds a spectrum, not acceleration", units="g")


def test_a_motion_that_begins_with_its_peak(tmp_path):
    """A first value is a number of points only if it may be one."""
    blow = [9.0, *(0.1 * value for value in VALUES * 10)]
    assert read_record(save(tmp_path, "".join(f"{v}\n" for v in blow)), dt=0.01, units="m/s2").n_points == 71
    refused(save(tmp_path, "".join(f"{v}\n" for v in (800.0, *blow))), "far above all others", dt=0.01, units="m/s2")


def test_only_a_heading_of_time_gives_a_step(tmp_path):
    path = save(tmp_path, f"x,acc (g)\n{ROWS}")
    refused(path, "has no time step: its first column is headed 'x', not time; give dt=")
    assert read_record(path, dt=0.02).dt == 0.02
    for title in ("# matched to a response spectrum\ntime,acc (g)", "Response spectrum compatible\n,acc (g)"):
        assert read_record(save(tmp_path, f"{title}\n{ROWS}")).dt == 0.01
    assert read_record(save(tmp_path, f"El Centro\n{ROWS.replace(',', ' ')}"), units="g").dt == 0.01  # a title


@pytest.mark.parametrize("first", ["made up\n I1  9.95 35.02\n 7 0.01 2.5", "7 0.01 0 0", "0.01 7 1", "# dt=0.01\n7"])
def test_a_row_with_the_number_of_rows_is_a_header(tmp_path, first):
    path = save(tmp_path, f"{first}\n{COMPONENTS}")
    for column in (1, 2, 3):
        record = read_record(path, units="m/s2", column=column)
        assert (record.dt, record.n_points) == (0.01, 7)
        np.testing.assert_allclose(record.acceleration, column * np.array(VALUES), atol=1e-7)
    assert read_record(save(tmp_path, f"7\n{COLUMN}"), units="g", dt=0.01).n_points == 7
    assert read_record(save(tmp_path, f"7\n{COLUMN}"), units="g", dt=0.01, layout="rows").n_points == 7


@pytest.mark.parametrize(
    "unit", ["INCHES/SEC2", "PERCENT OF G", "UNITS OF VOLTS", "UNITS OF G, SCALED BY 9.81", "FT/S2"]
)
def test_words_behind_in_leave_no_default_unit(tmp_path, unit):
    path = save(tmp_path, at2(header=f"PEER\nEVENT\nACCELERATION TIME SERIES IN {unit}\n"))
    refused(path, "its header says|states several units")
    with pytest.warns(UserWarning, match="in place of"):
        assert read_record(path, units="g").pga == pytest.approx(0.5 * G)
    refused(save(tmp_path, at2(points="NPTS= 7, DT= .01 SEC, SCALED BY 981")), "several units: 'G' .* 'SCALED BY 981'")
    refused(save(tmp_path, at2(header="PEER\nEVENT\nACCELERATION IN COUNTS\n")), "holds counts, not acceleration")


@pytest.mark.parametrize(
    "head", ["acc (g)*10", "10*acc (g)", "acc [g] x 100", "0.1*acc_g", "acc (g)/10", "a\n# units: g, scaled by 2.5"]
)
def test_a_factor_beside_a_unit_leaves_none(tmp_path, head):
    refused(save(tmp_path, f"t,{head}\n{ROWS}"), "its units are not known; its header says")


@pytest.mark.parametrize("head", ["NS,EW,UD", "H,V,T", "L,T,V", "h1,h2,v"])
def test_components_are_no_units_of_time(tmp_path, head):
    rows = COMPONENTS.replace("\n", ";").split(";")[:-1]
    text = "# dt = 0.01 s, units: gal\n" + head + "\n" + "".join(",".join(row.split()) + "\n" for row in rows)
    record = read_record(save(tmp_path, text), column=head.split(",")[1])
    np.testing.assert_allclose(record.acceleration, 0.02 * np.array(VALUES), atol=1e-9)
    for time in ("time (ns)", "time_h", "t in hours"):
        refused(save(tmp_path, f"{time},acc (g)\n{ROWS}"), "times are not in seconds")


def test_rows_that_are_not_one_component(tmp_path):
    given = {"layout": "rows", "dt": 0.01, "units": "g"}
    values = in_rows(VALUES * 3)
    assert read_record(save(tmp_path, values), **given).n_points == 21
    refused(save(tmp_path, in_rows([0, 2, 127] * 16, "{:5d}", 16) + values), "line 1 holds whole numbers", **given)
    refused(save(tmp_path, f"NS EW UD\n{COMPONENTS}"), r"heads several components: \['NS', 'EW', 'UD'\]", **given)
    refused(save(tmp_path, "".join(f"{i * 0.01:.2f} {v}\n" for i, v in enumerate(VALUES))), "rises like times", **given)
    refused(save(tmp_path, f"7 0.01 2.5\n{COMPONENTS}"), "says 7 points, it holds 21", **given)
    for broken in (values + "end of data\n", values + "1.0 2.0\n"):
        refused(save(tmp_path, broken), "give layout='rows' with dt= and units= if its values wrap", column=1, dt=0.01)


def test_several_channels_in_one_file(tmp_path):
    twice = [2 * v for v in VALUES]
    for text in (cosmos() + cosmos(values=twice).replace("Chan  1", "Chan  2"), geonet() + geonet("UP", values=twice)):
        path = save(tmp_path, text)
        refused(path, r"has 2 components: '(Chan  1|N10E)' \(1\), '(Chan  2|UP)' \(2\)")
        assert read_record(path, column=2).pga == pytest.approx(2 * read_record(path, column=1).pga)


def test_knet(tmp_path):
    """The header of NIED's own example; 3920 gal are 6182761 counts, and a mean of 8000 counts is no motion."""
    counts = [8000 + wave for wave in (9, -9, 100, -100, 5, -5, 0, 0)] * 25
    path = save(tmp_path, knet(counts), "MYG0020601182325.NS")
    record = read_record(path)
    assert (record.dt, record.n_points, record.name) == (0.01, 200, "MYG0020601182325.NS")
    assert record.source == "MYG002 N-S, earthquake of 2006/01/18 23:25:00 (MYG0020601182325.NS)"
    np.testing.assert_allclose(record.acceleration, (np.array(counts) - 8000) * 39.2 / 6182761, rtol=1e-12)
    underground = save(tmp_path, knet(counts, rate=200, seconds=1, direction="3", scale="2000(gal)/8388608"), "T.UD1")
    assert read_record(underground, name="T", units="gal").dt == 0.005
    assert read_record(underground).pga == pytest.approx(100 * 20 / 8388608)
    save(tmp_path, knet(counts), "MYG0020601182325.EW")
    both = [name for name, _ in list_records(tmp_path)][1:]
    assert both == ["MYG0020601182325.EW", "MYG0020601182325.NS", "T"]
    assert [record.name for record in resolve_records(both, tmp_path)] == [*both[:2], "T.UD1"]


# --- bad files --------------------------------------------------------------------------------------------------

_ESM = NETWORKS["esm.ASC"]
#: Files that are refused, by what is wrong with them.
BAD = {
    "nothing": "",
    "any bytes": bytes(range(256)),
    "a null byte": b"0.1\n0.2\x00\n",
    "gzip": b"\x1f\x8b\x08abc",
    "an Excel workbook": b"PK\x03\x04" + bytes(40) + b"[Content_Types].xml",
    "a page of HTML": b"\n<!DOCTYPE html><html>login</html>",
    "a git-lfs pointer": b"version https://git-lfs.github.com/spec/v1\noid sha256:1\nsize 1\n",
    "a SAC binary": bytes(304) + b"\x06\0\0\0" + bytes(400),
    "miniSEED": b"000001D ABCD" + bytes(50),
    "RENADIC": b"line\n" * 7 + b"UNIVERSIDAD DE CHILE - RENADIC\n 1 2 3\n",
    "BHRC": b"* VOL1 DATA\n 1 2 3\n",
    "half a UTF-16 character": b"\xff\xfea\x00b",
    "words": "some words\nand no numbers\n",
    "many words": "word\n" * 1001,
    "a long line": "1\n2\n" + "3 " * 700_000,
    "too few": at2(npts=8),
    "too many": at2(npts=6),
    "no step": at2(points="NPTS= 7"),
    "step 0": at2(points="NPTS= 7, DT= 0.0 SEC"),
    "step infinite": at2(points="NPTS= 7, DT= 1E999 SEC"),
    "points in words": at2(points="NPTS= many, DT= .01 SEC"),
    "points of many digits": at2(points="NPTS= " + "9" * 5000 + ", DT= .01 SEC"),
    "points beyond bounds": at2(npts=10_000_001),
    "NaN": at2().replace(fortran(0.5), "            NaN"),
    "overflow": at2().replace(fortran(0.5), "  .1234567E+999"),
    "stars": at2().replace(fortran(0.5), " **************"),
    "a word": at2().replace(fortran(0.5), "           oops"),
    "a word behind too few": at2(npts=8, per_line=7) + "*** End\n",
    "touching": NGA + "NPTS= 2, DT= .01 SEC\n-.1234E-02.5678E-03\n",
    "velocity": at2(header=NGA.replace("ACCELERATION", "VELOCITY").replace("OF G", "OF CM/S")),
    "displacement": at2(header=NGA.replace("ACCELERATION", "DISPLACEMENT")),
    "furlongs": at2(header=NGA.replace("OF G", "OF FURLONGS")),
    "no unit": "0 0\n0.01 1\n",
    "feet": "time,acc (ft/s2)\n0,0\n0.01,1\n",
    "milliseconds": "time (ms),acc (g)\n0,0\n10,1\n",
    "one column, no step": "acc (g)\n0.0\n0.1\n",
    "two steps": f"# dt=0.02\nt,acc (g)\n{ROWS}",
    "a step and times": "7 0.02\n" + ROWS.replace(",", " "),
    "uneven": "t,a (g)\n0,0\n0.01,1\n0.02,2\n0.035,3\n0.045,4\n",
    "a row missing": "t,a (g)\n" + "".join(f"{i / 100},0\n" for i in range(500) if i != 300),
    "a shift": "t,a (g)\n" + "".join(f"{i / 100 if i < 300 else i / 100 + 0.005},0\n" for i in range(600)),
    "backwards": "t,a (g)\n0,0\n0.02,1\n0.01,2\n",
    "time NaN": "t,a (g)\n0,0\nnan,1\n0.02,2\n",
    "column NaN": "t,a (g)\n0,0\n0.01,nan\n0.02,2\n",
    "an empty cell": "t,a (g)\n0,0\n0.01,\n0.02,2\n",
    "a word in a cell": "t,a (g)\n0,0\n0.01,x\n",
    "a word in the first row": "t,a (g)\n0,1.O\n0.01,1\n0.02,1\n",
    "digits of another script": "t,a (g)\n0,0\n0.01,\u0661\n".encode(),
    "three columns": "t,a,b (g)\n0,0,1\n0.01,1,2\n",
    "five columns": ".1 .2 .3 .4 .5\n.1 .2 .3 .4 .5\n",
    "one row": "t,a (g)\n0.5,2\n",
    "index and time": "index,time (s)\n0,0\n1,0.01\n2,0.02\n",
    "a count": "0 0.1\n1 0.2\n2 0.3\n",
    "fewer than the first line says": f"8 0.01\n{in_rows(VALUES, '{:12.7f}', 2)}",
    "K-NET, cut": knet([8000] * 99),
    "K-NET, header cut": knet([8000] * 200).partition("Memo.")[0],
    "K-NET, no rate": knet([8000] * 200).replace("100Hz", "fast"),
    "K-NET, rate 0": knet([8000] * 200, rate=0),
    "K-NET, no scale": knet([8000] * 200).replace("Scale Factor", "Scale"),
    "K-NET, scale 0": knet([8000] * 200, scale="3920(gal)/0"),
    "K-NET, for years": knet([8000] * 200, seconds=10**9),
    "K-NET, a word": knet([8000] * 200 + ["oops"]),
    "ESM, velocity": _ESM.replace("UNITS: cm/s^2", "UNITS: cm/s").replace("ACCELERATION", "VELOCITY"),
    "ESM, no unit": _ESM.replace("UNITS: cm/s^2\n", "").replace("PGA_CM/S^2", "PGA"),
    "a step in furlongs": at2(points="NPTS= 7, DT= .01 FURLONG"),
    "a step of hours": at2(points="NPTS= 7, DT= 10 SEC"),
    "a column of dates": "date,acc (g)\n2001-01-01 00:00:00.00,0.1\n2001-01-01 00:00:00.01,0.2\n",
    "a first row far above": "t (s),acc (g)\n0,400\n" + "".join(f"{i / 100},{i % 3}\n" for i in range(1, 20)),
    "times of day": "t;acc (g)\n00:00:00.00;0,1\n00:00:00.01;0,2\n",
    "days and times": "date,t,acc (g)\n2001-01-01,00:00:00.00,0.1\n2001-01-01,00:00:00.01,0.2\n",
    "a column of days": "01.02.2001 00:00:01;0,1\n01.02.2001 00:00:02;0,2\n",
    "CSMIP, on film": CSMIP.partition("{n} Acc")[0] + in_rows([0.0, 0.1, 0.005, 0.2] * 4, "{:7.3f}"),
    "USC, on film": "FILE     0 OF UNCORRECTED ACCELEROGRAM DATA OF VOLUME I:\n" + in_rows([0, 2, 127], "{:5d}"),
    "CSMIP, a spectrum": "Response and Fourier amplitude spectra (78 periods,  .04 -  6.0 sec)\n" + in_rows([0] * 32),
    "COSMOS, volume 0": cosmos("raw accel.  ", "counts(50)"),
    "TSPAIR, counts": NETWORKS["tspair.txt"].replace("CM/S**2", "Counts"),
    "SLIST, no unit": NETWORKS["slist.txt"].replace("CM/S**2", ""),
    "SLIST, too few": NETWORKS["slist.txt"].replace("7 samples", "8 samples"),
    "GeoCSV, counts": NETWORKS["geocsv0.csv"].replace("CM/S**2", "Counts"),
    "GeoCSV, too few": NETWORKS["geocsv1.csv"].replace("count: 7", "count: 8"),
    "China, two records": NETWORKS["csmnc.dat"] * 2,
    "UNAM, too few": NETWORKS["unam.191"].replace("/6/6/6", "/8/8/8"),
    "NIED, too few": NIED.replace("#DurationTime(s)\n#1", "#DurationTime(s)\n#3"),
    "China, too few": NETWORKS["csmnc.dat"].replace("POINTS:  7", "POINTS:  8"),
    "ESM, no step": _ESM.replace("0.010", "x"),
    "AFAD, too few": NETWORKS["afad.txt"].replace("DATA : 7", "DATA : 8"),
    "CWA, another rate": NETWORKS["cwa.dat"].replace("Hz): 100", "Hz): 200"),
    "COSMOS, velocity": cosmos("velocity", "cm/sec(05)"),
    "COSMOS, counts": cosmos(unit="counts(50)"),
    "COSMOS, no step": cosmos(ms=0.0),
    "GeoNet, step 0": geonet(step=0.0),
    "GeoNet, no points": geonet().replace("Number of points", "Points"),
    "SMC, rate 0": smc(rate=0.0),
    "SMC, no remark": smc(rate=1e3).replace("|remark\n", "", 1),
}


def messages(folder):
    """Return the message of each bad file."""
    columns = {"AFAD, too few": "N-S", "CWA, another rate": "U", "UNAM, too few": "V", "NIED, too few": "U-D"}
    paths = {what: save(folder, text, f"{what}.AT2") for what, text in BAD.items()}
    return {w: refused(path, column=columns.get(w)).replace(str(path), "") for w, path in paths.items()}


def test_messages_of_bad_files(tmp_path):
    found = messages(tmp_path)
    assert found == json.loads(MESSAGES.read_text(encoding="utf-8"))
    assert all(text.startswith(": ") and len(text) < 400 for text in found.values())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"units": "furlong"}, "unknown acceleration unit 'furlong'"),
        ({"units": "cm/s"}, r"did you mean 'cm/s2'\? Valid: .*gal"),
        ({"units": 9.81}, "unknown acceleration unit 9.81"),
        ({"dt": 0.02}, "time step is 0.01 s, dt=0.02 was given"),
        ({"dt": -1}, r"dt \(s\) must be positive"),
        ({"dt": "x"}, r"dt \(s\) must be a number"),
        ({"scale": float("nan")}, "scale factor must be finite"),
        ({"pga": 0.0}, "PGA to scale to .* must be positive"),
        ({"scale": 2.0, "pga": 1.0}, r"scale=2\.0 and pga=1\.0 exclude each other"),
        ({"name": ""}, "name must be a non-empty text"),
        ({"layout": "row"}, r"unknown layout 'row'; did you mean 'rows'"),
    ],
)
@pytest.mark.parametrize("text", [at2(), "t,a (g)\n0,0\n0.01,0.5\n0.02,0.1\n"])
def test_bad_arguments(tmp_path, arguments, message, text):
    refused(save(tmp_path, text), message, **arguments)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("none.AT2", r"none\.AT2: no such file"),
        ("", "is a folder or a device; give a file"),
        ("nul\0byte", "can't be read"),
        ("x" * 5000, "can't be read"),
        ("file.AT2/below.AT2", "can't be read"),
        ("huge.AT2", "more than 64 MiB are refused"),
        ("pipe.AT2", "is a folder or a device"),  # opening it would wait for ever
    ],
)
def test_unreadable_places(tmp_path, path, message):
    save(tmp_path, at2())
    os.mkfifo(tmp_path / "pipe.AT2")
    with (tmp_path / "huge.AT2").open("wb") as stream:
        stream.truncate(MAX_FILE_BYTES + 1)
    refused(tmp_path / path, message)


@pytest.mark.parametrize("text", ["1\n" * 200, "0.1 1\n" * 200, "PEER NGA\nNPTS= 200, DT= .01 SEC\n" + "1 2\n" * 100])
def test_too_many_points_are_refused(tmp_path, monkeypatch, text):
    monkeypatch.setattr(reader, "MOST_POINTS", 199)
    refused(save(tmp_path, text), "has more than 199 points; is it a record", dt=0.01, units="g")


@pytest.mark.parametrize(
    ("word", "times"),
    [
        ("1", 2_000_000),
        ("1-", 10**6),
        ("units ", 300_000),
        ("from ", 300_000),
        ("acc in ", 300_000),
        ("(", 500_000),
        ("NPTS ", 300_000),
        ("1E", 500_000),
    ],
)
def test_long_lines_are_linear(tmp_path, word, times):
    refused(save(tmp_path, word * times), dt=0.1, units="g")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        MESSAGES.write_text(json.dumps(messages(Path(folder)), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
