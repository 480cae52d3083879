"""The search for a reading that fits the paper's tables; ``python -m benchmarks.paper_found`` prints and draws it."""
