"""`query`: one SQL query over the views, in a separate process."""

from pathlib import Path

from kb.artifacts import table_catalog
from kb.core.errors import UsageError
from kb.mcp.untrusted_text import Fence, cut
from kb.query.isolated import run_isolated
from kb.query.limits import Limits

ROWS, MOST_ROWS = 100, 1_000
SECONDS, MOST_SECONDS = 10, 60
_MEMORY = 1 << 30  # bytes
_LEFT_OUT = "More rows were left out: raise max_chars or max_rows, or ask for less."


def run_query(root: Path, sql: str, rows: int, seconds: float, size: int) -> str:
    """The first rows as CSV in at most `size` characters. Raises DamagedData."""
    fence = Fence()
    views = table_catalog.read(root).views
    head = f"{fence.note}\nThe answer as CSV, times in UTC."
    room = size - len(head) - len(_LEFT_OUT) - len(fence.mark("")) - 6
    try:
        reply = run_isolated(
            sql,
            views,
            rows=rows,
            characters=room,
            cell=room // 2,
            limits=Limits(seconds, _MEMORY),
        )
    except UsageError as error:  # the message may quote a value
        hint = error.hint.replace("`kb query --tables`", "`about`")
        raise UsageError(f"{fence.note}\n{fence.mark(cut(f'{error}; {hint}', room))}") from None
    body = fence.mark("".join(reply.lines).rstrip("\n"))
    return "\n\n".join([head, body, *([_LEFT_OUT] if reply.more else [])])
