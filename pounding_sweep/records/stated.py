"""The one place that decides in which unit the accelerations of a file are, and its time step."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice

import numpy as np
import numpy.typing as npt

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import RecordError, unknown
from pounding_sweep.records.reader import NUMBER, Array, RecordText, Stated, StatedStep, not_acceleration, to_float

UNITS = {"g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "mm/s2": 1e-3}
UNITS |= {"mg": 1e-3 * STANDARD_GRAVITY, "%g": 0.01 * STANDARD_GRAVITY}
"""Acceleration units of files, each with its size in m/s2."""

_QUANTITIES = {
    **dict.fromkeys(UNITS, "acceleration"),
    **dict.fromkeys(("m/s", "cm/s", "mm/s", "in/s", "ft/s", "ms-1", "cms-1", "mms-1", "mps"), "velocity"),
    **dict.fromkeys(("m", "cm", "mm", "in", "inch", "ft"), "displacement"),
}
_ALIASES = {
    **{"gal": "cm/s2", "gals": "cm/s2", "g's": "g", "ms-2": "m/s2", "cms-2": "cm/s2", "mms-2": "mm/s2"},
    **{"ms2": "m/s2", "cms2": "cm/s2", "mms2": "mm/s2", "mps2": "m/s2", "milli-g": "mg", "percentg": "%g"},
}
_SPELLING = (
    *(("²", "2"), ("⁻", "-"), ("−", "-"), ("**", ""), ("^", ""), ("·", ""), ("*", "")),
    *(("second", "s"), ("sec", "s"), ("/s/s", "/s2")),
)
_TIMES = ("s", "ms", "min", "h", "hz")

_ACC = r"(?<![^\W_])(?:acc(?:n|l|[eé]l(?:[eé]ration)?s?)?|acel(?:eraci[oó]n)?|accelerazione|beschl(?:eunigung)?|ivme)"
_BRACKET = r"[(\[]\s*([^()\[\]\n]{1,24}?)\s*[)\]]"
#: What stands behind the name of an acceleration: perhaps its component, then the unit and nothing else.
_TAIL = re.compile(
    rf"{_ACC}(?![^\W_])[\s_.,:;/=-]*(?:(?:[xyzhvneu123]|ns|ew|ud|n-s|e-w|u-d|h[12])[\s_.,:;/-]+)?(?:in\s+)?([^\s:=].{{0,15}})$",
    re.IGNORECASE,
)
_BEHIND_ACC = re.compile(rf"{_ACC}\.?(?:[ \t]+[^\W\d_]+){{0,3}}?[ \t]*{_BRACKET}", re.IGNORECASE)
_UNITS = re.compile(
    r"(?:\bin\s+)?\b(?:units?|unidad(?:es)?|einheit(?:en)?|unit[ée]s?)\b\s*"
    r"((?:[:=]|(?:of|in|is|are|en)\b\s*[:=]?)?\s*[(\[]?)([^()\[\]\n]{1,40})",
    re.IGNORECASE,
)
_IN = re.compile(r"\b(?:in|en)\s+([^\s,;()\[\]][^,;()\[\]\n]{0,23})", re.IGNORECASE)
_VALUES = re.compile(rf"{_ACC}|(?:values?|data|amplitudes?|motions?|samples|ordinates|series)\s*$", re.IGNORECASE)
#: Lines that speak of other numbers than the values as they are: peaks, and units that were or will be.
_ASIDE = re.compile(
    r"convert|conversion|umgerechnet|multipl|divide|\bfrom\b.*\bto\b|\bwas\b|original|->|=>|→"
    r"|(?:[x×*/]|\btimes|\bby)\s*(?:9[.,]8|98[01]|386|32[.,][12])|\b(?:peak|max|min|pga|pgv|amax|rms|range|sensitiv|full.?scale|sensor|gain|resol|trigger)",
    re.IGNORECASE,
)
_NAMED = re.compile(
    r"(?<![^\W_])(?:(v_?g(?![^\W_])|vel(?![^\W_])|veloc|geschw|vitesse|velocidad)"
    r"|[ud]_?g(?![^\W_])|displ?(?![^\W_])|displac|verschieb|d[ée]plac|desplaz)",
    re.IGNORECASE,
)
_SERIES = re.compile(
    r"(?:^\W*(?:(?:ground|base|input|corrected|filtered|relative|absolute|horizontal|vertical)\s+)*"
    r"(veloc|displac)\w*\s*(?:$|[,;([]|at\b|of\b|record))|(veloc|displac)\w*\s+(?:time|data|histor|in\b)",
    re.IGNORECASE,
)


def _plain(text: str) -> str:
    plain = "".join(text.lower().split()).strip(".,;:")
    for spelled, meant in _SPELLING:
        plain = plain.replace(spelled, meant)
    return _ALIASES.get(plain, plain)


def _quantity(text: str) -> str | None:
    """Return the quantity, acceleration, velocity or displacement, that has the unit which `text` spells."""
    return _QUANTITIES.get(_plain(text))


def match_unit(text: str) -> str | None:
    """Find the unit of `UNITS` that `text` spells, or None."""
    return plain if (plain := _plain(text)) in UNITS else None


def require_unit(text: object) -> str:
    """Find the unit of `UNITS` that `text` spells, or raise `RecordError`."""
    unit = match_unit(text) if isinstance(text, str) else None
    if unit is None:
        raise RecordError(unknown("acceleration unit", text, [*UNITS, "gal", "m/s^2", "m/s**2", "cm/s^2", "cm/s/s"]))
    return unit


def _leading_unit(text: str) -> str:
    """Return the first words of a text that are a unit, with nothing but punctuation behind them; else the text."""
    words = text.split()
    for count in range(len(words), 0, -1):
        phrase = " ".join(words[:count])
        if _quantity(phrase) and (count == len(words) or phrase[-1] in ".,;:"):
            return phrase
    return text.strip()


def _of_heading(line: int, heading: str) -> list[Stated]:
    """Return the unit at a column's heading: in brackets at its end, else behind "in" or the word acceleration."""
    where = f"{heading!r}, line {line}"
    if _ASIDE.search(heading):
        return []
    bracket = re.search(_BRACKET + r"\W*$", heading)
    if bracket and (_quantity(bracket[1]) or "/" in bracket[1]):
        return [Stated(bracket[1], where)]
    plain = heading[: bracket.start()] if bracket else heading
    tail = _TAIL.search(plain.strip())
    text = tail[1] if tail else plain
    for spelled in (text, text.replace("_", "/"), text.replace("_", "")):
        if match_unit(spelled) and (tail or _plain(spelled) != "g"):
            return [Stated(spelled, where)]
    return []


