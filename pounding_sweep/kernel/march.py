"""A lane group's life: begin, step over the record, finish; steps that contacts may cut.

There each lane goes through its step in sub-steps that end at its events.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

from pounding_sweep import lanes as lane_code
from pounding_sweep.kernel import collapse, forces, hysteresis, impulse, rest, transfers
from pounding_sweep.kernel.group import BENDS, ENDS_OF_STEP, Group
from pounding_sweep.kernel.peaks import largest_accelerations, reduce_step, samples, turning, turns
from pounding_sweep.kernel.row import iter_powers
from pounding_sweep.kernel.types import Index, Lanes, Note, Truths
from pounding_sweep.lanes import Cell, any_lane, fma, maximum, minimum, not_, once_if, real, when_any, where, while_any
from pounding_sweep.model.laws import RESTING_SPEED

#: A displacement (m) that only a diverged run reaches.
DIVERGED = 1.0e5
#: Bits of the output ``flags``.
FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED = 1, 2, 4


def declare_rows(group: Group) -> None:
    """Declare what accelerations at the start, and steps that events cut, need."""
    if group.spec.implicit or group.has_events or group.spec.links:
        group.declare(group.spec.n_moving, "a0")
    if group.has_events:
        group.declare(1, "time_left", "fraction", "ahead", "tries", "land", "accepted", "fallback", "unsolved", "stiff")
        group.declare(1, *ENDS_OF_STEP)


def begin(group: Group, start: Lanes, lanes: Truths = None) -> None:
    """Fill lanes (all, or some) whose inputs are there; `start` is the first ground acceleration."""
    s, spec = group.state, group.spec
    for i in group.indices(spec.n_moving):
        s.put(lanes, group.full(group.prop("u0", i)), "u", i)
        s.put(lanes, group.full(group.prop("v0", i)), "v", i)
    group.ground.go(s["scale"] * start, s["scale"] * start, lanes)
    if spec.yielding:
        hysteresis.begin(group, lanes)
    if spec.law is not None:
        for which in range(len(spec.laws)):
            s.put(lanes, group.full(group.limit.far), "shortest", which)
    for reducer in group.reducers:
        for slot in (slot for slot in reducer.slots if slot.first):
            if slot.per == "building":
                for b, floors in group.iter_buildings():
                    s.put(lanes, slot.first(group, floors), slot.name, b)
            else:
                for i in group.indices(slot.count(spec)):
                    s.put(lanes, group.full(slot.first(group, i)), slot.name, i)
    rest.note_energies(group, lanes)
    if spec.implicit:
        group.scheme.begin(group)


def conclude(group: Group, lanes: Truths, steps: Index) -> None:
    """Last energies and flags of lanes that are at their end, after so many steps."""
    s, spec = group.state, group.spec
    rest.conclude(group, lanes)
    if spec.history:
        s.put(lanes, group.full(real(steps)), "ended")
    sound = group.cell(True)
    for i in group.indices(spec.n_moving):
        v = s["v", i]
        sound.now &= (lane_code.size(s["u", i]) < DIVERGED) & (v - v == 0.0)
    flags = where(sound.now, 0.0, float(FLAG_DIVERGED))
    flags = flags + s["collapsed"] if spec.falling else flags
    for spring in group.iter_springs() if "strength" in group.requested else ():
        spring.put(lanes, strength_left=spring.law.strength_left(spring))
    if group.has_events:
        flags = flags + where(s["fallback"] > 0.0, float(FLAG_FALLBACK), 0.0)
        flags = flags + where(s["unsolved"] > 0.0, float(FLAG_UNSOLVED), 0.0)
    s["flags"] = flags


def plain_contacts(group: Group, h: Lanes, time: Lanes) -> None:
    """Onsets and sampled peaks of contacts at the end of a step."""
    s, r = group.state, group.requested
    implicit = group.spec.implicit
    for b in group.indices(group.spec.n_buildings) if implicit and "transfer" in r else ():
        s["gain", b] = 0.0
    for contact in group.iter_contacts():
        law, which = contact.law, contact.law_index
        d = contact.penetration()
        v, before = contact.between("v"), contact.between("v0")
        speed = maximum(v, before)
        closed = d > 0.0
        fresh = closed & (contact.mode == 0.0)
        contact.mode = where(closed, 1.0, 0.0)
        forces.note_onset(contact, fresh, fresh, speed, time)
        for reducer in group.reducers:
            if reducer.plain:
                reducer.plain(contact, closed, d, h)
        fastest = None
        if law.shape.per_speed:
            fastest = maximum(where(fresh, speed, contact.fastest), v)
            contact.fastest = where(closed, fastest, 0.0)
        with when_any(fresh):
            lasts = law.duration(contact.stiffness, speed, contact.reduced)
            s.put(fresh, minimum(s["shortest", which], lasts), "shortest", which)
        if not (implicit or group.spec.history or group.looks("force")):
            continue
        c, last = contact.c, contact.force_end
        if fastest is not None and law.shape.damper:
            c = c / maximum(fastest, RESTING_SPEED)
        force = where(closed, law.closed_force(contact.stiffness, c, d, v), 0.0)
        contact.force_end = force
        if "force" in r:
            contact.fmax = maximum(contact.fmax, force)
        if implicit:
            if "impulse" in r:
                contact.impulse += 0.5 * h * (last + force)
            if "work" in r:
                contact.work += 0.5 * h * (last * before + force * v)
            for force_at, v_at in ((last, "v0"), (force, "v")) if "transfer" in r else ():
                for b, power in iter_powers(contact, force_at, v_at):
                    s["gain", b] = fma(0.5 * h, power, s["gain", b])


def begin_step(group: Group, lanes: Truths, ga: Lanes, gb: Lanes, h: Lanes) -> None:
    """Begin a step of length h, the ground moving from `ga` to `gb`, in some lanes."""
    s = group.state
    group.ground.go(ga, gb, lanes, ENDS_OF_STEP)
    for name, value in (("time_left", h), ("tries", 0.0), ("land", 0.0)):
        s.put(lanes, value, name)


def look_ahead(group: Group, h: Lanes) -> None:
    """Length and ground of every lane's next trial."""
    s = group.state
    most = group.prop("longest") if group.spec.staged else h
    rest, longest = s["time_left"], forces.longest_substep(group, most) if group.touching else group.full(most)
    if group.spec.flowing and not group.spec.series:
        longest = minimum(longest, hysteresis.longest(group, most))
    if group.spec.staged:  # two equal ones rather than a long one and what is left
        longest = where(longest < rest, minimum(longest, 0.5 * rest), longest)
    ahead = where((longest < rest) & (s["tries"] < forces.MAX_TRIES), longest, rest)
    length = where(rest > 0.0, where(s["land"] > 0.0, s["ahead"], ahead), 0.0)
    s["h"] = length
    done, (start, end) = h - rest, (s[name] for name in ENDS_OF_STEP)
    rise = (end - start) * (1.0 / h)
    early, late = (fma(x, rise, start) for x in (done, done + length))
    group.ground.go(where(done <= 0.0, start, early), where(length >= rest, end, late))


