"""IPPO and MAPPO of TorchRL from scratch, on Swap with six parts or Feed: ``python -m studies.benchmarks.multi_agent``.

Parts are agents with shared weights on :class:`vibgym.adapters.torchrl.BatchEnv`, action ``velocity``. The critic of IPPO reads
the row of a part (de Witt et al. 2020, https://arxiv.org/abs/2011.09533), that of MAPPO also those of all others (Yu et al.
2022, https://arxiv.org/abs/2103.01955). Output: learning curve, then success, makespan and sum of costs on fresh episodes,
beside the classical controllers. The sum of costs adds the times at which the parts have last reached their goals (Stern et
al., "Multi-agent pathfinding: definitions, variants, and benchmarks", 2019).
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
import torch
from tensordict.nn import TensorDictModule
from tensordict.nn.distributions import NormalParamExtractor
from torch import nn
from torchrl.collectors import Collector
from torchrl.modules import MLP, ProbabilisticActor, TanhNormal
from torchrl.objectives import ClipPPOLoss, ValueEstimators

from studies import common
from vibgym.adapters.torchrl import GROUP, BatchEnv
from vibgym.policies import rollout
from vibgym.policies.rollout import Ends
from vibgym.policies.trained.coding import TOUCHING
from vibgym.policies.trained.symmetry import turned_rows
from vibgym.seeds import RANGES


class Case(NamedTuple):
    """A task: settings of its environment, settings of the training only, classical controllers, and its symmetry.

    ``opposed``: parts of the second kind have the task of the first after half a turn of the table.
    """

    scene: dict[str, Any]
    training: dict[str, Any]
    controllers: dict[str, dict[str, Any]]
    opposed: bool


LANES: dict[str, Any] = {"kind": "lanes", "action": "velocity"}
PLANNER: dict[str, Any] = {"kind": "planner", "law": "pose"}
FAST: dict[str, Any] = {"max_episode_steps": 500, "model": {"kind": "planar", "contacts": "fast"}}
# Where falls cost much relative to the way, parts first learn to stand still.
WEIGHTS = {"distance": 4.0, "time": 0.02, "within": 0.02, "success": 20.0, "fallen": 5.0}
CASES = {
    "Swap": Case(
        {"parts": ["steel_block", "aluminium_block"] * 3},
        {**FAST, "task_settings": {"weights": WEIGHTS}},
        {"planner, pose": PLANNER, "lanes": LANES},
        True,
    ),
    "Feed": Case({}, FAST, {"planner, pose": PLANNER, "lanes": LANES}, False),
}

UNSEEN = ("kind", "friction", "radius", "gyration", "extent", "position", "element")
"""Columns that agents do not read: what a part has to do depends on its way and its neighbours."""

LENGTH, CELLS = 32, 128
GAMMA, LAMBDA, CLIP, EPOCHS, BATCH, RATE = 0.99, 0.95, 0.2, 2, 256, 5e-4
SCALE = 0.1
"""Of rewards: errors of values then are of the order of 1, and their gradients do not crowd out those of the actor."""


class View(nn.Module):
    """Rows as agents see them: without the columns :data:`UNSEEN`; for agents ``turned``, after half a turn of the table.

    Where both kinds have the same task, but from opposite ends, one rule for passing then serves both.
    """

    def __init__(self, layout: Any, parts: Any, turned: np.ndarray) -> None:
        super().__init__()
        columns = [(row.name, row.width) for row in layout]
        seen = np.concatenate([np.full(width, name not in UNSEEN) for name, width in columns])
        half = np.linalg.matrix_power(turned_rows(columns, parts), 2) if turned.any() else np.eye(len(seen))
        codes = np.where(turned[:, None, None], half.T, np.eye(len(seen)))[..., seen]
        self.register_buffer("codes", torch.as_tensor(codes, dtype=torch.float32))  # (parts, columns, seen)

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return (..., parts, seen) for rows (..., parts, columns)."""
        return torch.einsum("...pc,pcs->...ps", rows, self.codes)


class Actor(nn.Module):
    """Mean and standard deviation of actions; see :class:`View`."""

    def __init__(self, view: View, turned: np.ndarray, numbers: int) -> None:
        super().__init__()
        self.net = nn.Sequential(
            view, mlp(view.codes.shape[-1], 2 * numbers), NormalParamExtractor("biased_softplus_0.3")
        )
        signs = np.where(turned[:, None], [-1.0, -1.0, 1.0], 1.0)  # of two velocities and a spin
        self.register_buffer("signs", torch.as_tensor(signs, dtype=torch.float32))
        # Commands are small at first.
        nn.init.orthogonal_(self.net[1][-1].weight, 0.01)

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return both (..., parts, numbers) for rows (..., parts, columns)."""
        mean, deviation = self.net(rows)
        return mean * self.signs, deviation


class Critic(nn.Module):
    """Value of every part from what it sees and, if ``central``, from the mean of an encoding of what all parts see.

    A critic that reads all parts alike, without the own row of a part apart, has the same value for all, whose rewards differ.
    """

    def __init__(self, view: View, central: bool) -> None:
        super().__init__()
        seen = view.codes.shape[-1]
        self.view, self.together = view, nn.Linear(seen, CELLS // 2) if central else None
        self.net = mlp(seen + (CELLS // 2 if central else 0), 1)

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return (..., parts, 1) for rows (..., parts, columns)."""
        seen = self.view(rows)
        if self.together is not None:
            world = torch.relu(self.together(seen)).mean(dim=-2, keepdim=True)
            seen = torch.cat([seen, world.expand(*seen.shape[:-1], -1)], dim=-1)
        return self.net(seen)


