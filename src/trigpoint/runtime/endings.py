"""How a process of the live runtime is told to stop or to read its settings again: signals, and its standard input."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from enum import Enum
from types import FrameType


class Order(Enum):
    """What a process is told from outside."""

    STOP = "stop"
    RELOAD = "reload"


def listen_for_orders(tell: Callable[[Order], None], *, tied: bool) -> None:
    """Call ``tell`` with ``STOP`` on SIGTERM and SIGINT, with ``RELOAD`` on SIGHUP.

    ``tell`` is called from a signal handler or another thread. With ``tied`` the process also stops when its standard
    input ends, which happens when the process that holds the other end of the pipe dies, whatever it died of: no
    orphan stays behind.
    """

    def handler(number: int, _: FrameType | None) -> None:
        tell(Order.RELOAD if number == signal.SIGHUP else Order.STOP)

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, handler)
    if tied:
        threading.Thread(target=_until_input_ends, args=(tell,), daemon=True).start()


def _until_input_ends(tell: Callable[[Order], None]) -> None:
    while os.read(0, 4096):
        pass
    tell(Order.STOP)
