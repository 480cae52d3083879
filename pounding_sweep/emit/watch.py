"""Text that looks, after a step of free flight, for what happened in it: a possible touch, a peak."""

from __future__ import annotations

from pounding_sweep.emit.spec import KernelSpec, Slots
from pounding_sweep.emit.text import Source, StepText, relative


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
        _floors_turn(src, shape, text, list(range(shape.n_dof)))
        _closings_turn(src, shape, text, ends)
        src(f"{slots.at('TURN')} = turn")


def emit_watch(shape: KernelSpec, slots: Slots, flies: str = "") -> str:
    """Write ``watch(S, h)``, which does the same for a longer row, with one function for buildings or pairs alike."""
    src, text = Source(), StepText(shape, slots, in_memory=True)
    heights = shape.heights if shape.reducers & {"displacement", "drift"} else []
    contact = shape.law is not None and bool(shape.contacts)
    pairs = shape.alike if contact or "closing" in shape.reducers else []
    for kind, buildings in enumerate(heights):
        text.function(src, f"floors_turn_{kind}(S", buildings)
        for floors in buildings[0].chunks():
            with src.block("for l in range(L):"):
                src(f"turn = {text.floor('OWN_TURN', buildings[0].home)}")
                _floors_turn(src, shape, text, floors)
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
                if "closing" in shape.reducers:
                    src(f"turn = {text.floor('OWN_TURN', pair.home)}")
                    _closings_turn(src, shape, text, [(left, right) for _, left, right in contacts])
                    src(f"{text.floor('OWN_TURN', pair.home)} = turn")
    src.function("watch(S, h)")
    kept = (("OWN_HIT", "HIT", "-1.0", "max", contact), ("OWN_TURN", "TURN", "1.0", "min", _turning_kept(shape)))
    homes = [shape.home(b) for b in range(shape.n_buildings)]
    with src.block("for l in range(L):"):
        src("pass")
        for own, _, nothing, _, wanted in kept:
            for home in homes if wanted else ():
                src(f"{slots.at(own, home)} = {nothing}")
    for kind, buildings in enumerate(heights):
        text.call(src, f"floors_turn_{kind}(S", buildings)
    for kind, alike in enumerate(pairs):
        text.call(src, f"near_{kind}(S, h", alike)
    with src.block("for l in range(L):"):
        src("pass")
        for own, name, nothing, worst, wanted in kept:
            if not wanted:
                continue
            src(f"x = {nothing}")
            for home in homes:
                src(f"x = {worst}(x, {slots.at(own, home)})")
            guard = f" if {flies} else -1.0" if flies and name == "HIT" else ""
            src(f"{slots.at(name)} = x{guard}")
    return str(src)


def _turning_kept(shape: KernelSpec) -> bool:
    return bool(shape.reducers & {"displacement", "drift", "closing"})


def _between(text: StepText, slot: str, left: int, right: int) -> str:
    """Text of left minus right of two floors."""
    return relative(*(text.floor(slot, i) if i >= 0 else None for i in (left, right)))


def _near(src: Source, text: StepText, left: int, right: int, gap: str) -> None:
    """Raise ``hit`` to the largest penetration that the ends of the step and their rates allow for."""
    src(f"d0 = {_between(text, 'UO', left, right)} - {gap}; d1 = {_between(text, 'U', left, right)} - {gap}")
    src(f"v0 = {_between(text, 'VO', left, right)}; v1 = {_between(text, 'V', left, right)}")
    src("hit = max(hit, max(d1, min(fma(h, v0, d0), fma(-h, v1, d1))))")


def _floors_turn(src: Source, shape: KernelSpec, text: StepText, floors: list[int]) -> None:
    """Lower ``turn`` to zero or less where a displacement or drift that is kept turns in the step."""
    at = text.floor
    if "displacement" in shape.reducers:
        for i in floors:
            src(f"turn = min(turn, {at('VO', i)} * {at('V', i)})")
    if "drift" in shape.reducers:
        for i in floors:
            if not shape.bottom[i]:
                src(f"turn = min(turn, ({at('VO', i)} - {at('VO', i - 1)}) * ({at('V', i)} - {at('V', i - 1)}))")
            elif "displacement" not in shape.reducers:
                src(f"turn = min(turn, {at('VO', i)} * {at('V', i)})")


def _closings_turn(src: Source, shape: KernelSpec, text: StepText, ends: list[tuple[int, int]]) -> None:
    """Lower ``turn`` to zero or less where two floors that can meet turn towards or from each other in the step."""
    for left, right in ends if "closing" in shape.reducers else ():
        src(f"turn = min(turn, {_between(text, 'VO', left, right)} * {_between(text, 'V', left, right)})")
