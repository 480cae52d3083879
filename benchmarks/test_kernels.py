"""What locating costs and what reducers cost, as ratios of interleaved medians; and that the lanes are vectors."""

from __future__ import annotations

import statistics
import time

import pytest

from pounding_sweep.cube.variables import VARIABLES

ROUNDS = 7


def medians(*jobs):
    """Median seconds of each job, the jobs taking turns."""
    taken = [[] for _ in jobs]
    for _ in range(ROUNDS):
        for seconds, job in zip(taken, jobs, strict=True):
            started = time.perf_counter()
            job()
            seconds.append(time.perf_counter() - started)
    return [statistics.median(seconds) for seconds in taken]


@pytest.mark.parametrize(("law", "stiffness"), [("linear", 2e6), ("hertz", 1.88e7)])
def test_locating_costs_less_than_a_smaller_step(law, stiffness, runner, benchmark):
    """A located step must cost far less than the ten smaller steps that it is worth in accuracy."""
    located, plain = runner(law, stiffness, True), runner(law, stiffness, False)
    with_events, without = medians(located, plain)
    benchmark.extra_info["located_over_plain"] = with_events / without
    benchmark.pedantic(located, rounds=3)
    assert with_events / without < 4.0


def test_unasked_reducers_cost_nothing(runner, benchmark):
    """A kernel of few outputs is faster than one of all: what nobody asks for is not run."""
    few = runner("linear", 2e6, True)
    every = runner("linear", 2e6, True, outputs=tuple(name for name in VARIABLES if name != "closing_max"))
    some, all_of_them = medians(few, every)
    benchmark.extra_info["all_over_few"] = all_of_them / some
    benchmark.pedantic(few, rounds=3)
    assert all_of_them / some > 1.2


def test_the_flight_step_is_vectorised(tmp_path, monkeypatch):
    """The compiled flight step works on packed doubles (AVX-512, AVX or SSE2, whatever the processor has)."""
    from pounding_sweep.kernels import cache
    from pounding_sweep.kernels.shape import KernelShape

    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
    shape = KernelShape((2, 2), (), 1, None, "rk4", True, frozenset({"displacement"}))
    run = cache.get_kernel(shape)
    text = next(iter(run.inspect_asm().values()))
    packed = [word for word in ("vfmadd231pd", "vfmadd213pd", "vfmadd132pd", "vmulpd", "mulpd") if word in text]
    assert packed, "no packed arithmetic in the compiled kernel"
