"""The parts of which the text of a kernel is written."""
