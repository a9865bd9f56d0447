"""Runs the command line, as ``airzoo-bench`` or as ``python -m airzoo_bench``."""

import os
import sys

__all__ = ["main"]

_STOPPED = 130
_PATIENCE_S = 0.5


def main() -> None:
    """Import the command line and run it; Ctrl-C while it is imported is no fault either."""
    try:
        _open_closed_streams()
        from airzoo_bench.cli.main import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("airzoo-bench: stopped; nothing was left half-written\n")
        _leave_at_once()
    except SystemExit as done:
        if done.code == _STOPPED:
            _leave_at_once()
        raise


def _open_closed_streams() -> None:
    """Let what is said to a closed stream go nowhere.

    Of a stream that the shell closed (``>&-``) Python makes None; and the next file that is opened
    would get its number, and what libraries say to that.
    """
    from pathlib import Path

    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            stream = Path(os.devnull).open(mode, encoding="utf-8")  # noqa: SIM115 - to the end
            setattr(sys, name, stream)


def _leave_at_once() -> None:
    """End without waiting for worker processes that were stopped in the middle of something."""
    from multiprocessing import active_children

    workers = active_children()
    for process in workers:
        process.terminate()
    for process in workers:
        process.join(_PATIENCE_S)
        process.kill()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(_STOPPED)


if __name__ == "__main__":
    main()
