"""What a kernel's arithmetic costs: beside C, beside other modes of its own; and that its lanes are vectors."""

from __future__ import annotations

import re

import numpy as np
import pytest

from benchmarks import arithmetic
from benchmarks.c_kernel import find_compiler
from benchmarks.engine import OUTPUTS
from benchmarks.sizes import job_of, row_of
from benchmarks.timing import medians
from benchmarks.work import neighbouring_gaps
from pounding_sweep.engine.kernel import compile_library
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.variables.registry import VARIABLES

needs_compiler = pytest.mark.skipif(
    find_compiler() is None, reason="no C compiler: install one, or name it in CC, to compare with the C kernel"
)


def job(scene, record, **settings):
    """Return what runs two lane groups of neighbouring gaps, compiled and warm."""
    sweep = Sweep(
        scene, record, "linear", gaps=neighbouring_gaps(32), method="rk4", dt=1e-3, **{"outputs": OUTPUTS, **settings}
    )
    return job_of(sweep.plan())


@needs_compiler
def test_the_c_kernel_finds_what_the_engine_finds(short_work):
    own = arithmetic.engine_job(short_work, locate=False)()
    for run in arithmetic.c_jobs(short_work).values():
        found = run()
        np.testing.assert_allclose(found["highest"], own["umax"], rtol=1e-6)
        np.testing.assert_allclose(found["lowest"], own["umin"], rtol=1e-6)
        np.testing.assert_allclose(found["force"], own["fmax"], rtol=1e-6)
        np.testing.assert_array_equal(found["onsets"], own["count"])


@needs_compiler
def test_arithmetic_is_close_to_hand_written_c(work, within):
    """The generated kernel takes not much longer than C written by hand for this very row; 1.15 times is aimed at."""
    within(lambda: arithmetic.measure_c(work, 7).plain, 1.9)  # 1.1 to 1.6 was measured: it differs between processes


def test_locating_costs_less_than_a_smaller_step(short_work, within):
    """A located step must cost far less than the ten smaller steps that it is worth in accuracy."""
    located, plain = (job(short_work.scene, short_work.record, locate=locate) for locate in (True, False))
    within(lambda: np.divide(*medians(located, plain)), 4.0)


def test_unasked_reducers_cost_nothing(short_work, within):
    """A kernel of few outputs is faster than one of all: what nobody asks for is not run."""
    every = [name for name in VARIABLES if name != "closing_max"]
    few, whole = (job(row_of(2, 1), short_work.record, outputs=outputs) for outputs in (OUTPUTS, every))
    within(lambda: np.divide(*medians(few, whole)), 1 / 1.2)


@pytest.mark.parametrize("method", ["rk4", "exact"])
def test_lanes_are_vectors(method, short_work):
    """A freshly compiled flight works on packed doubles (AVX-512, AVX or SSE2, whatever the processor has)."""
    sweep = Sweep(row_of(2, 2), short_work.record, "none", method=method, outputs=["displacement_max"])
    text = compile_library(sweep.plan().kernel(0).shape.pieces[0]).get_asm_str()
    packed = [word for word in ("vfmadd231pd", "vfmadd213pd", "vfmadd132pd", "vmulpd", "mulpd") if word in text]
    assert packed, "no packed arithmetic in the compiled kernel"
    # slow on many processors without AVX-512, and nothing that follows is given what they write
    writes = re.compile(r"\tvmaskmov\w+\t%[xy]mm\d+, %[xy]mm\d+, \S+$|\tvmovup\w\t%[xyz]mm\d+, \S+ \{%k\d\}$")
    masked = [line for line in text.splitlines() if writes.match(line)]
    assert not masked, masked
