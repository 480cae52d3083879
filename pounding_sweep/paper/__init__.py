"""Mate, Bakre & Jaiswal (2015) computed again: its tables, figures and conclusions beside this package's own."""
