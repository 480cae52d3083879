"""A stand-in for compiled kernels: plausible numbers from every input, at once and without compiling.

A filter takes the place of the time integration: each building answers alone in its first mode, floors touch where
that motion closes their gap, and a formula says how they then push each other back. So numbers are finite, differ with
everything that a scenario is made of (record, scale, gaps, contact stiffness, damping, masses, storeys, scheme, step,
precision), keep what the code around kernels relies on (a scenario that can't touch is the run without pounding,
energies balance, errors shrink with the step) and are the same in every process. What they say of buildings is nothing.

In tests: the fixture ``stub_engine``; for all tests of a module and its fixtures,
``pytestmark = pytest.mark.usefixtures("stub_module")``. Elsewhere: `install`, ``python -m stub_engine ARGUMENTS`` in
place of the command line, and this module as a preload of dask's workers (the fixtures see to it).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pounding_sweep import resume
from pounding_sweep.engine import compile
from pounding_sweep.kernel.march import FLAG_DIVERGED
from pounding_sweep.kernel.spec import LANES, KernelSpec, Slots, history_slots, input_slots, property_slots
from pounding_sweep.variables.registry import output_slots

#: Relative error of a step as long as the shortest period.
ERROR = 0.3
#: What the environment of child processes needs for this module to be found, and for workers of dask to have it.
ENVIRONMENT = {
    "DASK_DISTRIBUTED__WORKER__PRELOAD": "['stub_engine']",
    "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])]),
}


class StubEngine:
    """Kernels that are never compiled, and what was asked of them.

    Attributes
    ----------
    compiled : list of KernelSpec
        Kernels in the order in which they were first asked for.
    ran : list of (KernelSpec, ndarray)
        Kernel and inputs, shape (scenarios, slots), of each call; idle lanes repeat the last scenario.
    """

    def __init__(self) -> None:
        self.compiled: list[KernelSpec] = []
        self.ran: list[tuple[KernelSpec, np.ndarray]] = []

    @property
    def scenarios(self) -> int:
        """Scenarios run so far, those of idle lanes left out where they repeat their neighbour."""
        return sum(len(np.unique(inputs, axis=0)) for _, inputs in self.ran)

    def get_kernel(self, shape: KernelSpec) -> Callable[..., None]:
        """Stand in for `compile.get_kernel`."""
        if shape not in self.compiled:
            self.compiled.append(shape)

        def run(
            motion: Any, interval: float, record: int, steps: int, flights: int, constants: Any, *arrays: Any
        ) -> None:
            inputs, results, history, *_ = arrays
            given = _by_scenario(inputs)
            self.ran.append((shape, given))
            answer(shape, motion, interval, steps, constants, given, results, history)

        return run

    def is_cached(self, pieces: Iterable[KernelSpec]) -> bool:
        """Stand in for `compile.is_cached`."""
        return {piece for shape in self.compiled for piece in shape.pieces} >= {*pieces}


def install(put: Callable[[Any, str, Any], None] = setattr) -> StubEngine:
    """Put a stand-in in the place of compiled kernels, in this process."""
    stub = StubEngine()
    put(compile, "get_kernel", stub.get_kernel)
    put(compile, "is_cached", stub.is_cached)
    put(resume, "BUFFER_SECONDS", 0.0)
    put(compile, "shares", lambda shapes, n: [list(shapes)])  # no child compiles
    return stub


@contextmanager
def installed() -> Iterator[StubEngine]:
    """Have the stand-in here, in child processes that start from this module, and in workers of dask, for a while."""
    import dask
    import distributed  # noqa: F401 - with its settings, which would else be forgotten with those of here

    with pytest.MonkeyPatch.context() as patch, dask.config.set({"distributed.worker.preload": [__name__]}):
        for name, value in ENVIRONMENT.items():
            patch.setenv(name, value)
        yield install(patch.setattr)


def dask_setup(worker: Any) -> None:
    """Install it in a worker of dask."""
    install()


def answer(
    shape: KernelSpec,
    motion: np.ndarray,
    interval: float,
    steps: int,
    constants: np.ndarray,
    given: np.ndarray,
    results: np.ndarray,
    history: np.ndarray,
) -> None:
    """Fill in what a kernel leaves of scenarios, and the history of the first."""
    with np.errstate(all="ignore"):
        found, motions = _response(shape, motion, interval, steps, constants, given)
        slots = output_slots(shape)
        values = np.zeros((len(given), slots.size))
        for name, numbers in found.items():
            if name in slots.first:
                values[:, slots.first[name] : slots.first[name] + slots.count[name]] = numbers
        values = np.where(np.abs(values) < 1e-300, 0.0, values).astype(shape.precision).astype(float)
        wrong = ~np.isfinite(np.delete(values, slots.first.get("shortest", slots.size - 1), axis=1)).all(axis=1)
        values[wrong, 0] = FLAG_DIVERGED
    results[:] = values.reshape(-1, LANES, slots.size).transpose(0, 2, 1).reshape(len(results), -1)
    if shape.history:
        history = history[: (len(motion) - 1) * steps + 1]
        _leave_history(shape, history, (len(motion) - 1) * interval, {k: v[0] for k, v in motions.items()})


def _by_scenario(inputs: np.ndarray) -> np.ndarray:
    """Inputs by scenario, shape (scenarios, slots), from those by group, slot and lane."""
    groups = len(inputs)
    return np.array(inputs).reshape(groups, -1, LANES).transpose(0, 2, 1).reshape(groups * LANES, -1)


def _part(slots: Slots, name: str, values: np.ndarray) -> np.ndarray:
    return values[..., slots.first[name] : slots.first[name] + slots.count[name]]


def _response(
    shape: KernelSpec, motion: np.ndarray, interval: float, steps: int, constants: np.ndarray, given: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Outputs by the name of their slots, and amplitudes of the motion; shape (scenarios, slots)."""
    brought, shared = input_slots(shape), property_slots(shape)

    def of(name: str) -> np.ndarray:
        """Property of every scenario: its own where they differ, else that of the scene."""
        if f"p_{name}" in brought.first:
            return _part(brought, f"p_{name}", given)
        return np.broadcast_to(_part(shared, name, np.asarray(constants, float)), (len(given), shared.count[name]))

    owner = np.array(shape.building_of[: shape.n_dof])
    height = np.array([(s + 1.0) / n for n in shape.storeys for s in range(n)])
    mass, stiffness = (of(name)[:, : shape.n_dof] for name in "mk")
    factor = np.array([2.0 * n**2 * (1.0 - np.cos(np.pi / (2 * n + 1))) for n in shape.storeys])  # of equal storeys
    rate = np.sqrt(factor / (_of_buildings(mass, owner) * _of_buildings(1.0 / stiffness, owner)))  # rad/s, first mode
    ratio = 0.5 * (of("alpha") / rate + of("beta") * rate)
    fast = np.sqrt(stiffness / mass).max(axis=1, keepdims=True)
    order = 8 if shape.series else shape.order  # of series, whose steps are those of flight
    error = ERROR * (interval / steps * fast / (2 * np.pi)) ** order
    rows, which = np.unique(np.hstack([rate, ratio]), axis=0, return_inverse=True)
    peaks = np.array([_peaks(shape.contacts, owner, height, motion, interval, row) for row in rows])[which.ravel()]
    scale = _part(brought, "scale", given)
    strongest = float(np.abs(motion).max(initial=0.0)) * scale
    speeds = np.asarray(_part(shared, "v0", np.asarray(constants, float)))[: shape.n_dof]
    upwards = np.maximum(scale * peaks[:, 0], scale * peaks[:, 1]) * (1.0 + error)
    downwards = np.minimum(scale * peaks[:, 0], scale * peaks[:, 1]) * (1.0 + error)
    umax = upwards[:, : shape.n_dof] + np.abs(speeds) / rate[:, owner]
    umin = downwards[:, : shape.n_dof] - np.abs(speeds) / rate[:, owner]
    closing = upwards[:, shape.n_dof :]
    ended = np.full((len(given), 1), (len(motion) - 1) * steps)
    found = {"flags": np.zeros((len(given), 1)), "ended": ended, "closing": closing, "collapse_time": -1.0}
    contacts = shape.contacts
    duration = (len(motion) - 1) * interval
    work = np.zeros((len(given), max(1, len(contacts))))
    gained = np.zeros((len(given), shape.n_buildings))
    force = np.zeros((len(given), len(contacts)))
    if shape.law is not None:
        gaps = _part(brought, "gap", given)[:, [pair for _, _, pair in contacts]]
        k, c = _part(brought, "k", given), np.nan_to_num(_part(brought, "c", given))
        k = np.where(k > 0.0, k, stiffness.min(axis=1, keepdims=True))  # where velocities jump it has none
        over = np.maximum(closing - gaps, 0.0)
        speed = over * rate.max(axis=1, keepdims=True)
        pressed = over / (1.0 + np.sqrt(k / stiffness.min(axis=1, keepdims=True)))
        force = k * pressed**shape.law.exponent + 0.1 * c * np.sqrt(pressed) * speed
        touched = over > 0.0
        count = touched * (1.0 + np.floor(6.0 * over / np.where(touched, closing, 1.0)))
        lasted = np.pi * np.sqrt(of("reduced") / k) / (1.0 + np.tanh(over))
        damped = c / (c + np.sqrt(k * of("reduced")))
        work = 0.1 * force * pressed * damped
        found |= {
            "fmax": force,
            "dmax": pressed,
            "count": count,
            "vmax": speed,
            "impulse": force * lasted * count / 3.0,
            "tfirst": np.where(touched, duration * gaps / np.where(touched, closing, 1.0), -1.0),
            "shortest": np.where(touched, lasted, np.inf).min(axis=1, keepdims=True),
            "work": work,
        }
        for j, (left, right, _) in enumerate(contacts):
            push = (0.1 * over + 0.2 * pressed * (1.0 + 0.5 * damped))[:, j]
            for floor, way in ((left, -1.0), (right, 1.0)):
                if floor >= 0:  # held back on the side of the touch, thrown farther to the other
                    umax[:, floor] += way * push * (1.0 if way < 0 else 0.5)
                    umin[:, floor] += way * push * (0.5 if way < 0 else 1.0)
                    gained[:, owner[floor]] += way * force[:, j] * pressed[:, j]
        # what the contacts took in is what all buildings lost
        gained += (work.sum(axis=1) - gained.sum(axis=1))[:, None] / shape.n_buildings
    below = np.where(shape.bottom, 0.0, np.roll(umax, 1, axis=1))
    drift = np.maximum(np.abs(umax - below), np.abs(umin) / height / np.array(shape.storeys)[owner])
    acceleration = umax * rate[:, owner] ** 2 + strongest
    for j, (left, right, _) in enumerate(contacts):
        for floor in (left, right):
            if floor >= 0:
                acceleration[:, floor] += force[:, j] / mass[:, floor]
    strain = _of_buildings(0.05 * stiffness * drift**2, owner)
    kinetic = _of_buildings(0.02 * mass * (umax * rate[:, owner]) ** 2, owner)
    lost = 2.0 * ratio * _of_buildings(stiffness * drift**2, owner)
    start = _of_buildings(0.5 * mass * speeds**2, owner)
    found |= {
        "umax": np.maximum(umax, 0.0),
        "umin": np.minimum(umin, 0.0),
        "drift": drift,
        "acc": acceleration,
        "e_in": gained + strain + kinetic + lost - start,
        "e_damp": lost,
        "e_kin": kinetic,
        "e_strain": strain,
        "e_held": strain + kinetic,
        "tmax": np.maximum(gained, 0.0),
        "tmin": np.minimum(gained, 0.0),
        "sway": 0.1 * umax[:, [shape.floors[b][0] for b in shape.foundations]],
        "rotation": 0.01 * umax[:, [shape.floors[b][0] for b in shape.foundations]],
    }
    moving = {"u": umax, "rate": rate[:, owner], "force": force, "work": work[:, : len(contacts)]}
    return found, moving | {"e_in": found["e_in"], "e_damp": lost}


