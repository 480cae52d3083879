"""What a sweep is asked to do: axes, sweep files, validation."""
