"""Training: PPO on one task from one file, with or without an expert's lessons before; logs, checkpoints, going on."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from tqdm import tqdm

from agents.evaluation.provenance import processor, versions
from agents.learned.coding import Coding
from agents.learned.pictures import PictureCoding
from agents.learned.residual import ResidualPolicy, load_correction
from agents.learned.storage import check_name, load_set, save_set
from agents.learned.trained import CODINGS, TrainedPolicy, load_trained
from agents.policy import Policy
from agents.registry import make_policy
from agents.task_info import TaskInfo
from agents.training import checkpoint, sac_run
from agents.training.adapter import StableBaselinesAdapter
from agents.training.checkpoint import Diverged, TrainingError
from agents.training.imitation import Imitation, check_room
from agents.training.judging import Judge
from agents.training.parts_policy import PartsPolicy, trained_tensors
from agents.training.ppo import PartsPPO
from agents.training.residual_env import ResidualEnv
from agents.training.settings import TrainSettings, load_settings
from vibgym import checks, locks
from vibgym.envs import VibgymVectorEnv
from vibgym.files import WriteError, output_directory, output_files, reason

MOST_ROLLOUT = 4e9
"""Bytes of a rollout: what Stable-Baselines3 keeps of ``ppo.n_steps`` steps of all worlds before it learns from them."""

POLICY, BEST = "policy.json", "best.json"


def make_env(settings: TrainSettings) -> StableBaselinesAdapter:
    """The worlds that a run trains on, dealt out to its scenes; policies are trained and act on what their network reads."""
    own = observation_of(settings)
    checks.choice("observation", settings.environment.get("observation", own), (own,))
    if settings.residual is not None:
        check_residual(settings)
    scenes = settings.all_scenes
    if settings.worlds < len(scenes):
        raise checks.refuse("worlds", settings.worlds, f"at least {len(scenes)}, one for each scene")
    shares = [len(each) for each in np.array_split(np.arange(settings.worlds), len(scenes))]
    return StableBaselinesAdapter(*(_scene(settings, *each) for each in zip(scenes, shares, strict=True)))


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


def _scene(settings: TrainSettings, scene: dict[str, Any], worlds: int) -> VibgymVectorEnv | ResidualEnv:
    arguments = {**settings.environment, **scene, "num_envs": worlds, "observation": observation_of(settings)}
    arguments.setdefault("autoreset_mode", "SameStep")
    name = settings.environment_name
    try:
        env = gym.make_vec(name, **arguments) if name in gym.registry else VibgymVectorEnv(settings.task, **arguments)
    except TypeError as error:
        raise checks.refuse("arguments", sorted(arguments), f"those of the environment ({error})") from None
    assert isinstance(env, VibgymVectorEnv)
    if settings.residual is None:
        return env
    try:
        return ResidualEnv(env, make_policy(settings.residual.base, TaskInfo.of(env)), settings.residual.scale)
    except ValueError as error:
        raise ValueError(f"residual: {error}") from None


def reads(settings: TrainSettings) -> type[Coding] | type[PictureCoding]:
    """What the run's network reads."""
    return CODINGS[settings.ppo.network]


def action_of(settings: TrainSettings) -> str:
    """What the policy speaks: the environment's action, or its default."""
    return settings.environment.get("action", "element")


def coding_of(settings: TrainSettings, env: VibgymVectorEnv | ResidualEnv) -> Coding | PictureCoding:
    """How the run's network reads and acts in an environment.

    Raises:
        ValueError: columns to be blind to that there are not.
    """
    layout, blind = env.parts_layout, settings.ppo.blind
    names = [row.name for row in layout]
    for name in blind:
        checks.choice("ppo.blind", name, tuple(names))
    columns = [[row.name, row.width] for row in layout if row.name not in blind] if blind else None
    flags = settings.ppo.turned, settings.ppo.remembers
    return reads(settings)(env.surface, env.parts, layout, action_of(settings), columns, *flags)


