"""PPO on parts: its worlds, how a network reads them and acts in them, the model, its experts and start, its policies.

:mod:`agents.training.off_policy` has the same for SAC, under the same names; see :data:`agents.training.train.ALGORITHMS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import VectorEnv

from agents.training.checkpoint import refuse_infinite
from agents.training.imitation import check_room
from agents.training.offline_learner import OfflineLearner
from agents.training.parts_policy import PartsPolicy, trained_tensors
from agents.training.ppo import PartsPPO
from agents.training.residual_env import ResidualEnv
from agents.training.settings import TrainSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs import VibgymVectorEnv
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.networks.acting import FLOOR
from vibgym.policies.trained.pictures import PictureCoding
from vibgym.policies.trained.residual import ResidualPolicy, load_correction
from vibgym.policies.trained.storage import save_set
from vibgym.policies.trained.trained import ANY, CODINGS, RESIDUAL, TrainedPolicy, described, load_trained
from vibgym.policies.trained.trained import KIND as POLICY_KIND
from vibgym.policies.trained.trained import VERSION as POLICY_VERSION

TITLE, PHASE = "PPO with parts as samples (on Stable-Baselines3)", "ppo"
"""What policies' files and learning curves call it."""

ADVICE = "ppo.learning_rate, ppo.ent_coef, ppo.log_std_init or ppo.clip_range"
"""What to lower where a training diverges."""

Learner = PartsPPO | OfflineLearner
"""What has a policy of parts."""

MOST_ROLLOUT = 4e9
"""Bytes of a rollout: what is kept of ``ppo.n_steps`` steps of all worlds before a model learns from them."""


def make_env(settings: TrainSettings) -> VecEnv:
    """The worlds that a run trains on, dealt out to its scenes; policies are trained and act on what their network reads."""
    own = observation_of(settings)
    checks.choice("observation", settings.environment.get("observation", own), (own,))
    if settings.residual is not None:
        check_residual(settings)
    scenes = settings.all_scenes
    if settings.worlds < len(scenes):
        raise checks.refuse("worlds", settings.worlds, f"at least {len(scenes)}, one for each scene")
    shares = [len(each) for each in np.array_split(np.arange(settings.worlds), len(scenes))]
    return VecEnv(*(_scene(settings, *each) for each in zip(scenes, shares, strict=True)))


def check_residual(settings: TrainSettings) -> None:
    """Refuse what a correction cannot be trained with.

    Raises:
        ValueError: imitation, whose experts say what to do and not what to add; rows that remember or turn, in which the
            base's action would stand twice or not turned; another network or action than parts' and ``"wrench"``.
    """
    ppo, why = settings.ppo, "with 'residual'"
    for name, got, allowed in (
        ("imitation", None if settings.imitation is None else settings.imitation.expert, None),
        ("ppo.remembers", ppo.remembers, False),
        ("ppo.turned", ppo.turned, False),
        ("ppo.network", ppo.network, "parts"),
        ("environment.action", action_of(settings), "wrench"),
    ):
        if got != allowed:
            raise checks.refuse(name, got, f"{allowed!r} {why}")


def observation_of(settings: TrainSettings) -> str:
    """What the environment shows: what the network reads, and the flat state where a base policy acts."""
    return reads(settings).observation if settings.residual is None else ResidualPolicy.observation


def _scene(settings: TrainSettings, scene: dict[str, Any], worlds: int) -> VectorEnv:
    """The worlds of one scene, in the wrappers that the registered environment brings along."""
    arguments = {**settings.environment, **scene, "num_envs": worlds, "observation": observation_of(settings)}
    arguments.setdefault("autoreset_mode", "SameStep")
    name = settings.environment_name
    try:
        env = gym.make_vec(name, **arguments) if name in gym.registry else VibgymVectorEnv(settings.task, **arguments)
    except TypeError as error:
        raise checks.refuse("arguments", sorted(arguments), f"those of the environment ({error})") from None
    check_native(settings, env)
    if settings.residual is None:
        return env
    try:
        return ResidualEnv(env, make_policy(settings.residual.base, TaskInfo.of(env)), settings.residual.scale)
    except ValueError as error:
        raise ValueError(f"residual: {error}") from None


