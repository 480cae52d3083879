"""``doctor``: the state of this installation, and whether it computes what it should."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Annotated, Any

import typer

from pounding_sweep.base.tables import bytes_text, print_json, print_pairs, seconds_text
from pounding_sweep.base.text import printable
from pounding_sweep.cli.app import AsJson, app
from pounding_sweep.cli.reporting import FAILED, NAME, reporting, say


@app.command("doctor")
def doctor_command(
    no_check: Annotated[bool, typer.Option("--no-check", help="Only look; run no scenarios.")] = False,
    as_json: AsJson = False,
) -> None:
    """Show versions, processor, kernel cache, problems, and run a few scenarios whose results are known."""
    with reporting():
        from pounding_sweep.run.diagnosis import diagnose

        found = diagnose()
        if not as_json:
            _print_state(found)
        if not no_check:
            from pounding_sweep.accuracy.self_check import TOLERANCE, self_check, to_compile

            if not as_json:
                missing, seconds = to_compile()
                first = f"; {missing} kernels are compiled first: about {seconds_text(seconds)} of CPU time"
                say(f"running the self-check{first if missing else ''}")
            check = self_check()
            found["self_check"] = {
                **asdict(check),
                "error_max": check.error_max if math.isfinite(check.error_max) else None,
                "passed": check.passed,
                "tolerance": TOLERANCE,
            }
            if not as_json:
                _print_check(found["self_check"])
        if as_json:
            print_json(found)
        if not no_check and not found["self_check"]["passed"]:
            say("failed: this installation does not compute the stored values; install it again, or report this")
            raise typer.Exit(FAILED)


def _print_state(found: dict[str, Any]) -> None:
    """Print what `diagnose` found."""
    cpu, cache = found["processor"], found["kernel_cache"]
    bits = cpu["vector_bits"]
    width = f"{bits} bit, {bits // 64} numbers at a time (guessed from the features)" if bits else "unknown"
    folders = found["record_folders"]
    missing = {name: f"not installed; pip install '{NAME}[{extra}]'" for name, extra in found["optional"].items()}
    limits = " ".join(f"{name}={value}" for name, value in found["threads"]["environment"].items())
    memory, output = found["memory"], found["output"]
    known = memory["free_bytes"] is not None
    usual, every = (seconds_text(found["compile_seconds"][name]) for name in ("default", "all"))
    compiling = f"about {usual} of CPU time each for three 3-storey buildings, {every} with all outputs (estimated)"
    free = "can't be written"
    if output["writable"]:
        room = output["free_bytes"]
        free = "free space unknown" if room is None else f"{bytes_text(room)} free"
    sections = {
        "Versions": [(name, text or missing.get(name, "not installed")) for name, text in found["versions"].items()],
        "Processor": [
            ("system", found["system"]),
            ("name", cpu["name"]),
            ("vectors", width),
            ("scenarios", f"{cpu['lanes_per_kernel']} side by side in a kernel"),
            ("cores", f"{cpu['cores_usable']} usable of {cpu['cores']}"),
            ("features", " ".join(cpu["features"])),
        ],
        "Threads": [("workers", str(found["threads"]["workers"])), ("limits", limits or "none set")],
        "Memory": [("free", f"{bytes_text(memory['free_bytes'])} ({memory['limit']})" if known else "unknown")],
        "Kernel cache": [
            ("folder", cache["folder"] or "none"),
            ("kernels", f"{cache['kernels']}, {bytes_text(cache['bytes'])}"),
            ("compiling", compiling),
        ],
        "Record folders": [(item["folder"], f"{item['files']} record files") for item in folders]
        or [("none", "POUNDING_SWEEP_RECORDS is not set; el_centro is always there")],
        "Output": [(output["folder"] or "none", free)],
    }
    for heading, rows in sections.items():
        print(heading)
        print_pairs(rows, indent=2)
    print("Problems" if found["problems"] else "No problems found")
    for problem in found["problems"]:
        print(f"  {printable(problem)}")


def _print_check(check: dict[str, Any]) -> None:
    """Print what the self-check found."""
    print("Self-check")
    largest = "infinite" if check["error_max"] is None else f"{check['error_max']:.1e}"
    stored = f"converged values, themselves right to {check['error_stored']:.0e}"
    print_pairs(
        [
            ("compared", f"{check['values']} numbers of {check['scenarios']} scenarios with {stored}"),
            ("largest error", f"{largest} of the largest value; at most {check['tolerance']:g} is right"),
            ("kernels", f"ready after {seconds_text(check['compile_seconds'])}"),
            ("run", seconds_text(check["run_seconds"])),
            ("result", "passed" if check["passed"] else "failed"),
        ],
        indent=2,
    )
    for fault in check["faults"]:
        print(f"  {fault}")
