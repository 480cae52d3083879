"""Size of the package's source, which may not grow: `python -m benchmarks.package_size` prints it.

With `--set`, what is smaller becomes the limit. `package_size.json` holds the smallest size that was reached;
`test_package_size.py` allows 2 % above it.
"""

from __future__ import annotations

import ast
import io
import json
import sys
import tokenize
from pathlib import Path

LIMITS = Path(__file__).with_suffix(".json")
PACKAGE = Path(__file__).parents[1] / "pounding_sweep"
#: Allowed above the smallest size.
SLACK = 1.02
_NAMES = ("COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENCODING", "ENDMARKER")
_LAYOUT = {getattr(tokenize, name) for name in _NAMES}
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def size(folder: Path = PACKAGE) -> dict[str, int]:
    """Count lines, functions, and tokens without docstrings and layout."""
    total = {"lines": 0, "functions": 0, "tokens": 0}
    for path in sorted(folder.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        nodes = list(ast.walk(ast.parse(text)))
        first = [
            node.body[0] for node in nodes if isinstance(node, _DOCUMENTED) and ast.get_docstring(node) is not None
        ]
        docstrings = {(statement.lineno, statement.col_offset) for statement in first}
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        total["lines"] += text.count("\n")
        total["functions"] += sum(isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) for node in nodes)
        total["tokens"] += sum(token.type not in _LAYOUT and token.start not in docstrings for token in tokens)
    return total


def main() -> None:
    """Print the size beside its limit; with `--set`, take what is smaller as the new limit."""
    now, limits = size(), json.loads(LIMITS.read_text(encoding="utf-8"))
    if "--set" in sys.argv:
        limits = {name: min(now[name], limit) for name, limit in limits.items()}
        LIMITS.write_text(json.dumps(limits) + "\n", encoding="utf-8")
    for name, limit in limits.items():
        print(f"{name:10}{now[name]:9,}  smallest reached {limit:9,}")


if __name__ == "__main__":
    main()
