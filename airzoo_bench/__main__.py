"""Runs the command line as ``python -m airzoo_bench``."""

from airzoo_bench.cli.main import main

if __name__ == "__main__":
    main()