def make_model(settings: TrainSettings, env: StableBaselinesAdapter) -> PartsPPO:
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
    if ppo.network == "elements" and not coding.shape.has_elements:
        why = "this action has no elements" if not coding.shape.side else "it is blind to the column 'element'"
        raise checks.refuse("ppo.network", ppo.network, f"'parts': {why}")

    def learning_rate(remaining: float) -> float:
        return ppo.final_learning_rate + remaining * (ppo.learning_rate - ppo.final_learning_rate)

    return PartsPPO(
        PartsPolicy,
        env,
        n_steps=ppo.n_steps,
        batch_size=ppo.batch_size,
        n_epochs=ppo.n_epochs,
        learning_rate=learning_rate,
        gamma=ppo.gamma,
        gae_lambda=ppo.gae_lambda,
        clip_range=ppo.clip_range,
        ent_coef=ppo.ent_coef,
        target_kl=ppo.target_kl,
        touch_cost=ppo.touch_cost,
        critic_steps=ppo.critic_steps + lessons_steps(settings),
        policy_kwargs={
            "coding": coding,
            "actor": ppo.network,
            "net": list(ppo.net),
            "critic_net": list(ppo.critic_net),
            "activation": ppo.activation,
            "attention": ppo.attention,
            "log_std": ppo.log_std_init,
        },
        seed=settings.seed,
        device="cpu",
    )


def lessons_steps(settings: TrainSettings) -> int:
    """Steps that imitation takes before PPO begins, all worlds together."""
    lessons = settings.imitation
    return 0 if lessons is None else lessons.rounds * lessons.steps * settings.worlds


def acting(model: PartsPPO, settings: TrainSettings) -> TrainedPolicy:
    """The model as it acts without torch."""
    actor, coding = model.policy.actor, model.policy.coding
    return TrainedPolicy(trained_tensors(actor), actor.kind, settings.ppo.activation, coding)


class Progress(BaseCallback):
    """Progress bar, and a checkpoint at a rollout's end when one is due."""

    def __init__(
        self, settings: TrainSettings, directory: Path, seconds_before: float, quiet: bool, judge: Judge | None = None
    ) -> None:
        super().__init__()
        self.settings, self.directory, self.judge = settings, directory, judge
        self.seconds_before, self.began = seconds_before, time.perf_counter()
        self.bar: Any = tqdm(total=settings.steps, unit="step", unit_scale=True, disable=quiet)
        self.saved_at = 0  # steps of the checkpoint on disk

    @property
    def seconds(self) -> float:
        """Training time so far, over all sittings."""
        return self.seconds_before + time.perf_counter() - self.began

    def _on_training_start(self) -> None:
        self.bar.initial = self.bar.n = self.num_timesteps  # steps of earlier sittings do not count in the rate

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self.bar.update(self.num_timesteps - self.bar.n)
        episodes = self.model.ep_info_buffer or []
        if episodes:
            success = float(np.mean(self.model.ep_success_buffer or [0.0]))
            length = float(np.mean([each["l"] for each in episodes]))
            self.bar.set_postfix_str(f"success {100 * success:.1f} %, {length:.0f} steps an episode", refresh=False)

    def _on_rollout_start(self) -> None:
        # Here the last update is complete, so weights and optimizer belong together.
        assert isinstance(self.model, PartsPPO)
        checkpoint.check_finite(self.model)
        if self.judge is not None and self.judge.due(self.num_timesteps):
            self.play("ppo")
        if self.num_timesteps - self.saved_at >= self.settings.checkpoint_steps:
            self.save()

    def play(self, phase: str) -> None:
        """Add a row to the learning curve, and keep the actor where it does better than ever before."""
        assert isinstance(self.model, PartsPPO) and self.judge is not None
        row = self.judge.judge(acting(self.model, self.settings), self.model.num_timesteps, self.seconds, phase)
        if self.judge.is_best(row):
            record = {"steps": row["steps"], "success": row["success"], "time_to_goal": row["time_to_goal"]}
            save_set(self.directory / BEST, checkpoint.KIND, trained_tensors(self.model.policy.actor), record)

    def save(self) -> None:
        """Write a checkpoint of the present state."""
        assert isinstance(self.model, PartsPPO)
        checkpoint.save(self.directory, self.model, self.settings, self.seconds)
        self.saved_at = self.num_timesteps


