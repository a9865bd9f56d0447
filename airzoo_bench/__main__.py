"""Runs the command line, as ``airzoo-bench`` or as ``python -m airzoo_bench``."""

import os
import signal
import sys
import time
from threading import Event, Lock, Thread

__all__ = ["main"]

_MESSAGE = "airzoo-bench: stopped; nothing was left half-written\n"
_STOPPED, _TERMINATED = 130, 143
_PATIENCE_S = 0.5
# A library that does not return to Python within this time of a Ctrl-C is not waited for.
_HEARING_S = 1.0
# Once it has, workers are ended and what is kept is said: the time for it on a busy machine.
_UNWINDING_S = 5.0
_HEARD, _LEAVING = Event(), Lock()


def main() -> None:
    """Import the command line and run it; Ctrl-C while it is imported is no fault either."""
    try:
        for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
            if getattr(sys, name) is None:  # closed: what is said there goes nowhere
                setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115
        _obey_signals()
        from airzoo_bench.cli.main import main as run

        run()
    except KeyboardInterrupt:
        _stop(_STOPPED)
    except SystemExit as done:
        if done.code in (_STOPPED, _TERMINATED):
            _stop(int(done.code))
        raise


def _obey_signals() -> None:
    """Unwind at SIGTERM as at Ctrl-C, and end a run that does neither in time."""
    signal.signal(signal.SIGINT, _interrupt)
    signal.signal(signal.SIGTERM, _terminate)
    if sys.platform == "win32":
        return
    ear, mouth = os.pipe()
    os.set_blocking(mouth, False)
    signal.set_wakeup_fd(mouth, warn_on_full_buffer=False)
    Thread(target=_end_in_time, args=(ear,), daemon=True).start()


def _interrupt(*_: object) -> None:
    _HEARD.set()
    raise KeyboardInterrupt


def _terminate(*_: object) -> None:
    _HEARD.set()
    sys.exit(_TERMINATED)


def _end_in_time(ear: int) -> None:
    codes = {signal.SIGINT: _STOPPED, signal.SIGTERM: _TERMINATED}
    code = None
    while code is None:
        code = codes.get(signal.Signals(os.read(ear, 1)[0]))
    if _HEARD.wait(_HEARING_S):
        time.sleep(_UNWINDING_S)
    _stop(code)


def _stop(code: int) -> None:
    """Say so and end, without waiting for processes that were stopped in the middle of something.

    Whichever thread comes first does it; the other waits here for the end.
    """
    _LEAVING.acquire()
    sys.stderr.write(_MESSAGE)
    from multiprocessing import active_children

    from airzoo_bench.core.files import remove_own

    remove_own()
    for process in (workers := active_children()):
        process.terminate()
    for process in workers:
        process.join(_PATIENCE_S)
        if process.pid is not None and process.is_alive():
            os.kill(process.pid, 9)  # those of loky have no method for it
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
