"""Demonstration: policies align and sort parts; a table and a picture: ``python examples/demo.py [EPISODES]`` (15 s)."""

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pygame

import vibgym
from vibgym.seeds import RANGES

TASKS = {
    "Align": ("move a part to a pose", ("random", "local_field", "pose", "learned")),
    "Sort": ("move each kind of part to its zone", ("random", "planner", "pose", "learned")),
}
PICTURE = Path("runs/demo/demo.png")
SEEDS = RANGES["evaluation"]  # as make report: no training or selection uses them
BAND = 44  # height of a line of text in the picture, pixels


def episode(task: str) -> list[tuple[str, np.ndarray]]:
    """Return captions and pictures, (height, width, 3), of an episode of the shipped agent."""
    policy = vibgym.make_policy("learned", gym.make(f"vibgym/{task}-v0"))
    settings = {"action": policy.action, "observation": policy.observation, "render_mode": "rgb_array"}
    env = gym.make(f"vibgym/{task}-v0", **settings)
    observation, info = env.reset(seed=SEEDS[16])
    pictures, state, over = [env.render()], None, False
    while not over:
        action, state = policy.predict(observation, state)
        observation, reward, terminated, truncated, info = env.step(action)
        pictures.append(env.render())
        over = terminated or truncated
    last = len(pictures) - 1
    captions = {0: "start", last // 3: "under way", last: "success" if info["is_success"] else "no success"}
    return [(f"{k * env.unwrapped.step_time:.2f} s, {caption}", pictures[k]) for k, caption in captions.items()]


def write(sheet: pygame.Surface, text: str, size: int, left: int, top: int) -> None:
    """Write a line of text. Scaled down from a larger size, since small letters are spaced unevenly."""
    large = pygame.font.Font(None, 4 * size).render(text, True, "black")
    sheet.blit(pygame.transform.smoothscale_by(large, 0.25), (left + 20, top + 14))


episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 100
print(f"{episodes} episodes for each policy")
print(f"{'task':8}{'policy':14}{'success':>8}{'median time to goal':>22}", flush=True)
for task, (_, names) in TASKS.items():
    for name in names:
        result = vibgym.policies.rollout(name, task, seeds=SEEDS[:episodes])
        median = f"{np.nanmedian(result.time_to_goal):.2f} s" if result.success.any() else "-"
        print(f"{task:8}{name:14}{100 * result.success.mean():6.1f} %{median:>22}", flush=True)

pygame.font.init()
shown = {f"{task}: {goal} (policy: learned)": episode(task) for task, (goal, _) in TASKS.items()}
height, width, _ = shown[min(shown)][0][1].shape
sheet = pygame.Surface((len(shown) * width, BAND + 3 * (BAND + height)))
sheet.fill("white")
for column, (title, pictures) in enumerate(shown.items()):
    write(sheet, title, 36, column * width, 0)
    for row, (caption, picture) in enumerate(pictures):
        top = BAND + row * (BAND + height)
        write(sheet, caption, 28, column * width, top)
        sheet.blit(pygame.surfarray.make_surface(picture.swapaxes(0, 1)), (column * width, top + BAND))
PICTURE.parent.mkdir(parents=True, exist_ok=True)
pygame.image.save(sheet, PICTURE)
print(f"picture: {PICTURE.resolve()}")
