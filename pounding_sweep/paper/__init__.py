"""Mate, Bakre & Jaiswal (2015) computed again: its tables, figures and conclusions beside this package's own.

Data go one way: `published` (what the paper prints) and `readings` (which sweeps stand for it) -> `study` (cubes,
histories and spectra of both readings, `questions`) -> `compare`, `conclusions`, `checks` (comparisons as rows and
verdicts) -> `report` (one HTML page) and `figures`.
"""