def check_native(settings: TrainSettings, env: VectorEnv) -> None:
    """Refuse an environment that is none of ours.

    Raises:
        ValueError: a registered environment of other makers.
    """
    if not isinstance(env.unwrapped, VibgymVectorEnv):
        raise checks.refuse("task", settings.task, "a task or an id whose batch is a VibgymVectorEnv, wrapped or not")


def reads(settings: TrainSettings) -> type[Coding] | type[PictureCoding]:
    """What the run's network reads."""
    return CODINGS[settings.network.network]


def action_of(settings: TrainSettings) -> str:
    """What the policy speaks: the environment's action, or its default."""
    return settings.environment.get("action", "element")


def coding_of(settings: TrainSettings, env: VibgymVectorEnv | ResidualEnv) -> Coding | PictureCoding:
    """How the run's network reads and acts in an environment.

    Raises:
        ValueError: columns to be blind to that there are not.
    """
    layout, blind = env.parts_layout, settings.network.blind
    names = [row.name for row in layout]
    for name in blind:
        checks.choice(f"{settings.algorithm}.blind", name, tuple(names))
    columns = [[row.name, row.width] for row in layout if row.name not in blind] if blind else None
    flags = settings.network.turned, settings.network.remembers
    return reads(settings)(env.surface, env.parts, layout, action_of(settings), columns, *flags)


def make_model(settings: TrainSettings, env: VecEnv) -> PartsPPO:
    """An untrained model.

    Raises:
        ValueError: a rollout that is too short to learn from, or too large to keep.
    """
    ppo, base = settings.ppo, env.env
    if ppo.n_steps * settings.worlds < 2:
        raise checks.refuse("ppo.n_steps", ppo.n_steps, "2 or more with one world")
    coding = coding_of(settings, base)
    seen = np.dtype(coding.dtype).itemsize * coding.shape.columns
    size = len(base.parts) * (seen + 4 * (coding.shape.action + 6)) * ppo.n_steps * settings.worlds
    if size > MOST_ROLLOUT:
        allowed = f"a rollout of at most {MOST_ROLLOUT:.1e} bytes; with {settings.worlds} worlds it has {size:.1e}"
        raise checks.refuse("ppo.n_steps", ppo.n_steps, allowed)
    if settings.imitation is not None:
        check_room(settings.imitation, coding, settings.worlds)
    if ppo.noise_floor is not None and ppo.network != "parts":
        raise checks.refuse("ppo.noise_floor", ppo.noise_floor, f"none with the network {ppo.network!r}")

    return PartsPPO(
        PartsPolicy,
        env,
        n_steps=ppo.n_steps,
        batch_size=ppo.batch_size,
        n_epochs=ppo.n_epochs,
        learning_rate=ppo.rate,
        gamma=ppo.gamma,
        gae_lambda=ppo.gae_lambda,
        clip_range=ppo.clip_range,
        ent_coef=ppo.ent_coef,
        target_kl=ppo.target_kl,
        touch_cost=ppo.touch_cost,
        critic_steps=ppo.critic_steps + lessons_steps(settings),
        policy_kwargs={
            **networks(settings, coding),
            "log_std": ppo.log_std_init,
            "noise_floor": ppo.noise_floor,
        },
        seed=settings.seed,
        device="cpu",
    )


def networks(settings: TrainSettings, coding: Coding | PictureCoding) -> dict[str, Any]:
    """Arguments of :class:`agents.training.parts_policy.PartsPolicy`.

    Raises:
        ValueError: a network of elements, and none to read.
    """
    network = settings.network
    if network.network == "elements" and not coding.shape.has_elements:
        why = "this action has no elements" if not coding.shape.side else "it is blind to the column 'element'"
        raise checks.refuse(f"{settings.algorithm}.network", network.network, f"'parts': {why}")
    return {
        "coding": coding,
        "actor": network.network,
        "net": list(network.net),
        "critic_net": list(network.critic_net),
        "activation": network.activation,
        "attention": network.attention,
    }


def lessons_steps(settings: TrainSettings) -> int:
    """Steps that imitation takes before PPO begins, all worlds together."""
    lessons = settings.imitation
    return 0 if lessons is None else lessons.rounds * lessons.steps * settings.worlds


def acting(model: Learner, settings: TrainSettings) -> TrainedPolicy:
    """The model as it acts without torch."""
    return TrainedPolicy(actor(model), model.policy.actor.kind, settings.network.activation, model.policy.coding)


