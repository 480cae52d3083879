"""What costs how many times as much as something else of the same run: chunks, axes, sizes, yielding, compilation."""

from __future__ import annotations

import pytest

import pounding_sweep as ps
from benchmarks.around import around
from benchmarks.axes import AXES, relative_throughput
from benchmarks.compiling import OUTPUTS, kernel, measure, over_plain, quickstart
from benchmarks.sizes import plan_of, row_of, start_of
from benchmarks.start import first_run_ratio
from benchmarks.suite import SHORT_SIZES, SIZES, measure_sizes
from benchmarks.tasks import task_overhead
from benchmarks.timing import medians
from benchmarks.trade import KINDS, dearest_of_less
from benchmarks.yielding import runner, weakened
from pounding_sweep.engine.compile import compiling_seconds

#: Least share of a gap sweep's scenarios per second. Scenarios of other gaps share one motion without pounding; where
#: each has one of its own, as along periods and damping, finding that motion costs as much as the impacts do.
LEAST = dict.fromkeys(AXES, 0.55) | {"building.left.period_factor": 0.45, "damping_ratio": 0.36}


def test_tasks_cost_little(work, within):
    """In chunks of half a second, less than 5 % of the workers' time passes with anything but integrating."""
    within(lambda: task_overhead(work, 0.5, 8.0, method="exact", dt=2.5e-3).overhead, 0.05)


def test_little_is_done_around_kernels(within):
    """A sweep whose kernels cost nothing takes less than 25 times what the netCDF library takes to write its cube."""

    def over_netcdf():
        run = around(200_000, rounds=3)
        return run.outside / run.netcdf

    within(over_netcdf, 25.0)


@pytest.mark.slow
def test_the_first_run_with_an_accuracy_takes_little_longer(within):
    """Kernels in double precision are compiled where a scenario needs one."""
    within(first_run_ratio, 1.3)


@pytest.mark.parametrize(
    "kind", [*list(KINDS)[:1], *(pytest.param(k, marks=pytest.mark.slow) for k in list(KINDS)[1:])]
)
def test_less_accuracy_never_costs_more(kind, within):
    within(lambda: dearest_of_less(kind), 1.1)


@pytest.mark.parametrize("axis", [name for name in AXES if name != "gap"])
def test_every_axis_keeps_much_of_the_throughput_of_gaps(axis, short_work, within):
    within(lambda: 1.0 / relative_throughput(short_work, 5, [axis], method="exact", dt=2.5e-3)[axis], 1.0 / LEAST[axis])


@pytest.mark.parametrize("sizes", [SHORT_SIZES, pytest.param(SIZES, marks=pytest.mark.slow)], ids=["short", "all"])
def test_a_degree_of_freedom_costs_about_the_same_in_every_row(sizes, short_work, within):
    def dearest():
        measured = measure_sizes(short_work, sizes, 5, starts=False, notify=lambda line: None)
        return max(size.relative for size in measured)

    within(dearest, 2.5)


@pytest.mark.slow
def test_a_hundred_degrees_of_freedom_are_compiled_once(short_work, within):
    """Loading the kernel of ten buildings of ten storeys takes a tenth of compiling it, or less."""
    start = start_of(plan_of(row_of(10, 10), short_work.record))
    within(lambda: start.loaded / start.compiled, 0.1)


def test_yielding_costs_less_than_four_times_the_elastic_row(within):
    whole, scene = ps.find_record("el_centro"), ps.get_preset("mate2015")
    record = ps.Record("cut", whole.dt, whole.acceleration[:600])
    jobs = [runner(row, record, "rk4", 2e-3, "kelvin_voigt") for row in (weakened(scene, record), scene)]
    for job in jobs:
        job()

    def ratio():
        yields, elastic = medians(*jobs, rounds=5)
        return yields / elastic

    within(ratio, 4.0)


def test_the_first_kernels_take_few_plain_functions(within):
    """The quickstart's five kernels take about as long as three functions of 200 lines; as much again is too much."""
    within(lambda: over_plain(quickstart()), 6.0)


@pytest.mark.parametrize(("method", "most"), [pytest.param("rk4", 2.0, marks=pytest.mark.slow), ("exact", 5.0)])
def test_a_new_row_with_all_outputs_takes_little(method, most, within):
    """What compiles before the first scenario of a row with all outputs: its runs without pounding and one law."""
    within(
        lambda: over_plain([kernel((3, 3, 3), method, law, OUTPUTS["all"]) for law in ("none", "hertz_damped")]), most
    )


def test_another_law_takes_its_contacts_alone(within):
    """The second law of a row by `exact` finds its flight compiled."""
    first, second = (kernel((3, 3, 3), "exact", law, OUTPUTS["default"]) for law in ("hertz_damped", "hysteretic"))

    def share():
        alone, (_, after) = measure([second])[1][0], measure([first, second])[1]
        return after / alone

    within(share, 0.7)


def test_the_estimate_knows_what_takes_long(within):
    """`plan` and `doctor` tell how long compiling takes: in ratios, whatever the machine, within a factor of two."""
    kinds = (("rk4", "none", "default"), ("rk4", "linear", "few"), ("newmark", "linear", "all"))
    shapes = [kernel((3, 3, 3), method, law, OUTPUTS[outputs]) for method, law, outputs in kinds]

    def spread():
        seconds = measure(shapes)[1]
        ratios = [taken / compiling_seconds(shape.pieces) for taken, shape in zip(seconds, shapes, strict=True)]
        return max(ratios) / min(ratios)

    within(spread, 2.0)
