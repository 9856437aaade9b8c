"""Facts of `python -m eval play`, without a display: the window is SDL's dummy, the keys are posted
events.
"""

import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import HumanRendering

from eval.commands import play
from irs_gym.grid import MOVE_NAMES

ROOT = Path(__file__).resolve().parents[2]
CLOSE = {"target_db": -62.2, "start": (30, 22), "goal": (33, 20)}


@pytest.fixture
def pygame(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame

    pygame.display.init()
    pygame.event.clear()
    yield pygame
    pygame.quit()


def window(**arguments) -> HumanRendering:
    return HumanRendering(gymnasium.make("irs_gym:IrsNav-v0", render_mode="rgb_array", **arguments))


def press(pygame, *keys: int) -> None:
    for key in keys:
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))
        pygame.event.post(pygame.event.Event(pygame.KEYUP, key=key))


def close(pygame) -> None:
    pygame.event.post(pygame.event.Event(pygame.QUIT))


@pytest.mark.parametrize("set_of_keys", [0, 1, 2])
def test_every_set_of_keys_moves_in_all_eight_directions(pygame, set_of_keys):
    env = window(start=(10, 20), goal=(33, 20), target_db=-80.0)
    taken = []
    env.unwrapped.step = lambda action, step=env.unwrapped.step: (
        taken.append(MOVE_NAMES[action]) or step(action)
    )
    press(pygame, *(pygame.key.key_code(play.NAMES[action][set_of_keys]) for action in range(8)))
    close(pygame)
    play.play_by_keyboard(env, seed=0)
    assert taken == ["E", "NE", "N", "NW", "W", "SW", "S", "SE"]
    env.close()


def test_an_episode_ends_is_told_and_begins_anew_on_r(pygame):
    env = window(**CLOSE)
    to_goal = [pygame.K_RIGHT, pygame.K_PAGEDOWN, pygame.K_PAGEDOWN]
    press(
        pygame, *to_goal, pygame.K_LEFT, pygame.K_r, pygame.K_RIGHT
    )  # left comes after the end: nothing moves
    press(pygame, pygame.K_ESCAPE)
    told = []
    play.play_by_keyboard(env, seed=0, tell=told.append)
    assert told == ["goal reached, SPL 1.000: 1.914 m, the oracle needs 1.914 m"]
    assert env.unwrapped.path == [(30, 22), (31, 22)]
    env.close()


def test_title_tells_how_far_the_robot_came(pygame):
    env = window(**CLOSE)
    titles = []
    show, play._show = (
        play._show,
        lambda *infos: show(*infos) or titles.append(pygame.display.get_caption()[0]),
    )
    try:
        press(pygame, pygame.K_RIGHT)
        close(pygame)
        play.play_by_keyboard(env)
    finally:
        play._show = show
    assert titles[0] == "0.00 m of 1.91 m"
    assert "0.50 m of 1.91 m" in titles
    env.close()


def test_command_opens_a_window_and_ends_with_it(pygame, capsys):
    close(pygame)
    assert play.main(target_db=-63.0, constraint="terminate", random_start=True, seed=0) == 0
    assert "arrow keys" in capsys.readouterr().out


def test_command_refuses_what_cannot_be_played(capsys):
    assert play.main(target_db=-20.0) == 2
    assert "highest feasible target" in capsys.readouterr().err


def test_missing_pygame_is_told_in_a_line():
    code = (
        "import sys; sys.modules['pygame'] = None; "
        "from eval.commands.play import main; sys.exit(main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "python -m eval play: the window needs pygame: pip install pygame-ce\n"


def test_a_robot_that_goes_anywhere_follows_keys_and_mouse(pygame):
    pictures = gymnasium.make(
        "irs_gym:IrsNavContinuous-v0", render_mode="rgb_array", start=(8.0, 3.0)
    )
    env = HumanRendering(pictures)
    robot = pictures.unwrapped
    robot.reset()
    picture = robot.render()
    pixel = next(  # that shows a point half a step to the west of where the keys lead
        (column, row)
        for row in range(picture.shape[0])
        for column in range(picture.shape[1])
        if abs(robot.point_at((column, row)) - (8.25, 3.5)).max() < 0.03
    )
    press(pygame, pygame.K_RIGHT, pygame.K_UP)
    pygame.event.post(pygame.event.Event(pygame.MOUSEBUTTONDOWN, pos=pixel, button=1))
    press(pygame, pygame.K_ESCAPE)
    play.play_by_keyboard(env, seed=0)
    np.testing.assert_allclose(robot.path[:3], [(8.0, 3.0), (8.5, 3.0), (8.5, 3.5)])
    np.testing.assert_allclose(robot.position, (8.25, 3.5), atol=0.03)
    env.close()


def test_command_plays_the_robot_that_goes_anywhere(pygame, capsys):
    close(pygame)
    assert play.main(continuous=True) == 0
    assert "towards the pointer" in capsys.readouterr().out
