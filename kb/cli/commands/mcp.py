"""`kb mcp`: search and tables for agents."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.cli.framework.command import command, group

if TYPE_CHECKING:
    from kb.core.context import Run

app = group("Serve search and tables to agents over the Model Context Protocol on stdio.")


@command(
    app,
    without=("json",),
    needs_data=True,
    resumable=False,
    examples=[
        "kb mcp --data data                         the command for a client's configuration",
        "claude mcp add lorecrawl -- kb mcp --data /home/me/data",
    ],
)
def mcp(run: Run) -> None:
    """Serve four tools to an agent: search, read, query (read-only SQL) and about.

    A client starts the server and talks to it on stdin and stdout; it opens no port, and ends when
    stdin closes. Answers respect the client's size limit, name source, link and licence, and mark
    retrieved text as such. Needs the extra `mcp`. docs/agents.md shows how to set up clients.
    """
    from kb.mcp.server import serve

    serve(run)