def mlp(inputs: int, outputs: int) -> MLP:
    """Return two hidden layers with orthogonal weights (Engstrom et al. 2020, https://arxiv.org/abs/2005.12729)."""
    net = MLP(inputs, outputs, depth=2, num_cells=CELLS, activation_class=nn.ReLU)
    for layer in net:
        if isinstance(layer, nn.Linear):
            nn.init.orthogonal_(layer.weight, 2.0**0.5)
            nn.init.zeros_(layer.bias)
    return net


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


def nets(task: str, env: BatchEnv, central: bool) -> tuple[nn.Module, nn.Module]:
    """Return actor and critic of all parts."""
    parts = env.env.unwrapped.core.parts
    turned = np.array([CASES[task].opposed and part.name != parts[0].name for part in parts])
    view = View(env.parts_layout, parts, turned)
    return Actor(view, turned, env.full_action_spec[env.action_key].shape[-1]), Critic(view, central)


def train(task: str, central: bool, steps: int, worlds: int, seed: int, blame: float, touch: float) -> Learned:
    """Train IPPO (``central`` false) or MAPPO, print the learning curve, and return the policy.

    ``blame`` is what a fall costs every part from the middle of the training on; it grows from 0, since parts first learn to
    move. Parts are pushed over the border by others, which the reward of a fall does not reach. ``touch`` is what a step in
    contact with another part costs.
    """
    torch.manual_seed(seed)
    case = CASES[task]
    env = BatchEnv(f"vibgym/{task}-v0", num_envs=worlds, **case.scene, **case.training)
    env.set_seed(seed)
    net, value = nets(task, env, central)
    nearest = [row.start for row in env.parts_layout if row.name in ("neighbour_1_there", "neighbour_1_gap")]
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
    optimizer = torch.optim.Adam(loss.parameters(), lr=RATE, eps=1e-5, fused=True)
    learned, began, last = Learned(net), time.perf_counter(), 0
    batches = Collector(
        env, actor, frames_per_batch=worlds * LENGTH, total_frames=steps, auto_register_policy_transforms=True
    )
    for number, batch in enumerate(batches):
        share = 1.0 - number * worlds * LENGTH / steps
        for group in optimizer.param_groups:
            group["lr"] = RATE * max(share, 0.1)
        reward = batch["next", GROUP, "reward"]
        fell = (batch["next", "terminated"] & ~batch["next", "success"]).unsqueeze(-1)
        there, gap = (batch["next", GROUP, "observation"][..., column : column + 1] for column in nearest)
        touching = (there > 0.5) & (gap < TOUCHING)
        costs = min(2.0 * (1.0 - share), 1.0) * blame * fell + touch * touching
        batch["next", GROUP, "reward"] = SCALE * (reward - costs)
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
        samples = batch.exclude("next").reshape(-1)
        for _ in range(EPOCHS):
            for rows in torch.randperm(len(samples)).split(BATCH):
                terms = loss(samples[rows])
                optimizer.zero_grad()
                (terms["loss_objective"] + terms["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
        done = (number + 1) * worlds * LENGTH
        if done - last >= steps // 8:
            last = done
            print(f"{done} steps, {time.perf_counter() - began:.0f} s: ", end="")
            show("", task, learned, RANGES["evaluation"][:50], **case.training)
    batches.shutdown()
    return learned


def show(name: str, task: str, policy: Any, seeds: range, **more: Any) -> None:
    """Play episodes and print success, makespan and sum of costs, or where parts come and leave good parts a minute."""
    result, arrived = rollout(policy, task, seeds=seeds, keep=Arrivals, **CASES[task].scene, **more)
    good = result.reported("good_per_minute")
    if np.isfinite(good).all():
        lost = result.reported("lost_per_minute").mean()
        print(
            f"{name:20s} good parts a minute {good.mean():.1f} ({good.min():.1f} to {good.max():.1f}), lost {lost:.2f}",
            flush=True,
        )
        return
    won = result.success
    makespan = f"{np.median(result.time_to_goal[won]):.2f} s" if won.any() else "-"
    costs = f"{np.median(arrived[won].sum(axis=1)):.2f} s" if won.any() else "-"
    print(
        f"{name:20s} success {won.mean():6.1%}  makespan {makespan}  sum of costs {costs}  fallen {result.fallen.mean():.1%}",
        flush=True,
    )


def main() -> None:
    """Train, evaluate and print."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--task", choices=tuple(CASES), default="Swap")
    parser.add_argument("--algorithm", choices=("ippo", "mappo"), default="mappo")
    parser.add_argument("--steps", type=int, default=600_000)
    parser.add_argument("--worlds", type=int, default=128)
    parser.add_argument("--blame", type=float, default=20.0, help="cost of a fall for every part, in the end")
    parser.add_argument("--touch", type=float, default=0.05, help="cost of a step in contact with another part")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument(
        "--beside", nargs="*", default=[], type=common.policy, help="further policies to play: JSON, names or paths"
    )
    asked = parser.parse_args()
    learned = train(
        asked.task, asked.algorithm == "mappo", asked.steps, asked.worlds, asked.seed, asked.blame, asked.touch
    )
    seeds = RANGES["held_out"][: asked.episodes]
    show(asked.algorithm, asked.task, learned, seeds)
    for name, controller in (*CASES[asked.task].controllers.items(), *((str(kind), kind) for kind in asked.beside)):
        show(name, asked.task, controller, seeds)


if __name__ == "__main__":
    main()
