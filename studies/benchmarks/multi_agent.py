"""IPPO and MAPPO of TorchRL from scratch, on Swap with six parts or Feed: ``python -m studies.benchmarks.multi_agent``.

Parts are agents with shared weights on :class:`vibgym.adapters.torchrl.BatchEnv`, action ``velocity``. IPPO has a critic for
each part (de Witt et al. 2020, https://arxiv.org/abs/2011.09533), MAPPO one that reads all parts (Yu et al. 2022,
https://arxiv.org/abs/2103.01955). The networks are those of TorchRL, without vibgym's attention. Output: learning curve, then
success, makespan and sum of costs on fresh episodes, beside the classical controllers. The sum of costs adds the times at which
the parts have last reached their goals (Stern et al., "Multi-agent pathfinding: definitions, variants, and benchmarks", 2019).
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from tensordict.nn import TensorDictModule
from tensordict.nn.distributions import NormalParamExtractor
from torch import nn
from torchrl.collectors import Collector
from torchrl.modules import MultiAgentMLP, ProbabilisticActor, TanhNormal
from torchrl.objectives import ClipPPOLoss, ValueEstimators

from studies.benchmarks import common
from vibgym.adapters.torchrl import GROUP, BatchEnv
from vibgym.policies import rollout
from vibgym.policies.rollout import Ends


class Case(NamedTuple):
    """A task: settings of its environment, settings of the training only, and classical controllers."""

    scene: dict[str, Any]
    training: dict[str, Any]
    controllers: dict[str, dict[str, Any]]


LANES: dict[str, Any] = {"kind": "lanes", "action": "velocity"}
PLANNER: dict[str, Any] = {"kind": "planner", "law": "pose"}
CASES = {
    "Swap": Case(
        {"parts": ["steel_block", "aluminium_block"] * 3},
        # Falls cost all parts; jams last to the limit.
        {"task_settings": {"weights": {"success": 20.0, "fallen": 20.0}}, "max_episode_steps": 500},
        {"planner, pose": PLANNER, "lanes": LANES},
    ),
    "Feed": Case({}, {"max_episode_steps": 500}, {"planner, pose": PLANNER, "lanes": LANES}),
}

UNSEEN = ("position", "element")
"""Columns that agents do not read: what a part has to do depends on its way and its neighbours."""

LENGTH, CELLS = 32, 128
GAMMA, LAMBDA, CLIP, EPOCHS, BATCH, RATE = 0.99, 0.95, 0.2, 4, 1024, 5e-4
SCALE = 0.1
"""Of rewards: errors of values then are of the order of 1, and their gradients do not crowd out those of the actor."""

FIRST_SEED, JUDGED = 300_000, 100_000


class Columns(nn.Module):
    """Chooses columns of observations."""

    def __init__(self, chosen: Any) -> None:
        super().__init__()
        self.register_buffer("chosen", torch.as_tensor(chosen))

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the chosen columns."""
        return rows[..., self.chosen]


class Learned:
    """Deterministic policy of an actor, for rollouts."""

    action, observation = "velocity", "parts"

    def __init__(self, net: nn.Module) -> None:
        self.net = net

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        """Return the actions of all worlds."""
        with torch.no_grad():
            mean, _ = self.net(torch.as_tensor(observation["parts"]))
        return torch.tanh(mean).reshape(len(mean), -1).numpy(), state


class Arrivals(Ends):
    """Collector of outcomes with the times at which parts have last reached their goals, s (episodes, parts)."""

    def __init__(self, env: Any, info: dict[str, Any], seeds: Any) -> None:
        super().__init__(env, info, seeds)
        self.arrived = np.zeros((len(seeds), len(env.parts)))

    def add(self, step: Any) -> None:
        """Add a step."""
        super().add(step)
        which, late = step.episode[step.playing], ~step.info["parts"]["done"][step.playing]
        now = self.env.step_time * step.age[step.playing, None]
        self.arrived[which] = np.where(late, now, self.arrived[which])

    def result(self, task: str, timing: Any) -> Any:
        """Return outcomes and arrivals."""
        return super().result(task, timing), self.arrived


def nets(env: BatchEnv, central: bool) -> tuple[nn.Module, nn.Module]:
    """Return actor and critic networks of all parts."""
    seen = np.concatenate([
        np.arange(each.start, each.start + each.width) for each in env.parts_layout if each.name not in UNSEEN
    ])  # fmt: skip
    columns = len(seen)
    numbers = env.full_action_spec[env.action_key].shape[-1]
    more: dict[str, Any] = {"depth": 2, "num_cells": CELLS, "activation_class": nn.ReLU, "share_params": True}
    agents = len(env.group_map[GROUP])
    actor = MultiAgentMLP(columns, 2 * numbers, agents, centralized=False, **more)
    extract = NormalParamExtractor(scale_mapping="biased_softplus_0.3")
    critic = MultiAgentMLP(columns, 1, agents, centralized=central, **more)
    return nn.Sequential(Columns(seen), actor, extract), nn.Sequential(Columns(seen), critic)


