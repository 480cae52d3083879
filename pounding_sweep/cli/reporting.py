"""Errors and warnings of a command: one message each on stderr, and the exit code."""

from __future__ import annotations

import os
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

NAME = "pounding-sweep"
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130


@contextmanager
def reporting(out: Path | None = None) -> Iterator[list[str]]:
    """Turn errors into one message and an exit code; gives the list of warnings said so far.

    `out` is the cube of a run, whose finished chunks outlast an interruption.
    """
    from pounding_sweep.errors import InputError, OutputError, PoundingSweepError

    said: list[str] = []

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        text = str(message)
        if text not in said:
            said.append(text)
            say(f"warning: {text}")

    with warnings.catch_warnings():
        warnings.showwarning = show
        try:
            yield said
            sys.stdout.flush()
        except PoundingSweepError as error:
            say(f"error: {error}")
            raise typer.Exit(BAD_INPUT if isinstance(error, InputError | OutputError) else FAILED) from None
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # a second Ctrl-C doesn't wait for the chunks under way
            say(f"interrupted{_kept(out)}")
            raise typer.Exit(INTERRUPTED) from None
        except (typer.Exit, BrokenPipeError):
            raise
        except Exception as error:  # a fault of the package, or of the machine: the traceback is for the report
            traceback.print_exception(error)
            say(f"failed: {type(error).__name__}: {error}{_kept(out)}")
            raise typer.Exit(FAILED) from None


def say(text: str) -> None:
    """Write one message to stderr."""
    print(f"{NAME}: {text}", file=sys.stderr, flush=True)


def parts_folder(out: Path) -> Path:
    """Folder in which a run keeps finished chunks."""
    return Path(os.path.realpath(out.expanduser()) + ".parts")


def _kept(out: Path | None) -> str:
    """Say what an unfinished run leaves behind; nothing for other commands."""
    from pounding_sweep.sweep.store import MANIFEST

    if out is None:
        return ""
    try:
        chunks = len((parts_folder(out) / MANIFEST).read_bytes().splitlines())
    except OSError:
        chunks = 0
    if not chunks:
        return "; nothing was finished yet"
    return f"; {chunks} finished chunks are kept in {out}.parts: running the same command again continues from there"
