"""Work on Ray: the same results, whatever dies meanwhile."""

import csv
import os
import time

import pytest
import ray

from agents import __main__ as command
from agents import evaluation
from agents.workers import side_by_side
from agents.workers.cluster import NodesLost, on_ray
from tests.agents.evaluation.test_evaluation_workers import dies_once, fails


@pytest.fixture
def cluster():
    """Two nodes of one processor each, on this machine; nothing works on the head, lest it dies with it."""
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    nodes = [made.add_node(num_cpus=1) for _ in range(2)]
    yield made, nodes
    ray.shutdown()
    made.shutdown()


def slow(number, folder):
    """Leaves a mark that says where it is done when it begins."""
    node = ray.get_runtime_context().get_node_id()
    (folder / f"{number}-{node}-{time.monotonic_ns()}").touch()
    time.sleep(1.0)
    return number, node


def evaluated(directory, address):
    """CSV files of an evaluation; of results without rates, which are what a machine has just managed."""
    settings = evaluation.settings_from(
        {
            "tasks": ["Transport", "Rotate"],
            "policies": ["random", "pose", "vibgym/policies/trained/shipped/{task}.json"],
            "episodes": 3,
            "resamples": 100,
            "animations": False,
            "output": str(directory),
        }
    )
    found = evaluation.evaluate(evaluation.prepare(settings), quiet=True, ray=address)
    page = evaluation.write(found, quiet=True)
    with (page.parent / "results.csv").open(newline="") as file:
        rows = [{k: v for k, v in row.items() if not k.endswith("steps_per_second")} for row in csv.DictReader(file)]
    return (page.parent / "episodes.csv").read_bytes(), rows


def test_a_node_that_is_killed_costs_a_retry(cluster, tmp_path):
    made, nodes = cluster
    with on_ray(made.address, 2) as submit:
        asked = [submit(slow, number, tmp_path) for number in range(12)]
        deadline = time.monotonic() + 120.0
        while len({path.name.split("-")[1] for path in tmp_path.iterdir()}) < 2:  # until both are at work
            assert time.monotonic() < deadline
            time.sleep(0.05)
        made.remove_node(nodes[1], allow_graceful=False)
        found = [each.result(120) for each in asked]
    assert [number for number, _ in found] == list(range(12))
    assert len({node for _, node in found}) <= 2 and len(list(tmp_path.iterdir())) >= 12


def test_killed_workers_and_errors(cluster, tmp_path):
    made, _ = cluster
    with on_ray(made.address, 2) as submit:
        assert submit(dies_once, tmp_path / "mark").result(120) == "done"
        with pytest.raises(ArithmeticError, match="said there"):
            submit(fails, "said there").result(120)
        assert submit(os.getcwd).result(120) == os.getcwd()


def test_nodes_that_are_lost_for_good_end_it_with_an_error(cluster, tmp_path):
    made, nodes = cluster
    with on_ray(made.address, 2, lost_after=3.0) as submit:
        assert submit(abs, -1).result(120) == 1
        asked = submit(time.sleep, 600.0)
        for node in nodes:
            made.remove_node(node, allow_graceful=False)
        with pytest.raises(NodesLost, match="no processor for 3 s"):
            asked.result(120)


def test_an_evaluation_is_the_same_on_a_cluster(cluster, tmp_path):
    made, _ = cluster
    assert evaluated(tmp_path / "here", None) == evaluated(tmp_path / "there", made.address)


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere", "host:port"])
def test_unreachable_clusters_are_refused(address):
    began = time.monotonic()
    with pytest.raises(ValueError, match="--ray"), side_by_side(2, address):
        pass
    assert time.monotonic() - began < 30.0


@pytest.mark.parametrize("said", [
    "Token authentication is enabled but no authentication token was found",
    "Token authentication is enabled but the authentication token is invalid or incorrect.",
])  # fmt: skip
def test_a_cluster_that_refuses_the_token_says_how_to_hand_it_on(monkeypatch, said):
    def refuses(*arguments, **more):
        raise ray.exceptions.AuthenticationError(said)

    monkeypatch.setattr(ray, "init", refuses)
    with pytest.raises(ValueError, match="--ray") as error:
        with on_ray("auto", 2):
            pass
    assert "RAY_AUTH_TOKEN to what 'ray get-auth-token' says" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("arguments", [
    ["evaluate", "configs/evaluations/quick.yaml"], ["compare", "configs/comparisons/quick.yaml"], ["verify"],
    ["tune", "configs/tuning/align.yaml"], ["train", "configs/agents/ppo.yaml", "--agent", "Align/ideal", "--seeds", "0", "1"],
])  # fmt: skip
def test_commands_refuse_unreachable_clusters_in_one_line(arguments, tmp_path, capsys):
    output = [] if arguments[0] == "verify" else ["--output", str(tmp_path / "out")]
    assert command.main([*arguments, *output, "--quiet", "--ray", "127.0.0.1:1"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and said[0].startswith("--ray")


def test_a_command_whose_cluster_is_lost_ends_in_one_line(monkeypatch, capsys):
    def lost(*arguments, **more):
        raise NodesLost("the cluster has had no processor for 60 s")

    monkeypatch.setattr(evaluation, "evaluate", lost)
    assert command.main(["evaluate", "configs/evaluations/quick.yaml", "--quiet"]) == 1
    assert capsys.readouterr().err == "the cluster has had no processor for 60 s\n"
