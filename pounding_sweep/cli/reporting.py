"""Errors and warnings of a command: one message each on stderr, and the exit code."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import typer

from pounding_sweep.texts import printable

NAME = "pounding-sweep"
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130


@contextmanager
def reporting(out: Path | None = None) -> Iterator[list[str]]:
    """Turn errors into one message and an exit code; gives the list of warnings said so far.

    `out` is the cube of a run, whose finished chunks outlast an interruption. SIGTERM is one too.
    """
    from pounding_sweep.errors import ClusterError, InputError, OutputError, PoundingSweepError, RunError, WriteError

    said: list[str] = []

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        text = str(message)
        if text not in said:
            said.append(text)
            say(f"warning: {text}")

    with warnings.catch_warnings(), _ended_by_sigterm():
        warnings.showwarning = show
        try:
            yield said
            sys.stdout.flush()
        except (WriteError, RunError, ClusterError) as error:
            say(f"failed: {error}{_kept(out)}")
            raise typer.Exit(FAILED) from None
        except PoundingSweepError as error:
            say(f"error: {error}")
            raise typer.Exit(BAD_INPUT if isinstance(error, InputError | OutputError) else FAILED) from None
        except KeyboardInterrupt:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda *_: os._exit(INTERRUPTED))  # it doesn't wait for the chunks under way
            say(f"interrupted{_kept(out)}")
            raise typer.Exit(INTERRUPTED) from None
        except (typer.Exit, BrokenPipeError):
            raise
        except Exception as error:
            # values of a cube are read where they are used, so that damage may show late
            if isinstance(error, RuntimeError) and str(error).startswith("NetCDF:"):
                say(f"error: values of a netCDF file can't be read ({error}): it is damaged; make it again")
                raise typer.Exit(BAD_INPUT) from None
            if isinstance(error, OSError) and error.filename is None and _stdout_fails():
                say(f"failed: stdout can't be written ({error.strerror}), give it another place{_kept(out)}")
                raise typer.Exit(FAILED) from None
            # a fault of the package, or of the machine: the traceback is for the report
            _print("".join(traceback.format_exception(error)).rstrip("\n"))
            say(f"failed: {type(error).__name__}: {error}{_kept(out)}")
            raise typer.Exit(FAILED) from None


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """Have SIGTERM do what Ctrl-C does, unless the process was started to ignore it; only a main thread can."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGTERM) is signal.default_int_handler:  # else a second one ends the process at once
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def say(text: str) -> None:
    """Write one message to stderr."""
    _print(f"{NAME}: {text}")


def _print(text: str) -> None:
    """Write to stderr, if it can be: a reader that has gone, or its full disk, ends nothing."""
    with suppress(OSError):
        print(printable(text, keep="\n"), file=sys.stderr, flush=True)


def _stdout_fails() -> bool:
    """Whether what was printed can't be written, its reader being there; no more is tried then."""
    try:
        sys.stdout.flush()
        print(flush=True)  # where nothing is buffered, nothing was left to flush
    except OSError:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - until the process ends
        return True
    return False


def open_streams() -> None:
    """Have somewhere to write where the process was started without stdout or stderr (``>&-``).

    Else a file that is opened later would have their numbers, and be written into by who prints to them.
    """
    for number, (name, mode) in enumerate({"stdin": "r", "stdout": "w", "stderr": "w"}.items()):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, os.O_RDWR)
            if handle == number:
                os.set_inheritable(handle, True)  # for processes that are started from here
            else:
                os.dup2(handle, number)
                os.close(handle)
            setattr(sys, name, os.fdopen(number, mode))


def _kept(out: Path | None) -> str:
    """Say what an unfinished run leaves behind; nothing for other commands."""
    from pounding_sweep.errors import OutputError
    from pounding_sweep.sweep.store import ChunkStore, parts_folder

    if out is None or not os.path.isdir(parts := parts_folder(out)):
        return ""
    try:
        chunks = len(ChunkStore(parts, "").completed())
    except OutputError as error:
        return f"; what is finished is kept, but {error}"
    if not chunks:
        return "; nothing was finished yet"
    return f"; {chunks} finished chunks are kept in {parts}: running the same command again continues from there"
