"""A lane group's life: begin, step over the record, finish."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pounding_sweep.outputs.variables import output_slots
from pounding_sweep.kernel import exact, forces, impulse, located, newmark, rk4
from pounding_sweep.kernel import implicit as implicit_contact
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
from pounding_sweep.kernel.peaks import MOTION, add_powers, largest_accelerations, samples, transfers, turning, turns
from pounding_sweep.kernel.row import kinetic, strain
from pounding_sweep.model.laws import RESTING_SPEED

#: A displacement (m) that only a diverged run reaches.
DIVERGED = 1.0e5
#: Bits of the output ``flags``.
FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED = 1, 2, 4


def begin(group: Group, start: Any) -> None:
    """Fill a lane group whose inputs are there; `start` is the first ground acceleration."""
    s, spec, r = group.state, group.spec, group.asked
    for i in group.each(spec.n_dof):
        s["u", i], s["v", i] = group.full(group.prop("u0", i)), group.full(group.prop("v0", i))
        if "displacement" in r:
            s["umax", i] = s["umin", i] = s["u", i]
    s["g1"] = s["scale"] * start
    if spec.law is not None:
        s["shortest"] = group.limit.far
    if group.touching:
        for j in group.each(len(group.contacts)) if "first_time" in r else ():
            s["tfirst", j] = -1.0
        for b, floors in group.each_building() if "transfer" in r else ():
            s["kinetic0", b] = kinetic(group, floors)
    if spec.scheme == "newmark":
        if spec.impulsive and group.touching:
            impulse.rest(group, s["scale"] == s["scale"])
        else:
            implicit_contact.balance(group, None, s["g1"], pressed=True)


def finish(group: Group, fallback: bool = True) -> None:
    """Last peaks, energies and flags."""
    s, spec, r = group.state, group.spec, group.asked
    if spec.located and r & MOTION:
        samples(group)
    if "energy" in r:
        for b, floors in group.each_building():
            s["e_kin", b], s["e_strain", b] = kinetic(group, floors), strain(group, floors)
    sound = Cell(group.lanes_where(True))
    for i in group.each(spec.n_dof):
        v = s["v", i]
        sound.now = sound.now & (size(s["u", i]) < DIVERGED) & (v - v == 0.0)
    flags = where(sound.now, group.full(0.0), float(FLAG_DIVERGED))
    if group.touching and fallback:
        flags = flags + where(s["fallback"] > 0.0, float(FLAG_FALLBACK), group.full(0.0))
        flags = flags + where(s["unsolved"] > 0.0, float(FLAG_UNSOLVED), group.full(0.0))
    s["flags"] = flags


def whole(group: Group) -> list[tuple[Any, Any]]:
    """All buildings of a short row, and their floors."""
    return list(enumerate(group.building_floors))


def _record(group: Group, step: rk4.Step) -> Callable[[], None]:
    """Return what adds energies, work and impulse of a Runge-Kutta step, once it is taken."""

    def add() -> None:
        s, r = group.state, group.asked
        h6 = s["h"] * (1.0 / 6.0)
        if "energy" in r:
            add_powers(group, step.powers, h6)
        for j, x in enumerate(step.work):
            s["work", j] = fma(h6, x, s["work", j])
        for j, x in enumerate(step.impulse):
            s["impulse", j] = fma(h6, x, s["impulse", j])

    return add


def _record_long(group: Group) -> None:
    """Add energies, work and impulse of a Runge-Kutta step of a long row, which left its sums in rows."""
    s, r = group.state, group.asked
    h6 = s["h"] * (1.0 / 6.0)
    for b in group.each(group.spec.n_buildings) if "energy" in r else ():
        s["e_in", b] = fma(h6, s["din", b], s["e_in", b])
        s["e_damp", b] = fma(h6, s["ddamp", b], s["e_damp", b])


def _record_contacts(group: Group) -> None:
    s, r = group.state, group.asked
    h6 = s["h"] * (1.0 / 6.0)
    _record_long(group)
    for name in ("work", "impulse"):
        if name in r and not (name == "work" and group.spec.impulsive):
            for j in group.each(len(group.contacts)):
                s[name, j] = fma(h6, s[f"d{name}", j], s[name, j])


def rk4_trial(group: Group) -> Callable[[], None]:
    """Try a sub-step of every lane's own length by Runge-Kutta, modes frozen."""
    s, law = group.state, group.law
    assert law is not None
    if group.long:
        if group.spec.impulsive:
            rk4.step_long(group, s["h"], None, lambda name: impulse.join_rows(group, name))
        else:

            def push(j: Any) -> Any:
                d = group.between("x", j) - group.gap(j)
                return law.pressing(s["ke", j], s["ce", j], d, group.between("y", j))

            rk4.step_long(group, s["h"], push, None)
        return lambda: _record_contacts(group)
    every = range(len(group.contacts))
    u0, v0, ground, h = group.floors("u0"), group.floors("v0"), (s["g0"], s["g1"]), s["h"]
    if group.spec.impulsive:
        rests = impulse.resting(group)
        step = rk4.step(group, whole(group), u0, v0, h, ground, join=lambda a: impulse.join(group, a, rests))
    else:
        k, c, gaps = [s["ke", j] for j in every], [s["ce", j] for j in every], [group.gap(j) for j in every]

        def press(x: Any, y: Any) -> list[Any]:
            return [law.pressing(k[j], c[j], group.between(x, j) - gaps[j], group.between(y, j)) for j in every]

        step = rk4.step(group, whole(group), u0, v0, h, ground, press)
    group.put("a0", step.a0)
    group.put("u", step.u)
    group.put("v", step.v)
    return _record(group, step)


