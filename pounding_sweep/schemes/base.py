"""What a time-stepping scheme is: its order, limits and costs, and the text of its steps."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from pounding_sweep.emit.spec import KernelSpec, Slots


class Scheme(ABC):
    """One way of stepping time: what plans, statuses and kernels ask about it.

    Attributes
    ----------
    name, title, source : str
        Key in sweep files; what it is; where it comes from.
    order : int
        Order of its error, contacts included.
    implicit : bool
        Contact forces are found together with the step that they act on.
    flies_exactly : bool
        Buildings move without error between contacts, which must be located.
    follows_ground : bool
        A ground acceleration that is linear over the step is integrated twice without error.
    parameters : tuple of str
        Settings of a sweep that are its own.
    without_limit : str
        What has no stability limit instead, as the end of "give dt <= ..., ".
    min_steps_located, min_steps_sampled : float
        Steps that the fastest part of the shortest contact needs, located or not.
    step_cost : float
        Cost of one scenario and step (ns per degree of freedom), for estimates and chunk sizes only.
    ladder : tuple of float
        Steps per 0.01 s (of exact flight: its `finer`) at which errors are measured for ``accuracy``.
    finest_float32 : float
        The last of them that is of use in single precision.
    """

    name: str
    title: str
    source: str
    order: int
    implicit = False
    flies_exactly = False
    follows_ground = True
    parameters: tuple[str, ...] = ()
    without_limit = "the newmark scheme"
    min_steps_located: float
    min_steps_sampled = 16.0
    step_cost: float
    ladder: tuple[float, ...]
    finest_float32: float

    def min_steps_per_contact(self, located: bool) -> float:
        """Return the steps that the fastest part of the shortest contact needs."""
        return self.min_steps_located if located else self.min_steps_sampled

    def ladder_in(self, precision: str) -> tuple[float, ...]:
        """Return the steps at which errors are measured in a number format."""
        return tuple(n for n in self.ladder if precision == "float64" or n <= self.finest_float32)

    @abstractmethod
    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Largest stable step (s) where squared frequencies reach `w2` (1/s2) and dampers `rate` (1/s)."""

    @abstractmethod
    def phase_error(self, x: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Relative error of a free vibration's phase and size at steps of `x` rad."""

    @abstractmethod
    def step(self, shape: KernelSpec, slots: Slots, variant: str) -> str:
        """Text of the function ``flight``, ``trial`` (contacts in frozen modes) or ``plain`` (unlocated contacts)."""

    def flight(self, shape: KernelSpec, slots: Slots) -> str:
        """Text of the step without contact."""
        return self.step(shape, slots, "flight")

    def stages(self, shape: KernelSpec, slots: Slots) -> str:
        """Text of what the variants of a longer row's step share."""
        del shape, slots
        return ""

    def motion_slots(self, shape: KernelSpec) -> dict[str, int]:
        """Slots of the motion beside displacements and velocities."""
        return {"AO": shape.n_dof} if shape.law is not None and shape.contacts else {}

    def stage_slots(self, shape: KernelSpec) -> tuple[str, ...]:
        """Slots of each floor that hold the stages of a longer row."""
        del shape
        return ()
