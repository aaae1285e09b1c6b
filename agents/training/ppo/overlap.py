"""Rollouts beside updates: while a model learns from one rollout, the next one is made by the policy from before.

Two processors are then at work though neither worlds nor networks keep two busy all the time. The price is that a rollout's
policy is one update old: PPO's ratios are those to the policy that acted, so that the objective stays what it is, but the
clipping leaves it less room. What is computed does not depend on who is faster: the thread that makes a rollout draws from
torch's generator, the update from one of its own, and both begin and end together.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import torch

from vibgym.simulation.threads import available_threads


def learn_overlapping(model: Any, total: int, callback: Any, log_interval: int) -> None:
    """As ``learn`` of Stable-Baselines3, until all worlds together have made ``total`` steps more.

    Between two rollouts, where the callback may save the model, there is one that has not been learned from: ``model.waiting``,
    which is part of the model's state.

    Args:
        model: a :class:`agents.training.ppo.learner.PartsPPO`.
        total, callback, log_interval: as there.
    """
    until, callback = model._setup_learn(total, callback, reset_num_timesteps=False)
    callback.on_training_start(locals(), globals())
    acting, spare, iteration = copy.deepcopy(model.policy.actor), copy.deepcopy(model.rollout_buffer), 0
    with ThreadPoolExecutor(1, thread_name_prefix="rollout") as other, _one_thread_less():
        if model.waiting is None and model.collect_rollouts(model.env, callback, model.rollout_buffer, model.n_steps):
            model.waiting = model.rollout_buffer.samples()
        while model.waiting is not None:
            iteration += 1
            steps = model.num_timesteps
            model._update_current_progress_remaining(steps, until)
            if iteration % log_interval == 0:
                model.dump_logs(iteration)
            if steps < until:
                callback.on_rollout_start()
                acting.load_state_dict(model.policy.actor.state_dict())
                model.rollout_buffer, spare = spare, model.rollout_buffer  # what waits stands in the other one
            order = torch.Generator().manual_seed(int(torch.randint(2**60, ())))
            beside = other.submit(model.make_steps, acting, callback) if steps < until else None
            try:
                model.train(steps, order)
            finally:
                goes_on = beside is not None and beside.result()
            if goes_on:
                model.end_rollout(callback)
            model.waiting = model.rollout_buffer.samples() if goes_on else None
    callback.on_training_end()


@contextmanager
def _one_thread_less() -> Iterator[None]:
    """Leave a processor to the worlds: two threads that wait for one another by turning in circles take each other's time."""
    before = torch.get_num_threads()
    torch.set_num_threads(max(min(before, available_threads() - 1), 1))
    try:
        yield
    finally:
        torch.set_num_threads(before)
