"""Histories of one scenario: what its states after each step tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.base.files import read_data
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import history_slots
from pounding_sweep.model.storeys import Sampled
from pounding_sweep.model.variants import variants_of
from pounding_sweep.records import Record
from pounding_sweep.variables.registry import DIMS, scatter

if TYPE_CHECKING:
    import xarray as xr

#: Histories in the order of the dataset: what there is one of each for, unit, and what it is.
HISTORIES = {name: tuple(about.values()) for name, about in read_data("histories.toml").items()}


def histories(kernel: RowKernel, states: np.ndarray, record: Record, time: np.ndarray) -> dict[str, xr.DataArray]:
    """Return ``time`` and all histories that the row has, from its states at these times, shape (time, slots)."""
    import xarray as xr

    scene, slots = kernel.scene, history_slots(kernel.shape)
    row, n = variants_of(scene), scene.n_dof
    part = {name: states[:, first : first + slots.count[name]] for name, first in slots.first.items()}
    moved, moving = part["u"], part["v"]  # of floors, then of foundations
    u, v = moved[:, :n], moving[:, :n]
    drifts, deformations = scene.of_buildings("drifts"), scene.of_buildings("deformations")
    owner = np.repeat(np.arange(len(scene.buildings)), [b.n_storeys for b in scene.buildings])
    owned = np.equal.outer([*owner, *np.repeat(scene.foundations, 2)], range(len(scene.buildings))).astype(float)
    masses, base = np.hstack([row.masses, row.base_masses])[0], row.base_stiffnesses[0]
    alpha, beta = (factor[0, owner] for factor in row.rayleigh_factors)

    # in one more step of the record the ground comes to rest
    ground = np.append(record.time, record.duration + record.dt), np.append(record.acceleration, 0.0)

    # storeys, and their springs
    drift, stiffnesses = moved @ drifts.T, row.stiffnesses[0]
    spring = part.get("kt", stiffnesses) * drift + part.get("ct", 0.0)
    # of a building by its matrix shears are what it puts on the floors above, and hold what they have moved
    dense = np.repeat(["k" in b.letters for b in scene.buildings], np.diff(scene.offsets))
    spring = np.where(dense, moved @ scene.of_buildings("lateral_shears").T, spring)
    strain, plastic, losses = 0.5 * spring * drift, np.zeros_like(drift), np.zeros_like(drift)
    strain[:, list({element.floor for element in scene.springs})] = 0.0
    for e, (element, numbers) in enumerate(zip(scene.springs, row.spring_numbers, strict=True)):
        values = {name: constants[0, e] for name, constants in row.spring_constants.items()}
        values |= {name: part[name][:, e] for name in element.law.rows}
        strain[:, element.floor] += element.law.stored(Sampled(numbers.stiffness[0], values), drift[:, element.floor])
        plastic[:, element.floor] += values["slip"] * numbers.stiffness[0] / stiffnesses[element.floor]
        losses[:, element.floor] += element.law.loss(numbers)[0] * (part["travel"][:, e] if "travel" in part else 0.0)
    hysteretic = losses @ owned[:n]
    kd = part.get("kd", stiffnesses)
    damper = (np.where(dense, 0.0, beta * kd) + row.dashpots[0]) * (moving @ drifts.T)

    # contacts and links: what each floor moves them by
    shares, floors, contacts, links = np.zeros((len(scene.contacts), n)), np.eye(n), scene.contacts, scene.linked_floors
    for j, contact in enumerate(contacts):
        for floor, share in contact.ends:
            shares[j, floor] = share
    linked = np.array([floors[link.left] - floors[link.right] for link in links]).reshape(-1, n)
    gaps = scene.clearances(np.array([scene.gaps]), kernel.law.thickness)[0]
    force = part.get("force", np.zeros((len(time), len(contacts))))
    pull = u @ linked.T * [link.stiffness for link in links] + v @ linked.T * [link.damping for link in links]
    labels = np.equal.outer([contact.place for contact in contacts], range(len(scene.pair_labels)))

    on_floors = -alpha * masses[:n] * (moving @ deformations.T) - (spring + damper) @ drifts[:, :n]
    on_floors -= moving @ scene.of_buildings("dense_damping").T
    on_floors -= force @ shares + pull @ linked
    kinetic = (0.5 * masses * moving**2) @ owned
    strain = np.hstack([strain, 0.5 * base * moved[:, n:] ** 2]) @ owned
    to_links = part.get("e_link", np.zeros_like(kinetic))
    values = {
        "displacement": u,
        "velocity": v,
        "acceleration": on_floors / masses[:n],
        "ground_acceleration": np.interp(time, *ground)[:, None],
        "input": part["e_in"],
        "damping": part["e_damp"],
        "kinetic": kinetic,
        "strain": strain,
        "transfer": part["e_in"] - part["e_damp"] - strain - (kinetic - kinetic[0]) - hysteretic - to_links,
    }
    if any(scene.yields):
        shear = spring + row.geometric_stiffnesses[0] * drift
        values |= {"storey_drift": drift, "plastic_drift": plastic, "storey_shear": shear, "hysteretic": hysteretic}
    if scene.links:
        values |= {"link_force": pull, "given_to_links": to_links}
    if scene.foundations:
        values |= {"foundation_sway": moved[:, n::2], "foundation_rotation": moved[:, n + 1 :: 2]}
    if scene.pair_names:
        work = part.get("work", np.zeros_like(force)) @ labels.astype(float)
        values |= {"contact_force": force, "penetration": np.maximum(u @ shares.T - gaps, 0.0), "work": work}
    arrays = {"time": xr.DataArray(time, dims="time", attrs={"units": "s", "long_name": "time", "axis": "T"})}
    for name, (per, units, long_name) in HISTORIES.items():
        if name in values:
            about = {"units": units, "long_name": long_name}
            arrays[name] = xr.DataArray(scatter(values[name], scene, per), dims=("time", *DIMS[per]), attrs=about)
    return arrays


#: Peaks that a cube has, the histories in which they are seen, and on which side: 0 for either.
_SEEN = {
    "displacement_max": ("displacement", 1),
    "displacement_min": ("displacement", -1),
    "acceleration_max": ("acceleration", 0),
    "impact_force_max": ("contact_force", 0),
}


def peak_share(one: xr.Dataset) -> float:
    """Return the least share of a reported peak that its history shows, of displacements, accelerations and forces."""
    # peaks are located between the instants of the histories; the share is that of the largest of all floors or
    # contacts, 1 where every peak is shown
    least = 1.0
    for peak, (history, sign) in _SEEN.items():
        if peak in one and history in one:
            seen, reported = (float((abs(x) if sign == 0 else sign * x).max()) for x in (one[history], one[peak]))
            least = min(least, seen / reported) if reported > 0.0 else least
    return least


def instants_in_contact(one: xr.Dataset) -> float:
    """Return the instants of the longest contact of the floors that penetrate deepest; infinity without contact."""
    if "penetration" not in one or not (one["penetration"] > 0.0).any():
        return np.inf
    floors = one["penetration"].fillna(0.0).stack(floor=("pair", "storey")).transpose("floor", "time").values
    is_open = floors[floors.max(axis=1).argmax()] <= 0.0
    return np.diff(np.flatnonzero(np.concatenate([[True], is_open, [True]]))).max() - 1
