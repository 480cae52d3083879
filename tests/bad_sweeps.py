"""Bad sweeps, as Python arguments and as files: `report` lists every message for those of golden/bad_sweeps.txt.

A line of that file that is not indented is a case: arguments in place of those of a valid sweep, an edit of the file
`GOOD` as 'old' -> 'new', or the text of a whole file as an expression. Below it stand the places of its faults, each
with its kind. At the end is the first text of each kind: texts of one kind differ by values and names alone.
`python tests/bad_sweeps.py` writes all but the cases anew.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import itertools
import os
import re
import sys
import tempfile
import warnings
from pathlib import Path
from unittest import mock

import numpy as np

from pounding_sweep.base.errors import SweepError
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.scene import ContactProperties, Scene, Wall
from pounding_sweep.records import Record
from pounding_sweep.request import build
from pounding_sweep.request.axes import Case, Range
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.toml import load_spec
from pounding_sweep.variables.registry import VARIABLES

GOLDEN = Path(__file__).parent / "golden" / "bad_sweeps.txt"
PULSE = Record("pulse", dt=0.01, acceleration=[0.0, 1.0, -1.0, 0.0])
A, B = (Building(name, [1.0], [1.0]) for name in "ab")
YIELDING = Building("a", [1.0], [1.0], yield_strengths=[0.1])
NAMES = {
    "Building": Building, "Case": Case, "ContactProperties": ContactProperties, "PULSE": PULSE, "Range": Range,
    "Record": Record, "Scene": Scene, "Wall": Wall, "count": itertools.count, "inf": float("inf"),
    "nan": float("nan"), "np": np, "bare": Scene([A, B], [0.01]),
    "yielding": Scene([YIELDING, B], [0.01], ContactProperties(1.0)),
    "half": Scene([A, B], [0.01], ContactProperties(1.0, restitution=0.0)),
}  # fmt: skip

GOOD = """\
title = "a sweep"

[scene]
gaps = [0.01]

[[scene.row]]
name = "left"
masses = [10.0, 8.0]
stiffnesses = [4e3, 3e3]
damping_ratio = [0.05, 0.06]
storey_heights = [3.0, 3.5]

[[scene.row]]
wall = true
name = "moat wall"

[scene.contact]
linear_stiffness = 2e6
hertz_stiffness = 1.88e7
restitution = 0.6

[sweep]
records = [
    { record = "el_centro" },
    { path = "x.csv", units = "g", dt = 0.01, name = "x", scale = 2.0 },
    { path = "x.csv", units = "g", dt = 0.01, name = "y", pga = 3 },
    { synthetic = 1, duration = 2.0, pga = 3.0 },
    { pulse = "half_sine", amplitude = 4.0, period = 0.5, dt = 0.01 },
    { record = "el_centro", pga = 2.0, name = "el_centro_2" },
]
laws = ["linear", "hertz_damped"]
gaps = { start = 0.002, stop = 0.006, count = 3 }
stiffness_factors = { start = 0.1, stop = 10.0, count = 3, spacing = "log" }
restitutions = [
    0.4,  # low
    0.6,
]
scales = [1, 2]

[solver]
method = "newmark"
dt = 2e-3
locate = false
beta = 0.3
gamma = 0.6
force_unstable = true

[output]
variables = ["impulse", "drift_max"]
"""
BAD = """\
titel = "a sweep"

[scene]
gaps = [0.01, -0.02]

[[scene.row]]
name = "left"
masses = [10.0, -8.0, "x"]
stiffnesses = [
    4e3,
    0.0,
    3e3,
]
damping = 0.05

[[scene.row]]
name = "right"
masses = [1.0, 2.0]
stiffnesses = [1.0]

[scene.contact]
linear_stiffness = -2e6
hertz = { radii = [1.0], poisson = 0.2 }

[sweep]
records = [
    "el_centro",
    "nowhere.AT2",
    { path = "x.csv", unit = "g", dt = 0.01 },
    { path = "x.csv", units = "furlong", dt = 0.01 },
    { synthetic = -1 },
    { pulse = "squiggle", amplitude = 1.0, period = 0.5, dt = 0.01 },
    { pulse = "sine" },
    { sine = 3 },
    7,
]
laws = [
    "linear",
    "herz",
]
gaps = [0.01, 0.02,
        nan, -1.0]
