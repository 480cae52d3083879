"""The application that commands register on, the arguments they share, and how their errors and warnings are told."""

from __future__ import annotations

import functools
import gc
import inspect
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.text import printable

if TYPE_CHECKING:
    from pounding_sweep.model.laws import Law
    from pounding_sweep.run.execute import Progress
    from pounding_sweep.run.sweep import Sweep

NAME = "pounding-sweep"
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
#: What asks a command to end, each with its default handler.
INTERRUPTS: dict[signal.Signals, Any] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}


#: Warnings of the command that runs, as they were printed.
WARNINGS: list[str] = []


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    if (text := str(message)) not in WARNINGS:
        WARNINGS.append(text)
        say(f"warning: {text}")


@contextmanager
def reporting(out: Path | None = None) -> Iterator[None]:
    """Turn errors into one message and an exit code; `out` is the cube of a run, whose chunks outlast its end."""
    from pounding_sweep.base.errors import ClusterError, PoundingSweepError, RunError, WriteError

    WARNINGS.clear()
    before = _written_at(out)
    with warnings.catch_warnings(), _ended_by_interrupts():
        warnings.showwarning = _show_warning
        try:
            yield
            sys.stdout.flush()
            return
        except (typer.Exit, BrokenPipeError):
            raise
        except (WriteError, RunError, ClusterError) as error:
            text, code = f"failed: {error}", FAILED
        except PoundingSweepError as error:
            text, code = f"error: {error}", BAD_INPUT
        except KeyboardInterrupt:
            text, code = "interrupted", INTERRUPTED
        except OSError as error:
            text, code = f"failed: {error}", FAILED
            if error.filename is None and _stdout_fails():
                text = f"failed: stdout can't be written ({error.strerror}), give it another place"
        except Exception as error:
            if isinstance(error, RuntimeError) and str(error).startswith("NetCDF:"):  # damage that shows late
                text = f"error: values of a netCDF file can't be read ({error}): it is damaged; make it again"
                code = BAD_INPUT
            else:  # a fault of the package, or of the machine: the traceback is for the report
                text, code = f"failed: {type(error).__name__}: {error}", FAILED
                _print("".join(traceback.format_exception(error)).rstrip("\n"))
        say(text if out is None or code == BAD_INPUT else text + _left_by(out, before))
        raise typer.Exit(code) from None


@contextmanager
def _ended_by_interrupts() -> Iterator[None]:
    """Have Ctrl-C, SIGTERM and SIGHUP end the block in order, and one more of them the process at once."""
    # what the process was started to ignore (by `nohup`, or in the background of a script) stays so
    numbers = [number for number, default in INTERRUPTS.items() if signal.getsignal(number) == default]

    def end_in_order(*_: object) -> None:
        for number in numbers:
            signal.signal(number, _end_at_once)
        raise KeyboardInterrupt

    for number in numbers:
        signal.signal(number, end_in_order)
    try:
        yield
    finally:
        for number in numbers:
            if signal.getsignal(number) is end_in_order:  # else the process is about to end
                signal.signal(number, INTERRUPTS[number])


def _end_at_once(*_: object) -> None:
    """End the process without a wait for chunks under way, or for workers."""
    if os.isatty(2):
        with suppress(OSError):
            os.write(2, b"\x1b[?25h\n")  # the display hides the cursor
    os._exit(INTERRUPTED)


def say(text: str) -> None:
    """Write one message to stderr."""
    _print(f"{NAME}: {text}")


def say_laws(laws: Iterable[Law]) -> None:
    """Say which Python files of the user's own were run, and what laws they gave."""
    for law in laws:
        where = f"from {law.source}, Python of your own that was run" if law.source else "of your own"
        say(f"law {law.key!r} {where} (SHA-256 {law.sha256[:12]}): {law.formula}")


def _print(text: str) -> None:
    """Write to stderr, if it can be: a reader that has gone, or its full disk, ends nothing."""
    with suppress(OSError):
        print(printable(text, keep="\n"), file=sys.stderr, flush=True)