def newmark_trial(group: Group) -> Callable[[], None]:
    """Try a sub-step of every lane's own length by Newmark-beta, contacts implicit."""
    s = group.state
    h = s["h"]
    for b, floors in group.each_building():
        u, v, before = ([s[name, i] for i in floors] for name in ("u0", "v0", "a0"))
        now = newmark.step(group, b, floors, u, v, before, h, s["g1"])
        for p, i in enumerate(floors):
            s["u", i], s["v", i] = now[0][p], now[1][p]
            # a lane that is done waits with h = 0: its acceleration, contact included, stays as it is
            s["a", i] = where(h > 0.0, now[2][p], before[p])
    if group.spec.impulsive:
        implicit_contact.correct_resting(group, h)
    else:
        implicit_contact.correct(group, h)
    return lambda: newmark.add_gains(group)


def _newmark_flight(group: Group, h: Any) -> None:
    """Take a Newmark step of all lanes, contacts aside."""
    s = group.state
    for b, floors in group.each_building():
        before = [[s[name, i] for i in floors] for name in "uva"]
        now = newmark.step(group, b, floors, *before, h, s["g1"])
        for name, old, new in zip("uva", before, now, strict=True):
            for i, x, y in zip(floors, old, new, strict=True):
                s[f"{name}0", i], s[name, i] = x, y


def flight(group: Group, h: Any) -> Callable[[], None]:
    """Take a step of all lanes without contact."""
    s = group.state
    if group.spec.scheme == "newmark":
        _newmark_flight(group, h)
        return lambda: newmark.add_gains(group)
    if group.long:
        for b, floors in group.each_building():
            u, v = [s["u", i] for i in floors], [s["v", i] for i in floors]
            step = rk4.step(group, [(b, floors)], u, v, h, (s["g0"], s["g1"]))
            for p, i in enumerate(floors):
                s["u0", i], s["v0", i], s["u", i], s["v", i] = u[p], v[p], step.u[p], step.v[p]
            for gained, lost in step.powers:
                s["din", b], s["ddamp", b] = gained, lost
        return lambda: _record_long(group)
    u, v = group.floors("u"), group.floors("v")
    group.put("u0", u)
    group.put("v0", v)
    step = rk4.step(group, whole(group), u, v, h, (s["g0"], s["g1"]))
    group.put("u", step.u)
    group.put("v", step.v)
    return _record(group, step)


def plain(group: Group, h: Any) -> Callable[[], None]:
    """Take a step of all lanes whose contacts follow from the present state alone."""
    s, law = group.state, group.law
    assert law is not None
    if group.spec.scheme == "newmark":
        _newmark_flight(group, h)
        implicit_contact.correct(group, h)
        return lambda: newmark.add_gains(group)
    if group.long:
        located.keep_start(group)

        def push(j: Any) -> Any:
            d = group.between("x", j) - group.gap(j)
            return law.memoryless(s["k"], s["c", j], s["vrun", j], d, group.between("y", j))

        rk4.step_long(group, h, push, None)
        return lambda: _record_contacts(group)
    every = range(len(group.contacts))
    u, v = group.floors("u"), group.floors("v")
    group.put("u0", u)
    group.put("v0", v)
    k, c, gaps, run = s["k"], [s["c", j] for j in every], [group.gap(j) for j in every], [s["vrun", j] for j in every]

    def press(x: Any, y: Any) -> list[Any]:
        return [law.memoryless(k, c[j], run[j], group.between(x, j) - gaps[j], group.between(y, j)) for j in every]

    step = rk4.step(group, whole(group), u, v, h, (s["g0"], s["g1"]), press)
    group.put("u", step.u)
    group.put("v", step.v)
    return _record(group, step)


