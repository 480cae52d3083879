"""``python -m benchmarks.paper_found -o FOLDER``."""

from benchmarks.paper_found.report import main

if __name__ == "__main__":
    main()
