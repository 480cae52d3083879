"""The application that commands register on, and the arguments they share."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from pounding_sweep.base.errors import InputError
from pounding_sweep.cli.reporting import NAME, open_streams, say_laws

if TYPE_CHECKING:
    from pounding_sweep.run.sweep import Sweep

app = typer.Typer(
    name=NAME,
    help="Parametric sweeps of seismic pounding between adjacent buildings. Units: kN, t, m, s.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

SweepFile = Annotated[Path, Argument(metavar="SWEEP.toml", help="Sweep file.", show_default=False)]
CubeFile = Annotated[Path, Argument(metavar="CUBE.nc", help="Cube made by 'run'.", show_default=False)]
At = Annotated[
    list[str] | None,
    Option("--at", metavar="AXIS=VALUE", help="Only this value of an axis; repeat for more axes, or values."),
]
Intensity = Annotated[
    str | None,
    Option(
        metavar="MEASURE",
        help="Of the ground motion: pga, pgv, sa(PERIOD), sa(BUILDING) at its first period, or sa at those of all; "
        "what the records are scaled to by default.",
    ),
]
Quiet = Annotated[bool, Option("--quiet", help="Show no progress.")]
AsJson = Annotated[bool, Option("--json", help="Print one JSON value instead of text.")]
Folders = Annotated[
    list[Path] | None,
    Option("--records", metavar="FOLDER", help="Folder of record files, instead of POUNDING_SWEEP_RECORDS."),
]
Workers = Annotated[int | None, Option(metavar="N", help="Threads or processes; one per core by default.")]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace the output file if it exists.")]
SkipMissing = Annotated[bool, Option("--skip-missing-records", help="Skip records that cannot be found.")]
#: Arguments of comparisons by the option that gives them.
ARGUMENTS = {
    "--reference": "reference",
    "--event": "event",
    "--level": "level",
    "--quantile": "quantiles",
    "--probability": "probabilities",
    "--intensity": "intensity",
    "--given": "levels",
    "--hazard": "hazard",
    "--years": "years",
    "--one-dispersion": "one_dispersion",
    "--records": "folders",
}
#: Help of every option that draws: a figure is made again from its data, which are never replaced unasked.
FIGURE_FILE = "PNG, SVG or PDF file; replaced if it exists."


@dataclass
class SweepOptions:
    """Options of the commands that plan a sweep and run all of it."""

    sweep: SweepFile
    workers: Workers = None
    laws: Annotated[
        list[str] | None,
        Option("--law", metavar="LAW", help="Contact law in place of the file's, or FILE.py:NAME; may be repeated."),
    ] = None
    accuracy: Annotated[
        float | None, Option(metavar="ERROR", help="Relative error, 1e-2 to 1e-6, in place of the file's step.")
    ] = None
    folders: Folders = None
    skip_missing: SkipMissing = False

    def load(self) -> Sweep:
        """Read the sweep file, with the laws and the accuracy that were asked for."""
        from pounding_sweep.model.laws import LAW_GROUPS, find_law
        from pounding_sweep.run.sweep import load_sweep
        from pounding_sweep.spec.spec import with_accuracy

        laws = [name if name in LAW_GROUPS else find_law(name) for name in self.laws or ()]
        loaded = load_sweep(
            self.sweep, skip_missing_records=self.skip_missing, folders=self.folders or None, laws=laws or None
        )
        say_laws(loaded.spec.own_laws)
        return loaded if self.accuracy is None else loaded.from_spec(with_accuracy(loaded.spec, self.accuracy))


@dataclass
class ScenarioOptions:
    """Options that choose one scenario of a sweep."""

    sweep: SweepFile
    law: Annotated[str | None, Option(metavar="LAW", help="Contact law, or FILE.py:NAME.")] = None
    gap: Annotated[float | None, Option(metavar="M", help="Gap of every pair (m).")] = None
    stiffness: Annotated[
        float | None,
        Option(metavar="K", help="Contact stiffness (kN/m of laws with force ~ d, kN/m^1.5 with force ~ d^1.5)."),
    ] = None
    stiffness_factor: Annotated[
        float | None, Option(metavar="X", help="Factor on the scene's reference contact stiffness, instead.")
    ] = None
    restitution: Annotated[float | None, Option(metavar="E", help="Coefficient of restitution.")] = None
    record: Annotated[str | None, Option(metavar="NAME", help="One of the sweep's records.")] = None
    scale: Annotated[float | None, Option(metavar="X", help="Factor on the record.")] = None
    case: Annotated[int | None, Option(metavar="N", help="Listed case, from 1.")] = None
    at: Annotated[
        list[str] | None,
        Option(
            metavar="AXIS=VALUE",
            help="This value of any axis, such as period_factor_left, damping_ratio or pga; gap once per pair, or "
            "once.",
        ),
    ] = None
    output_step: Annotated[
        float | None,
        Option(
            metavar="S",
            help="Largest time (s) between instants of the histories; by default the sweep's step, or as short as it "
            "takes to show every peak that is reported.",
        ),
    ] = None
    folders: Folders = None
    skip_missing: SkipMissing = False


def command(name: str, **settings: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a command; a parameter that is a dataclass stands for its fields, an option each."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        parameters, sets = [], dict[str, Any]()
        for parameter in inspect.signature(function, eval_str=True).parameters.values():
            kind = parameter.annotation
            if not (isinstance(kind, type) and is_dataclass(kind)):
                parameters.append(parameter.replace(kind=parameter.KEYWORD_ONLY))
                continue
            sets[parameter.name] = kind
            inner = inspect.signature(kind, eval_str=True).parameters.values()
            parameters += [each.replace(kind=each.KEYWORD_ONLY) for each in inner]

        @functools.wraps(function)
        def call(**values: Any) -> None:
            for key, kind in sets.items():
                values[key] = kind(**{each.name: values.pop(each.name) for each in fields(kind)})
            function(**values)

        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return app.command(name, **settings)(call)

    return register


def numbers_of(text: str, option: str, form: str) -> list[float]:
    """Read numbers separated by commas; `form` says what the option takes, with an example."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} {text!r} is no list of {form}") from None


def axis_values(given: list[str]) -> dict[str, list[str]]:
    """Read texts AXIS=VALUE, of which several may be of one axis; raises `InputError` for any other text."""
    values: dict[str, list[str]] = {}
    for text in given:
        axis, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--at {text!r} won't do; give AXIS=VALUE, such as gap=0.01")
        values.setdefault(axis.strip(), []).append(value.strip())
    return values


def main() -> None:
    """Run the command line of this process and leave with its exit code."""
    open_streams()
    app(prog_name=NAME)


def _print_version(wanted: bool) -> None:
    """Print the version and leave, if `wanted`."""
    if wanted:
        from importlib.metadata import PackageNotFoundError, version

        try:
            print(f"{NAME} {version(NAME)}")
        except PackageNotFoundError:  # run from a source tree that is not installed
            print(f"{NAME} (version unknown: not installed)")
        raise typer.Exit


@app.callback()
def _root(
    _version: Annotated[
        bool, Option("--version", is_eager=True, callback=_print_version, help="Print the version and leave.")
    ] = False,
) -> None: ...
