"""From a sweep to the scenarios that must really run, their scheme, steps and chunks."""