stiffness_factors = { start = 1.0, stop = 2.0, cuont = 3 }
restitutions = [1.5]
scale = [1.0]

[solver]
method = "rk5"
dt = "1e-3"
locate = 1

[output]
variables = ["displacement_mx"]
"""
SMALL = '[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\nlaws = ["linear"]\n'
_CASES = '[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\n'
#: A row whose floors are not level.
_STAGGERED = """
[scene]
gaps = [0.01]
[[scene.row]]
name = "a"
masses = [1.0]
stiffnesses = [9.0]
[[scene.row]]
name = "b"
masses = [1.0]
stiffnesses = [9.0]
storey_heights = [4.0]
[scene.contact]
hertz_stiffness = 1e6
[sweep]
records = ["el_centro"]
"""
NAMES |= {"SMALL": SMALL, "_CASES": _CASES, "_STAGGERED": _STAGGERED, "BAD": BAD}


#: What texts of one kind differ by: names and values, however they are written.
_VALUES = re.compile(
    r"""b?'[^']*' | "[^"]*" | \[[^][]*\] | -?(?<![\w*])[\d.]+(?:e[-+]?\d+)?j?
    | -?\b(?:nan|inf)\b | True | False | None""",
    re.VERBOSE,
)
TEXTS = "# the first text of each kind"


def _told(make) -> list[str]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            make()
        except SweepError as error:
            return list(error.problems)
    return ["accepted"]


@mock.patch.object(build, "find_record", functools.cache(build.find_record))
def report(folder: Path) -> str:
    """Return every input with the places and kinds of its faults, and a text of each kind; records are read once."""
    (folder / "x.csv").write_text("0.1\n0.2\n-0.3\n")
    path = folder / "s.toml"

    def load(text: str) -> list[str]:
        path.write_text(text)
        return [each.replace(f"{path}:", "").replace(f"{folder}/", "") for each in _told(lambda: load_spec(path))]

    lists = ("outputs", sorted(VARIABLES)), ("laws", sorted(LAWS)), ("laws", list(LAWS))
    said, texts = [], {}
    for line in GOLDEN.read_text().partition(TEXTS)[0].splitlines():
        if line.startswith("    "):  # what was said before
            continue
        said.append(line)
        if line.startswith("file: "):
            problems = load(eval(line.removeprefix("file: "), NAMES))
        elif edit := re.fullmatch(r"(['\"].*['\"]) -> (['\"].*['\"])", line):
            old, new = map(ast.literal_eval, edit.groups())
            assert old in GOOD
            problems = load(GOOD.replace(old, new, 1))
        else:
            change = eval(f"dict({line})", NAMES)
            sweep = {"scene": "mate2015", "records": PULSE, "laws": "linear"} | change
            problems = _told(lambda sweep=sweep: build_spec(**sweep))
        for problem in problems:
            place, text = re.fullmatch(r"((?:\d+(?::\d+)?: )?(?:[\w.\[\]-]+: )?)(.*)", problem, re.DOTALL).groups()
            for what, names in lists:  # that grow, and no message changes by that
                text = text.replace(", ".join(names), f"ALL {what}")
            template = _VALUES.sub("_", text)
            words, digest = re.findall("[a-z]+", template)[:4], hashlib.sha256(template.encode()).hexdigest()
            kind = " ".join([*words, digest[:3]])
            texts.setdefault(kind, text)
            said.append(f"    {place}{kind}")
    return "\n".join([*said, TEXTS, *(f"    {kind}: {text}" for kind, text in sorted(texts.items())), ""])


if __name__ == "__main__":
    os.environ.pop("POUNDING_SWEEP_RECORDS", None)
    with tempfile.TemporaryDirectory() as where:
        text = report(Path(where))
    (Path(sys.argv[1]) if sys.argv[1:] else GOLDEN).write_text(text)
