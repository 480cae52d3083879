"""The one place that decides the time step of a file: by its header, its times, and what the caller gave."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice

import numpy as np
import numpy.typing as npt

from pounding_sweep.records.reader import NUMBER, Array, RecordText, Stated, StatedStep, to_float

_SECONDS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "segundos": 1.0, "": 1.0}
_SECONDS |= dict.fromkeys(("ms", "msec", "msecs", "millisec", "milliseconds", "millisecond"), 1e-3)
_SECONDS |= dict.fromkeys(("us", "µs", "usec", "microseconds"), 1e-6) | {"min": 60.0}
_N, _UNIT = NUMBER.pattern, r"[(\[]\s*(\w+)\s*[)\]]"
_STEP = re.compile(
    r"(?<![^\W_])(?:d_?t|delta[ _]?t|Δt|time[ _-]?(?:step|interval|increment)|sampl\w*[ _-]?(?:interval|period|step)|"
    rf"intervalo de muestreo|zeitschritt|pas de temps)(?:[ _]s)?\s*(?:{_UNIT})?\s*(?:[=:]|\bof\b|\bis\b)?\s*"
    rf"({_N})[ \t]*([^\W\d_]*)",
    re.IGNORECASE,
)
_RATE = re.compile(
    r"(?<![^\W_])(?:(?:sampl\w*|data)[ _-]?(?:rate|freq\w*)|fs(?=\s*[=:])|sampled at|(?:frecuencia|tasa|vel\w*\.?) de "
    r"muestreo|abtast\w*)\s*(?:[(\[]\s*(?:hz|sps|samples/s\w*|muestras/s\w*)\s*[)\]])?\s*(?:[=:]|\bof\b|\bis\b)?\s*"
    rf"({_N})(?:\s*(?:hz|sps))?|({_N})\s*(?:(?:muestras|samples|points|puntos)\s*(?:/|por|per)\s*s|sps\b)",
    re.IGNORECASE,
)
#: Lines that tell how a motion came about, in which a step may be that of another motion.
_STORY = re.compile(
    r"\bfrom\b|resampl|interpol|decimat|original|\bwas\b|\bwere\b|\bold\b|\bnow\b|before|after|->|→", re.I
)
#: Steps that differ by less are one.
_SAME = 1e-6


def stated_steps(lines: Iterable[tuple[int, str]], firm: bool = False) -> list[StatedStep]:
    """Collect the steps, and the inverse of sampling rates, that lines of a header state."""
    found = []
    for line, text in lines:
        for match in _STEP.finditer(text) if firm or not _STORY.search(text) else ():
            unit = (match[1] or match[3]).lower()
            if match[1] is None or unit in _SECONDS:
                found.append(
                    StatedStep(to_float(match[2]) * _SECONDS.get(unit, 1.0), f"{match[0].strip()!r}, line {line}", firm)
                )
        for match in _RATE.finditer(text) if firm or not _STORY.search(text) else ():
            rate = to_float(match[1] or match[2])
            found.append(StatedStep(1.0 / rate if rate else float("inf"), f"{match[0].strip()!r}, line {line}", firm))
    return found


def field_step(source: RecordText, fields: Mapping[str, Stated], key: str, rate: bool = False) -> list[StatedStep]:
    """Return the step (s) that the header of a format states, perhaps as a rate (1/s)."""
    value = source.number(fields, key)
    return [StatedStep((1.0 / value if value else -1.0) if rate else value, fields[key].where, firm=True)]


def choose_step(
    source: RecordText, stated: Sequence[StatedStep], lines: Iterable[tuple[int, str]] = ()
) -> tuple[float, str]:
    """Choose the time step (s) of a file without times, and say where it is from; a failure shows `lines`."""
    for step in stated:
        if not 0.0 < step.value < float("inf"):
            source.fail(f"its time step is {step.value:g} s ({step.where}); it must be positive and finite")
    different = list({f"{step.value:.6g}": step for step in reversed(stated)}.values())
    if source.dt is not None:
        wrong = [step for step in different if abs(step.value - source.dt) > _SAME * step.value]
        for step in wrong:
            if step.firm:
                text = f"its time step is {step.value:g} s, dt={source.dt:g} was given; leave dt out ({step.where})"
                source.fail(text)
        return source.dt, f"given{', in place of ' + ' and '.join(step.where for step in wrong) if wrong else ''}"
    if len(different) > 1:
        both = " and ".join(f"{step.value:g} s ({step.where})" for step in different)
        source.fail(f"states several time steps: {both}; give dt= in seconds")
    if not different:
        told = [f"{text.strip(' #%!/')[:60]!r}, line {line}" for line, text in lines if _STEP.search(text)]
        source.fail(f"has no time step{' of its own (' + told[0] + ')' if told else ''}; give dt= in seconds")
    return different[0].value, different[0].where


def _places(words: Iterable[str], size: int) -> Array:
    """Return the size of one unit in the last printed place in use, e.g. 0.01 for "1.25", of each number."""

    def place(word: str) -> float:
        mantissa, _, exponent = word.lower().replace("d", "e").partition("e")
        return 10.0 ** (max(-400, min(300, int(exponent[:6] or 0))) - len(mantissa.partition(".")[2]))

    # Writers drop trailing zeros, and "%g" coarsens as time grows: the finest place still to come is the one in use.
    sizes = np.fromiter(map(place, words), np.float64, size)
    return np.minimum.accumulate(sizes[::-1])[::-1]


@np.errstate(all="ignore")
def step_of_times(
    source: RecordText,
    time: Array,
    printed: Callable[[], Iterator[tuple[int, str]]],
    stated: Sequence[StatedStep],
    what: str,
) -> tuple[float, str]:
    """Find the constant step (s) that explains the printed times, each right to half a unit in its last place.

    `printed` goes through lines and printed times; `what` names their column. A `dt` of the caller wins where it
    explains the times too.
    """

    def row(wrong: npt.NDArray[np.bool_], shift: int = 1) -> tuple[int, str]:
        return next(islice(printed(), int(wrong.argmax()) + shift, None))

    remedy = "a record needs a constant time step; resample it"
    bad = ~np.isfinite(time)
    if bad.any():
        source.fail(f"line {row(bad, 0)[0]}: its time is not a finite number")
    if time.size == 1:
        return choose_step(source, stated)
    passed, index, steps = time[1:] - time[0], np.arange(1, time.size), np.diff(time)
    slack = (0.51 if time[0] == 0 else 1.02) * _places((word for _, word in printed()), time.size)[1:]
    slack += 2e-7 * np.maximum(np.maximum(np.abs(time[1:]), abs(time[0])), passed)  # for float32 times
    if source.dt is not None and (np.abs(passed - index * source.dt) <= slack + 1e-6 * source.dt * index).all():
        return source.dt, "given, and explains the times"
    if (steps <= 0).any():
        remedy = (
            f"{remedy}; or give dt= if its times are rounded, layout='rows' if it has none"
            if source.dt is None
            else remedy
        )
        source.fail(f"line {row(steps <= 0)[0]}: its time does not increase; {remedy}")
    slack = np.minimum(slack, 0.15 * np.median(steps))
    low = np.maximum.accumulate((passed - slack) / index)
    high = np.minimum.accumulate((passed + slack) / index)
    middle = float(low[-1] + high[-1]) / 2
    if not 1e-9 < 2 * middle < 1e9:
        source.fail(f"its time step of about {middle:g} s makes no sense; times must be in seconds")
    if low[-1] > high[-1]:
        line, text = row(low > high)
        source.fail(f"line {line}: time {text} s does not continue the steps before it; {remedy}")
    if source.dt is not None:
        source.fail(f"its time step is {middle:g} s, dt={source.dt:g} was given; leave dt out")
    rounded = [float(f"{middle:.{digits}e}") for digits in range(6)]
    candidates = (*rounded[:3], 1 / max(1, round(1 / middle)), *rounded[3:])
    step = next((value for value in candidates if low[-1] <= value <= high[-1]), middle)
    for other in stated:
        if abs(other.value - step) > 1e-3 * step and not low[-1] <= other.value <= high[-1]:
            source.fail(
                f"states several time steps: {step:g} s ({what}) and {other.value:g} s ({other.where}); give dt="
            )
    return step, what