def _stdout_fails() -> bool:
    """Whether what was printed can't be written, its reader being there; no more is tried then."""
    try:
        print(flush=True)
    except OSError:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - until the process ends
        return True
    return False


def open_streams() -> None:
    """Have somewhere to write where the process was started without streams (``>&-``), and escape what can't be."""
    for name, mode in {"stdin": "r", "stdout": "w", "stderr": "w"}.items():
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - until the process ends
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # names on a terminal of ASCII


def _left_by(out: Path, before: int | None) -> str:
    """Say what a run that ends early leaves behind; `before` is when the cube was last written before it."""
    from pounding_sweep.resume import parts_folder

    with suppress(OSError):  # the working folder may be gone
        if _written_at(out) not in (None, before):
            return f"; the cube {out} is complete"
        if (parts := parts_folder(out)).is_dir():
            return f"; what is finished is kept in {parts}: running the same command again continues from there"
    return ""


def _written_at(path: Path | None) -> int | None:
    return path.stat().st_mtime_ns if path and path.is_file() else None


app = typer.Typer(
    name=NAME,
    help="Parametric sweeps of seismic pounding between adjacent buildings. Units: kN, t, m, s.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def option(metavar: str, text: str, *names: str, default: Any = None) -> Any:
    """Return an option that takes a value: what stands for it, the help; without it `default`, `...` for an error."""
    return Option(default, *names, metavar=metavar, help=text)


def output(metavar: str, text: str, *, default: Any = None) -> Any:
    """Return the option that names what is written; see `option`."""
    return option(metavar, text, "-o", "--output", default=default)


def flag(name: str, text: str) -> Any:
    """Return an option that is given or not, and its help."""
    return Option(False, name, help=text)


def argument(metavar: str, text: str, *, default: Any = None) -> Any:
    """Return an argument; see `option`."""
    return Argument(default, metavar=metavar, help=text)


SweepFile = Annotated[Path, argument("SWEEP.toml", "Sweep file.", default=...)]
CubeFile = Annotated[Path, argument("CUBE.nc", "Cube made by 'run'.", default=...)]
At = Annotated[
    list[str] | None,
    option("AXIS=VALUE", "Only this value of an axis; repeat for more axes, or values.", "--at", default=...),
]
Quiet = Annotated[bool, Option("--quiet", help="Show no progress.")]
AsJson = Annotated[bool, Option("--json", help="Print one JSON value instead of text.")]
Folders = Annotated[
    list[Path] | None,
    option("FOLDER", "Folder of record files, instead of POUNDING_SWEEP_RECORDS.", "--records", default=...),
]
Workers = Annotated[int | None, option("N", "Threads or processes; one per core by default.", default=...)]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace the output file if it exists.")]
SkipMissing = Annotated[bool, Option("--skip-missing-records", help="Skip records that cannot be found.")]
#: Help of every option that draws: a figure is made again from its data, which are never replaced unasked.
FIGURE_FILE = "PNG, SVG or PDF file; replaced if it exists."


@dataclass
class SweepOptions:
    """Options of the commands that plan a sweep and run all of it."""

    sweep: SweepFile
    workers: Workers = None
    laws: list[str] | None = option(
        "LAW", "Contact law in place of the file's, or FILE.py:NAME; may be repeated.", "--law"
    )
    accuracy: float | None = option("ERROR", "Relative error, 1e-1 to 1e-6, in place of the file's step.")
    folders: Folders = None
    skip_missing: SkipMissing = False

    def load(self) -> Sweep:
        """Read the sweep file, with the laws and the accuracy that were asked for."""
        from pounding_sweep.model.laws import LAW_GROUPS, find_law
        from pounding_sweep.request.spec import with_accuracy
        from pounding_sweep.run.sweep import load_sweep

        laws = [name if name in LAW_GROUPS else find_law(name) for name in self.laws or ()]
        loaded = load_sweep(self.sweep, skip_missing_records=self.skip_missing, folders=self.folders, laws=laws or None)
        say_laws(loaded.spec.user_laws)
        return loaded if self.accuracy is None else loaded.from_spec(with_accuracy(loaded.spec, self.accuracy))


@dataclass
class ScenarioOptions:
    """Options that choose one scenario of a sweep, or of a cube, which carries its sweep."""

    sweep: Path = argument("SWEEP.toml|CUBE.nc", "Sweep file, or a cube made by 'run'.", default=...)
    law: str | None = option("LAW", "Contact law, or FILE.py:NAME.")
    gap: float | None = option("M", "Gap of every pair (m).")
    stiffness: float | None = option(
        "K", "Contact stiffness (kN/m of laws with force ~ d, kN/m^1.5 with force ~ d^1.5)."
    )
    stiffness_factor: float | None = option("X", "Factor on the scene's reference contact stiffness, instead.")
    restitution: float | None = option("E", "Coefficient of restitution.")
    record: str | None = option("NAME", "One of the sweep's records.")
    scale: float | None = option("X", "Factor on the record.")
    case: int | None = option("N", "Listed case, from 1.")
    at: list[str] | None = option(
        "AXIS=VALUE",
        "This value of any axis, such as period_factor_left, damping_ratio or pga; gap once per pair, or once.",
    )
    output_step: float | None = option(
        "S",
        "Largest time (s) between instants of the histories; by default the sweep's step, or as short as it "
        "takes to show every peak that is reported.",
    )
    folders: Folders = None
    skip_missing: SkipMissing = False


def command(name: str, on: typer.Typer = app) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a command; a parameter that is a dataclass stands for its fields, an option each."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        parameters, sets = [], dict[str, Any]()
        for parameter in inspect.signature(function, eval_str=True).parameters.values():
            if is_dataclass(kind := parameter.annotation):
                sets[parameter.name] = inspect.signature(kind, eval_str=True).parameters, kind  # type: ignore[arg-type]
            fields = sets[parameter.name][0].values() if parameter.name in sets else [parameter]
            parameters += [field.replace(kind=field.KEYWORD_ONLY) for field in fields]

        @functools.wraps(function)
        def call(**values: Any) -> None:
            for key, (fields, kind) in sets.items():
                values[key] = kind(**{name: values.pop(name) for name in fields})
            with reporting():
                function(**values)

        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return on.command(name)(call)

    return register


def numbers_of(text: str, flag: str) -> list[float]:
    """Read numbers separated by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{flag} {text!r} is no list of numbers; give them as 0.2,0.6") from None


@contextmanager
def progress_display(quiet: bool = False) -> Iterator[Progress]:
    """Show progress on stderr while the block runs, unless `quiet`."""
    from pounding_sweep.cli.progress import ProgressDisplay
    from pounding_sweep.run.execute import Progress

    with closing(Progress() if quiet else ProgressDisplay()) as progress:
        yield progress


def axis_values(texts: list[str] | None) -> dict[str, list[str]]:
    """Read texts AXIS=VALUE, of which several may be of one axis; raises `InputError` for any other text."""
    values: dict[str, list[str]] = {}
    for text in texts or ():
        axis, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--at {text!r} won't do; give AXIS=VALUE, such as gap=0.01")
        values.setdefault(axis.strip(), []).append(value.strip())
    return values


def main() -> None:
    """Run the command line of this process and leave with its exit code."""
    gc.set_threshold(50_000, 20, 100)  # loading modules makes many objects, and nearly all of them stay
    open_streams()
    app(prog_name=NAME)


def _print_version(wanted: bool) -> None:
    """Print the version and leave, if `wanted`."""
    if wanted:
        from importlib.metadata import version

        print(f"{NAME} {version(NAME)}")
        raise typer.Exit


@app.callback()
def _root(
    _version: Annotated[
        bool, Option("--version", is_eager=True, callback=_print_version, help="Print the version and leave.")
    ] = False,
) -> None: ...