def experts(settings: TrainSettings, env: VecEnv) -> list[tuple[Policy, VibgymVectorEnv]]:
    """Whom the run imitates in each of its scenes; none without imitation.

    Raises:
        ValueError: an expert that does not serve the task, or does not speak its actions.
    """
    if settings.imitation is None:
        return []
    found = []
    for wrapped in env.envs:
        scene = wrapped.unwrapped  # its rewards do not count here
        assert isinstance(scene, VibgymVectorEnv)
        expert = make_policy(settings.imitation.expert, TaskInfo.of(scene), settings.seed)
        if expert.action != action_of(settings) or expert.observation != "state":
            got = f"one that speaks {expert.action!r} and reads {expert.observation!r}"
            allowed = f"one that speaks {action_of(settings)!r} and reads 'state'"
            raise checks.refuse("imitation.expert", got, allowed)
        found.append((expert, scene))
    return found


def begin_with(settings: TrainSettings, model: PartsPPO, env: VecEnv) -> None:
    """Take the actor over from the policy that the settings name, if they do; how much it explores is theirs to say.

    Raises:
        ValueError: a policy of another form, or for another task.
    """
    if settings.start is None:
        return
    path = Path(settings.start.replace("{seed}", str(settings.seed)))
    info, mine, what = TaskInfo.of(env.env), acting(model, settings), settings.residual
    found = load_trained(path, info) if what is None else load_correction(path, info, what.base, what.scale).learned
    if not isinstance(found, TrainedPolicy):
        raise checks.refuse("start", str(path), "a policy that PPO has trained")
    # Weights may fit and yet mean something else: numbers of other columns, or another action.
    for name, theirs, ours in (
        ("action", found.action, mine.action),
        ("columns", found.coding.columns, mine.coding.columns),
        ("ppo.turned", found.coding.turned, mine.coding.turned),
        ("ppo.remembers", found.coding.remembers, mine.coding.remembers),
        ("ppo.network", found.network, mine.network),
        ("ppo.activation", found.activation, mine.activation),
        ("layers", _shapes(found.tensors), _shapes(mine.tensors)),
    ):
        if theirs != ours:
            got = f"{path} (other {name})"
            raise checks.refuse("start", got, "a policy with a network as the settings have it")
    kept = {
        name: torch.from_numpy(each.copy()) for name, each in found.tensors.items() if not name.startswith("log_std")
    }
    model.policy.actor.load_state_dict({**model.policy.actor.state_dict(), **kept})


def _shapes(tensors: Mapping[str, np.ndarray]) -> dict[str, tuple[int, ...]]:
    return {name: value.shape for name, value in tensors.items() if name != FLOOR}


def actor(model: Learner) -> dict[str, np.ndarray]:
    """The tensors of what acts."""
    return trained_tensors(model.policy.actor)


def take_actor(model: Learner, tensors: Mapping[str, np.ndarray]) -> None:
    """Act as these tensors do."""
    model.policy.actor.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in tensors.items()})


def save_policy(path: Path, model: Learner, settings: TrainSettings, training: dict[str, Any]) -> None:
    """Write the acting part of the model for :func:`vibgym.policies.trained.trained.load_trained`.

    Raises:
        Diverged: a weight is not finite; an older policy stays.
    """
    tensors = actor(model)
    refuse_infinite(tensors)
    serves, info, coding = settings.serves, TaskInfo.of(_env(model).env), model.policy.coding
    record: dict[str, Any] = {
        "tasks": list(dict.fromkeys([info.name, *(serves.tasks or ())])),
        "surface": ANY if serves.surface == ANY else described(info.surface),
        "parts": ANY if serves.parts == ANY else len(info.parts),
        "columns": coding.columns,
        "turned": coding.turned,
        "remembers": coding.remembers,
        "action": coding.action,
        "network": settings.network.network,
        "activation": settings.network.activation,
        "training": training,
    }
    if settings.residual is not None:
        record[RESIDUAL] = settings.residual.model_dump(mode="json")
    save_set(path, POLICY_KIND, tensors, record, POLICY_VERSION)


def _env(model: Learner) -> VecEnv:
    env = model.get_env()
    assert isinstance(env, VecEnv)
    return env
