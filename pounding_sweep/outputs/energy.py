"""Outputs of energies: what the ground puts in, what buildings lose, hold and give to their neighbours."""

from __future__ import annotations

import numpy as np

from pounding_sweep.outputs.declare import UNMEASURED, Reducer, Slot, Variable, needs
from pounding_sweep.outputs.readout import KernelResults, buildings

_BUILDING = ("building",)
#: Differences of larger energies: an undamped contact takes in no work in the end, however much passed through it.
_EXCHANGED = ("energy_transfer_max", "energy_transfer_min", "contact_work")


def _work(kept: KernelResults) -> np.ndarray:
    """Sum of the works of a pair's contacts."""
    result = np.zeros((len(kept), len(kept.scene.pair_labels)))
    work = kept.get("work", len(kept.scene.contacts))
    for j, contact in enumerate(kept.scene.contacts):
        result[:, contact.place] += work[:, j]
    return result


def hysteretic(kept: KernelResults) -> np.ndarray:
    """(1 - r) k dy by the plastic travel of its storeys, by building."""
    if "travel" not in kept.slots:
        return np.zeros((len(kept), len(kept.scene.buildings)))
    held = (1.0 - kept.variants.elastic_hardenings) * kept.variants.yield_strengths
    lost = np.where(kept.slots["travel"] > 0.0, held, 0.0) * kept.slots["travel"]
    return np.add.reduceat(lost, kept.scene.offsets[:-1], axis=1)


#: Of outputs of energies.
ENERGIES = (
    Variable(
        "energy_input",
        _BUILDING,
        "kN m",
        "energy input",
        "Energy put in by the ground until the end of the record, -int m ag v dt with v relative to the ground; its "
        "foundation included.",
        needs("energy"),
        buildings("e_in"),
        error="energies",
    ),
    Variable(
        "energy_damping",
        _BUILDING,
        "kN m",
        "energy lost in damping",
        "Energy lost in the building's own damping, dashpots and its foundation included, until the end of the record, "
        "int v'Cv dt.",
        needs("energy"),
        buildings("e_damp"),
        error="energies",
    ),
    Variable(
        "energy_kinetic",
        _BUILDING,
        "kN m",
        "kinetic energy at the end",
        "Kinetic energy v'Mv/2 of the motion relative to the ground, at the end of the record; foundation included.",
        needs("energy"),
        buildings("e_kin"),
        error="energies",
    ),
    Variable(
        "energy_strain",
        _BUILDING,
        "kN m",
        "strain energy at the end",
        "Elastic strain energy u'Ku/2 at the end of the record; of storeys that yield, hardening k d^2/2 + (1 - "
        "hardening) k z^2/2 of the drift d and z = d - p. With P-Delta less what weights have given, P d^2 / (2 h); "
        "springs of its foundation included.",
        needs("energy"),
        buildings("e_strain"),
        error="energies",
    ),
    Variable(
        "hysteretic_energy",
        _BUILDING,
        "kN m",
        "energy lost in yielding",
        "Energy lost in yielding of the building's storeys until the end of the record, (1 - hardening) int k z dp, z "
        "the drift less its plastic part p.",
        needs("hysteretic"),
        hysteretic,
        error=UNMEASURED,
        of_yielding=True,
    ),
    Variable(
        "energy_links",
        _BUILDING,
        "kN m",
        "energy given to links",
        "Energy that the building has given to its links until the end of the record, negative where it has taken it; "
        "the sum over buildings is what the links' springs hold and their dashpots have lost.",
        needs("links"),
        buildings("e_link"),
        error=UNMEASURED,
        relative_to=("energy_input",),
        of_links=True,
    ),
    Variable(
        "energy_transfer_max",
        _BUILDING,
        "kN m",
        "largest energy transfer",
        "Largest value over time of the transfer, what the building has given to its contacts: the integral of their "
        "forces on it times its floors' velocities, equal to input - kinetic - damping - strain - lost in yielding - "
        "given to links.",
        needs("transfer"),
        buildings("tmax"),
        error="energies",
        relative_to=_EXCHANGED,
    ),
    Variable(
        "energy_transfer_min",
        _BUILDING,
        "kN m",
        "smallest energy transfer",
        "Smallest value over time of the transfer, what the building has given to its contacts: the integral of their "
        "forces on it times its floors' velocities, equal to input - kinetic - damping - strain - lost in yielding - "
        "given to links; negative where the building has taken energy through its contacts.",
        needs("transfer"),
        buildings("tmin"),
        error="energies",
        relative_to=_EXCHANGED,
    ),
    Variable(
        "contact_work",
        ("pair",),
        "kN m",
        "work taken by contacts",
        "Work the contacts of the pair took in until the end of the record, int F d' dt.",
        needs("work"),
        _work,
        error="energies",
        # the last two are energies (kN m) that went through the contacts
        relative_to=(*_EXCHANGED, ("impact_force_max", "penetration_max"), ("impulse", "approach_speed_max")),
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
