"""What every other part stands on: errors, text, files."""

STANDARD_GRAVITY = 9.81
"""Acceleration of one g in m/s2, as in the pounding literature (not 9.80665)."""
