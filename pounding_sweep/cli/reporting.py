"""Errors and warnings of a command: one message each on stderr, and the exit code."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from pounding_sweep.base.text import printable

if TYPE_CHECKING:
    from pounding_sweep.model.laws import Law

NAME = "pounding-sweep"
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
#: What asks a command to end, each with its default handler.
INTERRUPTS: dict[signal.Signals, Any] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}


@contextmanager
def reporting(out: Path | None = None) -> Iterator[list[str]]:
    """Turn errors into one message and an exit code; gives the list of warnings said so far."""
    # `out` is the cube of a run, whose finished chunks outlast an interruption
    from pounding_sweep.base.errors import ClusterError, PoundingSweepError, RunError, WriteError

    said: list[str] = []
    left = _left_by(out)

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        text = str(message)
        if text not in said:
            said.append(text)
            say(f"warning: {text}")

    with warnings.catch_warnings(), _ended_by_interrupts():
        warnings.showwarning = show
        try:
            yield said
            sys.stdout.flush()
        except (WriteError, RunError, ClusterError) as error:
            say(f"failed: {error}{left()}")
            raise typer.Exit(FAILED) from None
        except PoundingSweepError as error:
            say(f"error: {error}")
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            say(f"interrupted{left()}")
            raise typer.Exit(INTERRUPTED) from None
        except (typer.Exit, BrokenPipeError):
            raise
        except Exception as error:
            # values of a cube are read where they are used, so that damage may show late
            if isinstance(error, RuntimeError) and str(error).startswith("NetCDF:"):
                say(f"error: values of a netCDF file can't be read ({error}): it is damaged; make it again")
                raise typer.Exit(BAD_INPUT) from None
            if isinstance(error, OSError) and error.filename is None and _stdout_fails():
                say(f"failed: stdout can't be written ({error.strerror}), give it another place{left()}")
                raise typer.Exit(FAILED) from None
            # a fault of the package, or of the machine: the traceback is for the report
            _print("".join(traceback.format_exception(error)).rstrip("\n"))
            say(f"failed: {type(error).__name__}: {error}{left()}")
            raise typer.Exit(FAILED) from None


@contextmanager
def _ended_by_interrupts() -> Iterator[None]:
    """Have Ctrl-C, SIGTERM and SIGHUP end the block in order, and one more of them the process at once."""
    # what the process was started to ignore (by `nohup`, or in the background of a script) stays so, as does what has a
    # handler already. Only a main thread can be interrupted.
    in_main = threading.current_thread() is threading.main_thread()
    numbers = [number for number, default in INTERRUPTS.items() if in_main and signal.getsignal(number) == default]

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
    if os.isatty(2) and os.environ.get("TERM", "dumb") != "dumb":
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


def _left_by(out: Path | None) -> Callable[[], str]:
    """Return what says, when a run ends early, what it leaves behind; nothing for other commands."""
    from pounding_sweep.base.errors import InputError, OutputError
    from pounding_sweep.base.files import absolute

    try:
        target = out and absolute(out)  # now: the working folder may be removed meanwhile
    except (InputError, OSError, ValueError):  # said by who writes there
        target = None
    before = target and _stamp(target)

    def left() -> str:
        if target is None:
            return ""
        from pounding_sweep.resume.checkpoint import ChunkStore, parts_folder

        parts = parts_folder(target)
        if _stamp(target) not in (None, before):
            more = f"; {parts} is left: remove it, or run again with --overwrite where scenarios have no result"
            return f"; the cube {out} is complete{more if parts.is_dir() else ''}"
        if not parts.is_dir():
            return ""
        try:
            chunks = len(ChunkStore(parts, "").completed())
        except OutputError as error:
            return f"; what is finished is kept, but {error}"
        if not chunks:
            return "; nothing was finished yet"
        return f"; {chunks} finished chunks are kept in {parts}: running the same command again continues from there"

    return left


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return what differs between a file and the one that replaced it; None where there is none."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size
