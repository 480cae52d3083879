"""The gallery: every figure of the registry, drawn by the commands that its page shows.

``python docs/gallery.py`` runs small sweeps on El Centro and draws all pictures into ``docs/_static/gallery``; with
names of figures, only those. The page itself is written at every build from the pictures that are there.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from pounding_sweep.figures import FIGURES, Kind
from pounding_sweep.records import RECORDS_VARIABLE

DOCS = Path(__file__).parent
PICTURES = DOCS / "_static" / "gallery"
#: Sweep files and other input that the commands name.
SWEEPS = (
    *(
        DOCS.parent / "sweeps" / f"{name}.toml"
        for name in (
            "quickstart",
            "period_ratio",
            "what_matters",
            "yielding",
            "isolated",
            "ductility",
            "frames_and_walls",
        )
    ),
    *sorted((DOCS / "gallery_sweeps").iterdir()),
)


@dataclass(frozen=True)
class Entry:
    """One picture of the gallery."""

    key: str  # A key of `FIGURES`, or "animation"
    #: arguments of ``pounding-sweep``, in order; the last draws the picture, unless `code` does
    commands: tuple[str, ...]
    picture: str  # file that the last command writes
    about: str = ""  # what it shows, where that is not the figure's own title
    code: str = ""  # python that draws the picture from what the commands wrote
    elsewhere: bool = False  # the picture is made with another page of the documentation and only shown here

    @property
    def title(self) -> str:
        """What it shows."""
        return self.about or FIGURES[self.key].title if self.key in FIGURES else "the row in motion, impacts marked"

    @property
    def place(self) -> Path:
        """The picture as it is kept."""
        return (PICTURES.parent if self.elsewhere else PICTURES) / self.picture


_QUICK = "run quickstart.toml -o quickstart.nc"
_PERIODS = "run period_ratio.toml -o period_ratio.nc"
_DESIGN = "run what_matters.toml -o what_matters.nc"
_FRAMES = "run frames_and_walls.toml -o frames.nc"
_SUITE = "run suite.toml -o suite.nc"
_ONE = "simulate quickstart.toml -o one.nc --law hertz_damped --gap 0.006"
_YIELDING = "simulate yielding.toml -o yielding.nc --law kelvin_voigt --gap 0.01"
_LOOPS = """\
import pounding_sweep as ps
from pounding_sweep.figures import plot
from pounding_sweep.run.cyclic import fema_461

flag = {"law": "flag", "beta": 0.8}
wall = ps.Building("wall", [100.0], [4e4], yield_strengths=[200.0], hardening=0.05, hysteresis=flag)
plot(ps.cyclic_test(wall, fema_461(0.03)), "loops", "loops.png", dpi=100)
"""
_PUSHOVER = """\
import numpy as np
import pounding_sweep as ps
from pounding_sweep.figures import plot

drift = np.linspace(0.0, 150.0, 151)
shear = 300.0 * np.tanh(drift / 8.0) * (0.2 + 0.8 / (1.0 + (drift / 90.0) ** 6))
curve = np.column_stack([drift, shear])
np.savetxt("pushover.csv", curve, delimiter=",", header="drift (mm),shear (kN)", comments="")
plot(ps.backbone_from_pushover("pushover.csv").curve, "pushover", "pushover.png", dpi=100)
"""
_SPECTRA = """\
import pounding_sweep as ps
from pounding_sweep.analysis import response_spectrum
from pounding_sweep.figures import plot

