"""What is kept of an interrupted sweep, and what a sweep takes from an earlier cube."""
