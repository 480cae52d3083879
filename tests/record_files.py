"""Record files written for tests."""

from __future__ import annotations

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


def knet(counts, rate=100, seconds=2, direction="N-S", scale="3920(gal)/6182761"):
    header = {
        "Origin Time": "2006/01/18 23:25:00",
        "Lat.": 37.798,
        "Long.": 142.200,
        "Depth. (km)": 36,
        "Mag.": 5.7,
        "Station Code": "MYG002",
        "Station Lat.": 38.7262,
        "Station Long.": 141.5109,
        "Station Height(m)": 79,
        "Record Time": "2006/01/18 23:25:46",
        "Sampling Freq(Hz)": f"{rate}Hz",
        "Duration Time(s)": seconds,
        "Dir.": direction,
        "Scale Factor": scale,
        "Max. Acc. (gal)": 48.060,
        "Last Correction": "2006/01/18 23:25:31",
        "Memo.": "",
    }
    rows = ["".join(f"{count:>8} " for count in counts[i : i + 8]) for i in range(0, len(counts), 8)]
    return "\n".join([*(f"{key:<18}{value}" for key, value in header.items()), *rows, ""])


def save(folder, content, name="file.AT2"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
    return path


CSV_TEXT = "time (s),acc (g)\n" + "".join(f"{i * 0.01:.2f},{v}\n" for i, v in enumerate(VALUES * 3))