spectra = response_spectrum(ps.find_record("el_centro"), damping_ratio=[0.02, 0.05, 0.1])
plot(spectra, "response-spectra", "response_spectra.png", dpi=100)
"""


#: What a figure is drawn from where nothing else is said, by its source.
_RUNS = {"cube": _QUICK, "design": _DESIGN, "histories": _ONE}
#: Figures drawn from something else, or of one value of an axis: commands and options.
_OTHERS = {
    "energy-budget": (_SUITE, " --at record=synthetic-1 --at scale=3"),
    "fragility": (_SUITE, ""),
    "hysteresis": (_YIELDING, ""),
    "incremental": (_SUITE, ""),
    "modes": (_FRAMES, ""),
    "map": (_PERIODS, " --value drift_max_ratio"),
    "profiles": (_SUITE, " --at scale=2"),
    **dict.fromkeys(("closing", "force-penetration", "phase"), (_ONE, " --start 2 --end 5")),
}
#: Figures that other commands draw.
_OWN = (
    Entry("response-spectra", (), "response_spectra.png", code=_SPECTRA),
    Entry("loops", (), "loops.png", code=_LOOPS),
    Entry("pushover", (), "pushover.png", code=_PUSHOVER),
    Entry("ground-motion", ("records plot el_centro -o ground_motion.png",), "ground_motion.png"),
    Entry(
        "work-precision",
        ("tradeoff quickstart.toml --plot work_precision.png",),
        "work_precision.png",
        elsewhere=True,
    ),
    Entry(
        "gap-for-probability",
        (
            "run gaps.toml -o gaps.nc",
            "compare gaps.nc --what gap-for-probability --given 0.2 --given 0.4 --hazard site.csv -o gaps",
            "plot gaps/gap-for-probability.nc gap-for-probability -o gap_for_probability.png",
        ),
        "gap_for_probability.png",
    ),
    Entry("stability-map", ("extremes --plot stability_map.png",), "stability_map.png", elsewhere=True),
)


def _entry(kind: Kind) -> Entry:
    """Return the entry of a figure; by default `plot` draws it from what the command of its source wrote."""
    for own in _OWN:
        if own.key == kind.key:
            return own
    run, options = _OTHERS.get(kind.key) or (_RUNS[kind.source], "")
    data, picture = shlex.split(run)[3], f"{kind.key.replace('-', '_')}.png"
    return Entry(kind.key, (run, f"plot {data} {kind.key} -o {picture}{options}"), picture)


ENTRIES: tuple[Entry, ...] = (
    *map(_entry, FIGURES.values()),
    Entry(
        "closing",
        (
            "simulate isolated.toml -o isolated.nc --law kelvin_voigt --gap 0.1 --scale 2",
            "plot isolated.nc closing -o moat.png --end 12",
        ),
        "moat.png",
        "an isolated building in its moat: displacement of the floor above the isolators against both walls",
    ),
    Entry(
        "map",
        (
            "run ductility.toml -o ductility.nc",
            "plot ductility.nc map -o ductility.png --value ductility_max --at law=kelvin_voigt",
        ),
        "ductility.png",
    ),
    Entry(
        "sensitivity",
        (_QUICK, "plot quickstart.nc sensitivity -o tornado.png"),
        "tornado.png",
        "which axes of a grid matter: main effects and shares of the variance",
    ),
    Entry("animation", ("animate quickstart.toml -o row.gif --gap 0.006 --frames 30",), "row.gif"),
)


def draw(keys: list[str]) -> None:
    """Run the commands of entries, each command once, and keep the pictures."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for sweep in SWEEPS:
            shutil.copy(sweep, folder)
        done = set()
        for entry in ENTRIES:
            if entry.elsewhere or (keys and entry.key not in keys):
                continue
            for command in entry.commands:
                if command not in done:
                    small = ["--dpi", "100"] if command.startswith("plot") else []
                    _python(["-m", "pounding_sweep", *shlex.split(command), *small], folder)
                    done.add(command)
            if entry.code:
                _python(["-c", entry.code], folder)
            _keep(Path(folder) / entry.picture, entry.place)
            print(entry.place)


def _python(words: list[str], folder: str) -> None:
    """Run Python in a folder, with no records but those of the package."""
    env = {name: value for name, value in os.environ.items() if name != RECORDS_VARIABLE}
    subprocess.run([sys.executable, *words], cwd=folder, env=env, check=True, stdout=subprocess.DEVNULL)


def _keep(made: Path, place: Path) -> None:
    """Keep a picture; a PNG in 256 colours, which is all it has but for the smoothing of its edges."""
    if made.suffix == ".png":
        with Image.open(made) as picture:
            picture.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(place, optimize=True)
    else:
        shutil.copy(made, place)


def gallery_page() -> str:
    """Return the page as Markdown, of the pictures that are there."""
    lines = [
        "# Gallery",
        "",
        "Every figure of the package, with the commands that drew it. `pounding-sweep plot --list` lists all of them, "
        "`pounding-sweep plot CUBE.nc` says which of them a cube allows. `--at AXIS=VALUE` draws another "
        "value of an axis than the middle one at which floors touch, `--x AXIS` draws along another axis. "
        "From Python, each is a function of a dataset that returns a matplotlib figure, "
        "`ps.figures.force_gap(cube)` for `force-gap`, see [`pounding_sweep.figures`](../api).",
        "",
        "The commands use [files of `sweeps/`](../sweep_file), `gaps.toml` and `site.csv` of "
        "[gaps for a probability](../comparisons), and this `suite.toml`:",
        "",
        "```{literalinclude} ../gallery_sweeps/suite.toml",
        ":language: toml",
        "```",
        "",
    ]
    for entry in ENTRIES:
        if entry.place.exists():
            title = entry.title[0].upper() + entry.title[1:]
            heading = entry.picture.partition(".")[0] if entry.about else entry.key
            lines += [f"## {heading}", "", f"{title}.", ""]
            if entry.commands:
                lines += ["```sh", *(f"pounding-sweep {command}" for command in entry.commands), "```", ""]
            lines += ["```python", *entry.code.rstrip().splitlines(), "```", ""] if entry.code else []
            lines += [f"![{title}](../{entry.place.relative_to(DOCS).as_posix()})", ""]
    return "\n".join(lines)


if __name__ == "__main__":
    unknown = set(sys.argv[1:]) - {entry.key for entry in ENTRIES}
    if unknown:
        sys.exit(f"unknown: {', '.join(sorted(unknown))}; valid: {', '.join(entry.key for entry in ENTRIES)}")
    draw(sys.argv[1:])
