"""What tests of evaluation share: its command line in this process."""

import sys

from eval.__main__ import main


def call(monkeypatch, *words: object) -> int:
    """Exit status of `python -m eval` in this process."""
    monkeypatch.setattr(sys, "argv", ["eval", *map(str, words)])
    try:
        return main()
    except SystemExit as ended:  # the parser's own
        return ended.code
