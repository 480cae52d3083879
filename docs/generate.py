"""Write the pages that list what the package's registries hold."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from gallery import gallery_page
from sweep_keys import key_tables
from typer.main import get_command
from typeset import typeset

import pounding_sweep.cli  # noqa: F401  (its import registers the commands)
from pounding_sweep import analysis
from pounding_sweep.analysis.comparisons import COMPARISONS, EVENTS
from pounding_sweep.analysis.comparisons.gaps import SEPARATION_RULES
from pounding_sweep.base.files import read_data
from pounding_sweep.cli.app import NAME, app
from pounding_sweep.figures import FIGURES
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS, RESTING_SPEED, Law
from pounding_sweep.model.presets import PRESETS
from pounding_sweep.model.rebound import RELATIONS
from pounding_sweep.plan.advice import measured_schemes
from pounding_sweep.plan.sanity import LIMITS
from pounding_sweep.records import NAMED_RECORDS, RECORD_SETS
from pounding_sweep.records.formats import READERS
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import DEFAULT_OUTPUTS, STATUS, VARIABLES


def _laws() -> str:
    lines = [
        "# Contact laws",
        "",
        "Force of one pair of floors while their penetration $d$ is positive; $v$ is the rate of $d$, $v_0$ the",
        "approach velocity at the touch, $m = m_1 m_2 / (m_1 + m_2)$. Units kN, t, m, s.",
        f"A touch slower than {RESTING_SPEED:g} m/s is damped as if it came at that speed.",
        "",
    ]
    groups: dict[str, list[Law]] = {name: [] for name in _GROUPS}
    for law in LAWS.values():
        groups[next(name for name, among in _GROUPS.items() if among(law))].append(law)
    for name, laws in groups.items():
        lines += [f"## {name}", "", *(line for law in laws for line in _law(law))]
    return "\n".join(lines)


#: Headings of the page of laws, each with what stands below it; a law stands below the first that fits.
_GROUPS: dict[str, Callable[[Law], bool]] = {
    "Models of Mate, Bakre & Jaiswal (2015)": lambda law: law.key in MATE2015_MODELS,
    "Forces with memory, and jumps of velocity": lambda law: law.yields or law.impulsive,
    "Linear springs with other dampers": lambda law: law.exponent == 1.0,
    "Hertz springs with other dampers": lambda law: True,
}


def _law(law: Law) -> list[str]:
    """Return what the page of laws says of one."""
    paper = "" if law.model == "-" else f" (model {law.model} of Mate, Bakre & Jaiswal 2015)"
    lines = [f"### `{law.key}`", "", f"{law.title}{paper}.", "", f"- force: {typeset(law.formula)}"]
    if law.number_text:
        lines.append(f"- damping number: {typeset(law.number_text)}")
    if law.relation:
        factor = f", with $z$ = {law.relation_factor:.6g} times the damping number" * (law.relation_factor != 1)
        found = typeset(RELATIONS[law.relation].text)
        lines.append(f"- [restitution it really gives](../restitution): {found}{factor}")
    if law.exponent is not None:
        power = "" if law.exponent == 1 else f"$^{{{law.exponent:g}}}$"
        lines.append(f"- contact stiffness $k$ in kN/m{power}")
    return [*lines, f"- restitution: {law.validity}", f"- source: {law.reference}", ""]


def _row(*cells: object) -> str:
    """Return one line of a table; a bar in a text is no edge of a cell."""
    return "| " + " | ".join(str(cell).replace("|", r"\|") for cell in cells) + " |"


def _schemes() -> str:
    """Return the schemes, their orders, limits and what statuses ask of their steps."""
    measured = measured_schemes()
    lines = [
        "# Schemes",
        "",
        "What `method` may name. The [theory](../theory) says how steps are cut at contacts, and what the limit is. A",
        "scheme whose errors were measured may be chosen for an `accuracy`; the others run at the `dt` that is given.",
        "Steps in a contact are the least of a scenario that is `ok`, with contacts located (and not).",
        "",
        "| scheme | what it is | order | steps in a contact | errors measured | source |",
        "|---|---|---:|---:|---|---|",
    ]
    for scheme in SCHEMES.values():
        sampled = "" if scheme.flies_exactly else f" ({scheme.min_steps_sampled:g})"
        steps, known = f"{scheme.min_steps_located:g}{sampled}", "yes" if scheme.name in measured else "no"
        lines.append(_row(f"`{scheme.name}`", scheme.title, scheme.order, steps, known, scheme.source))
    return "\n".join([*lines, ""])


def _variables() -> str:
    lines = [
        "# Variables of a cube",
        "",
        "Dimensions are those inside a scenario; in front of them stand the axes of the sweep.",
        "",
        "| name | dimensions | unit | meaning |",
        "|---|---|---|---|",
    ]
    for variable in VARIABLES.values():
        default = " (default)" if variable.name in DEFAULT_OUTPUTS or variable.always else ""
        dims = ", ".join(variable.dims) or "-"
        lines.append(_row(f"`{variable.name}`{default}", dims, variable.units, variable.definition))
    lines += ["", "## Status of a scenario", "", "| value | name | meaning | remedy |", "|---|---|---|---|"]
    lines += [_row(int(s), f"`{s.label}`", s.meaning, s.remedy or "-") for s in STATUS]
    return "\n".join([*lines, ""])


def _records() -> str:
    lines = ["# Records by name", "", "| name | event | file |", "|---|---|---|"]
    for known in NAMED_RECORDS.values():
        lines.append(_row(f"`{known.key}`", known.description, ", ".join(known.files)))
    lines += ["", "## Sets", "", "| name | what | records |", "|---|---|---:|"]
    lines += [_row(f"`{each.key}`", each.title, each.components) for each in RECORD_SETS.values()]
    return "\n".join([*lines, ""])


def _record_formats() -> str:
    """Return the formats of record files as a Markdown table."""
    rows = [_row(each.name, each.suffixes, each.step, each.unit) for each in READERS]
    return "\n".join(["| file | usual endings | time step | unit |", "|---|---|---|---|", *rows, ""])


def _presets() -> str:
    """Return the rows of the presets as Markdown tables."""
    lines = []
    for preset in PRESETS.values():
        scene, contact = preset.scene, preset.scene.contact
        lines += [f"**`{preset.key}`**: {preset.title}. Source: {preset.reference}.", ""]
        lines += [
            "| building | masses (t) | stiffnesses (kN/m) | damping ratio | first period (s) |",
            "|---|---|---|---|---|",
        ]
        for b in scene.buildings:
            masses, stiffnesses = (", ".join(f"{v:g}" for v in values) for values in (b.masses, b.stiffnesses))
            lines.append(_row(b.name, masses, stiffnesses, b.damping_ratio, f"{b.periods[0]:.4f}"))
        gaps = ", ".join(f"{gap:g}" for gap in scene.gaps)
        lines += [
            "",
            f"Gaps {gaps} m; contact {contact.linear_stiffness:g} kN/m, {contact.hertz_stiffness:g} kN/m^1.5, "
            f"restitution {contact.restitution:g}.",
            "",
        ]
    return "\n".join(lines)


def _commands() -> str:
    """Return every command of the command line with its help."""
    lines = [
        "# Command line",
        "",
        "What `pounding-sweep COMMAND --help` prints. Data go to stdout; progress, warnings and errors to stderr. Exit "
        "codes: 0, 1 failed, 2 wrong usage or bad input, 130 interrupted.",
        "",
    ]
    for name, text in _helps(get_command(app), NAME):
        lines += [f"## {name}", "", "```text", text.rstrip(), "```", ""]
    return "\n".join(lines)


def _helps(command: Any, name: str, parent: Any = None) -> Iterator[tuple[str, str]]:
    """Give the help of a command's own commands, at any depth, by name."""
    with command.make_context(name, [], parent=parent, resilient_parsing=True, terminal_width=100) as context:
        for key in command.list_commands(context):
            found = command.get_command(context, key)
            label = f"{context.command_path} {key}".removeprefix(f"{NAME} ")
            with found.make_context(key, [], parent=context, resilient_parsing=True, terminal_width=100) as inner:
                yield label, found.get_help(inner)
            if hasattr(found, "list_commands"):
                yield from _helps(found, key, context)