def train(task: str, central: bool, steps: int, worlds: int, seed: int, shared: float) -> Learned:
    """Train IPPO (``central`` false) or MAPPO, print the learning curve, and return the policy.

    ``shared`` is the share of the reward of every other part that a part gets at the end; it grows from 0, since parts first
    learn to reach their own goals.
    """
    torch.manual_seed(seed)
    case = CASES[task]
    given = {**case.scene, **case.training, "model": {"kind": "planar", "contacts": "fast"}}
    env = BatchEnv(f"vibgym/{task}-v0", num_envs=worlds, **given)
    env.set_seed(seed)
    net, value = nets(env, central)
    actor = ProbabilisticActor(
        TensorDictModule(net, in_keys=[(GROUP, "observation")], out_keys=[(GROUP, "loc"), (GROUP, "scale")]),
        in_keys=[(GROUP, "loc"), (GROUP, "scale")],
        out_keys=[env.action_key],
        distribution_class=TanhNormal,
        return_log_prob=True,
        log_prob_key=(GROUP, "log_prob"),
    )
    critic = TensorDictModule(value, in_keys=[(GROUP, "observation")], out_keys=[(GROUP, "state_value")])
    loss = ClipPPOLoss(actor, critic, clip_epsilon=CLIP, entropy_coeff=0.0, normalize_advantage=False)
    loss.set_keys(
        reward=env.reward_key, action=env.action_key, sample_log_prob=(GROUP, "log_prob"), value=(GROUP, "state_value"),
        done=(GROUP, "done"), terminated=(GROUP, "terminated"),
    )  # fmt: skip
    loss.make_value_estimator(ValueEstimators.GAE, gamma=GAMMA, lmbda=LAMBDA)
    optimizer = torch.optim.Adam(loss.parameters(), lr=RATE)
    learned, began, last = Learned(net), time.perf_counter(), 0
    batches = Collector(env, actor, frames_per_batch=worlds * LENGTH, total_frames=steps)
    for number, batch in enumerate(batches):
        share = 1.0 - number * worlds * LENGTH / steps
        for group in optimizer.param_groups:
            group["lr"] = RATE * max(share, 0.1)
        reward = batch["next", GROUP, "reward"]
        others = shared * (1.0 - share) * (reward.sum(dim=-2, keepdim=True) - reward)
        batch["next", GROUP, "reward"] = SCALE * (reward + others)
        for name in ("done", "terminated"):
            batch["next", GROUP, name] = batch["next", name].unsqueeze(-1).expand(reward.shape)
        with torch.no_grad():
            loss.value_estimator(
                batch, params=loss.critic_network_params, target_params=loss.target_critic_network_params
            )
        # Actions of empty slots have no effect.
        mask, advantage = batch[GROUP, "mask"], batch["advantage"]
        present = advantage[mask]
        batch["advantage"] = mask * (advantage - present.mean()) / present.std()
        samples = batch.reshape(-1)
        for _ in range(EPOCHS):
            for rows in torch.randperm(len(samples)).split(BATCH):
                terms = loss(samples[rows])
                optimizer.zero_grad()
                (terms["loss_objective"] + terms["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
        done = (number + 1) * worlds * LENGTH
        if done - last >= steps // 12:
            last = done
            print(f"{done} steps, {time.perf_counter() - began:.0f} s: ", end="")
            show("", task, learned, range(JUDGED, JUDGED + 50))
    batches.shutdown()
    return learned


def show(name: str, task: str, policy: Any, seeds: range) -> None:
    """Play episodes and print success, makespan and sum of costs, or where parts come and leave good parts a minute."""
    found, arrived = rollout(policy, task, seeds=seeds, keep=Arrivals, **CASES[task].scene)
    good = found.fact("good_per_minute")
    if np.isfinite(good).all():
        lost = found.fact("lost_per_minute").mean()
        print(
            f"{name:20s} good parts a minute {good.mean():.1f} ({good.min():.1f} to {good.max():.1f}), lost {lost:.2f}",
            flush=True,
        )
        return
    won = found.success
    makespan = f"{np.median(found.time_to_goal[won]):.2f} s" if won.any() else "-"
    costs = f"{np.median(arrived[won].sum(axis=1)):.2f} s" if won.any() else "-"
    print(
        f"{name:20s} success {won.mean():6.1%}  makespan {makespan}  sum of costs {costs}  fallen {found.fallen.mean():.1%}",
        flush=True,
    )


def throughput(task: str, worlds: int) -> None:
    """Print the steps of the TorchRL environment relative to the native batch's, measured alternately."""
    scene = CASES[task].scene
    native = gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, action="velocity", observation="parts", **scene)
    env = BatchEnv(f"vibgym/{task}-v0", num_envs=worlds, **scene)
    native.reset(seed=0)
    now = env.reset()
    now[env.action_key] = torch.zeros(env.full_action_spec[env.action_key].shape)
    still = np.zeros(native.action_space.shape, dtype=np.float32)
    took = common.interleaved({"native": lambda: native.step(still), "TorchRL": lambda: env.step(now)}, 200, 20)
    share = np.median(took["native"] / took["TorchRL"])
    print(f"{worlds} worlds: {share:.0%} of the native batch's steps per second")


def main() -> None:
    """Train, evaluate and print."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--task", choices=tuple(CASES), default="Swap")
    parser.add_argument("--algorithm", choices=("ippo", "mappo"), default="mappo")
    parser.add_argument("--steps", type=int, default=2_000_000)
    parser.add_argument("--worlds", type=int, default=128)
    parser.add_argument("--shared", type=float, default=0.0, help="share of the rewards of other parts at the end")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument(
        "--beside", nargs="*", default=[], type=common.policy, help="further policies to play: JSON, names or paths"
    )
    parser.add_argument("--throughput", action="store_true", help="compare the speed of the environments instead")
    asked = parser.parse_args()
    if asked.throughput:
        throughput(asked.task, asked.worlds)
        return
    learned = train(asked.task, asked.algorithm == "mappo", asked.steps, asked.worlds, asked.seed, asked.shared)
    seeds = range(FIRST_SEED, FIRST_SEED + asked.episodes)
    show(asked.algorithm, asked.task, learned, seeds)
    for name, controller in (*CASES[asked.task].controllers.items(), *((str(each), each) for each in asked.beside)):
        show(name, asked.task, controller, seeds)


if __name__ == "__main__":
    main()
