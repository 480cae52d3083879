"""The way of one scenario through the package: ``python -m benchmarks.walk``.

Runs one scenario of ``sweeps/quickstart.toml``, from the file to netCDF, in this thread, its kernels compiled before.
Prints how many functions of the package are called, in how many files, and how often a reader who follows them in the
order in which each is first called returns to a file already left.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pounding_sweep as ps

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(ps.__file__).resolve().parent


def called_by(action: Callable[[], Any]) -> list[CodeType]:
    """Return the functions of the package that `action` calls, in the order of their first call."""
    found: dict[CodeType, None] = {}
    inside = str(PACKAGE)

    def note(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(inside) and not code.co_name.startswith("<"):
            found.setdefault(code)

    sys.setprofile(note)
    try:
        action()
    finally:
        sys.setprofile(None)
    return list(found)


def one_scenario(folder: Path) -> Path:
    """Write the quickstart with one value on each of its axes."""
    lines = (ROOT / "sweeps" / "quickstart.toml").read_text(encoding="utf-8").splitlines()
    one = {"laws": '["hertz_damped"]', "gaps": "[0.004]", "stiffness_factors": "[1.0]", "restitutions": "[0.6]"}
    kept = [f"{key} = {one[key]}" if (key := line.partition(" =")[0]) in one else line for line in lines]
    path = folder / "one.toml"
    path.write_text("\n".join(kept) + "\n", encoding="utf-8")
    return path


def main() -> None:
    """Walk, and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.walk", description=__doc__)
    parser.add_argument("--files", action="store_true", help="list the files, and how many functions of each")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = one_scenario(folder)

        def walk(out: str) -> Callable[[], Any]:
            return lambda: ps.load_sweep(path).run(folder / out, scheduler="synchronous").close()

        walk("first.nc")()
        called = called_by(walk("second.nc"))
    files: dict[str, int] = {}
    returns, at = 0, ""
    for code in called:
        if code.co_filename != at:
            returns += code.co_filename in files
            at = code.co_filename
        files[at] = files.get(at, 0) + 1
    if arguments.files:
        for file, count in files.items():
            print(f"{count:4d} {Path(file).relative_to(PACKAGE)}")
    print(f"{len(called)} functions in {len(files)} files, {returns} returns to a file already left")


if __name__ == "__main__":
    main()
