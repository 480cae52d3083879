"""Other tools on the same work: each a module with one or more `Peer`, all called alike.

A module imports its tool only when a peer is prepared, so that all are listed where none is installed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from benchmarks.work import Peaks, Work

#: Runs scenarios of gaps (m), each the same between all neighbours; shape (n,).
Run = Callable[[np.ndarray], Peaks]


@dataclass(frozen=True)
class Peer:
    """One way of one tool to do the work."""

    key: str  # name on the command line
    title: str  # what it is, in tables and figures
    package: str  # distribution that must be installed
    module: str  # what is imported of it
    knob: str  # what its settings are: time steps (s) or relative tolerances
    #: settings from coarse to fine, of the long and of the short form
    settings: tuple[float, ...]
    short: tuple[float, ...]
    prepare: Callable[[Work, float], Run]  # takes the work and a setting; returns what runs it, compiled and warm
    laws: tuple[str, ...] = ("linear",)  # contact laws that it can do
    batch: int = 1  # scenarios that are timed together: one for tools that run one at a time

    def missing(self) -> str:
        """Say why the tool can't be used here; "" where it can."""
        try:
            import_module(self.module)
        except Exception as error:  # a broken native library raises anything
            return f"{self.title}: {self.module} can't be imported ({type(error).__name__}: {error})"
        return ""

    @property
    def version(self) -> str:
        """Version of the distribution, "" where it is not installed."""
        try:
            return version(self.package)
        except PackageNotFoundError:
            return ""


def all_peers() -> dict[str, Peer]:
    """Every peer by key, installed or not."""
    modules = ("opensees", "scipy_ivp", "numbalsoda_ivp", "cyrk_ivp", "jax_scan", "heyoka_taylor")
    found: Iterable[Peer] = (p for name in modules for p in import_module(f"benchmarks.peers.{name}").PEERS)
    return {peer.key: peer for peer in found}