def _peaks(contacts: Any, owner: Any, height: Any, motion: Any, interval: float, row: Any) -> np.ndarray:
    """Largest and smallest displacements of floors, then of closings, in first modes of these rates and ratios."""
    from scipy.linalg.lapack import dtbtrs  # a filter as a banded system: scipy.signal takes a second to import

    floors = []
    for w, ratio in zip(*np.split(row, 2), strict=True):
        damped, left = w * np.sqrt(max(1e-6, 1.0 - ratio**2)), np.exp(-ratio * w * interval)
        turn = damped * interval
        band = np.repeat([[1.0], [-2.0 * left * np.cos(turn)], [left**2]], len(motion), axis=1)
        pushed = np.append(0.0, motion[:-1]) * (-1.3 * interval * left * np.sin(turn) / damped)
        floors.append(dtbtrs(band, pushed[:, None], uplo="L")[0][:, 0])
    u = [height[i] * floors[b] for i, b in enumerate(owner)]
    ways = [*u, *((u[i] if i >= 0 else 0.0) - (u[j] if j >= 0 else 0.0) for i, j, _ in contacts)]
    return np.array([[way.max() for way in ways], [way.min() for way in ways]])


def _of_buildings(values: np.ndarray, owner: np.ndarray) -> np.ndarray:
    return np.stack([values[:, owner == b].sum(axis=1) for b in range(owner.max() + 1)], axis=1)


def _leave_history(shape: KernelSpec, history: np.ndarray, duration: float, moving: dict[str, np.ndarray]) -> None:
    """Leave sines that reach the peaks, energies that grow, and a force near each peak."""
    slots, times = history_slots(shape), np.linspace(0.0, duration, len(history))[:, None]
    grown = times / duration if duration else times
    phase = moving["rate"] * times
    beaten = np.maximum(np.sin(phase.max(axis=1, keepdims=True)), 0.0) ** 8
    rows = {"u": moving["u"] * np.sin(phase), "v": moving["u"] * moving["rate"] * np.cos(phase)}
    rows |= {name: moving[name] * grown for name in ("e_in", "e_damp", "work")} | {"force": moving["force"] * beaten}
    for name, first in slots.first.items():
        history[:, first : first + slots.count[name]] = rows[name]


if __name__ == "__main__":
    os.environ.update(ENVIRONMENT)
    install()
    from pounding_sweep.cli import main

    sys.exit(main())
