"""Writing kernel source: lines, lane loops, and where a quantity lives.

No fast-math flag is ever set. Products that the hardware can fuse are written
as ``fma``, so a lane's arithmetic is fixed by the source: the flight step and
the contact step of a lane that touches nothing give the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pounding_sweep.kernels.shape import LANES, KernelShape, Slots, property_slots


class Source:
    """Indented lines of one function."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._depth = 0

    def __call__(self, line: str) -> None:
        """Append a line at the present depth."""
        self.lines.append("    " * self._depth + line)

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        """Write `head` and indent what follows."""
        self(head)
        self._depth += 1
        yield
        self._depth -= 1

    def function(self, head: str) -> None:
        """Begin a compiled function."""
        self._depth = 0
        self("")
        self("")
        self("@njit(**OPTIONS)")
        self(f"def {head}:")
        self._depth = 1

    def __str__(self) -> str:
        return "\n".join(self.lines) + "\n"


class StepText:
    """Where the quantities of one step live: locals in a fused step, slots otherwise."""

    def __init__(self, shape: KernelShape, slots: Slots, in_memory: bool) -> None:
        self.shape, self.slots, self.props = shape, slots, property_slots(shape)
        self.in_memory = in_memory
        self.contacts_of: list[list[tuple[int, str]]] = [[] for _ in range(shape.n_dof)]
        for j, (left, right, _) in enumerate(shape.contacts):
            if left >= 0:
                self.contacts_of[left].append((j, "-"))
            if right >= 0:
                self.contacts_of[right].append((j, "+"))

    def ref(self, kind: str, i: int) -> str:
        """Text of quantity `kind` of degree of freedom (or contact) `i` inside a lane loop."""
        if not self.in_memory:
            return f"{kind}{i}"
        home = {"u": "UO", "v": "VO"}.get(kind, f"_{kind}")
        return self.slots.at(home, i)

    def prop(self, name: str, i: int = 0) -> str:
        """Text of a scene constant."""
        return f"props[P_{name.upper()} + {i}]"

    def load_constants(self, src: Source, dofs: list[int]) -> None:
        """Local copies of the scene constants that these floors (and the storeys above them) use."""
        shape = self.shape
        for i in dofs:
            src(f"im{i} = {self.prop('im', i)}; k{i} = {self.prop('k', i)}; m{i} = {self.prop('m', i)}")
            if not shape.top[i] and i + 1 not in dofs:
                src(f"k{i + 1} = {self.prop('k', i + 1)}")
        for b in sorted({shape.building_of[i] for i in dofs}):
            src(f"al{b} = {self.prop('alpha', b)}; be{b} = {self.prop('beta', b)}")

    def storey_forces(self, src: Source, dofs: list[int], x: str, y: str) -> None:
        """Storey forces f = k (w_i - w_(i-1)), w = x + beta y, of these floors and the storeys above them."""
        shape = self.shape
        need = set(dofs)
        for i in dofs:
            if not shape.bottom[i]:
                need.add(i - 1)
            if not shape.top[i]:
                need.add(i + 1)
        for i in sorted(need):
            b = shape.building_of[i]
            if shape.storeys[b] > 1:
                src(f"w{i} = fma(be{b}, {self.ref(y, i)}, {self.ref(x, i)})")
            else:
                src(f"w{i} = {self.ref(x, i)}")
        for i in sorted(need):
            if i in dofs or (i - 1 in dofs and not shape.bottom[i]):
                src(f"f{i} = k{i} * w{i}" if shape.bottom[i] else f"f{i} = k{i} * (w{i} - w{i - 1})")

    def net_force(self, i: int, contact: str | None) -> str:
        """Force on floor `i` from its storeys and, where `contact` names it, its contacts."""
        text = f"-f{i}" if self.shape.top[i] else f"(f{i + 1} - f{i})"
        if contact is not None:
            for j, sign in self.contacts_of[i]:
                text = f"({text} {sign} {self.ref(contact, j)})"
        return text

    def rates(self, src: Source, dofs: list[int], y: str, ground: str, weight: str, first: bool) -> None:
        """Add the powers of ground input and damping at this stage to the step's increments."""
        shape = self.shape
        for b in sorted({shape.building_of[i] for i in dofs}):
            mine = [i for i in dofs if shape.building_of[i] == b]
            begins = first and shape.bottom[mine[0]]
            momentum = " + ".join(f"m{i} * {self.ref(y, i)}" for i in mine)
            mass = " + ".join(f"m{i} * {self.ref(y, i)} * {self.ref(y, i)}" for i in mine)
            stiff = []
            for i in mine:
                dv = self.ref(y, i) if shape.bottom[i] else f"({self.ref(y, i)} - {self.ref(y, i - 1)})"
                stiff.append(f"k{i} * {dv} * {dv}")
            for name, value in (
                ("DIN", f"-{ground} * ({momentum})"),
                ("DDAMP", f"al{b} * ({mass}) + be{b} * ({' + '.join(stiff)})"),
            ):
                slot = self.slots.at(name, b)
                old = "" if begins else f"{slot} + "
                src(f"{slot} = {old}{weight} * ({value})")


#: Writes one contact in a lane loop: text of left minus right in a slot, address of its gap, its first lane, its mass.
ContactBody = Callable[[Callable[[str], str], str, str, str], None]


def over_contacts(src: Source, shape: KernelShape, slots: Slots, body: ContactBody) -> None:
    """Write `body` for every contact, in lane loops.

    Few contacts are written out one by one, with addresses that are known to differ:
    a loop over contacts whose addresses come from a table is not vectorised as well.
    """
    if shape.fused:
        with src.block("for l in range(L):"):
            for j, (left, right, pair) in enumerate(shape.contacts):
                ends = [None if i < 0 else f"S[{{0}} + {i * LANES} + l]" for i in (left, right)]
                body(_between(ends), slots.at("gap", pair), str(j * LANES), f"props[P_REDUCED + {j}]")
        return
    with src.block("for j in range(NC):"):
        src("left = LEFT[j] * L; right = RIGHT[j] * L; gap = GAP + PAIR[j] * L; j0 = j * L")
        sides: list[tuple[str, list[str | None]]] = [
            ("if left >= 0 and right >= 0:", ["S[{0} + left + l]", "S[{0} + right + l]"]),
            ("elif left >= 0:", ["S[{0} + left + l]", None]),
            ("else:", [None, "S[{0} + right + l]"]),
        ]
        for head, ends in sides:
            with src.block(head), src.block("for l in range(L):"):
                body(_between(ends), "S[gap + l]", "j0", "props[P_REDUCED + j]")


def _between(ends: list[str | None]) -> Callable[[str], str]:
    """Return what writes left minus right of the motion in a slot."""
    return lambda slot: relative(*(None if end is None else end.format(slot) for end in ends))


def relative(ref_left: str | None, ref_right: str | None) -> str:
    """Text of left minus right, a wall being at rest."""
    if ref_left is None:
        return f"(-{ref_right})"
    return ref_left if ref_right is None else f"({ref_left} - {ref_right})"
