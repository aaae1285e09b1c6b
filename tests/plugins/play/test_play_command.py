"""``python -m vibgym play``: errors are one line and exit code 2."""

import builtins
import os
import signal
import socket
import subprocess
import sys

import pytest

from vibgym.__main__ import main


def error_of(capsys, *words):
    assert main(["play", *words, "--no-browser"]) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1 and "Traceback" not in text
    return text


def test_bad_input(capsys, tmp_path):
    assert "id" in error_of(capsys, "Alin")
    assert "--port" in error_of(capsys, "--port", "70000")
    assert "--host" in error_of(capsys, "--host", "nowhere.invalid")
    assert "--import" in error_of(capsys, "--import", "no_such_module")
    (tmp_path / "file").write_text("")
    assert "--output" in error_of(capsys, "--output", str(tmp_path / "file"))


def test_a_taken_port(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert "--port" in error_of(capsys, "--port", str(port))


@pytest.mark.parametrize("missing", ["uvicorn", "starlette", "websockets"])
def test_without_the_extra(capsys, monkeypatch, missing):
    real = builtins.__import__

    def without(name, *rest):
        if name == missing:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
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