def refuse(group: Group, lanes: Truths) -> None:
    """Lanes that refuse their trial return to its start."""
    s, spec = group.state, group.spec
    s["land"] += where(lanes, 1.0, 0.0)
    s.put(lanes, 0.0, "accepted")
    s.put(lanes, 0.0, "h")
    pairs = [(name, f"{name}0", count) for name, count in moving_rows(group).items()]
    contacts = ("pen", "rate", "force")[: 2 + spec.impulsive] if group.touching else ()
    for now, before, count in [*pairs, *((f"{row}_end", f"{row}_start", len(group.contacts)) for row in contacts)]:
        for i in group.indices(count, straight=False):
            s.put(lanes, s[before, i], now, i)


def cut(group: Group, lanes: Truths) -> None:
    """Lanes end their trial at its first event."""
    s, t = group.state, group.state["fraction"]
    h = t * s["h"]
    for i in group.indices(group.spec.n_moving, straight=False):
        sped, moved, power = s["a0", i], 0.5 * s["a0", i], t
        for n, name in enumerate(BENDS, 3):
            bend = power * s[name, i]
            sped, moved, power = fma(float(n), bend, sped), moved + bend, t * power
            s.put(lanes, bend, name, i)
        s.put(lanes, fma(h, fma(h, moved, s["v0", i]), s["u0", i]), "u", i)
        s.put(lanes, fma(h, sped, s["v0", i]), "v", i)
    for contact in group.iter_contacts():
        contact.pen_end, contact.rate_end = contact.penetration(), contact.between("v")
    group.ground.go(group.ground.at(0.0)(0), group.ground.at(t)(0), lanes)
    s.put(lanes, 1.0, "land")
    s.put(lanes, h, "h")


