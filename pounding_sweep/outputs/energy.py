"""Outputs of energies: what the ground puts in, what buildings lose, hold and give to their neighbours."""

from __future__ import annotations

from functools import partial

import numpy as np

from pounding_sweep.outputs.declare import UNMEASURED, KernelResults, Reducer, Slot, Variable

#: Differences of larger energies: an undamped contact takes in no work in the end, however much passed through it.
_EXCHANGED = ("energy_transfer_max", "energy_transfer_min", "contact_work")


def _work(results: KernelResults) -> np.ndarray:
    """Sum of the works of a pair's contacts."""
    works, taken = np.zeros((len(results), len(results.scene.pair_labels))), results.get("work", "contact")
    for j, contact in enumerate(results.scene.contacts):
        works[:, contact.place] += taken[:, j]
    return works


def hysteretic(results: KernelResults) -> np.ndarray:
    """(1 - r) k dy by the plastic travel of its storeys, by building."""
    if "travel" not in results.slots:
        return np.zeros((len(results), len(results.scene.buildings)))
    held = (1.0 - results.variants.elastic_hardenings) * results.variants.yield_strengths
    lost = np.where(results.slots["travel"] > 0.0, held, 0.0) * results.slots["travel"]
    return np.add.reduceat(lost, results.scene.offsets[:-1], axis=1)


_energy = partial(Variable, per="building", error="energies")
ENERGIES = (
    _energy(
        "energy_input",
        "kN m",
        "energy input",
        "Energy put in by the ground until the end of the record, -int m ag v dt with v relative to the ground; "
        "its foundation included.",
        "e_in",
    ),
    _energy(
        "energy_damping",
        "kN m",
        "energy lost in damping",
        "Energy lost in the building's own damping, dashpots and its foundation included, until the end of the "
        "record, int v'Cv dt.",
        "e_damp",
    ),
    _energy(
        "energy_kinetic",
        "kN m",
        "kinetic energy at the end",
        "Kinetic energy v'Mv/2 of the motion relative to the ground, at the end of the record; foundation included.",
        "e_kin",
    ),
    _energy(
        "energy_strain",
        "kN m",
        "strain energy at the end",
        "Elastic strain energy u'Ku/2 at the end of the record; of storeys that yield, hardening k d^2/2 + (1 - "
        "hardening) k z^2/2 of the drift d and z = d - p. With P-Delta less what weights have given, P d^2 / (2 "
        "h); springs of its foundation included.",
        "e_strain",
    ),
    _energy(
        "hysteretic_energy",
        "kN m",
        "energy lost in yielding",
        "Energy lost in yielding of the building's storeys until the end of the record, (1 - hardening) int k z "
        "dp, z the drift less its plastic part p.",
        hysteretic,
        needs=frozenset({"hysteretic"}),
        error=UNMEASURED,
        of_yielding=True,
    ),
    _energy(
        "energy_links",
        "kN m",
        "energy given to links",
        "Energy that the building has given to its links until the end of the record, negative where it has taken "
        "it; the sum over buildings is what the links' springs hold and their dashpots have lost.",
        "e_link",
        error=UNMEASURED,
        relative_to=("energy_input",),
        of_links=True,
    ),
    _energy(
        "energy_transfer_max",
        "kN m",
        "largest energy transfer",
        "Largest value over time of the transfer, what the building has given to its contacts: the integral of "
        "their forces on it times its floors' velocities, equal to input - kinetic - damping - strain - lost in "
        "yielding - given to links.",
        "tmax",
        relative_to=_EXCHANGED,
    ),
    _energy(
        "energy_transfer_min",
        "kN m",
        "smallest energy transfer",
        "Smallest value over time of the transfer, what the building has given to its contacts: the integral of "
        "their forces on it times its floors' velocities, equal to input - kinetic - damping - strain - lost in "
        "yielding - given to links; negative where the building has taken energy through its contacts.",
        "tmin",
        relative_to=_EXCHANGED,
    ),
    _energy(
        "contact_work",
        "kN m",
        "work taken by contacts",
        "Work the contacts of the pair took in until the end of the record, int F d' dt.",
        _work,
        needs=frozenset({"work"}),
        relative_to=(*_EXCHANGED, ("impact_force_max", "penetration_max"), ("impulse", "approach_speed_max")),
        per="pair",
    ),
)

REDUCERS = (
    Reducer("energy", tuple(Slot(name, "building") for name in ("e_in", "e_damp", "e_kin", "e_strain"))),
    Reducer("hysteretic", (Slot("travel", "floor"),), where="yields"),
    Reducer(
        "links", (Slot("e_link", "building"), Slot("link_lost", "link"), Slot("link_held", "link")), where="linked"
    ),
    Reducer("work", (Slot("work", "contact"),), where="touch"),
    Reducer(
        "transfer",
        (Slot("tmax", "building"), Slot("tmin", "building")),
        where="touch",
        looks="ends",
    ),
)
