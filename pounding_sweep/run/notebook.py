"""The display of a running sweep in the output of a notebook's cell, which `Sweep.run` takes by default."""

from __future__ import annotations

import sys
import time

from pounding_sweep.run.execute import STAGES, Progress


class NotebookProgress(Progress):
    """Stage, done and total, as a bar that the end of the run removes."""

    _shown, _next = False, 0.0

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps; 0 stands for an unknown number."""
        self._name, self._done, self._total = STAGES.get(name, name), 0, total
        self.advance(0)

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""
        self._done += count
        if time.monotonic() >= self._next:
            known = f'<progress max="{self._total}" value="{self._done}"></progress> {self._done:,} of {self._total:,}'
            self._show(f"{self._name} {known if self._total else '<progress></progress>'}")

    def close(self) -> None:
        """Remove the bar."""
        self._show("")

    def _show(self, html: str) -> None:
        notebook = sys.modules["IPython.display"]
        notebook.display(notebook.HTML(html), display_id=str(id(self)), update=self._shown)
        self._shown, self._next = True, time.monotonic() + 0.2  # five times a second
