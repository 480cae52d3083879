"""Seeded damage to files: what a bad disk, a broken download or a hostile hand makes of them."""

from __future__ import annotations

import random
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Processor time (s) after which reading one small file counts as hanging: thousands of times what it takes.
HANGING = 30.0

NUMBERS = [b"1e999", b"-1e308", b"9" * 400, b"1e-400", b"nan", b"-inf", b"0", b"-0.0", b"1_0", b"0x1f", b"1e", b"--1"]
WORDS = [b"NPTS", b"DT=", b"units", b"[sweep]", b"[[scene.row]]", b"true", b"inf", b"time", b"g", b'"""', b"'''"]
NOT_TEXT = [b"\x00", b"\xff\xfe", b"\xc3\x28", b"\xed\xa0\x80", b"\xef\xbb\xbf", b"\x1a", b"\x7f", b"\x85"]
NOT_TEXT += [b"\xe2\x80\xa8"]
MARKS = list(b"0123456789.+-eEdD,;:= \t\r\n\"'#[]{}()_/\\")
NESTS = (b"[", b"{a=", b"[[", b"a.", b"(")
Fault = Callable[[bytearray, random.Random], None]


def _flip(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 1, 3, 20))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _punctuate(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 2, 6))):
        data[rng.randrange(len(data))] = rng.choice(MARKS)


def _number(data: bytearray, rng: random.Random) -> None:
    """Put an extreme number in the place of one that is there."""
    if numbers := [match.span() for match in re.finditer(rb"[0-9][0-9.]*", data)]:
        start, end = rng.choice(numbers)
        data[start:end] = rng.choice(NUMBERS)


def _replace(lost: tuple[int, ...], put: Callable[[random.Random], bytes] = lambda _: b"") -> Fault:
    """Make the fault that something stands in the place of so many bytes."""

    def replace(data: bytearray, rng: random.Random) -> None:
        at = rng.randrange(len(data))
        data[at : at + rng.choice(lost)] = put(rng)

    return replace


def _lines(change: Callable[[list[bytes], int, random.Random], None]) -> Fault:
    """Make a fault of one of the lines."""

    def changed(data: bytearray, rng: random.Random) -> None:
        lines = bytes(data).split(b"\n")
        change(lines, rng.randrange(len(lines)), rng)
        data[:] = b"\n".join(lines)

    return changed


def _swap(lines: list[bytes], at: int, rng: random.Random) -> None:
    other = rng.randrange(len(lines))
    lines[at], lines[other] = lines[other], lines[at]


def _lengthen(lines: list[bytes], at: int, rng: random.Random) -> None:
    lines[at] += rng.choice((b"1 ", b"-", b"(", b"x", b"9")) * rng.choice((5_000, 100_000))


#: Kinds of damage to text files.
TEXT_FAULTS: dict[str, Fault] = {
    "bits flipped": _flip,
    "cut": _replace((2**40,)),
    "bytes lost": _replace((1, 8, 100)),
    "line lost": _lines(lambda lines, at, _: lines.pop(at) and None),
    "line repeated": _lines(lambda lines, at, rng: lines.extend([lines[at]] * rng.choice((1, 2, 500)))),
    "lines swapped": _lines(_swap),
    "line very long": _lines(_lengthen),
    "number extreme": _number,
    "word misplaced": _replace((0, 0, 1, 4), lambda rng: rng.choice(WORDS)),
    "not text": _replace((0, 0, 1, 4), lambda rng: rng.choice(NOT_TEXT)),
    "punctuation": _punctuate,
    "nested deeply": _replace((0,), lambda rng: rng.choice(NESTS) * rng.choice((3, 200, 20_000))),
}


def damaged(raw: bytes, faults: dict[str, Fault], count: int, seed: int) -> Iterator[tuple[str, bytes]]:
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
