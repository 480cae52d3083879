"""``python -m benchmarks``: measure everything, and write table, figure and JSON."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks import suite
from benchmarks.figure import speed
from benchmarks.peers import all_peers
from benchmarks.report import Report


def main(arguments: list[str] | None = None) -> int:
    """Run the suite; tables go to standard output, what goes on to standard error."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure the engine beside other tools.")
    parser.add_argument("--short", action="store_true", help="a few settings on the first seconds of the record")
    parser.add_argument("--tools", action="store_true", help="compare the tools, and measure nothing else")
    parser.add_argument("--peers", metavar="LIST", default="all", help="names with commas between, 'none', or 'all'")
    parser.add_argument("-o", "--output", metavar="FOLDER", type=Path, help="write speed.md, .json and .png there")
    parser.add_argument("--json", action="store_true", help="print JSON in place of markdown")
    given, known = parser.parse_args(arguments), all_peers()
    names = {"all": list(known), "none": []}.get(given.peers, given.peers.split(","))
    if unknown := [name for name in names if name not in known]:
        parser.error(f"unknown peers {', '.join(unknown)}; valid: {', '.join(known)}, all, none")

    def notify(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    def save(report: Report) -> None:
        if given.output is None:
            return
        given.output.mkdir(parents=True, exist_ok=True)
        (given.output / "speed.md").write_text(report.to_markdown(), encoding="utf-8")
        (given.output / "speed.json").write_text(report.to_json_text(), encoding="utf-8")
        points = [p for p in report.points if p.law == suite.LAWS[0]]
        if points:
            speed(points, suite.CAPTION).savefig(given.output / "speed.png")

    report = suite.run([known[name] for name in names], short=given.short, notify=notify, save=save, tools=given.tools)
    print(report.to_json_text() if given.json else report.to_markdown(), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
