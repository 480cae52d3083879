"""What every other part stands on: errors, text, files, locks, memory."""
