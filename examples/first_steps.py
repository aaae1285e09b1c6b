"""First steps: a world, a batch, a controller, the shipped agent, a picture: ``python examples/first_steps.py`` (15 s)."""

import sys

import gymnasium as gym
import numpy as np
import pygame

import vibgym

# Align: move a part to a goal pose. One step is one period of the table, 40 ms; "velocity" has three values per part.
env = gym.make("vibgym/Align-v0", action="velocity", render_mode="rgb_array")
observation, info = env.reset(seed=0)
for _ in range(10):
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
print(
    f"after ten random steps {1e3 * info['position_error']:.0f} mm and {np.degrees(info['heading_error']):.0f} deg to go"
)

# A thousand worlds are one compiled batch. Finished episodes are reset automatically.
envs = gym.make_vec("vibgym/Align-v0", num_envs=1000, action="velocity")
envs.reset(seed=0)
_, rewards, *_ = envs.step(envs.action_space.sample())
print(f"a thousand worlds, mean reward of a step {rewards.mean():.3f}")

# A classical controller, "pose".
env = gym.make("vibgym/Align-v0", action="phasor", render_mode="rgb_array")
policy = vibgym.make_policy("pose", env)
observation, info = env.reset(seed=0)
state, over = None, False
while not over:
    action, state = policy.predict(observation, state)
    observation, reward, terminated, truncated, info = env.step(action)
    over = terminated or truncated
print(f"pose: success {info['is_success']}, {1e3 * info['position_error']:.2f} mm off")
picture = pygame.surfarray.make_surface(env.render().swapaxes(0, 1))  # (height, width, 3) to columns first
pygame.image.save(picture, sys.argv[1] if len(sys.argv) > 1 else "first_steps.png")

# Compare policies on the same seeds; "learned" is the agent that is shipped for the task.
for name in ("local_field", "pose", "learned"):
    result = vibgym.policies.rollout(name, "vibgym/Align-v0", seeds=range(100))
    print(f"{name:12} {100 * result.success.mean():.0f} %, median {np.nanmedian(result.time_to_goal):.2f} s")