def _sweeps() -> str:
    """Return directives that show every sweep file of the repository."""
    lines = []
    languages = {".py": "python", ".toml": "toml"}
    for path in sorted((Path(__file__).parents[1] / "sweeps").glob("*.*")):
        language = languages[path.suffix]
        lines += [f"```{{literalinclude}} ../sweeps/{path.name}", f":caption: {path.name}", f":language: {language}"]
        lines += ["```", ""]
    return "\n".join(lines)


def _figures_api() -> str:
    """Return directives that document the functions of all figures."""
    drawn = [kind.draw for kind in FIGURES.values()]
    return "".join(f".. autofunction:: {draw.__module__}.{draw.__name__}\n" for draw in drawn)


def _analysis_api() -> str:
    """Return directives that document the public functions and classes of the comparisons."""
    lines = []
    for name in dir(analysis):
        found = getattr(analysis, name)
        if inspect.isfunction(found) or inspect.isclass(found):
            directive = "autofunction" if inspect.isfunction(found) else "autoclass"
            lines.append(f".. {directive}:: {found.__module__}.{name}\n")
    return "".join(lines)


def _comparisons() -> str:
    lines = ["| comparison | what it shows | what the cube must have | figure |", "|---|---|---|---|"]
    for item in COMPARISONS.values():
        drawn = f"`{item.figure}`" if item.figure else "-"
        lines.append(_row(f"`{item.key}`", item.title, item.needs, drawn))
    return "\n".join([*lines, ""])