def accept_substep(group: Group, look: Truths, kind: ModuleType) -> None:
    """Let lanes refuse their trial where an event ends it earlier; the length of the next one is in ``ahead``."""
    s, h = group.state, group.state["h"]
    ongoing = s["time_left"] > 0.0
    s["accepted"] = where(ongoing, 1.0, 0.0)
    landing = s["land"] > 0.0
    asks = ongoing & ~landing & look & (s["tries"] < forces.MAX_TRIES)
    if group.spec.implicit and group.touching:
        asks = asks | group.scheme.correct_landings(group, ongoing & landing)
    with when_any(asks):
        fraction = kind.locate_event(group, asks) if group.touching else group.full(1.0)
        if group.spec.yielding:
            fraction = minimum(fraction, hysteresis.locate_event(group, asks))
        early = asks & (fraction < 1.0)
        s.put(early, fraction, "fraction")
        s.put(early, h * fraction, "ahead")
        with when_any(early):
            # sums over the stages of a trial know no part of it
            sums = {"energy", "work", "impulse", "transfer", "links"} & group.requested
            (cut if group.spec.staged and not (group.spec.yielding or sums) else refuse)(group, early)


def substep(group: Group, h: Lanes) -> None:
    """One trial sub-step of every lane that has some of its step of length h left."""
    s, kind, r = group.state, impulse if group.spec.impulsive else forces, group.requested
    look_ahead(group, h)
    if group.spec.impulsive:
        for contact in group.iter_contacts(straight=True):
            contact.force_start = contact.force_end
    elif group.spec.implicit and group.touching:
        group.scheme.soften(group)
    add = group.scheme.trial(group)
    look = kind.update_penetrations(group) if group.touching else group.full(False)
    if group.spec.yielding:
        look = look | hysteresis.may_change(group, s["h"])
    accept_substep(group, look, kind)
    if group.touching:
        kind.sample_forces(group, group.prop("longest") if group.spec.staged else h)
    turns(group)
    if group.spec.impulsive:
        samples(group)  # a motion may turn in a velocity jump
    add()
    if "acceleration" in r:
        force_rates = impulse.force_rates if group.spec.impulsive else None
        largest_accelerations(group, located=True, pressed=group.presses, force_rates=force_rates)
    reduce_step(group)
    close(group, kind, h)


