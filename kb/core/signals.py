"""SIGINT and SIGTERM: the item in hand is finished, then the run ends resumable (exit 3). What
SIGTERM does not end within END_S is ended without: nothing is lost, as by SIGKILL.
"""

import contextlib
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from kb.core.errors import Interrupted

BOTH = (signal.SIGINT, signal.SIGTERM)
Handler = Callable[[int, Any], Any]
_STEP_S = 1.0  # seconds until a signal is heard at the latest
END_S = 4.0  # seconds from SIGTERM in which a command may finish the item in hand


class Stop:
    """A flag that every loop and every wait looks at."""

    def __init__(self) -> None:
        self._event = threading.Event()
        self.name = ""

    def request(self, name: str = "stop") -> None:
        """Ask the run to end after the item in hand."""
        self.name = self.name or name
        self._event.set()

    def clear(self) -> None:
        """Forget an earlier request (a new run in the same process)."""
        self.name = ""
        self._event.clear()

    def requested(self) -> bool:
        """Whether someone asked the run to end."""
        return self._event.is_set()

    def wait(self, seconds: float) -> bool:
        """Wait up to `seconds`; True when the run was asked to end.

        In steps: a signal that comes just before a wait begins does not end it, and Python calls
        the handler when it is over.
        """
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > _STEP_S:
            if self._event.wait(_STEP_S):
                return True
        return self._event.wait(max(left, 0))

    def raise_if_asked(self) -> None:
        """Raise Interrupted when the run was asked to end."""
        if self.requested():
            raise Interrupted(f"stopped by {self.name}", hint="run the same command to resume")


stop = Stop()


@contextlib.contextmanager
def handling(handler: Handler, numbers: Iterable[int] = BOTH) -> Iterator[None]:
    """Call `handler` for these signals during the block; only the main thread may set it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextlib.contextmanager
def stop_on_signals() -> Iterator[Stop]:
    """Turn SIGINT and SIGTERM into a request to stop; a second SIGINT ends at once."""

    def handle(number: int, frame: object) -> None:
        if stop.requested() and number == signal.SIGINT:
            signal.default_int_handler(number, None)
        stop.request(signal.Signals(number).name)

    with handling(handle):
        try:
            yield stop
        finally:
            stop.clear()


def leave(number: int, frame: object = None) -> None:
    """End the program at once, resumable, without raising: an exception in the middle of an import
    may end up anywhere.
    """
    name = signal.Signals(number).name
    if "--json" in sys.argv:
        os.write(1, f'{{"stopped": "stopped by {name}", "waits_for": "next run"}}\n'.encode())
    os.write(2, f"kb: stopped by {name}; run the same command to resume\n".encode())
    os._exit(3)


@contextlib.contextmanager
def ended_in_time() -> Iterator[None]:
    """During the block SIGTERM ends the program within END_S, also where its handler can't be
    called: Python calls it between two lines, and a library may be in one for minutes. Once heard,
    it also ends what follows the block.
    """
    heard, wakes = socket.socketpair()
    wakes.setblocking(False)
    before = signal.set_wakeup_fd(wakes.fileno(), warn_on_full_buffer=False)
    was_heard = threading.Event()

    def watch() -> None:
        with heard:
            while (numbers := heard.recv(64)) and signal.SIGTERM not in numbers:
                pass
        if numbers:
            was_heard.set()
            time.sleep(END_S)
            leave(signal.SIGTERM)

    threading.Thread(target=watch, name="end-in-time", daemon=True).start()
    try:
        yield
    finally:
        if not was_heard.is_set():
            signal.set_wakeup_fd(before)
            wakes.close()  # which ends the thread
