"""A server of the page in a thread of the test, and a browser."""

import asyncio
import threading
from collections.abc import Iterator

import pytest
import uvicorn

from tests.browser import chromium
from vibgym.plugins.play.choices import settings_of
from vibgym.plugins.play.command import LOOPBACK, _listening
from vibgym.plugins.play.server import Server
from vibgym.plugins.play.session import MAX_BYTES


@pytest.fixture(scope="module")
def served(tmp_path_factory) -> Iterator[tuple[str, Server]]:
    """Address (host and port) and server."""
    heard = _listening("127.0.0.1", 0)
    server = Server(settings_of("Align"), tmp_path_factory.mktemp("played"))
    config = uvicorn.Config(
        server.app(LOOPBACK), log_level="critical", ws_max_size=MAX_BYTES, ws_per_message_deflate=False,
        timeout_graceful_shutdown=1, lifespan="off", ws="websockets-sansio",
    )  # fmt: skip
    running = uvicorn.Server(config)
    thread = threading.Thread(target=lambda: asyncio.run(running.serve(sockets=[heard])), daemon=True)
    thread.start()
    yield "{}:{}".format(*heard.getsockname()), server
    running.should_exit = True
    thread.join(10)


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started
