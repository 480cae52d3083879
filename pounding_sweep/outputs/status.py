"""How a scenario ended, and the outputs that say how its run went, not what it found."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from pounding_sweep.outputs.declare import KernelResults, Variable
from pounding_sweep.outputs.energy import hysteretic

#: Relative error beyond which the peaks of a scenario are wrong, where no other was asked for.
OK_CLAIM = 0.05
#: Difference to a run at half the step within which one at a given step is ok, where that is asked for: an error that
#: impacts have magnified need not shrink with the step as small ones do.
SETTLED = 0.02


class Status(IntEnum):
    """How a scenario ended; its value in the cube, with what it means and what to do."""

    meaning: str
    remedy: str
    has_values: bool

    def __new__(cls, code: int, meaning: str, remedy: str, has_values: bool) -> Status:
        """Make the member of value `code`."""
        member = int.__new__(cls, code)
        member._value_ = code
        member.meaning = meaning
        member.remedy = remedy
        member.has_values = has_values
        return member

    OK = (
        0,
        "the scenario ran to the end of its record, and its step resolves contacts, buildings and ground by "
        "all rules of the engine; where error_estimate is there, a run at another step agrees as well",
        "",
        True,
    )
    DIVERGED = (
        1,
        "the motion left the range of finite numbers, or of what the ground can bring about, or a storey fell under "
        "the weight above it (with P-Delta, as far as it is high); no peaks are reported",
        "use a smaller dt, the newmark scheme or a softer contact; a storey that falls does so under any",
        False,
    )
    UNDER_RESOLVED_CONTACT = (
        2,
        "the shortest contact lasted too few time steps for its peaks to be trusted",
        "use a smaller dt (see steps_per_contact)",
        True,
    )
    NEWTON_NOT_CONVERGED = (
        3,
        "the implicit equation of contacts or of smooth storeys was not solved within its tolerance in some step",
        "use a smaller dt",
        True,
    )
    BEYOND_STABILITY_LIMIT = (
        4,
        "the time step is beyond the stability limit of the scheme; the scenario was refused",
        "use a smaller dt or the newmark scheme",
        False,
    )
    NOT_RUN = (
        5,
        "the scenario has no result, for instance because its worker failed or because no merged cube has it",
        "run the sweep again, for a merged cube with --extend of it",
        False,
    )
    UNDER_RESOLVED_MOTION = (
        6,
        "the time step is too long for a building's fundamental period, or for the ground motion",
        "use a smaller dt, or the exact scheme",
        True,
    )
    UNSETTLED = (
        7,
        "the estimated error is more than the accuracy asked for, however often the time step was halved, or, "
        f"at a given step, more than {SETTLED:.0%}",
        "use a smaller dt, or ask for a larger relative error (see error_estimate)",
        True,
    )

    @property
    def label(self) -> str:
        """Name in ``flag_meanings``."""
        return self.name.lower()


#: Every status, by rising value.
STATUS: tuple[Status, ...] = tuple(Status)


def _energy_residual(results: KernelResults) -> np.ndarray:
    """|sum of transfers - sum of works of contacts and links| over the largest energy in the balance."""
    raw = results.slots
    initial: np.ndarray | float = 0.0
    if results.initial_velocity is not None:
        initial = 0.5 * (results.variants.masses * np.square(results.initial_velocity)).sum(axis=1)
    gained = raw["e_kin"] + raw["e_strain"] + raw["e_damp"]
    if "travel" in raw:
        gained = gained + hysteretic(results)
    left = raw["e_in"].sum(axis=1) - gained.sum(axis=1) + initial
    work = raw["work"].sum(axis=1) if "work" in raw else np.zeros(len(left))
    if "link_held" in raw:
        work = work + raw["link_held"].sum(axis=1) + raw["link_lost"].sum(axis=1)
    size = np.maximum.reduce([np.abs(raw["e_in"]).sum(axis=1), gained.sum(axis=1), np.abs(work)])
    return np.asarray(np.abs(left - work) / np.where(size > 0, size, 1.0))


RUNS = (
    Variable(
        "time_step",
        "s",
        "time step",
        "Time step of the scenario; in every cube whose steps were chosen for an accuracy, scenario by scenario.",
        lambda results: np.full(len(results), results.step),
    ),
    Variable(
        "error_estimate",
        "1",
        "estimated relative error",
        "Largest relative difference of an output to a run at half the time step. Where an accuracy chose the step "
        "it is in every cube: three times what the order of the scheme makes of the difference to a run at twice "
        "the step, a fifth of it by the fourth order; that of a number of impacts is taken whole.",
    ),
    Variable(
        "amplification",
        "1",
        "amplification of small changes",
        "Largest relative change of an output over that of gaps, contact stiffness and ground motion, by a change "
        "of 1e-6 of each; the scenario is ill-conditioned where it is large.",
    ),
    Variable(
        "status",
        "1",
        "status of the scenario",
        "How the scenario ended; never missing. Only an ok scenario's values are to be trusted.",
        dtype="i1",
        always=True,
        flag_values=tuple(map(int, Status)),
        flag_meanings=" ".join(s.label for s in Status),
    ),
    Variable(
        "energy_residual",
        "1",
        "relative residual of the energy balance",
        "|sum of the buildings' transfers - sum of the contacts' works| at the end of the record, over the largest "
        "absolute value among the energies of the balance (input, damping, kinetic, strain, yielding, contact "
        "work); what links hold and lose counts as work.",
        _energy_residual,
        needs=frozenset({"energy", "hysteretic", "links", "work"}),
    ),
    Variable(
        "steps_per_contact",
        "1",
        "time steps in the shortest contact",
        "Time steps in the shortest contact, by the duration of an elastic contact of its stiffness, effective "
        "mass and approach velocity; missing where nothing touched.",
        lambda results: results.steps_per_contact,
        always=True,
    ),
)
