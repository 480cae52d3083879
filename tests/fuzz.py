"""Seeded damage to files: what a bad disk, a broken download or a hostile hand makes of them."""

from __future__ import annotations

import random
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Processor time (s) after which reading one small file counts as hanging: thousands of times what it takes.
HANGING = 30.0

NUMBERS = [b"1e999", b"-1e308", b"9" * 400, b"1e-400", b"nan", b"-inf", b"0", b"-0.0", b"1_0", b"0x1f", b"1e", b"--1"]
WORDS = [b"NPTS", b"DT=", b"units", b"[sweep]", b"[[scene.row]]", b"true", b"inf", b"time", b"g", b'"""', b"'''"]
NOT_TEXT = [
    b"\x00",
    b"\xff\xfe",
    b"\xc3\x28",
    b"\xed\xa0\x80",
    b"\xef\xbb\xbf",
    b"\x1a",
    b"\x7f",
    b"\x85",
    "\u2028".encode(),
]
MARKS = list(b"0123456789.+-eEdD,;:= \t\r\n\"'#[]{}()_/\\")


def _flip(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 1, 3, 20))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _cut(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data)) :]


def _drop(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    del data[at : at + rng.choice((1, 8, 100))]


def _put(choices: list[bytes]) -> Callable[[bytearray, random.Random], None]:
    def put(data: bytearray, rng: random.Random) -> None:
        at = rng.randrange(len(data) + 1)
        data[at : at + rng.choice((0, 0, 1, 4))] = rng.choice(choices)

    return put


def _punctuate(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 2, 6))):
        data[rng.randrange(len(data))] = rng.choice(MARKS)


def _lines(change: Callable[[list[bytes], random.Random], None]) -> Callable[[bytearray, random.Random], None]:
    def changed(data: bytearray, rng: random.Random) -> None:
        lines = bytes(data).split(b"\n")
        change(lines, rng)
        data[:] = b"\n".join(lines)

    return changed


def _drop_line(lines: list[bytes], rng: random.Random) -> None:
    del lines[rng.randrange(len(lines))]


def _repeat_line(lines: list[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(lines))
    lines[at:at] = [lines[at]] * rng.choice((1, 2, 500))


def _swap_lines(lines: list[bytes], rng: random.Random) -> None:
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a]


def _long_line(lines: list[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(lines))
    lines[at] += rng.choice((b"1 ", b"-", b"(", b"x", b"9")) * rng.choice((5_000, 100_000))


def _number(data: bytearray, rng: random.Random) -> None:
    """Put an extreme number in the place of one that is there."""
    places = [i for i, byte in enumerate(data) if byte in b"0123456789"]
    if places:
        start = rng.choice(places)
        end = start
        while end < len(data) and data[end] in b"0123456789.":
            end += 1
        data[start:end] = rng.choice(NUMBERS)


def _nest(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data) + 1)
    one = rng.choice((b"[", b"{a=", b"[[", b"a.", b"("))
    data[at:at] = one * rng.choice((3, 200, 20_000))


#: Kinds of damage to text files.
TEXT_FAULTS: dict[str, Callable[[bytearray, random.Random], None]] = {
    "bits flipped": _flip,
    "cut": _cut,
    "bytes lost": _drop,
    "line lost": _lines(_drop_line),
    "line repeated": _lines(_repeat_line),
    "lines swapped": _lines(_swap_lines),
    "line very long": _lines(_long_line),
    "number extreme": _number,
    "word misplaced": _put(WORDS),
    "not text": _put(NOT_TEXT),
    "punctuation": _punctuate,
    "nested deeply": _nest,
}


def damaged(
    raw: bytes, faults: dict[str, Callable[[bytearray, random.Random], None]], count: int, seed: int
) -> Iterator[tuple[str, bytes]]:
    """Give `count` damaged copies of `raw`, each with the kind of its first fault; every fourth has several."""
    rng = random.Random(seed)
    kinds = list(faults)
    for index in range(count):
        data = bytearray(raw)
        first = kinds[index % len(kinds)]
        faults[first](data, rng)
        if index % 4 == 3:
            for _ in range(rng.randrange(1, 4)):
                if data:
                    faults[rng.choice(kinds)](data, rng)
        yield first, bytes(data)


@contextmanager
def not_hanging(what: str, seconds: float = HANGING) -> Iterator[None]:
    """Raise TimeoutError after so much processor time of this process (not of the clock: other work does not count)."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"{what} took more than {seconds:g} s of processor time")

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
