"""Contact laws of a user's own: read from a Python file that is named, ``mylaws.py:my_law``."""

from __future__ import annotations

import runpy
import traceback
from pathlib import Path
from typing import Any

from pounding_sweep.base.errors import LawError, shown
from pounding_sweep.base.files import expanded
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS, Law, get_law

#: Groups of laws that a sweep may name in place of each law.
LAW_GROUPS = {"all": tuple(LAWS), "mate2015": MATE2015_MODELS}


def names_file(given: str) -> bool:
    """Whether a law is named by a file and a name in it."""
    return given.partition(":")[0].endswith(".py") or ".py:" in given


def find_law(given: Any, base: Path | None = None) -> Law:
    """Return a law of the registry by its key, one of a file (from the folder `base`) by FILE:NAME, or one given."""
    if isinstance(given, str) and names_file(given):
        return _checked(_load(given, base))
    law = get_law(given)
    return law if LAWS.get(law.key) is law else _checked(law)


def _checked(law: Law) -> Law:
    """Return a law of a user's own, if it can be one."""
    if LAWS.get(law.key) == law:
        return LAWS[law.key]
    where = f"law {law.key!r}" + (f" of {law.source}" if law.source else "")
    if law.key in LAWS or law.key in LAW_GROUPS:
        raise LawError(f"{where} has the key of a law or group that is there already; give it another key")
    if law.damping not in ("none", "viscous", "elastic") or law.exponent is None:
        raise LawError(
            f"{where} has damping {law.damping!r} and exponent {law.exponent}; a law of your own has a force"
        )
    if law.number is not None and not isinstance(law.number, str):
        raise LawError(
            f"{where} gives its damping number as a function; give it as text, a formula of e such as "
            "number='1.5*(1 - e)': it then belongs to the sweep, and goes to every worker"
        )
    reference = law.reference_stiffness
    if reference is not None and not (isinstance(reference, int | float) and 0.0 < reference < float("inf")):
        unit = law.stiffness_unit
        raise LawError(f"{where} has the reference_stiffness {shown(reference)}; it must be a positive number ({unit})")
    return law


def _load(given: str, base: Path | None) -> Law:
    """Run a law file and return the law of that name."""
    path, _, name = given.rpartition(":")
    if not path.endswith(".py") or not name.isidentifier():
        raise LawError(f"{given!r} names no law of a file; give FILE.py:NAME, such as mylaws.py:my_law")
    file = expanded(path) if base is None else Path(base) / expanded(path)
    if not file.is_file():
        raise LawError(
            f"law file {str(file)!r} does not exist; give a path relative to the sweep file, or an absolute one"
        )
    try:
        found = runpy.run_path(str(file), run_name=file.stem)
    except (Exception, SystemExit) as error:  # a user's file may raise anything
        lines = [entry.lineno for entry in traceback.extract_tb(error.__traceback__) if entry.filename == str(file)]
        lines += [error.lineno] if isinstance(error, SyntaxError) and error.filename == str(file) else []
        said = f"{type(error).__name__}: {error.msg if isinstance(error, SyntaxError) else error}"
        said = str(error) if isinstance(error, LawError) else said
        raise LawError(f"law file {file!s}{f':{lines[-1]}' if lines else ''}: {said}") from None
    law = found.get(name)
    if not isinstance(law, Law):
        there = [key for key, each in found.items() if isinstance(each, Law)]
        what = f"{name} is {shown(law)}, no Law" if name in found else f"there is no {name!r}"
        raise LawError(f"law file {file!s}: {what}; laws in it: {', '.join(there) or 'none (see pounding_sweep.Law)'}")
    object.__setattr__(law, "source", f"{file}:{name}")
    return law
