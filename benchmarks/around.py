"""What a sweep costs around its kernels: ``python -m benchmarks.around [SCENARIOS ...]``.

Plan, chunks, workers, audit and cube of sweeps like ``sweeps/million.toml``, its kernels replaced by ones that hand out
the results of one real scenario again and again. Prints processor time per scenario, beside that which the netCDF
library alone takes to write the same cube from memory, and beside that of the kernel.
"""

from __future__ import annotations

import argparse
import math
import resource
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import netCDF4
import numpy as np

import pounding_sweep as ps
from benchmarks.million import SWEEP
from pounding_sweep.base.text import bytes_text
from pounding_sweep.engine import compile
from pounding_sweep.kernel.spec import LANES, PARAMETERS, KernelSpec
from pounding_sweep.run.sweep import load_sweep

#: Where inputs and results stand among what a kernel is given.
INPUTS, RESULTS = (list(PARAMETERS).index(name) for name in ("inputs", "results"))
#: Groups of lanes by which the real kernels are timed.
GROUPS = 64
#: Scenarios of the sweeps that are timed where none are given.
SIZES = (20_000, 200_000)
#: Times that each sweep is run; the least time counts.
ROUNDS = 5
#: Bytes of a variable that the library is given at a time.
SLAB_BYTES = 2**23


class Replay:
    """Kernels that hand out the results of a scenario that real ones ran."""

    def __init__(self) -> None:
        self.seconds, self.each = 0.0, 0.0
        self._real, self._lock = compile.get_kernel, threading.Lock()
        self._known: dict[KernelSpec, np.ndarray] = {}

    def get_kernel(self, shape: KernelSpec) -> Callable[..., None]:
        """Stand in for `compile.get_kernel`."""
        real = self._real(shape)

        def run(*arguments: Any) -> None:
            started = time.thread_time()
            if shape.law is None:  # who touches is found as ever
                real(*arguments)
            else:
                arguments[RESULTS][:] = self._results(shape, real, list(arguments))
            with self._lock:
                self.seconds += time.thread_time() - started

        return run

    def _results(self, shape: KernelSpec, real: Callable[..., None], given: list[Any]) -> np.ndarray:
        """Results of one scenario in all lanes: a row in every place of the cube, and nothing for the audit to find."""
        with self._lock:
            if shape not in self._known:
                inputs, results = given[INPUTS], given[RESULTS]
                given[INPUTS] = np.ascontiguousarray(inputs[np.linspace(0, len(inputs) - 1, GROUPS).astype(int)])
                given[RESULTS] = found = np.zeros((GROUPS, results.shape[1]))
                given[-1] = GROUPS * LANES  # scenarios
                started = time.thread_time()
                real(*given)
                self.each = self.each or (time.thread_time() - started) / (GROUPS * LANES)
                self._known[shape] = np.repeat(found[0].reshape(-1, LANES)[:, 0], LANES)
        return self._known[shape]


@contextmanager
def replayed() -> Iterator[Replay]:
    """Have such kernels in this process for a while."""
    replay = Replay()
    with patch.object(compile, "get_kernel", replay.get_kernel):
        yield replay


@dataclass(frozen=True)
class Around:
    """What one size of sweep costs, in processor time (s) per scenario."""

    scenarios: int  # scenarios, none like another
    outside: float  # all but the kernels
    netcdf: float  # the netCDF library's, to write the same cube
    kernel: float  # the real kernel's, at one step
    peak_bytes: int  # largest memory of this process so far

    def __str__(self) -> str:
        return (
            f"{self.scenarios} scenarios: {1e6 * self.outside:.2f} us each outside of kernels, "
            f"{1e6 * self.netcdf:.2f} us of them what the netCDF library takes to write the cube, "
            f"{self.outside / self.kernel:.2f} of the kernel at one step; "
            f"at most {bytes_text(self.peak_bytes)} of memory"
        )


def _by_library(path: Path, to: Path) -> float:
    """Write a cube that is there to another file by the netCDF library alone; returns its processor time (s)."""
    with netCDF4.Dataset(path) as source:
        source.set_auto_maskandscale(False)
        source.set_auto_chartostring(False)
        told = [(each, each.__dict__, each.filters(), each.chunking()) for each in source.variables.values()]
        sizes, about = {name: len(each) for name, each in source.dimensions.items()}, source.__dict__
        spent = -time.process_time()
        with netCDF4.Dataset(to, "w") as target:
            target.setncatts(about)
            target.set_fill_off()
            for name, size in sizes.items():
                target.createDimension(name, size)
            for given, attributes, filters, blocks in told:
                how: dict[str, Any] = {key: filters[key] for key in ("zlib", "complevel", "shuffle", "fletcher32")}
                how |= {} if blocks == "contiguous" else {"chunksizes": blocks}
                fill: Any = attributes.pop("_FillValue", False)
                stored = target.createVariable(given.name, given.dtype, given.dimensions, fill_value=fill, **how)
                stored.set_auto_maskandscale(False)
                stored.set_auto_chartostring(False)
                stored.setncatts(attributes)
                for each in () if blocks == "contiguous" else (given, stored):
                    each.set_var_chunk_cache(size=1)  # none: whole blocks are read and written
            for given, _, _, blocks in told:
                parts: list[Any] = [...]
                if given.ndim:
                    row = max(1, given.dtype.itemsize * given.size // given.shape[0])
                    many = blocks[0] * max(1, SLAB_BYTES // (row * blocks[0]))
                    parts = [slice(first, first + many) for first in range(0, given.shape[0], many)]
                for part in parts:
                    reading = time.process_time()
                    values = given[part]
                    spent -= time.process_time() - reading
                    target[given.name][part] = values
        return spent + time.process_time()


def _sweep(scenarios: int) -> ps.Sweep:
    """Return a sweep of about so many scenarios, along the axes of ``sweeps/million.toml``."""
    spec = load_sweep(SWEEP).spec
    each = math.ceil(scenarios ** (1.0 / 3.0))
    return ps.Sweep(
        spec.scene,
        spec.records,
        spec.laws,
        gaps=np.linspace(0.004, 0.020, each),
        stiffness_factors=np.geomspace(0.25, 4.0, each),
        restitutions=np.linspace(0.3, 0.9, max(1, round(scenarios / each**2))),
        accuracy=spec.accuracy,
        outputs=spec.outputs,
    )


def around(scenarios: int, rounds: int = ROUNDS) -> Around:
    """Time a sweep of about so many scenarios on two threads, its kernels replayed; the least of several runs."""
    sweep = _sweep(scenarios)
    outside, alone, peak = [], [], 0
    with tempfile.TemporaryDirectory() as folder, replayed() as replay:
        path = Path(folder) / "cube.nc"
        _sweep(2000).run(path, workers=2).close()  # what is loaded once is no cost of a scenario
        for _ in range(rounds):
            replay.seconds, started = 0.0, time.process_time()
            sweep.run(path, workers=2, overwrite=True).close()
            outside.append(time.process_time() - started - replay.seconds)
            peak = peak or 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            alone.append(_by_library(path, Path(folder) / "copy.nc"))
        n = sweep.spec.n_scenarios
        return Around(n, min(outside) / n, min(alone) / n, replay.each, peak)


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.around", description=__doc__)
    parser.add_argument("scenarios", nargs="*", type=int, default=SIZES)
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="times that each sweep is run (default %(default)s)")
    given = parser.parse_args()
    for scenarios in given.scenarios:
        print(around(scenarios, given.rounds), flush=True)


if __name__ == "__main__":
    main()