def _saved(directory: Path) -> str:
    """What the checkpoint itself says: an interruption may come between its writing and anything that counts."""
    path = directory / checkpoint.FILE
    if not path.exists():
        return f"no checkpoint was due yet, so nothing is saved in {directory}"
    steps = load_set(path, checkpoint.KIND)[1]["steps"]
    return f"{steps} steps are saved in {directory}; the same command goes on from there"


def train(
    config: Path,
    output: Path | None = None,
    quiet: bool = False,
    policy: Path | None = None,
    agent: str | None = None,
    seed: int | None = None,
) -> Path:
    """Train as the file ``config`` says, from its last checkpoint if there is one.

    Writes ``checkpoint.json`` with its tensors, ``progress.csv`` and TensorBoard events, ``curve.csv`` where the settings ask
    for a learning curve, and at the end the policy: a JSON file with its tensors beside it.

    Args:
        config: YAML file, see :func:`agents.training.settings.load_settings`.
        output: directory, instead of the file's.
        quiet: no progress bar, no closing line.
        policy: path of the policy's file, instead of ``policy.json`` in the directory.
        agent: which one of a file of many.
        seed: instead of the file's.

    Returns:
        Path of the policy's file.

    Raises:
        ValueError: bad settings, a checkpoint of other settings, a place that cannot be written to, or a directory in which
            another run is at work.
        TrainingError: the training diverged; the last checkpoint and the last policy stay.
        WriteError: no space is left, or the like.
    """
    settings = load_settings(config, agent, seed)
    directory = output or Path(settings.output or Path("runs") / config.stem)
    if settings.algorithm == "sac":
        return sac_run.train(str(config), settings, directory, lambda: policy_path(directory, policy), quiet)
    try:
        env = make_env(settings)
    except ValueError as error:
        raise ValueError(f"{config}: environment: {error}") from None
    with contextlib.closing(env):
        try:
            model = make_model(settings, env)
            scenes = experts(settings, env)
            begin_with(settings, model, env)
            judge = None if settings.judging is None else Judge(settings, directory)
        except ValueError as error:
            raise ValueError(f"{config}: {error}") from None
        path = policy_path(directory, policy)
        with locks.one_run(directory):
            progress = Progress(settings, directory, checkpoint.restore(directory, model, settings), quiet, judge)
            try:
                if judge is not None:
                    judge.begin(model.num_timesteps)
                if model.num_timesteps == 0:
                    imitate(model, scenes, settings, progress)
                learn(model, settings, progress)
            except (Diverged, ValueError) as error:
                raise failure(error, model, progress) from error
            except OSError as error:
                raise WriteError(f"training stopped, {progress.saved_at} steps are saved ({reason(error)})") from error
            except KeyboardInterrupt:
                raise KeyboardInterrupt(_saved(directory)) from None
            kept_from = model.num_timesteps if judge is None else take_best(directory, model)
            training = {
                "algorithm": "PPO with parts as samples (on Stable-Baselines3)",
                "settings": settings.model_dump(mode="json"),
                "steps": model.num_timesteps,
                "kept_from_step": kept_from,
                "minutes": round(progress.seconds / 60.0, 2),
                "threads": torch.get_num_threads(),
                "processor": processor(),
                "versions": versions(),
            }
            # Others may write policies beside this one, and train elsewhere: a moment's lock, not the directory's.
            with locks.one_run(path.parent, "--policy", f".{path.name}.lock", patience=60.0):
                checkpoint.save_policy(path, model, settings, env.env, training)
    if not quiet:
        rate = model.num_timesteps / progress.seconds
        print(
            f"{path}: {model.num_timesteps} steps in {progress.seconds:.0f} s, {rate:.0f} steps/s, everything included"
        )
    return path


def take_best(directory: Path, model: PartsPPO) -> int:
    """Take the actor to where it did best on the episodes of the learning curve; returns the steps made until then."""
    tensors, record = load_set(directory / BEST, checkpoint.KIND)
    model.policy.actor.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in tensors.items()})
    return int(record["steps"])


