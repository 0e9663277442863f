"""`kb query`: SQL over the tables of a data root."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.help import Command

if TYPE_CHECKING:
    import pyarrow as pa

    from kb.cli.framework.options import Options
    from kb.query import Listed

TIMEOUT = 600.0  # seconds

app = group("SQL over the tables of the data root, by DuckDB.")


class OutputFormat(StrEnum):
    """How results are printed."""

    table = "table"
    csv = "csv"
    json = "json"
    ndjson = "ndjson"
    parquet = "parquet"


class SqlCommand(Command):
    """SQL may begin with a comment, which otherwise would be taken for an option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The arguments, the comments before a query left out."""
        return super().parse_args(ctx, [_uncommented(one) for one in args])


def _uncommented(argument: str) -> str:
    if not argument.startswith("--") or not ("\n" in argument or argument.startswith("-- ")):
        return argument
    from kb.query.statements import without_comments

    return without_comments(argument)


@command(
    app,
    raw=True,
    limit="Print the first N rows only (exit code 0).",
    json="the rows, as --format json does",
    resumable=False,
    cls=SqlCommand,
    examples=[
        "kb query --tables",
        'kb query "SELECT title, view_count FROM youtube_videos ORDER BY view_count DESC LIMIT 5"',
        'kb query "SELECT stage, count(*) FROM clean.youtube_rejected GROUP BY stage" --format csv',
        'kb query "FROM release.reddit_posts" --out posts.parquet',
        "kb query --file question.sql --out answer.csv",
    ],
)
def query(
    options: Options,
    sql: Annotated[
        str | None,
        typer.Argument(
            metavar="SQL", help="One query; views are named SOURCE_TABLE. -: from standard input."
        ),
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option(
            "--file", metavar="FILE", help="Read the query from there; -: standard input."
        ),
    ] = None,
    tables: Annotated[
        bool, typer.Option("--tables", help="List the views and what they hold.")
    ] = False,
    format: Annotated[
        OutputFormat | None,
        typer.Option(
            "--format",
            help="How results are written; it wins over --out's suffix. --json is --format json."
            " [default: by --out's suffix, else table]",
        ),
    ] = None,
    timeout: Annotated[
        float, typer.Option("--timeout", min=0.1, metavar="SECONDS", help="How long it may take.")
    ] = TIMEOUT,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Write there instead of to stdout, as its suffix says:"
            " .csv .json .ndjson .jsonl .parquet .txt. Its folder has to be there.",
        ),
    ] = None,
) -> None:
    """Run one SQL query over the tables of a data root or a downloaded release. It only reads.

    Schemas clean and release hold one view a table (clean.reddit_posts, release.youtube_videos),
    restored what a reconstruction brought back, links the entities; a bare name is the clean one
    where it exists, else the released, else the restored one. Times are UTC. --limit N gives the
    first N rows, with exit code 0. --data may be a data root, a release folder, a folder above
    several, or the folder of a reconstruction. A query has half of the machine's memory; what does
    not fit is spilled below the data root, or to the temporary folder for a download.
    """
    from kb.artifacts.catalog import read
    from kb.core.errors import UsageError
    from kb.query import catalog, connect, select
    from kb.query.bounds import bounded, generous
    from kb.query.write import choose, write

    if [tables, sql is not None, file is not None].count(True) != 1:
        raise UsageError(
            "give one of a query, --file and --tables",
            hint='for example: kb query "FROM youtube_videos LIMIT 5"',
        )
    asked = format or (OutputFormat.json if options.json else None)
    chosen = choose(asked, out)
    if not tables:
        sql = _read(sql, file)
    run = options.make_run(needs="root", exists=options.data is not None)
    if tables:
        read(run.root)
    limits = generous(timeout)
    with contextlib.closing(connect(run.root, limits=limits)) as db, bounded(db, limits):
        if tables:
            answer = _listing(catalog(run.root), for_people=chosen == OutputFormat.table)
        else:
            answer = select(
                db,
                sql or "",
                root=run.root,
                text=chosen != OutputFormat.parquet,
                progress=run.progress,
            )
        write(_first(answer, options.limit) if options.limit else answer, chosen, out)


def _read(sql: str | None, file: Path | None) -> str:
    """The query as it was typed, or what the file or standard input holds. Raises UsageError."""
    from kb.core.errors import UsageError

    if sql is not None and sql != "-":
        return sql
    try:
        if file is None or str(file) == "-":
            return sys.stdin.buffer.read().decode("utf-8-sig")
        return file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise UsageError(f"--file {file}: {error.strerror}", hint="check the name") from None
    except UnicodeDecodeError:
        raise UsageError(f"{file or 'standard input'} is no text in UTF-8") from None


def _listing(listed: list[Listed], *, for_people: bool) -> pa.RecordBatchReader:
    """The catalog as an answer; for people schema and view in one word, as they are typed."""
    import pyarrow as pa

    types = {"rows": pa.int64(), "columns": pa.int64()}
    lines = [view._asdict() for view in listed]
    head = ["schema", "view", "rows", "columns", "about"]
    if for_people:
        head[:2] = ["table"]
        lines = [{**line, "table": f"{line['schema']}.{line['view']}"} for line in lines]
    columns = {
        name: pa.array([line[name] for line in lines], types.get(name, pa.string()))
        for name in head
    }
    return pa.table(columns).to_reader()


def _first(answer: pa.RecordBatchReader, rows: int) -> pa.RecordBatchReader:
    import pyarrow as pa

    def batches() -> Iterator[pa.RecordBatch]:
        left = rows
        for batch in answer:
            yield batch.slice(0, left)
            left -= batch.num_rows
            if left <= 0:
                return

    return pa.RecordBatchReader.from_batches(answer.schema, batches())
