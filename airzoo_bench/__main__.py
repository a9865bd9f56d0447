"""Runs the command line, as ``airzoo-bench`` or as ``python -m airzoo_bench``."""

import sys

__all__ = ["main"]

_STOPPED = 130


def main() -> None:
    """Import the command line and run it; Ctrl-C while it is imported is no fault either."""
    try:
        from airzoo_bench.cli.main import main as run
    except KeyboardInterrupt:
        sys.stderr.write("airzoo-bench: stopped; nothing was left half-written\n")
        sys.exit(_STOPPED)
    run()


if __name__ == "__main__":
    main()
