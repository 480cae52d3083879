"""Mate, Bakre & Jaiswal (2015) computed again: its tables, figures and conclusions beside this package's own.

Data go one way: `published` (what the paper prints) and `readings` (which sweeps stand for it) ->
`study` (cubes, histories and spectra of both readings) -> `compare`, `conclusions`, `checks`, `hertz`,
`steps` (comparisons as rows and datasets) -> `verdict`, `report` (one HTML page). Beside it, `fit` (one measure),
`search` (designs over what is open) and `plain` (a plain program) -> `found` (which reading fits).
"""
