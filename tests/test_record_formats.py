"""Record files in columns and of many points: whose time it is, exact numbers, bounded memory."""

from __future__ import annotations

import random
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pounding_sweep.base.errors import RecordError
from pounding_sweep.records import STANDARD_GRAVITY as G
from pounding_sweep.records import read_record, reader
from pounding_sweep.records.reader import plain_words


def save(folder, text, name="x.csv"):
    path = folder / name
    path.write_bytes(text.encode())
    return path


# --- whose time it is -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("head", ["", "index", "Index", "#", "n", "no.", "Unnamed: 0", "sample", "unknown"])
@pytest.mark.parametrize("start", [0, 1])
def test_an_index_is_no_time(tmp_path, head, start):
    path = save(tmp_path, f"{head},acc (g)\n" + "".join(f"{start + i},{a}\n" for i, a in enumerate((0.1, 0.2, -0.3))))
    with pytest.raises(RecordError, match=r"counts by ones: points, or seconds\? Give dt= in seconds"):
        read_record(path)
    record = read_record(path, dt=0.01)
    assert record.dt == 0.01
    np.testing.assert_array_equal(record.acceleration, np.array([0.1, 0.2, -0.3]) * G)


def test_columns_without_headings_that_count_by_ones(tmp_path):
    path = save(tmp_path, "0 0.1\n1 0.2\n2 0.3\n")
    with pytest.raises(RecordError, match="its first column counts by ones: points, or seconds"):
        read_record(path, units="g")
    assert read_record(path, units="g", dt=1).dt == 1.0
    assert read_record(save(tmp_path, "# dt = 0.02\n# n, acc (g)\n0 0.1\n1 0.2\n"), units="g").dt == 0.02
    assert read_record(save(tmp_path, "time (s),acc (g)\n0,0.1\n1,0.2\n")).dt == 1.0
    assert read_record(save(tmp_path, ",acc (g)\n0.00,0.1\n0.01,0.2\n")).dt == 0.01  # a time index that lost its name
    assert read_record(save(tmp_path, "0 0.1\n2 0.2\n4 0.3\n"), units="g").dt == 2.0


@pytest.mark.parametrize(
    "head",
    [
        *("Time_ms", "t_ms", "time in ms", "Time (millisec)", "time [msec]", "T(ms)", "t/ms", "ms"),
        *("TIME (milliseconds)", "time (µs)", "time (us)", "Time (min)", "time, acc\ntime ms"),
    ],
)
def test_times_in_other_units_are_refused(tmp_path, head):
    for path in (
        save(tmp_path, f"{head},acc (g)\n0,0.1\n10,0.2\n20,0.1\n"),
        save(tmp_path, f"{head};acc (g)\n0;0,1\n10;0,2\n20;0,1\n"),
    ):
        with pytest.raises(RecordError, match=r"times are not in seconds .*; convert them"):
            read_record(path)


@pytest.mark.parametrize("head", ["time", "Time_s", "t (s)", "time in s", "Time (sec)", "t", "seconds", "s", "times"])
def test_times_in_seconds_are_taken(tmp_path, head):
    assert read_record(save(tmp_path, f"{head},acc (g)\n0,0.1\n0.5,0.2\n")).dt == 0.5


@pytest.mark.parametrize(
    "text",
    [
        "acc (g),time (s)\n0.1,0\n0.2,0.01\n0.3,0.02\n",
        "acc (g);t\n0,1;0\n0,2;0,01\n0,3;0,02\n",
        "# from a logger\nacc (g) time (s)\n0.1 0\n0.2 0.01\n0.3 0.02\n",
        "accel_g\tTime_s\n0.1\t5.00\n0.2\t5.01\n0.3\t5.02\n",
    ],
)
def test_headings_tell_the_columns(tmp_path, text, monkeypatch):
    for size in (reader.BLOCK, 8):  # rows one by one, and as arrays
        monkeypatch.setattr(reader, "BLOCK", size)
        record = read_record(save(tmp_path, text))
        assert record.dt == 0.01
        np.testing.assert_array_equal(record.acceleration, np.array([0.1, 0.2, 0.3]) * G)


def test_two_columns_without_acceleration_are_refused(tmp_path):
    with pytest.raises(RecordError, match=r"has no column of acceleration: its columns are headed \['index', 'time"):
        read_record(save(tmp_path, "index,time (s)\n0,0\n1,0.01\n2,0.02\n"))


