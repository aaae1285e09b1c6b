"""Play a sample of what was published: some published episodes again, and fresh ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from agents.evaluation.jobs import Job, effects_jobs, run_jobs, trials
from agents.evaluation.log import Log
from agents.evaluation.records import ALL, episodes_of
from agents.evaluation.verification.published import EPISODE_FILE, Published
from agents.evaluation.verification.published_figures import COLUMNS, EFFECTS, REPORT, EpisodeTable, Place
from agents.workers import side_by_side, usable
from vibgym import checks
from vibgym.policies.rollout import Ends

MOST_EPISODES = 1000


@dataclass(frozen=True)
class Asked:
    """What to play of published results.

    Attributes:
        episodes: fresh ones in every place.
        again: published ones in every place that are played again, the first of them; fewer where there are not so many.
        first_seed: of the fresh episodes; None: the one after the last that was published.
        tasks, policies: only these; None: all.
    """

    episodes: int = 20
    again: int = 5
    first_seed: int | None = None
    tasks: Sequence[str] | None = None
    policies: Sequence[str] | None = None

    def seeds(self, published: Published) -> list[int]:
        """Of the fresh episodes.

        Raises:
            ValueError: a number that is none, or seeds that were published.
        """
        checks.count("--episodes", self.episodes, most=MOST_EPISODES)
        checks.count("--again", self.again, least=0, most=MOST_EPISODES)
        first = published.last_seed + 1 if self.first_seed is None else self.first_seed
        checks.count("--first-seed", first, least=0, most=2**63 - 1 - self.episodes)
        fresh, least = range(first, first + self.episodes), min(min(each.seeds) for each in published.episodes.values())
        if fresh.start <= published.last_seed and fresh.stop > least:
            allowed = f"seeds that were not published, such as those from {published.last_seed + 1}"
            raise checks.refuse("--first-seed", first, allowed)
        return list(fresh)

    def places(self, published: Published) -> list[Place]:
        """Where to play.

        Raises:
            ValueError: a task or policy that was not published, or no place with both.
        """
        for option, index in (("task", 1), ("policy", 3)):
            known = tuple(dict.fromkeys(place[index] for place in published.episodes))
            for name in (self.tasks if option == "task" else self.policies) or ():
                checks.choice(f"--{option}", name, known)
        found = [
            place
            for place in published.episodes
            if place.task in (self.tasks or [place.task]) and place.policy in (self.policies or [place.policy])
        ]
        if not found:
            raise checks.refuse("--policy", list(self.policies or ()), f"policies of {', '.join(self.tasks or ())}")
        return found


@dataclass(frozen=True)
class Played:
    """What became of one place: published episodes played again, and fresh ones."""

    again: EpisodeTable
    fresh: EpisodeTable

    def the_same(self, published: EpisodeTable) -> int:
        """How many of the published episodes came out the same again, in every column that is kept."""
        pairs = [(self.again.columns[name], published.columns[name][: len(self.again.seeds)]) for name in COLUMNS]
        return int(np.all([(one == other) | (np.isnan(one) & np.isnan(other)) for one, other in pairs], axis=0).sum())


def play_sample(
    published: Published,
    places: Sequence[Place],
    fresh: Sequence[int],
    again: int,
    processes: int = 1,
    quiet: bool = False,
    ray: str | None = None,
) -> dict[Place, Played]:
    """Play fresh episodes in some places, and the first ``again`` of the published ones with them; writes nothing.

    Raises:
        ValueError: environments or policies that cannot be made.
    """
    made = _jobs(published)
    jobs: dict[tuple[str, ...], Job] = {}
    for place in places:
        if place not in made:
            raise checks.refuse(
                str(published.directory / EPISODE_FILE), str(place), "places that the settings speak of"
            )
        jobs[place] = replace(made[place], seeds=[*published.episodes[place].seeds[:again], *fresh])
    with side_by_side(processes, ray) as submit:
        found = run_jobs(submit, jobs, _played, (), alone=ray is None and usable(processes) == 1, quiet=quiet)
    cut = -len(fresh)
    return {place: Played(found[place].some(slice(None, cut)), found[place].some(slice(cut, None))) for place in places}


def _jobs(published: Published) -> dict[Place, Job]:
    """All of the settings, by their places."""
    settings = published.settings
    main = {Place(REPORT, *trial): job for trial, job in trials(settings)[2].items()}
    if settings.effects is None:
        return main
    task = settings.effects.task
    return main | {Place(EFFECTS, task, *key): job for key, job in effects_jobs(settings).items()}


def _played(job: Job, key: tuple[str, ...], quiet: bool) -> EpisodeTable:
    """The episodes of a place, as an evaluation runs and keeps them."""
    place = Place(*key)
    if place.study == EFFECTS:
        ends = job.play(Ends, place.policy, quiet)
        return EpisodeTable.of(episodes_of(ends))
    rollout = job.play(Log, place.policy, quiet)
    return EpisodeTable.of(episodes_of(rollout, ALL))
