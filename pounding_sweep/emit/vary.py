"""Kernels whose buildings differ from lane to lane: the text of the usual kernel, its constants read lane by lane.

In the usual text a constant of the scene is ``props[P_M + i]``, one number for all lanes.
Here it is ``S[(P_M + i) * L + l]``; what a function has taken from `props` before a lane
loop is taken inside it instead.
"""

from __future__ import annotations

import ast

#: Constants that all lanes share even so.
SHARED = frozenset({"P_U0", "P_V0", "P_CAP", "P_NEWMARK_BETA", "P_NEWMARK_GAMMA"})


def vary(text: str) -> str:
    """Return the text of a kernel module with the scene's constants read from the lanes' own inputs."""
    tree = ast.parse(text)
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            _Function(node).rewrite()
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def _names(node: ast.AST) -> set[str]:
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def _is_property(node: ast.AST) -> bool:
    if not (isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id == "props"):
        return False
    return not _names(node.slice) & SHARED


class _ByLane(ast.NodeTransformer):
    """Reads every property of an expression in lane ``l``."""

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        self.generic_visit(node)
        if not _is_property(node):
            return node
        return ast.parse(f"S[({ast.unparse(node.slice)}) * L + l]", mode="eval").body


class _Function:
    """One function whose statements are gone through in order."""

    def __init__(self, node: ast.FunctionDef) -> None:
        self.node = node
        self.taken: dict[str, ast.expr] = {}  # name -> what it was given outside the lane loops

    def rewrite(self) -> None:
        """Rewrite the function's body in place."""
        in_lane = "l" in {argument.arg for argument in self.node.args.args}
        self.node.body = self._statements(self.node.body, in_lane)

    def _statements(self, body: list[ast.stmt], in_lane: bool) -> list[ast.stmt]:
        kept = [new for statement in body for new in self._statement(statement, in_lane)]
        return kept or [ast.Pass()]

    def _statement(self, statement: ast.stmt, in_lane: bool) -> list[ast.stmt]:
        if in_lane:
            return [_ByLane().visit(statement)]
        if isinstance(statement, ast.For | ast.While | ast.If):
            lanes = isinstance(statement, ast.For) and _names(statement.target) == {"l"}
            wanted = _names(statement) if lanes else set()
            statement.body = self._statements(statement.body, lanes)
            statement.orelse = [new for item in statement.orelse for new in self._statement(item, in_lane)]
            if lanes:
                first = [
                    ast.parse(f"{name} = {ast.unparse(value)}").body[0]
                    for name, value in self.taken.items()
                    if name in wanted
                ]
                statement.body = [*first, *statement.body]
            return [statement]
        if (
            isinstance(statement, ast.Assign)
            and len(statement.targets) == 1
            and isinstance(statement.targets[0], ast.Name)
        ):
            name = statement.targets[0].id
            if any(_is_property(part) for part in ast.walk(statement.value)):
                self.taken[name] = _ByLane().visit(statement.value)
                return []
            self.taken.pop(name, None)
        return [statement]
