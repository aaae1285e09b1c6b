"""``python -m vibgym play [ID]``: serve the page, and open it."""

from __future__ import annotations

import argparse
import asyncio
import ipaddress
import os
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from vibgym import checks, extras, imports

if TYPE_CHECKING:
    from starlette.types import ASGIApp

PORT = 8734
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
NEEDED = ("PIL", "starlette", "uvicorn", "websockets")


def play(parser: argparse.ArgumentParser) -> Callable[[argparse.Namespace], int]:
    """Serve a page to control an environment by hand (extra 'play')."""
    parser.add_argument("id", nargs="?", default="vibgym/Align-v0", metavar="ID", help="an environment (Align)")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on; default: this host only")
    parser.add_argument("--port", type=int, default=PORT, help=f"default {PORT}; 0: any free port")
    parser.add_argument(
        "--import", dest="imports", action="append", default=[], metavar="PACKAGE",
        help="module that registers environments, tasks or controllers; repeatable",
    )  # fmt: skip
    parser.add_argument("--output", type=Path, default=Path("runs/play"), help="directory for recordings")
    parser.add_argument("--no-browser", action="store_true", help="do not open a browser")
    return run


def run(arguments: argparse.Namespace) -> int:
    """Serve until Ctrl-C; returns the exit code.

    Raises:
        ValueError: an unknown id, an invalid or used port, an address of another host, or an output that is not a directory.
        ModuleNotFoundError: the extra is not installed.
    """
    imports.import_user_modules(arguments.imports)
    _check_extra()
    from vibgym.plugins.play.choices import settings_of

    first = settings_of(arguments.id)
    if arguments.output.exists() and not arguments.output.is_dir():
        raise checks.refuse("--output", str(arguments.output), "a directory")
    heard = _listening(arguments.host, checks.count("--port", arguments.port, least=0, most=65535))
    host, port = heard.getsockname()[:2]
    from vibgym.plugins.play.server import Server

    wide = ipaddress.ip_address(host).is_unspecified
    names = ("*",) if wide else (*LOOPBACK, arguments.host, host, f"[{host}]")
    app = Server(first, arguments.output.absolute()).app(names)
    shown = "127.0.0.1" if wide else f"[{host}]" if ":" in host else host
    address = f"http://{shown}:{port}/"
    opened = not arguments.no_browser and webbrowser.open(address)
    todo = "it opens in your browser" if opened else "open it in a browser"
    _serve(app, heard, f"{first.id} is at {address} ({todo}; Ctrl-C ends)")
    return 0


def _serve(app: ASGIApp, heard: socket.socket, announcement: str) -> None:
    """Serve until Ctrl-C; print ``announcement`` after startup."""
    import uvicorn

    from vibgym.plugins.play.session import MAX_BYTES

    class Announced(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            print(announcement, flush=True)

    config = uvicorn.Config(
        app, log_level="warning", ws_max_size=MAX_BYTES, ws_per_message_deflate=False, access_log=False,
        timeout_graceful_shutdown=1, server_header=False, lifespan="off", ws="websockets-sansio",
    )  # fmt: skip
    with asyncio.Runner() as runner:
        runner.get_loop()  # slow setup before the coroutine is created, which Ctrl-C would leave unawaited
        runner.run(Announced(config).serve(sockets=[heard]))


def _check_extra() -> None:
    for name in NEEDED:
        try:
            __import__(name)
        except ModuleNotFoundError as error:
            raise extras.missing("play", error, "play") from None


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens at this address before the server starts."""
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError):
        raise checks.refuse("--host", host, "an address of this host, such as 127.0.0.1") from None
    try:
        return socket.create_server(address, family=family, backlog=64)
    except OSError as error:
        why = os.strerror(error.errno or 0).lower()
        raise checks.refuse("--port", f"{port} on {host} ({why})", "a free port; 0 selects one") from None
