"""Prints which numbers moved; with ``--record``, records them.

``python -m tests.goldens [--record] [NAME ...]``
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tests.goldens.compare import compare
from tests.goldens.run import CASES, load, machine, observe, save


def main() -> int:
    """Compare, or record, the cases named or all; return 1 where a number moved."""
    parser = argparse.ArgumentParser(prog="python -m tests.goldens", description=__doc__)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("names", nargs="*", metavar="NAME", default=[])
    chosen = parser.parse_args()
    moved = False
    for name in chosen.names or CASES:
        with tempfile.TemporaryDirectory() as home:
            new = observe(name, Path(home))
        old = load(name)
        broken, allowed = compare(old["values"], new, old["machine"] == machine())
        lines = [*broken, *(f"{line} (another machine may)" for line in allowed)]
        moved |= bool(broken)
        sys.stdout.writelines(f"{name}: {line}\n" for line in lines)
        if chosen.record:
            save(name, new)
    return int(moved and not chosen.record)


if __name__ == "__main__":
    sys.exit(main())
