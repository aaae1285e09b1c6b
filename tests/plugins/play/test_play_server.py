"""The server: separate worlds, reconnection, refused requests; and the command that starts it."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.commands import said_in_one_line
from vibgym.__main__ import main
from vibgym.plugins.play import server as module
from vibgym.plugins.play.session import MAX_BYTES


class Page:
    """A page's end of the link."""

    def __init__(self, address, **query):
        wanted = "&".join(f"{name}={value}" for name, value in query.items())
        self.socket = connect(f"ws://{address}/world?{wanted}", max_size=2**22)
        self.n, self.first = 0, self.next()
        self.token, self.ack = self.first.get("token"), self.first.get("ack")

    def next(self, kind=None):
        while True:
            message = json.loads(self.socket.recv(timeout=60))
            if kind is None or message["kind"] == kind:
                return message

    def send(self, do, **rest):
        self.n += 1
        self.socket.send(json.dumps({"n": self.n, "do": do, **rest}))

    def after(self, n):
        """The first frame that has seen message ``n``."""
        while (frame := self.next("frame"))["ack"] < n:
            pass
        return frame


@pytest.fixture
def visit(served):
    """Return a function that opens a page with a query; its sockets are closed at the end."""
    with ExitStack() as opened:

        def at(**query):
            page = Page(served[0], **query)
            opened.enter_context(page.socket)
            return page

        yield at


def get(address, path, **headers):
    connection = http.client.HTTPConnection(address, timeout=10)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read(), dict(answer.getheaders())


def test_the_page_and_nothing_else_is_served(served):
    address, _ = served
    status, body, headers = get(address, "/")
    assert status == 200 and b"<canvas" in body and "default-src 'none'" in headers["content-security-policy"]
    for path in module.PAGE.iterdir():
        status, body, headers = get(address, f"/{path.name}")
        assert status == 200 and body == path.read_bytes()
        kind = {".js": "text/javascript", ".css": "text/css", ".html": "text/html"}[path.suffix]
        assert headers["content-type"].startswith(kind) and headers["x-content-type-options"] == "nosniff"
    for path in ("/../server.py", "/..%2fserver.py", "/kept/x.gif", "/kept/..%2f..%2fetc%2fpasswd", "/%00"):
        assert get(address, path)[0] == 404, path


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "", "localhost.evil"])
def test_other_hosts_are_refused(served, host):
    assert get(served[0], "/", Host=host)[0] in (400, 403)


def test_every_visitor_has_a_world(visit):
    one, two = visit(), visit(id="Sort")
    assert one.token != two.token
    one.send("paint", elements=[[0, 0]], phasor=[1, 0])
    assert one.after(1)["painted"] is True
    assert len(two.next("scene")["outlines"]) == 6 and two.next("frame")["painted"] is False


def test_bad_messages_do_not_end_a_world(visit):
    one, two = visit(), visit()
    for text in ("no json", "[]", json.dumps({"n": 1, "do": "pace", "speed": 1e9})):
        one.socket.send(text)
        assert "\n" not in one.next("refused")["text"]
    one.socket.send(b"\xff\xfe\x00")
    assert one.next("refused")
    assert one.next("frame") and two.next("frame")
    # Only the header of a masked text message (RFC 6455, section 5.2), and what answers "too big" has read all there is:
    # the rest would meet a closed socket, whose reset may overtake the answer.
    one.socket.socket.sendall(b"\x81\xff" + (MAX_BYTES + 1).to_bytes(8, "big") + b"\0\0\0\0")
    with pytest.raises(ConnectionClosed) as caught:
        while True:
            one.next()
    assert caught.value.rcvd.code == 1009, "too big"
    assert two.next("frame")
    back = visit(token=one.token)
    assert back.token == one.token and back.next("frame")


def test_a_lost_connection_is_restored_without_loss(served, visit):
    page = visit()
    page.send("pace", running=False)
    page.send("aim", part=0, pose=[0.4, 0.1, 0.3])
    page.after(2)
    page.socket.socket.close()  # without a word
    back = visit(token=page.token)
    assert back.token == page.token and back.ack == 2
    frame = back.next("frame")
    assert [round(number, 3) for number in frame["goal"][0]] == [40000, 10000, 3000]
    # The page repeats unacknowledged messages; each is executed once.
    back.socket.send(json.dumps({"n": 2, "do": "aim", "part": 0, "pose": [0.9 - 0.4, 0.1, 0.0]}))
    back.socket.send(json.dumps({"n": 3, "do": "steps", "count": 1}))
    frame = back.after(3)
    assert frame["goal"][0][0] == 40000
    assert served[1].visitors[page.token].session.acknowledged == 3


def test_a_page_that_is_opened_twice_has_one_socket(visit):
    first = visit()
    second = visit(token=first.token)
    with pytest.raises(ConnectionClosed) as caught:
        while True:
            first.next()
    assert caught.value.rcvd.code == module.TAKEN_OVER
    assert second.next("frame")


@pytest.mark.parametrize(("query", "named"), [({"id": "Nothing"}, "id"), ({"start": "altered"}, "start")])
def test_bad_urls_are_one_clear_line(visit, query, named):
    page = visit(**query)
    assert named in page.first["text"]
    with pytest.raises(ConnectionClosed):
        page.next()


def test_the_number_of_worlds_is_limited(served, visit, monkeypatch):
    monkeypatch.setattr(module, "MAX_WORLDS", len(served[1].visitors))
    assert "no room" in visit().first["text"]
    monkeypatch.setattr(module, "WAIT", -1.0)  # disconnected visitors are removed
    assert visit().token


# -- the command -------------------------------------------------------------------------------------------------------


def error_of(capsys, *words):
    assert main(["play", *words, "--no-browser"]) == 2
    return said_in_one_line(capsys)


def test_bad_options_and_a_taken_port_are_one_line(capsys, tmp_path):
    (tmp_path / "file").write_text("")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        for option, value in (
            ("--port", "70000"), ("--host", "nowhere.invalid"), ("--import", "no_such_module"),
            ("--output", str(tmp_path / "file")), ("--port", str(taken.getsockname()[1])),
        ):  # fmt: skip
            assert option in error_of(capsys, option, value)
    assert "id" in error_of(capsys, "Alin")


@pytest.mark.parametrize("missing", ["uvicorn", "starlette", "websockets"])
def test_without_the_extra(capsys, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)  # counts as not installed
    assert error_of(capsys) == f"play needs {missing}, which is not installed: pip install 'vibgym[play]'\n"


@pytest.mark.usefixtures("interruptible")
def test_it_prints_its_address_and_ends_with_ctrl_c(tmp_path):
    command = [sys.executable, "-m", "vibgym", "play", "Align", "--port", "0", "--output", str(tmp_path)]
    env = {**os.environ, "BROWSER": "/nowhere/browser"}  # does not exist: it prints the address and serves
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env) as running:
        line = running.stdout.readline()
        assert line.startswith("vibgym/Align-v0 is at http://127.0.0.1:") and "open it in a browser" in line
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert running.returncode == 130 and "Traceback" not in err and err.startswith("interrupted")
