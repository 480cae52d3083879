"""What kernels take to compile: ``python -m benchmarks.compiling`` prints CPU seconds beside what was estimated.

Of rows of several sizes, or of the one that is given by the storeys of its buildings: ``3,3,3``.

Measured in a process of its own with an empty cache, beside a plain function that numba compiles in the same process,
as `STATEMENTS` lines of arithmetic: the ratio is the same on other machines, more or less.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

import pounding_sweep as ps
from pounding_sweep.engine.compile import CACHE_VARIABLE, COMPILING, compiling_parts, compiling_seconds, get_kernel
from pounding_sweep.engine.row_kernel import Numerics, kernel_shape
from pounding_sweep.kernel.spec import KernelSpec, from_json, to_json
from pounding_sweep.model.laws import LAWS
from pounding_sweep.variables.registry import DEFAULT_OUTPUTS, VARIABLES, reducers_for

#: Lines of the plain function.
STATEMENTS = 200
#: Outputs that kernels are compiled for, by what the table calls them.
OUTPUTS = {"few": ("displacement_max", "impact_force_max"), "default": DEFAULT_OUTPUTS, "all": tuple(VARIABLES)}
#: Storeys of the buildings of a row.
ROWS = ((1, 1), (2, 2), (3, 3, 3), (5, 5, 5), (25, 25))


def quickstart() -> list[KernelSpec]:
    """Return the kernels of the sweep that a newcomer runs first."""
    return ps.load_sweep("sweeps/quickstart.toml").plan().shapes()


def kernel(
    storeys: Sequence[int], method: str, law: str, outputs: Sequence[str], strength: float = np.inf
) -> KernelSpec:
    """Return the kernel of a row, whose storeys yield at a finite strength."""
    sizes = enumerate(storeys)
    buildings = [ps.Building(f"b{i}", [100.0] * n, [1e5] * n, yield_strengths=[strength] * n) for i, n in sizes]
    row = ps.Scene(buildings, gaps=[0.01] * (len(buildings) - 1))
    return kernel_shape(row, LAWS[law], Numerics(method, 1e-3), reducers_for(outputs))


def measure(shapes: Sequence[KernelSpec]) -> tuple[float, list[float]]:
    """CPU seconds (s) of the plain function and of each kernel, in a process of its own with an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", "from benchmarks import compiling; compiling.tell()"],
            input=json.dumps([to_json(shape) for shape in shapes]),
            env={**os.environ, CACHE_VARIABLE: folder},
            check=True,
            capture_output=True,
            text=True,
        )
    plain, *each = json.loads(done.stdout)
    return plain, each


def over_plain(shapes: Sequence[KernelSpec]) -> float:
    """CPU seconds of kernels together over those of the plain function."""
    plain, each = measure(shapes)
    return sum(each) / plain


def tell() -> None:
    """Compile what standard input names; print the CPU seconds, the plain function first."""
    from numba import njit

    shapes = [from_json(item) for item in json.load(sys.stdin)]
    njit("float64(float64)")(_same)  # what numba loads at its first use is no part of it
    before, each = _taken(_compile_plain), [_taken(partial(get_kernel, shape)) for shape in shapes]
    print(json.dumps([0.5 * (before + _taken(_compile_plain)), *each]))  # a machine's speed may change meanwhile


def _same(x: float) -> float:
    return x


def _taken(job: Callable[[], object]) -> float:
    started = time.process_time()
    job()
    return time.process_time() - started


def _compile_plain() -> None:
    from numba import njit

    lines = [f"    x{i + 1} = x{i} * a[{i % 64}] + y / (1.0 + x{i} * x{i})" for i in range(STATEMENTS)]
    names: dict[str, Callable[..., float]] = {}
    exec("\n".join(["def plain(a, y):", "    x0 = y", *lines, f"    return x{STATEMENTS}"]), names)
    njit("float64(float64[::1], float64)")(names["plain"])


def _table(rows: Sequence[tuple[int, ...]]) -> Iterator[tuple[str, KernelSpec]]:
    for storeys in rows:
        for method in ("rk4", "newmark", "exact"):
            yield f"{storeys} {method} none default", kernel(storeys, method, "none", DEFAULT_OUTPUTS)
            for name, outputs in OUTPUTS.items():
                yield f"{storeys} {method} hertz_damped {name}", kernel(storeys, method, "hertz_damped", outputs)
            for law in ("none", "hertz_damped"):
                shape = kernel(storeys, method, law, DEFAULT_OUTPUTS, strength=100.0)
                yield f"{storeys} {method} {law} default, yielding", shape


def main() -> None:
    """Print the table, and what `COMPILING` would be by it."""
    rows = [tuple(map(int, text.split(","))) for text in sys.argv[1:]] or ROWS
    names, shapes = zip(*_table(rows), strict=True)
    plain, seconds = measure(shapes)
    print(f"plain function of {STATEMENTS} lines: {plain:.2f} s of CPU time")
    for name, shape, taken in zip(names, shapes, seconds, strict=True):
        print(f"{name:50}{taken:6.2f} s, estimated {compiling_seconds(shape.pieces):5.2f} s")
    if rows != ROWS:
        return
    counts = [[Counter(compiling_parts(piece)) for piece in shape.pieces] for shape in shapes]
    parts = np.array([[sum(each[name] for each in pieces) for name in COMPILING] for pieces in counts], float)
    weights = 1.0 / np.array(seconds)
    fitted = np.linalg.lstsq(parts * weights[:, None], np.ones(len(shapes)), rcond=None)[0]
    print("fitted:", ", ".join(f"{name} {value:.4f}" for name, value in zip(COMPILING, fitted, strict=True)))


if __name__ == "__main__":
    main()
