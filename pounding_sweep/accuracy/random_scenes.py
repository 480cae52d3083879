"""Random rows of buildings for the stability suite, a few shapes of them so that few kernels are compiled."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pounding_sweep.accuracy.batches import Batch
from pounding_sweep.accuracy.extreme_families import lowest_restitution, oscillator
from pounding_sweep.emit.spec import LANES
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import Building, Scene, Wall
from pounding_sweep.records import Record, synthetic_record

#: Time steps (s) that random scenes are run at.
STEPS = (5.0e-3, 1.0e-3, 2.0e-4)


def random_batches(scenes: int, seed: int, laws: Sequence[Law]) -> list[Batch]:
    """Draw random scenes: rows, gaps, contacts and ground motions."""
    return [_draw(np.random.default_rng([seed, i]), i, laws) for i in range(-(-scenes // LANES))]


def _draw(rng: np.random.Generator, number: int, laws: Sequence[Law]) -> Batch:
    law = laws[number % len(laws)]
    kind = (number // len(laws)) % 2
    scene = _pair(rng) if kind == 0 else _beside_wall(rng)
    pairs = len(scene.pair_names)
    # a gap is met only if the buildings move as far: drawn around the displacement of the softest one
    period = max(float(b.periods[0]) for b in scene.buildings)
    pga = _log(rng, 0.05, 20.0)
    reach = pga * (period / (2.0 * math.pi)) ** 2
    gaps = reach * 10.0 ** rng.uniform(-3.0, 0.5, (LANES, pairs))
    gaps[rng.random(gaps.shape) < 0.1] = 0.0
    mass = min(contact.mass for contact in scene.contacts)
    if law.exponent == 1.0:  # contacts that last 0.3 ms to 0.3 s, and the odd one that is stiffer
        stiffness = mass * (math.pi / 10.0 ** rng.uniform(-3.5, -0.5, LANES)) ** 2
    else:
        stiffness = 10.0 ** rng.uniform(3.0, 9.0, LANES)
    return Batch(
        "random",
        f"number {number}",
        scene,
        law,
        _motion(rng, pga),
        gaps,
        np.clip(stiffness, 1e3, 1e12),
        np.where(rng.random(LANES) < 0.1, lowest_restitution(law), rng.uniform(0.02, 1.0, LANES)),
        10.0 ** rng.uniform(-0.5, 0.5, LANES),
        STEPS,
    )


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _damping(rng: np.random.Generator) -> float:
    return float(rng.choice([0.0, 0.02, 0.05, 0.2, 0.6]))


def _pair(rng: np.random.Generator) -> Scene:
    buildings = []
    for name in ("left", "right"):
        plain = oscillator(name, _log(rng, 0.05, 3.0), _log(rng, 1.0, 1e4), 2)
        uneven = rng.uniform(0.5, 2.0, (2, 2))
        masses = [m * u for m, u in zip(plain.masses, uneven[0], strict=True)]
        stiffnesses = [k * u for k, u in zip(plain.stiffnesses, uneven[1], strict=True)]
        buildings.append(Building(name, masses, stiffnesses, _damping(rng)))
    return Scene(buildings, [0.0])


def _beside_wall(rng: np.random.Generator) -> Scene:
    return Scene([oscillator("left", _log(rng, 0.05, 3.0), _log(rng, 1.0, 1e4), 1, _damping(rng)), Wall()], [0.0])


def _motion(rng: np.random.Generator, pga: float) -> Record:
    kind = rng.integers(4)
    dt = float(rng.choice([0.005, 0.01, 0.02]))
    if kind == 0:  # white noise: the roughest that a record can be
        noise = rng.standard_normal(round(1.0 / dt))
        return Record("noise", dt, pga * noise / np.abs(noise).max())
    if kind == 1:  # a pulse
        t = np.arange(0.0, 1.5, dt)
        width = _log(rng, 0.05, 0.6)
        return Record("pulse", dt, pga * np.where(t < width, np.sin(2.0 * np.pi * t / width), 0.0))
    return synthetic_record(int(rng.integers(10**6)), duration=2.0, dt=dt, pga=pga, rise=0.1, strong=0.6)