def close(group: Group, kind: ModuleType, h: Lanes) -> None:
    """Conclude a sub-step: time goes on, lanes that land change their modes, velocities jump."""
    s = group.state
    s["tries"] += where(s["land"] > 0.0, s["accepted"], forces.PLAIN_TRY * s["accepted"])
    for reducer in group.reducers:
        if reducer.substep:
            reducer.substep(group)
    if any(law.graded for law in group.laws) and not group.spec.impulsive:
        for contact in group.iter_contacts(straight=True):
            contact.age += s["h"]
    if group.spec.yielding:
        hysteresis.follow(group)
    rest = s["time_left"] - s["h"]
    s["time_left"] = where(rest > group.limit.done * h, rest, 0.0)
    accepted = s["accepted"] > 0.0
    if "transfer" in group.requested and not group.spec.series:
        transfers.substep(group, accepted)
    lands, implicit = accepted & (s["land"] > 0.0), group.spec.implicit and not group.spec.impulsive
    switched = group.cell(False)
    if implicit and group.touching:
        stiff = accepted & (s["stiff"] > 0.0)
        with when_any(stiff):
            group.scheme.settle(group, stiff)
            switched.now = stiff
    with when_any(lands):
        s.put(lands, 0.0, "land")
        if group.spec.yielding:
            switched.now |= hysteresis.apply_events(group, lands, h)
        if group.touching:
            switched.now |= kind.apply_events(group, lands, h)
    if implicit:
        with when_any(switched.now):
            group.scheme.balance(group, switched.now)
    keep_start(group)
    late = (s["time_left"] > 0.0) & (s["tries"] >= forces.MAX_TRIES)
    s.put(late, 1.0, "fallback")


def keep_start(group: Group) -> None:
    """Let the present state be the start of the next step."""
    for name, count in moving_rows(group).items():
        for i in group.indices(count):
            group.state[f"{name}0", i] = group.state[name, i]


def moving_rows(group: Group) -> dict[str, int]:
    """Return the rows that a step moves, and how many of each there are."""
    spec = group.spec
    floors = dict.fromkeys(("u", "v", *(["a"] if spec.implicit else [])), spec.n_moving)
    return floors | dict.fromkeys(spec.of_springs("moving"), len(spec.hysteretic))


def clear_forces(group: Group, lanes: Truths) -> None:
    """Flight goes on without contact forces, in some lanes."""
    for contact in group.iter_contacts(straight=True):
        contact.put(lanes, force_start=0.0, force_end=0.0, force_rate_start=0.0, force_rate_end=0.0)


def needs_ends(group: Group) -> bool:
    """Whether contact forces at the ends of a sub-step are asked for."""
    return group.touching and not group.spec.series and group.looks("ends")


def may_touch(group: Group, h: Lanes) -> Truths:
    """Lanes in which floors may touch in the step just flown, by its ends and their rates."""
    u0, v0, u, v = (name if group.looped else group.floors(name) for name in ("u0", "v0", "u", "v"))
    hit = group.cell(-1.0)
    for contact in group.iter_contacts(straight=True):
        gap = contact.gap
        d0, d1 = contact.between(u0) - gap, contact.between(u) - gap
        w0, w1 = contact.between(v0), contact.between(v)
        hit.now = maximum(hit.now, maximum(d1, minimum(fma(h, w0, d0), fma(-h, w1, d1))))
    return hit.now > 0.0


