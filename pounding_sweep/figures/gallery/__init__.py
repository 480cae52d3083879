"""Figures: every module registers its own with `pounding_sweep.figures.figure_of`; `FIGURES` lists them."""
