"""Small panes of the page's cards, and `set_new`, which tells the browser what differs alone."""

from html import escape
from typing import Any

import panel as pn

CARD = 320  # px, the width of the cards on the left
_WRONG = {"color": "#b30000", "font-size": "12.5px", "line-height": "1.35"}


def title(text: str) -> Any:
    """The title of a card."""
    return pn.pane.HTML(f"<b>{text}</b>", margin=(8, 10, 0, 10))


def note(**settings: Any) -> Any:
    """A line below a field, hidden until there is something to say."""
    return pn.pane.HTML("", visible=False, width=CARD - 20, margin=(0, 10), **settings)


def refusal() -> Any:
    """A note of what is wrong with a field."""
    return note(styles=_WRONG)


def say(pane: Any, text: str) -> None:
    """Show a text in a note; none hides it."""
    set_new(pane, object=escape(text), visible=bool(text))


def set_new(widget: Any, **values: Any) -> None:
    """Set what differs: of what does not, nothing goes to the browser."""
    new = {name: value for name, value in values.items() if getattr(widget, name) != value}
    if new:
        widget.param.update(**new)
