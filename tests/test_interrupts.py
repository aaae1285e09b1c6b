"""Ctrl-C: one line, exit code 130, no traceback, at any time."""

import io
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import vibgym
from vibgym import interrupts

pytestmark = pytest.mark.usefixtures("interruptible")

COMMANDS = {
    "accuracy": ["studies.accuracy", "configs/accuracy/quick.yaml"],
    "sensorless": ["studies.sensorless", "configs/sensorless.yaml"],
    "warm": ["vibgym", "warm"],
    "play": ["vibgym", "play", "Align", "--port", "0", "--no-browser"],
    "train": ["agents", "train", "configs/agents/align.yaml"],
    "evaluate": ["agents", "evaluate", "configs/evaluations/quick.yaml"],
}


@pytest.mark.parametrize(("command", "module"), [*((name, "numpy") for name in COMMANDS), ("play", "uvicorn.server")])
def test_while_a_command_imports_or_prepares(command, module, tmp_path):
    output = [] if command == "warm" else ["--output", str(tmp_path / "out")]
    environment = {**os.environ, "PYTHONPATH": str(Path.cwd()), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    program = [sys.executable, "-v", "-m", *COMMANDS[command], *output]  # which tells of every import
    process = subprocess.Popen(program, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith(f"import '{module}'"):
            break
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, text = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in text and text.count("interrupted: ") == 1
    assert not (tmp_path / "out").exists()


def test_run_tells_it_in_one_line_and_restores_what_was(capsys):
    before = signal.getsignal(signal.SIGINT)

    def work():
        signal.raise_signal(signal.SIGINT)
        return 0

    assert interrupts.run(work) == 130
    assert capsys.readouterr().err == "interrupted: whatever was written before is whole\n"
    assert interrupts.run(lambda: 7) == 7 and signal.getsignal(signal.SIGINT) is before


def test_text_that_the_terminal_cannot_show_is_escaped(monkeypatch):
    poor = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", poor)

    def work():
        print("success \u2013, 0.6 \u00b5m")
        return 0

    assert interrupts.run(work) == 0
    poor.flush()
    assert poor.buffer.getvalue() == b"success \\u2013, 0.6 \\xb5m\n"


def test_in_other_threads_and_where_interruptions_are_switched_off_signals_are_left_alone(monkeypatch):
    found = []
    thread = threading.Thread(target=lambda: found.append(interrupts.run(lambda: 3)))
    thread.start()
    thread.join()
    assert found == [3]
    monkeypatch.setattr(interrupts, "_own", lambda: False)
    monkeypatch.setattr(interrupts, "started", lambda: True)
    interrupts.start_command()
    assert signal.getsignal(signal.SIGINT) is not interrupts._end


@pytest.mark.parametrize(
    "code", ["import vibgym", "import vibgym.__main__, agents.__main__, studies.accuracy.__main__"]
)
def test_imports_into_another_program_leave_signals_alone(code):
    more = "import gymnasium; print(signal.getsignal(signal.SIGINT) is before, 'vibgym/Align-v0' in gymnasium.registry)"
    code = f"import signal; before = signal.getsignal(signal.SIGINT); {code}; {more}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]


def test_only_the_projects_own_commands_end_at_once(monkeypatch):
    root = Path(vibgym.__file__).parents[1]
    for file, expected in (
        (root / "agents" / "__main__.py", True),
        (root / "studies" / "accuracy" / "__main__.py", True),
        (root / "studies" / "benchmarks" / "digest.py", False),
        (root.parent / "agents" / "__main__.py", False),
        (Path("mine.py"), False),
    ):
        monkeypatch.setattr(sys.modules["__main__"], "__file__", str(file), raising=False)
        assert interrupts.started() is expected, file
    monkeypatch.setattr(sys, "argv", ["-m"])  # while Python looks for the module
    for words, expected in (
        (["python", "-m", "vibgym", "warm"], True),
        (["python", "-m", "pytest", "vibgym"], False),
        (["python", "-m", "vibgym.mine"], False),
        (["python", "-m"], False),
    ):
        monkeypatch.setattr(sys, "orig_argv", words)
        assert interrupts.started() is expected, words
