"""Commands without the extra that they need."""

import sys
import tomllib
from pathlib import Path

import pytest

from agents import __main__ as command
from agents import train
from agents.command_line import EXTRAS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("package, extra, arguments", [
    ("minari", "data", ["record", "configs/recordings/align.yaml"]),
    ("optuna", "tune", ["tune", "configs/tuning/align.yaml"]),
    ("ray", "cluster", ["evaluate", "configs/evaluations/quick.yaml", "--ray", "local", "--quiet"]),
])  # fmt: skip
def test_a_package_that_is_missing_is_named_with_its_extra(monkeypatch, capsys, package, extra, arguments):
    for name in [each for each in sys.modules if each.partition(".")[0] in (package, "agents")]:
        if name.startswith(("agents.recording.record", "agents.tune", "agents.parallel", package)):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.chdir(ROOT)
    assert command.main(arguments) == 1
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said == f"{arguments[0]}: {package} is not installed: pip install 'vibgym[{extra}]'"


def test_what_is_not_ours_to_install_is_an_error(monkeypatch):
    def broken(arguments):
        raise ModuleNotFoundError("No module named 'nonsense'", name="nonsense")

    monkeypatch.setitem(train.COMMANDS, "train", train.COMMANDS["train"]._replace(run=broken))
    with pytest.raises(ModuleNotFoundError, match="nonsense"):
        command.main(["train", "configs/agents/ppo.yaml"])


def test_extras_are_those_of_the_project():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    names = {"h5py": "minari[hdf5]"}  # which brings it
    for package, extra in EXTRAS.items():
        name = names.get(package, package.replace("_", "-"))
        brought = extras[extra] + (extras["policies"] if "vibgym[policies]" in extras[extra] else [])
        assert any(each.startswith(name) for each in brought), package
