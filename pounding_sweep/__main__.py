"""``python -m pounding_sweep``: the command line."""

from pounding_sweep.cli import main

if __name__ == "__main__":
    main()
