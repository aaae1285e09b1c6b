"""What command lines run in: Ctrl-C ends them with one line and exit code 130, and no terminal is too poor for their text."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any, NoReturn

CODE = 130
"""Of a program that the user has interrupted, as shells have it."""

WHOLE = "whatever was written before is whole"

PROGRAMS = ("vibgym", "studies.accuracy")
"""That Python finds only after it has imported this package, which takes seconds."""


def started() -> bool:
    """Whether this process is one of the project's own command lines."""
    words, beside = sys.orig_argv, os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    if getattr(sys.modules.get("__main__"), "__file__", None) == os.path.join(beside, "agents", "__main__.py"):
        return True
    return "-m" in words[:-1] and words[words.index("-m") + 1] in PROGRAMS


def at_once() -> None:
    """Until :func:`run` begins, Ctrl-C ends the process where it stands.

    Imports have nothing to clean up, and some of them turn an interruption into another error, or swallow it.
    """
    if _own():
        signal.signal(signal.SIGINT, _end)


def run(work: Callable[[], int]) -> int:
    """What ``work`` returns, or :data:`CODE` after an interruption, which is then told in one line.

    Text that the terminal's encoding lacks is escaped: a summary that cannot be shown is no reason to fail.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    before = signal.getsignal(signal.SIGINT)
    if _own():
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return work()
    except KeyboardInterrupt as interrupt:
        _say(str(interrupt) or WHOLE)
        return CODE
    finally:
        if _own():
            signal.signal(signal.SIGINT, before)


def leave(code: int) -> NoReturn:
    """End the process; after an interruption without waiting for threads that are at work in compiled code."""
    if code == CODE:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # pressing twice is no reason for a traceback
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _own() -> bool:
    """Whether interruptions are this thread's business, and nobody has switched them off (nohup, a shell's background)."""
    handler = signal.getsignal(signal.SIGINT)
    return threading.current_thread() is threading.main_thread() and handler in (signal.default_int_handler, _end)


def _say(text: str) -> None:
    clear = "\r\x1b[2K" if sys.stderr.isatty() else ""
    print(f"{clear}interrupted: {text}", file=sys.stderr, flush=True)


def _end(number: int, frame: Any) -> NoReturn:
    _say("nothing had begun")
    os._exit(CODE)