# --- many numbers -----------------------------------------------------------------------------------------------

WRITTEN = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.floats(-1e3, 1e3).map(lambda x: f"{x:+.7E}"),
    st.floats(-1e3, 1e3).map(lambda x: f"{x:.3f}".replace("0.", ".")),
    st.from_regex(r"[+-]?([0-9]{1,40}(\.[0-9]{0,40})?|\.[0-9]{1,40})([EeDd][+-]?[0-9]{1,3})?", fullmatch=True),
)


@given(st.lists(WRITTEN, min_size=1, max_size=40), st.sampled_from([" ", "  ", "\n", ", ", "\t"]))
def test_blocks_are_read_as_word_by_word(words, between):
    expected = [float(word.replace("D", "E").replace("d", "e")) for word in words]
    assert plain_words(between.join(words) + "\n").tolist() == expected


@pytest.mark.parametrize("odd", ["1-2", "x", "nan", "1_0", "0x1", "# 1", "1;2", "inf", "1e", "١"])
def test_what_is_not_plain_is_left_to_be_read_by_lines(odd):
    assert plain_words(f"1,2\n{odd}\n3,4\n") is None


def test_blocks_make_no_difference(tmp_path, monkeypatch):
    """A file is the same in blocks of any size, with remarks and odd rows anywhere; so are the lines of faults."""
    rng = random.Random(3)
    rows = [f"{i * 0.02:.2f},{rng.uniform(-1, 1):.4f}" for i in range(200)]
    rows[50:50] = ["# a remark", ""]
    rows[120] = rows[120].replace(",", " , ") + ","
    whole = save(tmp_path, "\n".join(["time (s),acc (g)", *rows]))
    rows[150] = "oops"
    broken = save(tmp_path, "\n".join(["time (s),acc (g)", *rows]), "b.csv")
    rows[150] = "2.955,0.1"
    uneven = save(tmp_path, "\n".join(["time (s),acc (g)", *rows]), "u.csv")
    at2 = "PEER NGA\nx\nUNITS OF G\nNPTS= 40, DT= .01 SEC\n" + "0.5 -0.25-.125 1.D-1\n" + "0.5 -0.25 -.125 1.D-1\n" * 9
    fortran = save(tmp_path, at2, "f.AT2")
    first = read_record(whole), read_record(fortran)
    expected = [float(row.split(",")[1]) * G for row in rows[:50] + rows[52:150]]
    assert first[0].acceleration[:148].tolist() == expected
    assert first[1].acceleration.tolist() == [0.5 * G, -0.25 * G, -0.125 * G, 0.1 * G] * 10
    for size in (1, 17, 300):
        monkeypatch.setattr(reader, "BLOCK", size)
        assert (read_record(whole), read_record(fortran)) == first
        with pytest.raises(RecordError, match="line 152: 'oops' is not a number"):
            read_record(broken)
        with pytest.raises(RecordError, match=r"line 152: time 2\.955 s does not continue"):
            read_record(uneven)


@pytest.mark.parametrize("text", ["1\n" * 400_000, "PEER NGA\nNPTS= 400000, DT= .01 SEC\n" + "1 2 3 4\n" * 100_000])
def test_memory_is_that_of_the_numbers(tmp_path, text):
    path = save(tmp_path, text, "x.AT2")
    tracemalloc.start()
    record = read_record(path, units="g") if "NPTS" in text else read_record(path, units="g", dt=0.01)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert record.n_points == 400_000
    assert peak < 6 * record.acceleration.nbytes  # a list of Python numbers alone takes 4 of these, of lists 11


@pytest.mark.parametrize("text", ["1\n" * 200, "0.1 1\n" * 200, "PEER NGA\nNPTS= 200, DT= .01 SEC\n" + "1 2\n" * 100])
def test_too_many_points_are_refused(tmp_path, monkeypatch, text):
    monkeypatch.setattr(reader, "MOST_POINTS", 199)
    with pytest.raises(RecordError, match="has more than 199 points; is it a record"):
        read_record(save(tmp_path, text), dt=0.01, units="g")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1\n2\n" + "3 " * 700_000, "line 3 has more than 1048576 characters; write the values in lines"),
        ("word\n" * 1001, "its first 1000 lines hold no row of numbers"),
    ],
)
def test_what_no_record_has_is_refused(tmp_path, text, message):
    with pytest.raises(RecordError, match=message):
        read_record(save(tmp_path, text), dt=0.01, units="g")