class FixedSteps:
    """All steps of one lane group, of one length; `leave` takes the results of lanes that are at their end."""

    def __init__(self, group: Group, ground: Any, note: Note, leave: Callable[[Truths], None]) -> None:
        self.group, self.ground, self.note, self.leave = group, ground, note, leave

    def run(self) -> None:
        """Go through the record and the rest after it."""
        group, ground = self.group, self.ground
        closed, number, busy, goes_on = Cell(False), Cell(0), group.cell(True), Cell(True)
        flowing = Cell(False) if group.spec.yielding else None
        for _ in while_any(lambda: goes_on.now):
            for _ in once_if(not_(number.now < ground.record)):
                self._leave(number.now, busy)
                goes_on.now = any_lane(busy.now)
            for _ in once_if(goes_on.now):
                for j in lane_code.count_to(ground.steps):
                    self._step(number.now, j, closed, flowing)
                number.now += 1

    def _leave(self, number: Index, busy: Cell) -> None:
        """Let lanes leave that are at their end, or that nothing changes any more, after so many intervals."""
        group, s = self.group, self.group.state
        rests = number - self.ground.record
        for _ in once_if(number == self.ground.record):
            rest.note_energies(group, None)
        over = Cell(busy.now & ~(s["rests"] > real(rests)))
        if group.spec.falling:
            over.now |= busy.now & ~collapse.stands(group)
        for _ in once_if(rests > 0) if group.spec.rest_is_bounded else ():
            over.now |= busy.now & ~rest.may_change(group) & (group.full(group.prop("settles")) > 0.0)
        with when_any(over.now):
            if group.spec.located:
                samples(group, over.now)
            conclude(group, over.now, number * self.ground.steps)
            self.leave(over.now)
        busy.now &= ~over.now

    def _step(self, i: Index, j: Index, closed: Cell, flowing: Cell | None) -> None:
        group, s, ground = self.group, self.group.state, self.ground
        ga, gb = ground.ends(i, j)
        number = i * ground.steps + j
        group.number = lambda: number
        h = where(collapse.stands(group), group.full(ground.h), 0.0) if group.spec.falling else ground.h
        s["h"] = h
        group.ground.go(s["scale"] * ga, s["scale"] * gb)
        if not group.has_events:
            self._reduce(group.scheme.flight(group, ground.h), turning(group))
        elif group.spec.located:
            for _ in once_if(any_lane(h > 0.0)) if group.spec.falling else (None,):
                self._step_events(closed, flowing, ga, gb, h)
        else:
            self._step_sampled(number)
        if self.note is not None:
            self.note(number + 1)

    def _reduce(self, add: Callable[[], None], turned: Truths) -> None:
        group = self.group
        if group.spec.located and group.follows:
            with when_any(turned <= 0.0):
                turns(group)
        elif group.follows:
            samples(group)
        add()
        if group.spec.located:
            reduce_step(group)
        if "acceleration" in group.requested:
            largest_accelerations(group, group.spec.located)

    def _step_events(self, closed: Cell, flowing: Cell | None, ga: Lanes, gb: Lanes, h: Lanes) -> None:
        group, s = self.group, self.group.state
        touched = Cell(True)
        for _ in once_if(not_(closed.now)):
            add = group.scheme.flight(group, h)
            turned = turning(group)
            asks = hysteresis.may_change(group, h) if group.spec.yielding else group.full(False)
            asks = asks | may_touch(group, h) if group.touching else asks
            touched.now = any_lane(asks & (h > 0.0) if group.spec.falling else asks)
            for _ in once_if(not_(touched.now)):
                if flowing is not None:
                    for _ in once_if(flowing.now):
                        hysteresis.follow(group)
                self._reduce(add, turned)
        for _ in once_if(closed.now):
            keep_start(group)
        for _ in once_if(touched.now):
            for name, count in moving_rows(group).items():
                for k in group.indices(count):
                    s[name, k] = s[f"{name}0", k]
            begin_step(group, None, s["scale"] * ga, s["scale"] * gb, h)
            for _ in while_any(lambda: s["time_left"] > 0.0):
                substep(group, self.ground.h)
            is_closed = forces.is_closed(group)
            closed.now = any_lane(is_closed & collapse.stands(group) if group.spec.falling else is_closed)
            if flowing is not None:
                flowing.now = any_lane(hysteresis.is_yielding(group))
            if needs_ends(group):
                for _ in once_if(not_(closed.now)):
                    clear_forces(group, group.full(True))

    def _step_sampled(self, number: Index) -> None:
        group, h = self.group, self.ground.h
        add = group.scheme.plain(group, h)
        plain_contacts(group, h, self.ground.time(number + 1))
        samples(group)
        add()
        if "transfer" in group.requested:
            transfers.plain(group)
        if "acceleration" in group.requested:
            largest_accelerations(group, located=False)
