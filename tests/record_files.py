"""Record files written for tests."""

from __future__ import annotations

from pathlib import Path

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
    numbers = [count for count in counts if isinstance(count, int)]
    full, steps = map(float, scale.split("(gal)/"))
    peak = max(abs(count - sum(numbers) / len(numbers)) for count in numbers) * full / steps if steps else 0.0
    header = {"Origin Time": "2006/01/18 23:25:00", "Lat.": 37.798, "Long.": 142.200, "Depth. (km)": 36, "Mag.": 5.7}
    header |= {"Station Code": "MYG002", "Station Lat.": 38.7262, "Station Long.": 141.5109, "Station Height(m)": 79}
    header |= {"Record Time": "2006/01/18 23:25:46", "Sampling Freq(Hz)": f"{rate}Hz", "Duration Time(s)": seconds}
    header |= {"Dir.": direction, "Scale Factor": scale, "Max. Acc. (gal)": f"{peak:.3f}"}
    header |= {"Last Correction": "2006/01/18 23:25:31", "Memo.": ""}
    rows = ["".join(f"{count:>8} " for count in counts[i : i + 8]) for i in range(0, len(counts), 8)]
    return "\n".join([*(f"{key:<18}{value}" for key, value in header.items()), *rows, ""])


def save(folder, content, name="file.AT2"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
    return path


CSV_TEXT = "time (s),acc (g)\n" + "".join(f"{i * 0.01:.2f},{v}\n" for i, v in enumerate(VALUES * 3))


def in_rows(values, form="{:10.4f}", per_line=8):
    rows = [values[i : i + per_line] for i in range(0, len(values), per_line)]
    return "".join("".join(map(form.format, row)) + "\n" for row in rows)


def cosmos(kind="acceleration", unit="cm/sec2(04)", values=VALUES, ms=10.0, seconds=0):
    """Write one channel of a COSMOS file, with its step as number 62 of the real header, in ms."""
    real = [0.0] * 100
    real[61] = ms
    return (
        "Corrected acceleration   (Format v01.20 with 13 text lines) Src: 000xxx\n"
        + "Chan  1: 90 Deg\n" * 12
        + f" 100 Integer-header values follow on 10 lines, Format= (10I8)\n{in_rows([0] * 100, '{:8d}', 10)}"
        + f" 100 Real-header values follow on 17 lines, Format= (6F13.6)\n{in_rows(real, '{:13.6f}', 6)}"
        + '   1 Comment line(s) follow, each starting with a "|":\n| example\n'
        + f"{len(values):8d} {kind} pts, approx {seconds:2d} secs, units={unit}, Format=(8F10.5)\n"
        + f"{in_rows(values, '{:10.5f}')}End-of-data for Chan  1 acceleration\n"
    )


def geonet(component="N10E", header=True, values=VALUES, step=0.01):
    """Write one component of a GeoNet V2A file: acceleration, velocity and displacement, in mm and s."""
    numbers = [0.0] * 100
    numbers[33], numbers[65] = len(values), step
    return (
        f"Corrected accelerogram 20200101_110256_ABCD_20 GNS Science\nSite ABCD\nNumber of points {len(values):6d}\n"
        f"Instrument corrected data at {step:.3f} sec intervals\nComponent {component}  Accelerometer Axis\n"
        f"Acceleration:  peak   {max(map(abs, values)):6.1f} mm/s/s at  0.04 sec\n"
        + (in_rows(numbers, "{:8.3f}", 10) if header else "")
        + "".join(
            in_rows([factor * value for value in values], "{:8.4f}", 10) for factor in ((1, 2, 3) if header else (1,))
        )
    )


def smc(first="2 CORRECTED ACCELEROGRAM", values=VALUES, rate=100.0):
    whole, real = [-32768] * 48, [1.7e38] * 50
    whole[15], whole[16], real[1] = 2, len(values), rate
    lines = "\n".join([first, *(["*  text"] * 10)])
    numbers = in_rows(whole, "{:10d}") + in_rows(real, "{:15.7E}", 5)
    return f"{lines}\n{numbers}|remark\n|remark\n{in_rows(values)}"


CSMIP = (
    "Uncorrected Accelerogram Data             Processed: 02/13/12, CGS  146be002    \nStation No. 89146\n"
    "Chan  1: 360 Deg                                                                \n"
    "No. of Points =  {n}  Record Length = 66.000 sec   at 100 Samples/sec         \n"
    "Units of uncor data are sec and g .        Max  =  {peak:6.3f} g , at  30.590 sec.    \n"
    + in_rows([0] * 100, "{:5d}", 16)
    + in_rows([0.1] * 100, "{:10.6f}")
    + " {n} Accelerogram points at 100 pts/sec in units of g .      Format: (8f9.6)  \n"
)


def csmip(values=VALUES, peak=None):
    """Write one channel of a CSMIP V1 file: accelerations in g, of which gal are the `values`."""
    peak = max(map(abs, values)) / 981 if peak is None else peak
    rows = in_rows([value / 981 for value in values], "{:11.8f}")
    return CSMIP.format(n=len(values), peak=peak) + rows + "/& ---- End of data for channel  1 ----\n"


COMPONENTS = "".join(f"{v:14.7f}{2 * v:14.7f}{3 * v:14.7f}\n" for v in VALUES)
#: Files of networks, all of the acceleration VALUES in cm/s2 (or mm/s2) at 0.01 s; in the first column of several.
NETWORKS = {path.name: path.read_bytes().decode("latin-1") for path in Path(__file__).parent.glob("golden/records/*")}
USC, NIED = NETWORKS["usc.s0a"], NETWORKS["nied.csv"]
NETWORKS |= {"cosmos.V2": cosmos(), "geonet.V2A": geonet(), "short.V2A": geonet(header=False)}
NETWORKS |= {"usgs.smc": smc(), "csmip.V1": csmip()}
#: Components that are VALUES, of files with several.
COLUMNS = {
    "afad.txt": "N-S",
    "cwa.dat": "U",
    "unam.191": "T",
    "nsmn.txt": "N-S",
    "nied.csv": "N-S(gal)",
    "jma.csv": "NS",
}
