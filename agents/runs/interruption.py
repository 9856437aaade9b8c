"""Interruption: how Ctrl-C, SIGTERM and SIGHUP end a command, in one line and with the shell's exit
status.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

CTRL_C = (signal.SIGINT,)
ALL = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))


class Interruption(KeyboardInterrupt):
    """A signal that ends the command; raised in the main thread."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


def exit_at_once(program: str) -> None:
    """From now on, let Ctrl-C end the process without raising anything.

    For the time of imports and of the interpreter's end, which there is nothing to clean up after,
    and where an exception would be swallowed or turned into another.
    """

    def end(number: int, frame: Any) -> NoReturn:
        _say(program)
        os._exit(128 + number)

    signal.signal(signal.SIGINT, end)


def interruptible(program: str, command: Callable[[], int], signals: Sequence[int] = CTRL_C) -> int:
    """Exit status of the command, or 128 + N and a line on stderr where one of the signals has
    ended it.
    """
    try:
        with _handled(_raise, signals):
            return command()
    except KeyboardInterrupt as error:
        _say(program)
        return 128 + getattr(error, "number", signal.SIGINT)
    finally:
        sys.stdout.flush()


def leave(status: int) -> NoReturn:
    """End the process; one that was interrupted does not wait for its threads."""
    if status > 128:
        os._exit(status)

    sys.exit(status)


@contextmanager
def noticed(notice: Callable[[int], None]) -> Iterator[None]:
    """Within, the first signal is told to ``notice``; the next one raises `Interruption`."""

    def told(number: int, frame: Any) -> None:
        for each in ALL:
            if signal.getsignal(each) is told:
                signal.signal(each, _raise)

        notice(number)

    with _handled(told, ALL):
        yield


@contextmanager
def _handled(handler: Callable[[int, Any], None], signals: Sequence[int]) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread only
        return

    # A program under nohup is to outlive its terminal.
    chosen = [
        each
        for each in signals
        if each == signal.SIGINT or signal.getsignal(each) is not signal.SIG_IGN
    ]
    before = {each: signal.signal(each, handler) for each in chosen}

    try:
        yield
    finally:
        for each, old in before.items():
            signal.signal(each, old)


def _raise(number: int, frame: Any) -> NoReturn:
    raise Interruption(number)


def _say(program: str) -> None:
    os.write(2, f"{program}: interrupted\n".encode())
