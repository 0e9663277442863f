"""`kb mcp`: search and tables for agents."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.cli.framework.command import command, group

if TYPE_CHECKING:
    from kb.core.context import Run

app = group("Search and tables for agents, over the Model Context Protocol on stdio.")


@command(
    app,
    without=("json",),
    needs_data=True,
    resumable=False,
    examples=[
        "kb mcp --data data                         what a client starts; it ends with stdin",
        "claude mcp add lorecrawl -- kb mcp --data /home/me/data",
    ],
)
def mcp(run: Run) -> None:
    """Answer an agent's questions: tools search, read, query (read-only SQL) and about.

    A client starts it and talks to it on stdin and stdout; it listens nowhere else. Answers keep
    the size that the client sets, name source, link and licence, and fence what was retrieved.
    Needs the extra `mcp`. docs/agents.md has the set-up of the usual clients.
    """
    from kb.mcp.server import serve

    serve(run)
