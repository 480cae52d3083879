"""Mate, Bakre & Jaiswal (2015) computed again: its tables, figures and conclusions beside this package's own.

Data go one way: `study` (what the paper prints; cubes, histories and spectra of both readings) -> `compare` (rows and
verdicts) -> `report` (one HTML page) and `figures`.
"""
