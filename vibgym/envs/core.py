"""The batched core under the single and the vector environment: worlds of one task, stepped together.

One step goes in one direction:

    action -> command -> actuators -> drive -> simulation -> true state -> task: reward, info
                                                               \\-> sensor -> measurement -> observation
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.actuators import actuators_from, nominal
from vibgym.config import part_from, surface_from
from vibgym.envs.actions import ACTIONS, Intake
from vibgym.envs.base import Observation
from vibgym.envs.disturbances import Disturbances
from vibgym.envs.info import Information
from vibgym.envs.limits import longest_paths, step_limit
from vibgym.envs.observations import OBSERVATIONS
from vibgym.envs.options import Options
from vibgym.envs.randomization import Randomization
from vibgym.envs.reset_options import StartOverride
from vibgym.envs.stages import Stages
from vibgym.physics.core.drive import Drive, all_phasors
from vibgym.scene.parts import Part
from vibgym.sensing import TOLD, sensing_from
from vibgym.sensing.measurement import Measurement, new_measurement
from vibgym.simulation.conditions import Conditions
from vibgym.simulation.simulator import MODELS, Simulator
from vibgym.snapshots import check_keys, copied, put_back, restored
from vibgym.tasks import TASKS, Start, Task
from vibgym.tasks.episode import new_relations
from vibgym.tasks.reward import OwnReward

NONE = np.zeros(0, dtype=np.int64)

BYTES_OF_WORLD, BYTES_OF_PART, BYTES_OF_ELEMENT = 2000, 1000, 64
"""What a world takes at least: its generator, what is known of each part, and spaces, actions and drives of the elements."""

NAMED = ("start", "zones", "slots", "paths", "randomize")
"""Settings of tasks that are keyword arguments of the environment; the others come as ``task_settings``."""

MOST_PERIODS = 1_000_000
"""In a step: eleven hours in the world."""


class Core:
    """Task, action, actuators, simulator, sensor and observation of ``worlds`` worlds.

    Args:
        options: what the environment is made of.
        worlds: number of worlds.
        information: what makes ``info``.

    Attributes:
        options: what it was made of, as given.
        episode: progress of every world, by the true state.  relations: how parts stand by the true state.
        facts, details: what ``info`` says, and groups of what it says besides, live arrays (worlds, ...).
        information: makes ``info`` of what :attr:`stages` have told.
        stages: what follows the simulation, with what the last step has come to.
        term_names, terms: names of the reward terms, and their values (worlds, terms).
        part_terms: their values for each part alone, (worlds, parts, terms).
        step_limit: steps after which episodes are truncated; None: not here.  longest: s that paths of an episode may last.

    Raises:
        ValueError: a bad setting.
    """

    STATE = ("environment", "simulator", "episode", "action", "actuators", "sensor", "began")
    """Keys of a snapshot."""

    def __init__(self, options: Options, worlds: int, information: type[Information] = Information) -> None:
        cls = TASKS.choose("task", options.task)
        self.options = options
        self.surface = surface_from(options.surface)
        self.parts = _parts_from(options.parts, cls)
        numbers = BYTES_OF_ELEMENT * self.surface.rows * self.surface.columns
        self.worlds = checks.fitting("num_envs", worlds, BYTES_OF_WORLD + BYTES_OF_PART * len(self.parts) + numbers)
        self.periods = checks.count("periods_per_step", options.periods_per_step, most=MOST_PERIODS)
        self.actuators = actuators_from(options.actuators, self.surface, worlds, self.periods)
        names = cls.RANDOMIZED, self.actuators.VARIED
        self.randomization = Randomization(options.randomize, *names, self.surface, self.parts)
        self.actuators.vary(self.randomization.actuators)
        settings, weights = _task_settings(options, cls, self.randomization.task)
        self.task: Task = checks.made("task", cls, (self.surface, self.parts), settings)
        self.task.weigh(weights)
        self.action = ACTIONS.choose("action", options.action)(self.surface, self.parts)
        model, knobs = checks.named("model", options.model, MODELS)
        if model == "auto":
            knobs.setdefault("periods_per_call", self.periods)
        if options.walls is not None and not cls.HAS_WALLS:
            raise checks.refuse("walls", options.walls, f"nothing for {options.task}, which has none")
        walls = () if options.walls is None else options.walls
        self.simulator = Simulator(self.surface, self.parts, worlds=worlds, model=model, walls=walls, **knobs)
        if "patches" in self.randomization.ranges:
            self.simulator.tell_elements_apart()
        disturbance, span = self.randomization.disturbance, self.periods * self.surface.period
        self.disturbances = None if disturbance is None else Disturbances(disturbance, self.simulator, span)
        self.sensing = sensing_from(
            options.sensor, self.surface, self.parts, worlds, self.periods,
            plant=nominal(self.actuators), latency=self.actuators.latency, walls=walls,
        )  # fmt: skip
        if self.task.flows and not self.sensing.sensor.renews:
            allowed = f"'ideal', 'pose', or another that {self.task.name}, whose parts come and go, can do with"
            raise checks.refuse("sensor", options.sensor, allowed)
        self.task.features = (*self.task.features, *(name for each in self.sensing.tell for name in TOLD[each]))
        self.observation = self._observation("observation", options.observation)
        self._observations = {options.observation: self.observation}
        self._aim = _at_all if self.task.driven.all() else self._at_driven
        self._renew = self._renew_parts if self.task.flows else _nothing
        self._commanded = self.action.resolve_limits(self.actuators.data_sheet, worlds)
        command = self._resting_command()
        self.actuators.prepare(command)
        self.sensing.prepare(command)
        self._check_extremes()
        self.identity = _identity(options, self)
        self.idle = self._idle_velocity(np.ones(len(self.parts)))
        # Arrays of the state and of the scoring live as long as the core and are changed in place.
        state = self.simulator.state
        self.scoring = self.task.scoring(state, self.periods)
        self.episode, self.relations = self.scoring.episode, self.scoring.relations
        # A sensor that tells the truth needs no relations of its own.
        self._measured = self.relations
        if self.sensing.exact:
            self.sensing.reset(NONE, state, np.zeros((0, 0)))
        else:
            self._measured = new_relations(worlds, len(self.parts))
        self.drive: Any = None
        self._own_reward: OwnReward | None = None
        self._choose_reward(weights)
        self._information = information
        self._intake = Intake(worlds, self.action.size, self.simulator.blocks)
        self._bind()
        self.step_limit = step_limit(self.periods, options.max_episode_periods)
        self.longest = longest_paths(self.task, self.actuators, self.sensing.sensor, options.max_episode_periods)
        self.began = False

    def _choose_reward(self, weights: Mapping[str, Any]) -> None:
        """Who rewards: kernels what is shipped, a task with a reward of its own, or the goal of the observation.

        Raises:
            ValueError: terms of the task's own that cannot be weighed, or weights beside a goal's reward.
        """
        worlds, parts = self.worlds, len(self.parts)
        self.term_names: tuple[str, ...] = tuple(self.task.made_of)
        self.terms, self.part_terms = self.episode.terms, self.episode.part_terms
        if self.observation.goal_reward:
            if weights:
                allowed = "none with observation='goal', whose reward is compute_reward's"
                raise checks.refuse("task_settings['weights']", dict(weights), allowed)
            self.term_names = ("goal",)
            self.terms, self.part_terms = np.zeros((worlds, 1)), np.zeros((worlds, parts, 1))
        elif self.task.has_own_reward:
            state = self.simulator.state
            self._own_reward = own = OwnReward(self.task, self.scoring, state, self.periods, self._all_phasors, weights)
            self.term_names, self.terms, self.part_terms = own.names, own.terms, own.part_terms

    def __getstate__(self) -> dict[str, Any]:
        """What a copy has of its own; the rest is made anew."""
        return {name: value for name, value in vars(self).items() if name not in ("information", "stages")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """A copy, pickled or not: what ``info`` shows are views, which have to be of the copy's own arrays."""
        vars(self).update(state)
        self._bind()

    def _bind(self) -> None:
        """Make what works on the core's own arrays."""
        state, episode = self.simulator.state, self.episode
        drawn = {name: getattr(state, name) for name in self.randomization.ranges} | self.actuators.drawn()
        groups = {"drawn": drawn, "measured": self.sensing.facts(), "commanded": self._commanded}
        self.details = {name: each for name, each in groups.items() if each}
        self.facts = self.task.facts(state.diverged, episode) | self.scoring.facts()
        rewards, part_facts = (self.term_names, self.terms, self.part_terms), self.scoring.part_facts()
        part_facts = {**part_facts, **self.simulator.part_facts()}
        if self.disturbances is not None:
            part_facts["struck"] = self.disturbances.struck
        self.information = self._information(episode, state.diverged, *rewards, self.facts, self.details, part_facts)
        self._strike = _nothing if self.disturbances is None else self._disturb
        score = None if self._own_reward is None else self._own_reward.score
        self.stages = Stages(
            self.simulator.blocks, self.scoring, self.sensing, self._measured, self.observation, self.information,
            self._reward_goals if self.observation.goal_reward else score,
        )  # fmt: skip

    @property
    def draws(self) -> int:
        """Uniform numbers that an episode's start takes from its world's generator."""
        draws = self.task.draws + self.actuators.draws + self.sensing.draws + self.randomization.draws
        return draws if self.disturbances is None else draws + self.disturbances.draws

    def reset(
        self, worlds: np.ndarray, generators: Sequence[np.random.Generator], override: StartOverride | None = None
    ) -> None:
        """Begin new episodes in ``worlds`` (index array), each drawn from its own generator.

        Args:
            override: what a caller sets of the start.

        Raises:
            ValueError: a start that cannot be; nothing has changed but the generators.
        """
        draws = self.draws
        uniform = np.array([generator.random(draws) for generator in generators])
        own, driven = self.task.draws, self.task.draws + self.actuators.draws
        sensed = driven + self.sensing.draws
        start = self.start_of(worlds, uniform[:, :own], override)
        struck = sensed + self.randomization.draws
        drawn = self.randomization.values(uniform[:, sensed:struck])
        idle = self.idle
        if "friction" in drawn:
            idle = np.array([self._idle_velocity(factors) for factors in drawn["friction"]])
        self.put(worlds, start, np.where(start.present[..., None], idle, 0.0))
        self.simulator.condition(worlds, drawn)
        self.actuators.reset(worlds, uniform[:, own:driven])
        self.sensing.reset(worlds, self.simulator.state, uniform[:, driven:sensed])
        if self.disturbances is not None:
            self.disturbances.reset(worlds, uniform[:, struck:])
        self.stages.relate(worlds)

    def put(self, worlds: np.ndarray, start: Start, velocity: Any, mean_velocity: Any = 0.0) -> None:
        """Put parts down in ``worlds`` (index array), at rest or in motion, and begin to score them there.

        With ideal actuators and sensor that is all there is to a start: so simulations go on from what a policy has measured.

        Args:
            velocity, mean_velocity: (n, parts, 3) at this instant, and over the last period, m/s, m/s, rad/s.
        """
        self.simulator.place(worlds, start.pose, velocity, mean_velocity, ~start.present)
        self.scoring.begin(worlds, start)
        if self.terms is not self.episode.terms:  # which have just been set
            self.terms[worlds], self.part_terms[worlds] = 0.0, 0.0
        for remembered in self.action.live().values():
            remembered[worlds] = 0
        self.began = True

    def _idle_velocity(self, factors: np.ndarray) -> np.ndarray:
        """(parts, 3) of parts that slide in place on elements at rest, with these factors (parts,) on their friction."""
        pairs = zip(factors.tolist(), self.parts, strict=True)
        return np.array([np.append(self.surface.idle_velocity(each * part.friction), 0.0) for each, part in pairs])

    def _check_extremes(self) -> None:
        """Refuse ranges of conditions whose ends the model does not cover, in whatever combination they may be drawn."""
        parts, lowest = len(self.parts), {name: low for name, (low, _) in self.randomization.ranges.items()}
        highest = {name: high for name, (_, high) in self.randomization.ranges.items()}
        # One part as heavy as may be and the others as light, for every part in turn.
        mass = np.where(np.eye(parts, dtype=bool), highest.get("mass", 1.0), lowest.get("mass", 1.0))
        incline = [self.surface.gravity * np.sin(highest.get("incline", 0.0)), 0.0]
        friction = np.full((parts, parts), highest.get("friction", 1.0))
        patches = np.full((parts, 1, 1), highest.get("patches", 1.0))
        rows = Conditions(friction, mass, np.tile(incline, (parts, 1)), patches)
        if self.randomization.ranges:
            self.simulator.check_conditions(rows, rows._asdict(), "randomize[{!r}]")

    def start_of(self, worlds: np.ndarray, uniform: np.ndarray, override: StartOverride | None) -> Start:
        """The start that a reset draws, with what the caller sets of it."""
        if override is None:
            return self.task.start(uniform)
        return override.start(self.task, self.simulator, worlds, uniform)

    def step(self, action: np.ndarray, given: Any = None) -> None:
        """Advance every world by one step under an action, score it, measure and observe.

        Args:
            action: float32 (worlds, size), see :meth:`vibgym.envs.actions.Action.shaped`.
            given: the action as it was given, for errors.

        Raises:
            ValueError: a number that is not finite; nothing has changed.
        """
        values = self._intake.take(action)
        if values is None:
            raise self.action.not_finite(action if given is None else given)
        command = self.action.command(values, self._aim(self.sensing.measurement))
        self.sensing.predict(command)
        if self._own_reward is not None:
            self._own_reward.begin_step()
        self.stages.open()
        self._strike()
        run, elapsed, instant, state = self.simulator.go_on, 0, self.sensing.instant, self.simulator.state
        for drive, periods in self.actuators.apply(command):
            self.drive = drive
            then = self.stages.by_blocks if elapsed + periods == self.periods else ()
            if elapsed < instant < elapsed + periods:  # the sensor looks within this stretch
                run(drive, instant - elapsed)
                self.sensing.look(state)
                run(drive, elapsed + periods - instant, then)
            else:
                run(drive, periods, then)
                if elapsed + periods == instant:
                    self.sensing.look(state)
            elapsed += periods
        self.sensing.correct()
        self._renew()
        for stage in self.stages.afterwards:
            stage()

    def _disturb(self) -> None:
        """Strike those parts whose time has come."""
        assert self.disturbances is not None
        self.disturbances.strike(self.episode.present)

    def _renew_parts(self) -> None:
        """Let nothing of a part that has left be remembered of the next one in its slot."""
        changed = self.scoring.changed
        if changed.any():
            for remembered in self.action.live().values():
                if remembered.shape[:2] == changed.shape:
                    remembered[changed] = 0
            self.sensing.renew(changed, self.simulator.state)
            self.simulator.renew(changed)

    def _at_driven(self, measurement: Measurement) -> Measurement:
        """What actions aim by where they do not speak for all parts: for the others nothing is commanded."""
        return measurement._replace(gone=measurement.gone | ~self.task.driven)

    def _reward_goals(self) -> None:
        """The reward of a goal observation."""
        state, present, reached = self.simulator.state, self.episode.present, self.observation.reached  # type: ignore[attr-defined]
        goal_reward = self.task.compute_reward  # type: ignore[attr-defined]
        reward = goal_reward(reached(state.pose), reached(self.episode.goal), {"fallen": self.episode.fallen})
        self.episode.reward[:] = reward
        self.terms[:, 0] = reward
        self.episode.part_reward[:] = self.part_terms[..., 0] = np.where(present, reward[:, None], 0.0)

    def observe(self) -> Any:
        """A fresh batch of observations."""
        return self.observation.observe(self.sensing.measurement, self._measured, self.episode)

    def observed(self, kind: str) -> Any:
        """A fresh batch of another observation of the same instant.

        Args:
            kind: as for ``observation=``. It is built once and kept.

        Raises:
            ValueError: there is no such observation, or the task or the sensor has it not.
        """
        name = checks.choice("kind", kind, tuple(OBSERVATIONS))
        if name not in self._observations:
            if not OBSERVATIONS[name].beside:
                have = [each for each in OBSERVATIONS if OBSERVATIONS[each].beside]
                raise checks.refuse("kind", kind, f"{', '.join(have)}, or what the environment was made with")
            self._observations[name] = self._observation("kind", name)
        return self._observations[name].observe(self.sensing.measurement, self._measured, self.episode)

    def _observation(self, argument: str, kind: Any) -> Observation:
        """An observation by its name, given as ``argument``."""
        observation = OBSERVATIONS.choose(argument, kind)(self.task)
        observation.watch(self.sensing.sensor)
        return observation

    def _resting_command(self) -> Drive:
        """A command as they all are, that nobody obeys."""
        shape = (self.worlds, len(self.parts))
        nowhere = new_measurement(*shape)
        nowhere.gone[...] = True
        return self.action.command(np.zeros((self.worlds, self.action.size), dtype=np.float32), nowhere)

    def phasors(self, world: int) -> np.ndarray:
        """(rows, columns, 2) phasors of the last step as fractions of full scale; zeros before the first."""
        return self._all_phasors(world, 1)[0]

    def _all_phasors(self, first: int = 0, worlds: int | None = None) -> np.ndarray:
        """Those of the worlds from ``first`` on, (worlds, rows, columns, 2)."""
        phasors = np.zeros((worlds or self.worlds, self.surface.rows, self.surface.columns, 2))
        if self.drive is not None and self.surface.full_scale > 0.0:
            all_phasors(self.drive, phasors, first)
            phasors /= self.surface.full_scale
        return phasors

    def get_state(self) -> dict[str, Any]:
        """Everything needed to go on bit for bit, but the generators."""
        return {
            "environment": self.identity,
            "simulator": self.simulator.get_state(),
            "episode": copied(self._progress()),
            "action": self.action.get_state(),
            "actuators": self.actuators.get_state(),
            "sensor": self.sensing.get_state(),
            "began": self.began,
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`get_state` gave, on a core with the same settings.

        Raises:
            ValueError: a state of another environment, or a damaged one; nothing has changed.
        """
        check_keys("state", state, self.STATE)
        if not isinstance(state["environment"], str) or state["environment"] != self.identity:
            raise checks.refuse("state['environment']", *_difference(state["environment"], self.identity))
        began = checks.flag("state['began']", state["began"])
        episode = restored("state['episode']", self._progress(), state["episode"])
        action = self.action.check_state(state["action"])
        actuators = self.actuators.check_state(state["actuators"])
        sensor = self.sensing.check_state(state["sensor"])
        self.simulator.set_state(state["simulator"])  # checks before it changes anything, and is the last that can fail
        put_back(self._progress(), episode)
        self.action.set_state(action)
        self.actuators.set_state(actuators)
        self.sensing.set_state(sensor)
        if began:
            if self.sensing.exact:
                self.sensing.reset(NONE, self.simulator.state, np.zeros((0, self.sensing.draws)))
            self.stages.relate(np.arange(self.worlds))
        self.drive, self.began = None, began

    def _progress(self) -> dict[str, np.ndarray]:
        """Live arrays of the episodes."""
        return {
            **self.episode._asdict(),
            **self.relations._asdict(),
            **self.scoring.own_state(),
            **({} if self.disturbances is None else self.disturbances.live()),
            "shown_terms": self.terms,
            "shown_part_terms": self.part_terms,
        }


def _nothing() -> None:
    """What there is to do where parts stay, and where nothing strikes them."""


def _at_all(measurement: Measurement) -> Measurement:
    """What actions aim by where they speak for all parts."""
    return measurement


def _parts_from(parts: Any, task: type[Task]) -> tuple[Part, ...]:
    """The parts of a world from the keyword argument."""
    parts = task.DEFAULT_PARTS if parts is None else parts
    one = task.MOST_PARTS == 1
    if isinstance(parts, str) or not isinstance(parts, Sequence) or not parts or (len(parts) != 1 and one):
        allowed = "a list with one part" if one else "a list of parts"
        raise checks.refuse("parts", parts, f"{allowed}: a shipped part's name or a mapping")
    return tuple(part_from(part, "parts" if one else f"parts[{k}]") for k, part in enumerate(parts))


def _task_settings(
    options: Options, cls: type[Task], randomize: Mapping[str, Any]
) -> tuple[dict[str, Any], Mapping[str, Any]]:
    """Keyword arguments of the task: those that the environment names, where the task has them, and the task's own.

    ``randomize``: the task's share of it. Also the weights of reward terms, which every task has, whatever its arguments.
    """
    settings = {name: getattr(options, name) for name in NAMED if name != "randomize"}
    settings = {
        name: value for name, value in {**settings, "randomize": randomize or None}.items() if value is not None
    }
    known = checks.keywords(cls)
    for name, value in settings.items():
        if name not in known:
            own = ", ".join(each for each in known if each in NAMED)
            raise checks.refuse(name, value, f"nothing for {options.task}, which has {own or 'no settings'}")
    more = {} if options.task_settings is None else options.task_settings
    known = tuple(dict.fromkeys((*known, "weights")))
    if not isinstance(more, Mapping) or any(name not in known or name in settings for name in more):
        raise checks.refuse("task_settings", more, f"a mapping with keys among {', '.join(known)}, each once")
    own = {name: value for name, value in more.items() if name != "weights"}
    return {**settings, **own}, more.get("weights", {})


def _identity(options: Options, core: Core) -> str:
    """What makes two environments the same, as JSON: their states fit each other."""

    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray | np.generic) else repr(value)

    content = {
        **options.of_state(),
        "surface": vars(core.surface),
        "parts": [part.to_dict() for part in core.parts],
        "walls": core.simulator.walls,
        "worlds": core.worlds,
    }
    return json.dumps(content, sort_keys=True, default=plain)


def _difference(theirs: Any, mine: str) -> tuple[str, str]:
    """The first setting in which a state's environment differs, and what this one has."""
    try:
        other, own = json.loads(theirs), json.loads(mine)
        name = next(key for key in own if other.get(key) != own[key])
        return f"a state of another environment, with {name}={other.get(name)!r}", f"{name}={own[name]!r}"
    except (TypeError, ValueError, AttributeError, StopIteration, RecursionError):
        return checks.shown(theirs), "the description of an environment with these settings"
