"""Mate, Bakre & Jaiswal (2015) computed again: its tables, figures and conclusions beside this package's own.

Data go one way: `published` (what the paper prints, and which sweeps stand for it) -> `study` (cubes, histories and
spectra of both readings) -> `compare` (rows and verdicts) -> `report` (one HTML page) and `figures`.
"""
