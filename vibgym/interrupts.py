"""What command lines run in: Ctrl-C ends them with one line and exit code 130, and no terminal is too poor for their text."""

from __future__ import annotations

import importlib
import io
import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

CODE = 130
"""Of a program that the user has interrupted, as shells have it."""

WHOLE = "whatever was written before is whole"


def started() -> bool:
    """Whether this process is one of the project's own command lines, or Python is about to find that it is."""
    words, beside = sys.orig_argv, Path(__file__).parents[1]
    if sys.argv[:1] == ["-m"]:  # a package is imported before its command line is found
        return "-m" in words[:-1] and words[words.index("-m") + 1] == "vibgym"
    program = Path(getattr(sys.modules.get("__main__"), "__file__", None) or "").absolute()
    return program.name == "__main__.py" and program.is_relative_to(beside) and program.parent.parent in (
        beside, beside / "studies",
    )  # fmt: skip


def start_command() -> None:
    """The first line of the project's command lines: until :func:`run` begins, Ctrl-C ends the process where it stands.

    Imports take seconds and have nothing to clean up, and some of them turn an interruption into another error, or swallow
    it. In another program, which only imports a command line, nothing happens. ``import vibgym`` leaves signals alone: in
    a command line it waits for this line with all that takes time, the registration of environments.
    """
    if not started():
        return
    if _own():
        signal.signal(signal.SIGINT, _end)
    importlib.import_module("vibgym.registration").register_environments()


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
