"""Every output of a sweep, where it stands in a cube, and how two of its values are compared."""
