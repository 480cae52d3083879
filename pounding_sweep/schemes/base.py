"""What a time-stepping scheme is: its order, limits and costs, and its steps."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import reduce

import numpy as np

from pounding_sweep.kernel import forces, hysteresis, impulse, links, march, peaks, series, transfers
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.types import Lanes
from pounding_sweep.model.scene import Scene

#: By what an error is taken for larger than it is by the order of a scheme.
SAFETY = 3.0


class Scheme(ABC):
    """One way of stepping time: what plans, statuses and kernels ask about it."""

    name: str  # key in sweep files
    title: str  # what it is
    source: str  # where it comes from
    order: int  # order of its error, contacts included
    implicit = False  # contact forces are found together with the step that they act on
    flies_exactly = False  # buildings move without error between contacts, which must be located
    #: steps of its largest acceleration that the range of the ground's velocity must exceed: where the ground turns
    #: back within steps, sums over stages give wrong energies, and ends of steps alone miss the motion too
    min_ground_steps = 0.0
    follows_flow = False  # it takes rows whose storeys have internal variables that flow between events
    parameters: tuple[str, ...] = ()  # settings of a sweep that are its own
    without_limit = "the newmark scheme"  # what has no stability limit instead, as the end of "give dt <= ..., "
    #: steps that the fastest part of the shortest contact needs, located or not
    min_steps_located: float
    min_steps_sampled = 16.0
    phase: tuple[tuple[int, float], ...]  # power and divisor of each term of `phase_error`
    step_cost: float  # cost of one scenario and step (ns per degree of freedom), for estimates and chunk sizes only
    #: steps per 0.01 s (of exact flight: its `refinement`) at which errors are measured for ``accuracy``, and the last
    #: of them that is of use in single precision; none: they are not measured, and ``accuracy`` never takes the scheme
    ladder: tuple[float, ...] = ()
    finest_float32 = math.inf

    @property
    def leeway(self) -> float:
        """Return by what the difference of a run to one at twice the step is divided, to be no less than its error."""
        return max(1.0, (2.0**self.order - 1.0) / SAFETY)

    def refuses(self, scene: Scene, precision: str = "float64") -> str | None:
        """Say why it can't take a row in a number format; None where it can."""
        for floor, law, *_ in () if self.follows_flow else scene.springs:
            if not law.straight:
                name = scene.buildings[np.searchsorted(scene.offsets, floor, "right") - 1].name
                return f"does not follow storeys of law {law.name!r}, as building {name!r} has"
        return None

    @abstractmethod
    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Largest stable step (s) where squared frequencies reach `w2` (1/s2) and dampers `rate` (1/s)."""

    def phase_error(self, x: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Relative error of a free vibration's phase and size at steps of `x` rad."""
        return reduce(np.hypot, [x**power / divisor for power, divisor in self.phase])

    def declare_rows(self, group: Group) -> None:
        """Declare the rows of state that steps need; a subclass adds its own."""
        for owner in (march, hysteresis, links, forces, impulse, transfers, peaks, series):
            owner.declare_rows(group)

    @abstractmethod
    def flight(self, group: Group, h: Lanes) -> Callable[[], None]:
        """Take a step of all lanes without contact; returns what adds its energies."""

    @abstractmethod
    def trial(self, group: Group) -> Callable[[], None]:
        """Try a sub-step of every lane's own length, contacts in frozen modes; returns what adds its energies."""

    @abstractmethod
    def plain(self, group: Group, h: Lanes) -> Callable[[], None]:
        """Take a step of all lanes whose contacts follow from the present state alone; returns what adds energies."""