def plain_contacts(group: Group, h: Any, time: Any) -> None:
    """Onsets and sampled peaks of contacts at the end of a step."""
    s, law, r = group.state, group.law, group.asked
    assert law is not None
    newmark_scheme = group.spec.scheme == "newmark"
    for j in group.each_contact():
        d = forces.penetration(group, j)
        v, before = group.between("v", j), group.between("v0", j)
        speed = maximum(v, before)
        closed = d > 0.0
        fresh = closed & (s["mode", j] == 0.0)
        s["mode", j] = where(closed, 1.0, group.full(0.0))
        if "count" in r:
            s["count", j] = s["count", j] + where(fresh, 1.0, 0.0)
        if "approach_speed" in r:
            s["vmax", j] = maximum(s["vmax", j], where(fresh, speed, 0.0))
        if "first_time" in r:
            s["tfirst", j] = where(fresh & (s["tfirst", j] < 0.0), time, s["tfirst", j])
        if "penetration" in r:
            s["dmax", j] = maximum(s["dmax", j], d)
        fastest = None
        if law.shape.per_speed:
            fastest = maximum(where(fresh, speed, s["vrun", j]), v)
            s["vrun", j] = where(closed, fastest, 0.0)
        with when_any(fresh):
            lasts = law.duration(s["k"], speed, group.prop("reduced", j))
            s["shortest"] = where(fresh, minimum(s["shortest"], lasts), s["shortest"])
        if not (newmark_scheme or group.spec.history or r & {"force", "acceleration", "transfer"}):
            continue
        c = s["c", j]
        if fastest is not None and law.shape.damper:
            c = c / maximum(fastest, RESTING_SPEED)
        pull = maximum(v, 0.0) if law.shape.approach_only else v
        p = law.elastic(s["k"], c, d)
        if law.shape.damper:
            p = p + law.damper(c, d) * pull
        force, last = where(closed, p if law.shape.tension else maximum(p, 0.0), 0.0), s["f1", j]
        s["f1", j] = force
        if "force" in r:
            s["fmax", j] = maximum(s["fmax", j], force)
        if newmark_scheme:
            for reducer, value in (("impulse", last + force), ("work", last * before + force * v)):
                if reducer in r:
                    s[reducer, j] = s[reducer, j] + 0.5 * h * value
    if "transfer" in r:
        transfers(group)


class FixedSteps:
    """All steps of one lane group, of one length."""

    def __init__(self, group: Group, ground: Any, note: Callable[[Any], None] | None) -> None:
        self.group, self.ground, self.note = group, ground, note
        self.trial = newmark_trial if group.spec.scheme == "newmark" else rk4_trial

    def run(self) -> None:
        """Go through the record."""
        group, s, ground = self.group, self.group.state, self.ground
        closed = Cell(flag(group.trace, False))
        for i in count_to(ground.intervals, group.trace):
            for j in count_to(ground.steps, group.trace):
                ga, gb = ground.ends(i, j)
                number = i * ground.steps + j
                group.number = lambda number=number: number
                s["h"], s["g0"], s["g1"] = ground.h, s["scale"] * ga, s["scale"] * gb
                if not group.touching:
                    self._fly()
                elif group.spec.located:
                    self._locate(closed, ga, gb)
                else:
                    self._plain(number)
                if self.note is not None:
                    self.note(number + 1)

    def _reduce(self, add: Callable[[], None], turned: Any) -> None:
        group, r = self.group, self.group.asked
        if group.spec.located and r & MOTION:
            with when_any(turned <= 0.0):
                turns(group)
        elif r & MOTION:
            samples(group)
        add()
        if "acceleration" in r:
            largest_accelerations(group, group.spec.located)

    def _fly(self) -> None:
        group = self.group
        add = flight(group, self.ground.h)
        self._reduce(add, turning(group))

    def _locate(self, closed: Cell, ga: Any, gb: Any) -> None:
        group, s, h = self.group, self.group.state, self.ground.h
        touched = Cell(flag(group.trace, True))
        for _ in when(not_(closed.now)):
            add = flight(group, h)
            turned = turning(group)
            touched.now = any_lane(exact.may_touch(group, h))
            for _ in when(not_(touched.now)):
                self._reduce(add, turned)
        for _ in when(closed.now):
            located.keep_start(group)
        for _ in when(touched.now):
            for now, before in (("u", "u0"), ("v", "v0"), *((("a", "a0"),) if group.spec.scheme == "newmark" else ())):
                for k in group.each(group.spec.n_dof):
                    s[now, k] = s[before, k]
            located.begin(group, None, s["scale"] * ga, s["scale"] * gb, h)
            for _ in while_any(lambda: s["time_left"] > 0.0, group.trace):
                located.substep(group, self.trial, h)
            closed.now = located.is_any_closed(group)
            if located.needs_ends(group):
                for _ in when(not_(closed.now)):
                    located.clear_forces(group, s["scale"] == s["scale"])

    def _plain(self, number: Any) -> None:
        group, h = self.group, self.ground.h
        add = plain(group, h)
        plain_contacts(group, h, self.ground.time(number + 1))
        if group.asked & MOTION:
            samples(group)
        add()
        if "acceleration" in group.asked:
            largest_accelerations(group, located=False)


def outputs(group: Group) -> list[tuple[str, int]]:
    """Rows of results, in their order."""
    return list(output_slots(group.spec).count.items())
