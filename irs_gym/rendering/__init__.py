"""Pictures (`draw`) and text (`text`) of a robot's trail over a `View` of its episode, with no window or display."""

from irs_gym.rendering.ansi import text
from irs_gym.rendering.frame import draw
from irs_gym.rendering.view import View

__all__ = ["View", "draw", "text"]
