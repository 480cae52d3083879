"""Figures, one in a module that is named after it; `pounding_sweep.figures.FIGURES` lists them."""
