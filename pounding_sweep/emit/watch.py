"""Text that looks, after a step of free flight, for what happened in it: a possible touch, a peak."""

from __future__ import annotations

from pounding_sweep.emit.spec import KernelSpec, Slots
from pounding_sweep.emit.text import Source, StepText, relative
from pounding_sweep.outputs.variables import reducers_of


def watch(src: Source, shape: KernelSpec, slots: Slots, flies: str = "") -> None:
    """Write, per lane (that `flies`), whether a floor may have touched (HIT > 0) and a kept peak turned (TURN <= 0)."""
    text = StepText(shape, slots, in_memory=True)
    ends = [(left, right) for left, right, _ in shape.contacts]
    if shape.law is not None and ends:
        src("hit = -1.0")
        for (left, right), contact in zip(ends, shape.contacts, strict=True):
            _near(src, text, left, right, slots.at("gap", contact[2]))
        src(f"{slots.at('HIT')} = hit if {flies} else -1.0" if flies else f"{slots.at('HIT')} = hit")
    if _turning_kept(shape):
        src("turn = 1.0")
        for reducer in reducers_of(shape):
            reducer.watch_floors(src, shape, text.floor, list(range(shape.n_dof)))
        for reducer in reducers_of(shape):
            reducer.watch_contacts(src, text.floor, ends)
        src(f"{slots.at('TURN')} = turn")


def emit_watch(shape: KernelSpec, slots: Slots, flies: str = "") -> str:
    """Write ``watch(S, h)``, which does the same for a longer row, with one function for buildings or pairs alike."""
    src, text = Source(), StepText(shape, slots, in_memory=True)
    kept = reducers_of(shape)
    heights = shape.heights if any(reducer.peaks == "floors" for reducer in kept) else []
    contact = shape.law is not None and bool(shape.contacts)
    closings = any(reducer.peaks == "contacts" for reducer in kept)
    pairs = shape.alike if contact or closings else []
    for kind, buildings in enumerate(heights):
        text.function(src, f"floors_turn_{kind}(S", buildings)
        for floors in buildings[0].chunks():
            with src.block("for l in range(L):"):
                src(f"turn = {text.floor('OWN_TURN', buildings[0].home)}")
                for reducer in kept:
                    reducer.watch_floors(src, shape, text.floor, floors)
                src(f"{text.floor('OWN_TURN', buildings[0].home)} = turn")
    for kind, alike in enumerate(pairs):
        text.function(src, f"near_{kind}(S, h", alike)
        pair = alike[0]
        for contacts in pair.chunks():
            with src.block("for l in range(L):"):
                if contact:
                    src(f"hit = {text.floor('OWN_HIT', pair.home)}; g = {text.gap(pair)}")
                    for _, left, right in contacts:
                        _near(src, text, left, right, "g")
                    src(f"{text.floor('OWN_HIT', pair.home)} = hit")
                if closings:
                    src(f"turn = {text.floor('OWN_TURN', pair.home)}")
                    for reducer in kept:
                        reducer.watch_contacts(src, text.floor, [(left, right) for _, left, right in contacts])
                    src(f"{text.floor('OWN_TURN', pair.home)} = turn")
    src.function("watch(S, h)")
    worst_of = (("OWN_HIT", "HIT", "-1.0", "max", contact), ("OWN_TURN", "TURN", "1.0", "min", _turning_kept(shape)))
    homes = [shape.home(b) for b in range(shape.n_buildings)]
    with src.block("for l in range(L):"):
        src("pass")
        for own, _, nothing, _, wanted in worst_of:
            for home in homes if wanted else ():
                src(f"{slots.at(own, home)} = {nothing}")
    for kind, buildings in enumerate(heights):
        text.call(src, f"floors_turn_{kind}(S", buildings)
    for kind, alike in enumerate(pairs):
        text.call(src, f"near_{kind}(S, h", alike)
    with src.block("for l in range(L):"):
        src("pass")
        for own, name, nothing, worst, wanted in worst_of:
            if not wanted:
                continue
            src(f"x = {nothing}")
            for home in homes:
                src(f"x = {worst}(x, {slots.at(own, home)})")
            guard = f" if {flies} else -1.0" if flies and name == "HIT" else ""
            src(f"{slots.at(name)} = x{guard}")
    return str(src)


def _turning_kept(shape: KernelSpec) -> bool:
    return any(reducer.peaks for reducer in reducers_of(shape))


def _between(text: StepText, slot: str, left: int, right: int) -> str:
    """Text of left minus right of two floors."""
    return relative(*(text.floor(slot, i) if i >= 0 else None for i in (left, right)))


def _near(src: Source, text: StepText, left: int, right: int, gap: str) -> None:
    """Raise ``hit`` to the largest penetration that the ends of the step and their rates allow for."""
    src(f"d0 = {_between(text, 'UO', left, right)} - {gap}; d1 = {_between(text, 'U', left, right)} - {gap}")
    src(f"v0 = {_between(text, 'VO', left, right)}; v1 = {_between(text, 'V', left, right)}")
    src("hit = max(hit, max(d1, min(fma(h, v0, d0), fma(-h, v1, d1))))")
