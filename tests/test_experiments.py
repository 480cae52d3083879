"""The experiments that benchmarks compute from published numbers: the frame under one noise, and the ball."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import experiments
from benchmarks.experiments import DAMPING, DT, MASSES, MEASURED, MEASURED_OPEN, OPEN, STIFFNESSES, State


def free_masses():
    """Stiffness (kN/m) and damping (kN s/m) of the frame as four masses in free space, its rails a dashpot."""
    drifts = np.vstack([np.eye(4)[0], np.diff(np.eye(4), axis=0)])
    return [(drifts.T * values) @ drifts for values in ([0.0, *STIFFNESSES], experiments.fit_dashpots())]


def test_the_frame_has_the_measured_modes():
    stiffness, damping = (-part / MASSES[:, None] for part in free_masses())
    roots = np.linalg.eigvals(np.block([[np.zeros((4, 4)), np.eye(4)], [stiffness, damping]]))
    roots = sorted(roots[roots.imag > 1.0], key=abs)
    assert np.abs(roots) / (2.0 * np.pi) == pytest.approx(MEASURED_OPEN, abs=0.25)
    assert -np.real(roots) / np.abs(roots) == pytest.approx(DAMPING, rel=0.05)


@pytest.mark.slow  # a kernel of its own; links are held against the reference by day
def test_the_ground_is_a_force_on_the_base():
    """Without contact two linked neighbours on moving ground are four free masses that a force drives."""
    force, ground = experiments.make_force(0)
    top = experiments.top_acceleration(OPEN, ground)
    w = 2.0 * np.pi * np.fft.rfftfreq(force.size, DT)[:, None, None]
    w[0] = 1.0  # the force has no mean
    stiffness, damping = free_masses()
    transfer = -(w**2) * np.linalg.inv(stiffness + 1j * w * damping - w**2 * np.diag(MASSES))
    expected = np.fft.irfft(transfer[:, 3, 0] * np.fft.rfft(force), force.size)
    half = force.size // 2  # the start at rest has faded
    assert np.abs(top - expected)[half:].max() < 0.01 * expected.std()  # the ground is a line between points


@pytest.mark.slow
def test_frequencies_rise_as_the_gap_closes():
    """On one noise: in the order of the gaps, modes 2 and 3 by about as much as measured at the smallest."""
    gaps = sorted(MEASURED)
    tests = experiments.run_tests([State(gap) for gap in gaps], noises=1)
    assert tests[OPEN].frequency == pytest.approx(MEASURED_OPEN, abs=0.3)
    shifts = np.array([tests[State(gap)].frequency for gap in gaps]) - tests[OPEN].frequency
    assert (shifts[0] > 0.5).all()
    assert (np.diff(shifts, axis=0) < 0.1).all()
    assert (shifts[0] > 2.0 * shifts[-2]).all()
    measured = np.subtract(MEASURED[gaps[0]], MEASURED_OPEN)
    assert shifts[0, 1:] == pytest.approx(measured[1:], rel=0.35)
    values = tests[State(gaps[0])].values[0]
    assert values[1] == tests[OPEN].values[0, 1]  # the same force
    assert values[0] < tests[OPEN].values[0, 0]


def test_a_table_has_numbers_and_ranges():
    table = experiments.format_table("a", "b", "c", "d", rows=[("x", 1.0, 2.0), ("y", 1.0, 2.0, 3.0, 4.0, 5.0)])
    assert table.splitlines()[2:] == ["| x | 1 | 2 |  |  |", "| y | 1 | 2 | 3 | 4 to 5 |"]


@pytest.mark.slow
def test_the_ball_rebounds_by_the_square_of_the_restitution():
    rebound, intervals = experiments.drop_ball(0.8, 0.9)
    assert rebound == pytest.approx(0.81 * 0.8, rel=1e-5)
    flight = 2.0 * np.sqrt(2.0 * 0.8 / experiments.STANDARD_GRAVITY)
    assert intervals == pytest.approx(flight * 0.9 ** np.arange(1, 5), rel=1e-4)