def experts(settings: TrainSettings, env: StableBaselinesAdapter) -> list[tuple[Policy, VibgymVectorEnv]]:
    """Whom the run imitates in each of its scenes; none without imitation.

    Raises:
        ValueError: an expert that does not serve the task, or does not speak its actions.
    """
    if settings.imitation is None:
        return []
    found = []
    for scene in env.envs:
        assert isinstance(scene, VibgymVectorEnv)  # corrections are not taught
        expert = make_policy(settings.imitation.expert, TaskInfo.of(scene), settings.seed)
        if expert.action != action_of(settings) or expert.observation != "state":
            got = f"one that speaks {expert.action!r} and reads {expert.observation!r}"
            allowed = f"one that speaks {action_of(settings)!r} and reads 'state'"
            raise checks.refuse("imitation.expert", got, allowed)
        found.append((expert, scene))
    return found


def begin_with(settings: TrainSettings, model: PartsPPO, env: StableBaselinesAdapter) -> None:
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
    return {name: value.shape for name, value in tensors.items()}


def imitate(
    model: PartsPPO, scenes: list[tuple[Policy, VibgymVectorEnv]], settings: TrainSettings, progress: Progress
) -> None:
    """Let the actor learn from the experts; the steps count."""
    if settings.imitation is None:
        return
    lessons = Imitation(model.policy, scenes, settings.imitation, settings.seed)
    for loss in lessons.rounds():
        model.num_timesteps = lessons.steps
        checkpoint.check_finite(model)
        progress.bar.update(lessons.steps - progress.bar.n)
        progress.bar.set_postfix_str(f"imitation, error {loss:.2e}", refresh=False)
    if progress.judge is not None:
        progress.model = model
        progress.play("imitation")
    checkpoint.save(progress.directory, model, settings, progress.seconds)


def policy_path(directory: Path, policy: Path | None) -> Path:
    """Where the policy goes, once it is clear that all can be written that a training writes.

    Raises:
        ValueError: it cannot.
    """
    tensors = f"-{'0' * 12}.safetensors"
    output_directory(directory)
    output_files((directory / name for name in (POLICY, checkpoint.FILE)), "output")
    if policy is None:
        return directory / POLICY
    check_name("--policy", policy)
    output_files((policy, policy.with_name(policy.stem + tensors)), "--policy")
    if policy.resolve() == (directory / checkpoint.FILE).resolve():
        raise checks.refuse("--policy", str(policy), "another file than the checkpoint")
    return policy


def learn(model: PartsPPO, settings: TrainSettings, progress: Progress) -> None:
    """Train to the end, and write the last checkpoint."""
    progress.saved_at = model.num_timesteps  # what was restored
    sitting = progress.directory / f"log-from-{model.num_timesteps}"
    model.set_logger(configure(str(sitting), ["csv", "tensorboard"]))
    # A sitting that goes on draws other episodes than the ones already seen.
    model.get_env().seed(settings.seed + model.num_timesteps)  # type: ignore[union-attr]
    try:
        if model.num_timesteps < settings.steps:
            todo = settings.steps - model.num_timesteps
            model.learn(todo, callback=progress, log_interval=1, reset_num_timesteps=False)
            checkpoint.check_finite(model)
            if progress.judge is not None:
                progress.play("ppo")
        checkpoint.save(progress.directory, model, settings, progress.seconds)
    finally:
        progress.bar.close()
        model.logger.close()


def failure(error: Exception, model: PartsPPO, progress: Progress) -> RuntimeError:
    """What ended a training whose settings were fine."""
    steps = model.num_timesteps
    try:
        checkpoint.check_finite(model)
    except Diverged as found:  # what the error says is then but a consequence
        kept = f"the checkpoint of {progress.saved_at} steps stays" if progress.saved_at else "nothing had been saved"
        return TrainingError(
            f"{progress.directory}: training diverged within {steps} steps ({found}); {kept}; lower ppo.learning_rate, "
            "ppo.ent_coef, ppo.log_std_init or ppo.clip_range and train into another output"
        )
    return RuntimeError(f"training failed after {steps} steps: {error}")