def _separation_rules() -> str:
    lines = ["| rule | what it is | needed gap | clause | edition | note |", "|---|---|---|---|---|---|"]
    for rule in SEPARATION_RULES.values():
        formula = typeset(rule.formula)
        lines.append(_row(f"{rule.name} (`{rule.key}`)", rule.title, formula, rule.clause, rule.edition, rule.note))
    return "\n".join([*lines, ""])


def _events() -> str:
    lines = ["| event | in words | output | unit of the level |", "|---|---|---|---|"]
    for event in EVENTS.values():
        words = event.title.format(level="the level")
        lines.append(
            _row(f"`{event.key}`", words, f"`{event.variable}`" if event.variable else "-", event.units or "-")
        )
    return "\n".join([*lines, ""])


def _sanity() -> str:
    """Return the limits of real buildings as a Markdown table."""
    lines = ["| quantity | unit | from | to | slips that are named |", "|---|---|---:|---:|---|"]
    for limit in LIMITS.values():
        low, high = (f"{end:.4g}" if 0.0 < end < math.inf else "-" for end in (limit.low, limit.high))
        slips = ", ".join([*limit.slips, *limit.mistaken]) or "-"
        lines.append(_row(limit.what, limit.unit or "1", low, high, slips))
    return "\n".join([*lines, ""])


def _unmodelled() -> str:
    """Return what cannot be modelled as a Markdown table."""
    lines = ["| what cannot be modelled | what to do instead |", "|---|---|"]
    lines += [_row(topic["what"], topic["instead"]) for topic in read_data("unmodelled.toml").values()]
    return "\n".join([*lines, ""])


_PAGES = {
    "unmodelled.txt": _unmodelled,
    "laws.md": _laws,
    "schemes.md": _schemes,
    "variables.md": _variables,
    "records.md": _records,
    "record_formats.txt": _record_formats,
    "presets.txt": _presets,
    "sweeps.txt": _sweeps,
    "sweep_keys.txt": key_tables,
    "commands.md": _commands,
    "figures_api.txt": _figures_api,
    "analysis_api.txt": _analysis_api,
    "comparisons.txt": _comparisons,
    "separation_rules.txt": _separation_rules,
    "events.txt": _events,
    "sanity.txt": _sanity,
    "gallery.md": gallery_page,
}


def write_pages(folder: Path) -> None:
    """Write all generated pages below `folder`."""
    folder.mkdir(exist_ok=True)
    for name, text in _PAGES.items():
        (folder / name).write_text(text(), encoding="utf-8")
