"""Pictures (`draw_frame`) and text (`text_frame`) of a robot's path over a `View` of its episode,
with no window or display.
"""

from irs_gym.rendering.ansi import text_frame
from irs_gym.rendering.frame import draw_frame
from irs_gym.rendering.view import View

__all__ = ["View", "draw_frame", "text_frame"]