def _of_remark(line: int, text: str) -> list[Stated]:
    """Return the units that a line of a header states: after "units", after "in", in brackets behind "acceleration"."""
    if _ASIDE.search(text):
        return []
    found: list[tuple[str, str]] = []
    for match in _UNITS.finditer(text):
        pieces = [_leading_unit(piece) for piece in re.split(r"[,;]", match[2])]
        units = [piece for piece in pieces if _quantity(piece)]
        units = units or [piece for piece in pieces[:1] if match[1] and piece and _plain(piece) not in _TIMES]
        found += [(unit, match[0][: match[0].index(unit) + len(unit)]) for unit in units]
    if not found:
        found += [(match[1], match[0]) for match in _BEHIND_ACC.finditer(text)]
        for match in _IN.finditer(text):
            unit = _leading_unit(match[1])
            if match_unit(unit) and (_plain(unit) not in ("g", "mg") or _VALUES.search(text[: match.start()])):
                found.append((unit, match[0][: match[0].index(unit) + len(unit)]))
        for piece in re.split(r"[,;|\t]", text):
            found += [(unit.text, piece) for unit in _of_heading(line, piece.strip()) if _TAIL.search(piece.strip())]
    return [Stated(unit, f"{' '.join(phrase.split())!r}, line {line}") for unit, phrase in found]


def stated_units(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> list[Stated]:
    """Collect the units that the lines of a header state for the column with a heading."""
    found = _of_heading(*heading) if heading else []
    return list(dict.fromkeys(found + [unit for line, text in lines for unit in _of_remark(line, text)]))


def other_quantity(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> tuple[str, str] | None:
    """Tell velocity or displacement by the column's heading, or else by a title, with the text that says so."""
    if heading and not re.search(_ACC, heading[1], re.IGNORECASE) and (match := _NAMED.search(heading[1])):
        return "velocity" if match[1] else "displacement", f"{heading[1]!r}, line {heading[0]}"
    for line, text in lines:
        match = _SERIES.search(text)
        if match and not re.search(r"acc", text, re.IGNORECASE):
            kind = "velocity" if (match[1] or match[2]).lower() == "veloc" else "displacement"
            return kind, f"{text.strip(' #%!/')[:60]!r}, line {line}"
    return None


def choose_unit(
    stated: Sequence[Stated], default: tuple[str, str] | None, wanted: str | None, shown: str
) -> tuple[str, str]:
    """Choose the unit of a file, and say where it is from.

    `default` is the unit of a format that states none, and why; `wanted` what the caller gave, which always wins;
    `shown` what the header has in place of a unit. Raises `RecordError` without the name of the file.
    """
    units: dict[str, Stated] = {}
    unreadable: dict[str, Stated] = {}
    for item in stated:
        if unit := match_unit(item.text):
            units.setdefault(unit, item)
        elif not _quantity(item.text):
            unreadable.setdefault(item.text, item)
    for item in stated:
        if not units and (quantity := _quantity(item.text)):
            raise RecordError(not_acceleration(quantity, item.where))
    if wanted:
        over = [item.where for unit, item in (units | unreadable).items() if unit != wanted]
        return wanted, f"given{', in place of ' + ' and '.join(over) if over else ''}"
    remedy = f"give units= one of {', '.join(map(repr, UNITS))}"
    if len(units) > 1 or (units and unreadable):
        both = " and ".join(f"{item.text!r} ({item.where})" for item in (*units.values(), *unreadable.values()))
        raise RecordError(f"states several units: {both}; {remedy}")
    if units:
        ((unit, item),) = units.items()
        return unit, item.where
    if default and not unreadable:
        return default
    header = ", ".join(f"{item.text!r} ({item.where})" for item in unreadable.values()) or shown
    raise RecordError(f"its units are not known{f'; its header says {header}' if header else ''}; {remedy}")


_SECONDS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "segundos": 1.0, "": 1.0}
_SECONDS |= dict.fromkeys(("ms", "msec", "msecs", "millisec", "milliseconds", "millisecond"), 1e-3)
_SECONDS |= dict.fromkeys(("us", "µs", "usec", "microseconds"), 1e-6) | {"min": 60.0}
_N, _IN_BRACKETS = NUMBER.pattern, r"[(\[]\s*(\w+)\s*[)\]]"
_STEP = re.compile(
    r"(?<![^\W_])(?:d_?t|delta[ _]?t|Δt|time[ _-]?(?:step|interval|increment)|sampl\w*[ _-]?(?:interval|period|step)|"
    rf"intervalo de muestreo|zeitschritt|pas de temps)(?:[ _]s)?\s*(?:{_IN_BRACKETS})?\s*(?:[=:]|\bof\b|\bis\b)?\s*"
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
