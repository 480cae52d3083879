"""A plan carried out: workers, refinement, audit, log, and the cube that comes of it."""
