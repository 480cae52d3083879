"""A lane group's life: begin, step over the record, finish."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pounding_sweep.kernel import bouc_wen, forces, hysteresis, links, located, transfers
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import (
    Cell,
    any_lane,
    count_to,
    flag,
    fma,
    maximum,
    minimum,
    not_,
    size,
    when,
    when_any,
    where,
    while_any,
)
from pounding_sweep.kernel.peaks import each_step, largest_accelerations, samples, turning, turns
from pounding_sweep.kernel.row import each_given, kinetic, strain
from pounding_sweep.model.laws import RESTING_SPEED

#: A displacement (m) that only a diverged run reaches.
DIVERGED = 1.0e5
#: Bits of the output ``flags``.
FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED = 1, 2, 4


def begin(group: Group, start: Any, lanes: Any = None) -> None:
    """Fill lanes (all, or some) whose inputs are there; `start` is the first ground acceleration."""
    s, spec = group.state, group.spec

    def put(row: Any, x: Any) -> None:
        s[row] = x if lanes is None else where(lanes, x, s[row])

    for i in group.each(spec.n_moving):
        put(("u", i), group.full(group.prop("u0", i)))
        put(("v", i), group.full(group.prop("v0", i)))
    put("g1", s["scale"] * start)
    if spec.yielding:
        hysteresis.begin(group, lanes)
    if spec.law is not None:
        for which in range(len(spec.laws)):
            put(("shortest", which), group.full(group.limit.far))
    for reducer in group.reducers:
        for slot in (slot for slot in (*reducer.slots, *reducer.keeps) if slot.first):
            if slot.per == "building":
                for b, floors in group.each_building():
                    put((slot.name, b), slot.first(group, floors))
            else:
                for i in group.each(slot.count(spec)):
                    put((slot.name, i), group.full(slot.first(group, i)))
    if spec.implicit:
        group.scheme.begin(group)


def finish(group: Group) -> None:
    """Last peaks, energies and flags."""
    if group.spec.located:
        samples(group)
    conclude(group)


def conclude(group: Group) -> None:
    """Last energies and flags."""
    s, spec, r = group.state, group.spec, group.asked
    if "energy" in r:
        for b, floors in group.each_building():
            s["e_kin", b], s["e_strain", b] = kinetic(group, floors), strain(group, floors)
    if "links" in r:
        links.conclude(group)
    sound = Cell(group.lanes_where(True))
    for i in group.each(spec.n_moving):
        v = s["v", i]
        sound.now = sound.now & (size(s["u", i]) < DIVERGED) & (v - v == 0.0)
    flags = where(sound.now, group.full(0.0), float(FLAG_DIVERGED))
    if group.eventful:
        flags = flags + where(s["fallback"] > 0.0, float(FLAG_FALLBACK), group.full(0.0))
        flags = flags + where(s["unsolved"] > 0.0, float(FLAG_UNSOLVED), group.full(0.0))
    s["flags"] = flags


def plain_contacts(group: Group, h: Any, time: Any) -> None:
    """Onsets and sampled peaks of contacts at the end of a step."""
    s, r = group.state, group.asked
    implicit = group.spec.implicit
    for b in group.each(group.spec.n_buildings) if implicit and "transfer" in r else ():
        s["gain", b] = 0.0
    for j in group.each_contact():
        law, which = group.law_of(j), group.law_index(j)
        d = forces.penetration(group, j)
        v, before = group.between("v", j), group.between("v0", j)
        speed = maximum(v, before)
        closed = d > 0.0
        fresh = closed & (s["mode", j] == 0.0)
        s["mode", j] = where(closed, 1.0, group.full(0.0))
        for reducer in group.reducers:
            if reducer.plain:
                reducer.plain(group, forces.Sample(j, closed, fresh, d, v, speed, h, time))
        fastest = None
        if law.shape.per_speed:
            fastest = maximum(where(fresh, speed, s["vrun", j]), v)
            s["vrun", j] = where(closed, fastest, 0.0)
        with when_any(fresh):
            lasts = law.duration(group.stiffness(j), speed, group.prop("reduced", j))
            s["shortest", which] = where(fresh, minimum(s["shortest", which], lasts), s["shortest", which])
        if not (implicit or group.spec.history or group.looks("force")):
            continue
        c = s["c", j]
        if fastest is not None and law.shape.damper:
            c = c / maximum(fastest, RESTING_SPEED)
        p = law.elastic(group.stiffness(j), c, d)
        if law.shape.damper:
            p = p + law.damper(c, d) * law.damped_rate(v)
        force, last = where(closed, p if law.shape.tension else maximum(p, 0.0), 0.0), s["f1", j]
        s["f1", j] = force
        if "force" in r:
            s["fmax", j] = maximum(s["fmax", j], force)
        if implicit:
            for reducer, value in (("impulse", last + force), ("work", last * before + force * v)):
                if reducer in r:
                    s[reducer, j] = s[reducer, j] + 0.5 * h * value
            for force_at, v_at in ((last, "v0"), (force, "v")) if "transfer" in r else ():
                for b, power in each_given(group, j, force_at, v_at):
                    s["gain", b] = fma(0.5 * h, power, s["gain", b])


def _always(x: Any) -> Callable[[], Any]:
    return lambda: x


class FixedSteps:
    """All steps of one lane group, of one length."""

    def __init__(self, group: Group, ground: Any, note: Callable[[Any], None] | None) -> None:
        self.group, self.ground, self.note = group, ground, note

    def run(self) -> None:
        """Go through the record."""
        group, s, ground = self.group, self.group.state, self.ground
        closed = Cell(flag(group.trace, False))
        flowing = Cell(flag(group.trace, False)) if group.spec.yielding else None
        for i in count_to(ground.intervals, group.trace):
            for j in count_to(ground.steps, group.trace):
                ga, gb = ground.ends(i, j)
                number = i * ground.steps + j
                group.number = _always(number)
                s["h"], s["g0"], s["g1"] = ground.h, s["scale"] * ga, s["scale"] * gb
                if not group.eventful:
                    self._fly()
                elif group.spec.located:
                    self._locate(closed, flowing, ga, gb)
                else:
                    self._plain(number)
                if self.note is not None:
                    self.note(number + 1)

    def _reduce(self, add: Callable[[], None], turned: Any) -> None:
        group = self.group
        if group.spec.located and group.follows:
            with when_any(turned <= 0.0):
                turns(group)
        elif group.follows:
            samples(group)
        add()
        if group.spec.located:
            each_step(group)
        if "acceleration" in group.asked:
            largest_accelerations(group, group.spec.located)

    def _fly(self) -> None:
        group = self.group
        add = group.scheme.flight(group, self.ground.h)
        self._reduce(add, turning(group))

    def _locate(self, closed: Cell, flowing: Cell | None, ga: Any, gb: Any) -> None:
        group, s, h = self.group, self.group.state, self.ground.h
        touched = Cell(flag(group.trace, True))
        for _ in when(not_(closed.now)):
            add = group.scheme.flight(group, h)
            turned = turning(group)
            touched.now = any_lane(located.may_change(group, h))
            for _ in when(not_(touched.now)):
                if flowing is not None:
                    for _ in when(flowing.now):
                        hysteresis.follow(group)
                self._reduce(add, turned)
        for _ in when(closed.now):
            located.keep_start(group)
        for _ in when(touched.now):
            for now, before in (("u", "u0"), ("v", "v0"), *((("a", "a0"),) if group.spec.implicit else ())):
                for k in group.each(group.spec.n_moving):
                    s[now, k] = s[before, k]
            if group.spec.smooth:
                bouc_wen.return_to_start(group)
            located.begin(group, None, s["scale"] * ga, s["scale"] * gb, h)
            for _ in while_any(lambda: s["time_left"] > 0.0, group.trace):
                located.substep(group, h)
            closed.now = any_lane(forces.is_closed(group))
            if flowing is not None:
                flowing.now = any_lane(hysteresis.is_yielding(group))
            if located.needs_ends(group):
                for _ in when(not_(closed.now)):
                    located.clear_forces(group, s["scale"] == s["scale"])

    def _plain(self, number: Any) -> None:
        group, h = self.group, self.ground.h
        add = group.scheme.plain(group, h)
        plain_contacts(group, h, self.ground.time(number + 1))
        samples(group)
        add()
        if "transfer" in group.asked:
            transfers.plain(group)
        if "acceleration" in group.asked:
            largest_accelerations(group, located=False)
