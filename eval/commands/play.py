"""`python -m eval play`: the robot steered from the keyboard or by the mouse, in a window."""

import sys
from collections.abc import Callable
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.error import DependencyNotInstalled
from gymnasium.spaces import Box
from gymnasium.wrappers import HumanRendering
from numpy.typing import NDArray

from irs_gym.grid import MOVE_LENGTHS, MOVES

KEYS = """arrow keys                        E, N, W, S
Home, Page Up, End, Page Down     NW, NE, SW, SE (so does the number pad)
Q W E / A D / Z X C               all eight, as they lie around S
R                                 a new episode
Escape                            the end"""
MOUSE = "mouse button, held down           towards the pointer, and no further"
NAMES = {  # of pygame's keys, by the number of the action: E, NE, N, NW, W, SW, S, SE
    0: ("right", "keypad 6", "d"),
    1: ("page up", "keypad 9", "e"),
    2: ("up", "keypad 8", "w"),
    3: ("home", "keypad 7", "q"),
    4: ("left", "keypad 4", "a"),
    5: ("end", "keypad 1", "z"),
    6: ("down", "keypad 2", "x"),
    7: ("page down", "keypad 3", "c"),
}

HEADINGS = MOVES / MOVE_LENGTHS[:, None]  # (8, 2), at full speed


def main(
    scene: str = "paper",
    target_db: float | None = None,
    constraint: Literal["refuse", "terminate", "allow"] = "refuse",
    random_start: bool = False,
    seed: int | None = None,
    continuous: bool = False,
) -> int:
    """Steer the robot to the goal from the keyboard; the oracle's path is drawn as dashes.

    Arrow keys and, for diagonals, Home, Page Up, End and Page Down move; R begins anew, Escape
    ends. A robot that goes anywhere on the floor follows the mouse as well.

    Parameters
    ----------
    scene
        A scene's name in the package, or the path of a scene file.
    target_db
        Lowest expected channel gain in dB that keeps the robot connected; by default the scene's
        own.
    constraint
        What happens at a cell below the target: the move is refused, ends the episode, or is
        allowed at a cost.
    random_start
        Whether each episode begins in another cell.
    seed
        Seed of the starts.
    continuous
        Whether the robot goes anywhere on the floor, and not from cell to cell.
    """
    try:
        pictures = gymnasium.make(
            "irs_gym:IrsNavContinuous-v0" if continuous else "irs_gym:IrsNav-v0",
            render_mode="rgb_array",
            scene=scene,
            target_db=target_db,
            constraint=constraint,
            # a player ends no episode for the reward, so any target may go with any constraint
            goal_bonus=1e3,
            random_start=random_start,
        )
        env: Any = HumanRendering(pictures)  # its `close` has no types
        print(f"{KEYS}\n{MOUSE}" if continuous else KEYS)
        play_by_keyboard(env, seed)
    except DependencyNotInstalled:
        print(
            "python -m eval play: the window needs pygame: pip install pygame-ce", file=sys.stderr
        )
        return 2
    except (OSError, ValueError) as error:
        print(f"python -m eval play: {error}", file=sys.stderr)
        return 2

    env.close()
    return 0


def play_by_keyboard(
    env: gymnasium.Env[Any, Any], seed: int | None = None, tell: Callable[[str], Any] = print
) -> None:
    """Play episodes until the window is closed; ``tell`` is told of each that ends.

    Raises
    ------
    DependencyNotInstalled
        Where pygame is missing.
    """
    _, start = env.reset(seed=seed)  # opens the window

    import pygame

    is_continuous = isinstance(env.action_space, Box)
    actions = {
        pygame.key.key_code(name): HEADINGS[action] if is_continuous else action
        for action, names in NAMES.items()
        for name in names
    }
    pygame.key.set_repeat(300, 100)  # a key held down moves on, ten times a second
    if is_continuous:
        pygame.time.set_timer(pygame.USEREVENT, 100)  # so does a button
    is_over = False
    info = start

    while True:
        _show(start, info)
        event = pygame.event.wait()
        if event.type == pygame.QUIT or (
            event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE
        ):
            return
        if event.type == pygame.KEYDOWN and event.key == pygame.K_r:
            _, start = env.reset()
            is_over = False
            info = start
            continue

        action = actions.get(event.key) if event.type == pygame.KEYDOWN else None
        if event.type == pygame.MOUSEBUTTONDOWN and is_continuous:
            action = towards(env, event.pos)
        elif event.type == pygame.USEREVENT and pygame.mouse.get_pressed()[0]:
            action = towards(env, pygame.mouse.get_pos())

        if action is not None and not is_over:
            _, _, terminated, truncated, info = env.step(action)
            is_over = terminated or truncated
            if is_over:
                tell(summary(start, info))


def towards(env: gymnasium.Env[Any, Any], pixel: tuple[float, float]) -> NDArray[np.float64]:
    """The action that leads towards what a pixel shows, as far as a step can and no further."""
    robot: Any = env.unwrapped
    away = robot.point_at(pixel) - robot.position
    action = away / (robot.task.speed * robot.task.time_step)

    return np.asarray(action / max(1.0, float(np.hypot(*action))))


def summary(start: dict[str, Any], info: dict[str, Any]) -> str:
    """How an episode ended."""
    ended = f"goal reached, SPL {info['spl']:.3f}" if info["is_success"] else "no success"
    return f"{ended}: {info['distance']:.3f} m, the oracle needs {start['oracle_distance']:.3f} m"


def _show(start: dict[str, Any], info: dict[str, Any]) -> None:
    """Write into the window's title how the episode goes."""
    import pygame

    refused = ", refused" if info["is_refused"] else ""
    pygame.display.set_caption(
        f"{info['distance']:.2f} m of {start['oracle_distance']:.2f} m{refused}"
    )
