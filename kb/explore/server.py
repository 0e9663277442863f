"""Serves the pages on 127.0.0.1 until a signal ends it."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import webbrowser
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from kb.core.config.profile import Profile
from kb.core.errors import SettingError
from kb.core.installation import require
from kb.explore.judge import JudgeDesk
from kb.mcp.documents import Readers

REQUEST_S = 15.0  # in which a whole request has to come
LAST_S = 2.5  # for the answers in hand, once a signal has come


def serve(
    root: Path,
    profile: Profile,
    about: Callable[[], Mapping[str, Any]],
    readers: Readers,
    port: int,
    *,
    graph: Callable[[], bytes],
    desk: JudgeDesk | None,
    browser: bool,
    say: Callable[[str], None],
    first: Callable[[], None],
) -> None:
    """`port` 0 takes a free one; `say` is told the address when requests are answered; `first` is
    called once nothing stands in the way of serving. The rest is as in `kb.explore.app.make`.

    Raises MissingExtra, SettingError for a port that is taken.
    """
    require("explore", "starlette", "uvicorn")
    import uvicorn
    from uvicorn.protocols.http.h11_impl import H11Protocol

    from kb.explore.app import HOST, make  # noqa: PLC0415  it needs the extra

    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
    except OSError as error:
        raise SettingError(
            f"port {port} can't be used: {error.strerror}", hint="leave --port out, or take another"
        ) from None
    first()
    address = f"http://{HOST}:{listening.getsockname()[1]}/"

    ending = threading.Timer(LAST_S, os._exit, (0,))
    ending.daemon = True

    class Announced(uvicorn.Server):  # type: ignore[misc]  # read without its types
        """Tells the address once requests are answered, and ends soon after a signal."""

        async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
            # Threads that make pages can't be ended; answers are written in one step.
            ending.start()
            await super().shutdown(sockets)

        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            say(address)
            if browser:
                webbrowser.open(address)

    class Patient(H11Protocol):  # type: ignore[misc]  # read without its types
        """Closes connections whose next request does not come, or not whole."""

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self.loop.call_later(REQUEST_S, self.look, None)

        def look(self, before: Any) -> None:
            """`before`: the answered request of the last look, None before the first one."""
            waits = self.cycle is None or self.cycle.response_complete
            if waits and self.cycle is before:
                self.transport.close()
            elif not self.transport.is_closing():
                self.loop.call_later(REQUEST_S, self.look, self.cycle)

    config = uvicorn.Config(
        make(root, profile, about, readers, graph, desk),
        http=Patient,
        log_config=None,
        access_log=False,
        lifespan="off",
    )
    try:
        with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C and SIGTERM are how it ends
            Announced(config).run(sockets=[listening])
    finally:
        ending.cancel()
