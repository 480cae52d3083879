"""Velocity jumps of floors that meet without a contact force, and floors that rest on each other.

A contact is in mode 0 (open) or 1: its floors rest on each other, with one velocity and one
acceleration. ``k_active`` > 0 marks those that rest. The force that holds them together follows
from the equation of motion; they part when it would pull.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pounding_sweep.kernel import transfers
from pounding_sweep.kernel.forces import MAX_TRIES, OPEN, course_of, is_closed, is_due, note_onset
from pounding_sweep.kernel.group import Contact, Group
from pounding_sweep.kernel.roots import NEVER, first_crossing
from pounding_sweep.kernel.row import put_accelerations
from pounding_sweep.kernel.types import Index, Lanes, Truths
from pounding_sweep.lanes import Cell, maximum, minimum, real, size, when_any, where, while_any
from pounding_sweep.model.laws import RESTING_SPEED

#: Mass (t) of a wall, beside which those of floors vanish.
WALL_MASS = 1.0e30
#: Rate, in units of the speed at which bounces end, below which floors that touch neither approach nor part.
PARTED = 1.0e-3
#: Approach, in the same units, below which a touch does not count: single precision tells no slower ones apart.
COUNTED = 1.0e-1
#: Shortest sub-step to the release of floors at rest, in trial sub-steps.
LEAST_SHARE = 1.0e-3


def declare_rows(group: Group) -> None:
    """Declare accelerations, with floors that rest on each other and without, and where floors come to rest."""
    if group.spec.impulsive:
        group.declare(group.spec.n_moving, "a", "alone", of_law=True)
        group.declare(len(group.spec.contacts), "joining", of_law=True)


def equalise_rows(group: Group, name: str, keeps: str = "force", memory: Any = None) -> None:
    """Give resting floors one rate, in rows of the state or of another `memory`; keep what it took."""
    s: Any = group.state if memory is None else memory
    values, forces = equalise(group, [s[name, i] for i in range(group.spec.n_moving)], resting(group))
    touched = {i for left, right, _ in group.contacts for i in (left, right) if i >= 0}
    for i in touched:
        s[name, i] = values[i]
    for j, x in enumerate(forces):
        s[keeps, j] = x


def equalise(group: Group, x: Sequence[Lanes], resting: Sequence[Truths]) -> tuple[list[Lanes], list[Lanes]]:
    """Give resting floors one rate: the mean by mass along each row of them; returns rates and what it took."""
    contacts, joined = group.contacts, list(x)
    before = {right: j for j, (_, right, _) in enumerate(contacts) if right >= 0}
    after = {left: j for j, (left, _, _) in enumerate(contacts) if left >= 0}
    total: list[Lanes] = []
    mass: list[Lanes] = []
    for left, _, _ in contacts:
        if left >= 0:
            momentum, heavy = group.prop("m", left) * x[left], group.full(group.prop("m", left))
        else:
            momentum, heavy = group.full(0.0), group.full(WALL_MASS)
        if left in before:
            b = before[left]
            momentum = where(resting[b], momentum + total[b], momentum)
            heavy = where(resting[b], heavy + mass[b], heavy)
        total.append(momentum)
        mass.append(heavy)
    common: list[Lanes] = [None] * len(contacts)
    force: list[Lanes] = [None] * len(contacts)
    for j, (_, right, _) in reversed(list(enumerate(contacts))):
        if right >= 0:
            m = group.prop("m", right)
            mean = (total[j] + m * x[right]) / (mass[j] + m)
        else:
            mean = total[j] / (mass[j] + WALL_MASS)
        if right in after:
            mean = where(resting[after[right]], common[after[right]], mean)
        common[j] = mean
        force[j] = where(resting[j], total[j] - mass[j] * mean, 0.0)
    for j, (left, right, _) in enumerate(contacts):
        for i in (left, right):
            if i >= 0:
                joined[i] = where(resting[j], common[j], joined[i])
    return joined, force


def resting(group: Group) -> list[Truths]:
    """Lanes in which the floors of each contact rest on each other."""
    return [contact.k_active > 0.0 for contact in group.iter_contacts(static=True)]


def resting_accelerations(group: Group, lanes: Truths) -> None:
    """Accelerations at the present state, and the forces of resting contacts, in some lanes."""
    s = group.state
    put_accelerations(group, "alone", "u", "v", group.ground.at(1.0))
    equalise_rows(group, "alone", "joining")
    for i in group.indices(group.spec.n_moving):
        s.put(lanes, s["alone", i], "a", i)
    for contact in group.iter_contacts(straight=True):
        contact.put(lanes, force_end=contact.joining)


def update_penetrations(group: Group) -> Truths:
    """Keep penetrations and their rates at both ends of the trial; returns the lanes in which something may happen."""
    s, look = group.state, group.cell(False)
    h = s["h"]
    closed = is_closed(group)
    with when_any(closed):
        resting_accelerations(group, closed)
    for contact in group.iter_contacts():
        v0, v1 = contact.between("v0"), contact.between("v")
        d0, d1 = contact.penetration("u0"), contact.penetration()
        contact.pen_start, contact.pen_end, contact.rate_start, contact.rate_end = d0, d1, v0, v1
        meets = maximum(d1, minimum(d0 + h * v0, d1 - h * v1)) > 0.0
        look.now |= where(contact.mode == OPEN, meets, contact.force_end < 0.0)
    return look.now


def locate_event(group: Group, asks: Truths) -> Lanes:
    """Fraction of the trial at which the first contact touches, or would pull (1: none), in the lanes that ask."""
    h, first = group.state["h"], group.cell(1.0)
    for contact in group.iter_contacts():
        mode, d0, d1, v0, v1 = contact.mode, contact.pen_start, contact.pen_end, contact.rate_start, contact.rate_end
        closed, late = mode > OPEN, contact.force_end
        pulls = closed & (late < 0.0)
        early = maximum(contact.force_start, 0.0)
        share = maximum(early / (early - late), LEAST_SHARE)  # a force may rise before it falls
        contact.put(asks, event=where(pulls, share, NEVER), next=where(pulls, OPEN, mode))
        # what a penetration at either end of the trial is the difference of
        far = size(contact.gap) + sum(contact.between(name, rounding=True) for name in ("u0", "u"))
        clear = group.limit.clear * far
        crosses = d1 > maximum(d0, 0.0) + clear
        busy = asks & ~closed & (crosses | (minimum(d0 + h * v0, d1 - h * v1) > 0.0))
        with when_any(busy):
            turns = busy & ~crosses & (v0 > 0.0) & (v1 < 0.0)
            depth = course_of(contact).begun(minimum(d0, 0.0))
            when = first_crossing(group, busy, depth, 1.0, crosses, turns, least=clear)
            contact.put(when < NEVER, event=when, next=1.0)
        first.now = minimum(first.now, contact.event)
    return first.now


def sample_forces(group: Group, length: Lanes) -> None:
    """Take the forces of resting floors over the sub-step just taken."""
    h = group.state["h"]
    for contact in group.iter_contacts() if group.spec.implicit and "impulse" in group.requested else ():
        contact.impulse += 0.5 * h * (contact.force_start + contact.force_end)


def force_rates(group: Group, end: str) -> None:
    """Rates of the forces of resting floors at an end of the sub-step, from those of accelerations without them."""
    s = group.state
    slope = group.ground.rise(0) / maximum(s["h"], group.limit.tiny)  # a wall moves as the ground
    _, rates = equalise(group, [x - slope for x in group.floors(f"acc_rate_{end}")], resting(group))
    for contact, x in zip(group.iter_contacts(static=True), rates, strict=True):
        setattr(contact, f"force_rate_{end}", x)


def _note_onset(contact: Contact, lanes: Truths, v: Lanes, h: Lanes) -> None:
    """Tell of an impact at the rate v; mark what is told."""
    group, r = contact.group, contact.group.requested
    fast = v > COUNTED * RESTING_SPEED
    if "count" in r:
        fast = fast | (contact.count == 0.0)
    note_onset(contact, lanes, lanes & (contact.next == 1.0) & fast, v, group.clock(h))
    contact.put(lanes, next=2.0)
    if "force" in r:
        contact.put(lanes, fmax=1.0)
    if "penetration" in r:
        contact.put(lanes, dmax=1.0)


def _set_speed(group: Group, i: Index, lanes: Truths, v: Lanes) -> None:
    """Let the velocity of a floor jump; its building gives its contacts the kinetic energy that it loses."""
    s, before = group.state, group.state["v", i]
    s["v", i] = after = where(lanes, v, before)
    if "transfer" in group.requested:
        b = group.home_of(i)[2]
        s["now", b] += 0.5 * group.prop("m", i) * (before - after) * (before + after)


def _jump(contact: Contact, lanes: Truths, v: Lanes, e: Lanes) -> None:
    """Velocities of two floors that meet at the rate v jump: v -> -e v, momentum kept (Newton's impact law)."""
    group = contact.group
    s, r, m = group.state, group.requested, contact.reduced
    left, right = contact.sides
    p = (1.0 + e) * m * v
    if left is not None:
        _set_speed(group, left, lanes, s["v", left] - p * group.prop("im", left))
    if right is not None:
        _set_speed(group, right, lanes, s["v", right] + p * group.prop("im", right))
    if "impulse" in r:
        contact.impulse += where(lanes, p, 0.0)
    if "work" in r:
        contact.work += where(lanes, 0.5 * m * v * v * (1.0 - e * e), 0.0)
    if "transfer" in r:
        transfers.jumped(group)


def _apply_impacts(group: Group, lanes: Truths, h: Lanes) -> None:
    """Impacts of the contacts at this instant (``next`` > 0), until none of their floors approach."""
    again = Cell(lanes)
    for _ in while_any(lambda: again.now, at_most=MAX_TRIES):
        mask, more = again.now, group.cell(False)
        for contact in group.iter_contacts():
            v, c = contact.between("v"), contact.c
            hits = mask & (contact.next > 0.0) & (v > PARTED * RESTING_SPEED)
            bounces = where(c * v > RESTING_SPEED, c, 0.0)
            with when_any(hits):
                _note_onset(contact, hits & ((contact.mode == OPEN) | (bounces > 0.0)), v, h)
                _jump(contact, hits, v, bounces)
            more.now |= hits
        again.now = more.now


def _stop_approach(group: Group, lanes: Truths) -> None:
    """Floors at this instant that do not part stop to approach: what `_apply_impacts` has left of it."""
    r = group.requested
    for contact in group.iter_contacts():
        v = contact.between("v")
        contact.put(lanes, rate_end=v)
        stays = (contact.next > 0.0) & (v >= -PARTED * RESTING_SPEED)
        contact.put(lanes, k_active=where(stays, 1.0, 0.0))
    speeds, impulses = equalise(group, group.floors("v"), resting(group))
    for i in {i for left, right, _ in group.contacts for i in (left, right) if i >= 0}:
        _set_speed(group, i, lanes, speeds[i])
    for contact, p in zip(group.iter_contacts(static=True), impulses, strict=True):
        if "impulse" in r:
            contact.impulse += where(lanes, p, 0.0)
        if "work" in r:
            contact.work += where(lanes, 0.5 * p * contact.rate_end, 0.0)
    if "transfer" in r:
        transfers.jumped(group)


def _choose(group: Group, lanes: Truths) -> None:
    """Let those of the contacts marked in ``k_active`` rest that are pressed; the others are unmarked."""
    active = Cell(lanes)
    for _ in while_any(lambda: active.now, at_most=len(group.contacts) + 1):
        mask = active.now
        resting_accelerations(group, mask)
        least, at = group.cell(-group.limit.released), group.cell(-1.0)
        for contact in group.iter_contacts():
            pressed = contact.force_end / contact.reduced
            worse = (contact.k_active > 0.0) & (pressed < least.now)
            least.now, at.now = where(worse, pressed, least.now), where(worse, real(contact.index), at.now)
        for contact in group.iter_contacts():
            contact.put(mask & (at.now == real(contact.index)), k_active=0.0)
        active.now = mask & (at.now >= 0.0)


def apply_events(group: Group, lanes: Truths, h: Lanes) -> Truths:
    """Let floors part, jump and come to rest at the instant that ends this sub-step; returns its lanes."""
    released = group.limit.released
    for contact in group.iter_contacts():
        due = is_due(contact, lanes)
        opened = contact.mode == OPEN
        pressed = ~opened & (contact.force_end > released * contact.reduced)
        takes_part = pressed | (due & opened) | (~due & ~opened)
        contact.put(lanes, next=where(takes_part, 1.0, 0.0))
    _apply_impacts(group, lanes, h)
    _stop_approach(group, lanes)
    _choose(group, lanes)
    for contact in group.iter_contacts():
        mode = where(contact.k_active > 0.0, 1.0, 0.0)
        comes = lanes & (mode > contact.mode)
        with when_any(comes):
            _note_onset(contact, comes, contact.rate_end, h)
        contact.put(lanes, mode=mode)
    return lanes
