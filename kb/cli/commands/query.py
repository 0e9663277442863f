"""`kb query`: SQL over the tables of a data root. `kb diff`: the rows that differ in two."""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import Command, command, group
from kb.cli.framework.messages import show, warn_stale
from kb.cli.framework.options import Options
from kb.core.errors import UsageError
from kb.core.regular_file import read_regular

if TYPE_CHECKING:
    import pyarrow as pa

    from kb.query import View, ViewInfo

TIMEOUT = 600.0  # seconds

app = group("Run SQL over the tables with DuckDB.")


class OutputFormat(StrEnum):
    """Formats of results."""

    table = "table"
    csv = "csv"
    json = "json"
    ndjson = "ndjson"
    parquet = "parquet"


class SqlCommand(Command):
    """Accepts SQL that begins with a comment, which would be parsed as an option otherwise."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments without the comments before a query."""
        for place, arg in enumerate(args):
            if arg.startswith("-- ") or (arg.startswith("--") and "\n" in arg):
                args[place] = re.sub(r"\A(?:\s*--[^\n]*(?:\n|\Z))+", "", arg)
        return super().parse_args(ctx, args)


@command(
    app,
    raw=True,
    limit="Print only the first N rows (exit code 0).",
    json="the rows, as with --format json",
    resumable=False,
    cls=SqlCommand,
    data="may read",
    examples=[
        "kb query --tables",
        'kb query "SELECT title, view_count FROM youtube_videos ORDER BY view_count DESC LIMIT 5"',
        'kb query "SELECT stage, count(*) FROM clean.youtube_rejected GROUP BY stage" --format csv',
        'kb query "FROM release.reddit_posts" --out posts.parquet',
        'kb query "SELECT language, count(*) FROM pairs_quality WHERE has_verb GROUP BY language"',
        "kb query --file question.sql --out answer.csv",
        'kb query --data hf://datasets/ORG/NAME "SELECT count(*) FROM youtube_videos"',
    ],
)
def query(
    options: Options,
    sql: Annotated[
        str | None,
        typer.Argument(
            metavar="SQL", help="A query; views are named SOURCE_TABLE. -: read standard input."
        ),
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option("--file", metavar="FILE", help="Read the query from FILE; -: standard input."),
    ] = None,
    tables: Annotated[
        bool, typer.Option("--tables", help="List the views with their contents.")
    ] = False,
    format: Annotated[
        OutputFormat | None,
        typer.Option(
            "--format",
            help="Format of the results; wins over --out's suffix. --json means --format json."
            " [default: by --out's suffix, else table]",
        ),
    ] = None,
    timeout: Annotated[
        float, typer.Option("--timeout", min=0.1, metavar="SECONDS", help="Time limit.")
    ] = TIMEOUT,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Write to FILE instead of stdout, in the format of its suffix:"
            " .csv .json .ndjson .jsonl .parquet .txt. Its folder must exist.",
        ),
    ] = None,
) -> None:
    """Run one SQL query over the tables of a data root or a downloaded release. Only reads.

    The schemas clean and release have one view per table (clean.reddit_posts,
    release.youtube_videos), restored has what was restored, links has the entities. A name without
    schema means the clean table if there is one, else the released, else the restored one. Times
    are UTC. --data may be a data root, a release folder, a folder of several, the folder of a
    reconstruction, or the address of a release (hf://datasets/ORG/NAME, s3://BUCKET/PREFIX or
    another that fsspec knows), of which only what the query needs is read. A query may use half of
    the machine's memory, and spills the rest to the data root, or to the temporary folder for a
    download.
    """
    from kb.artifacts import table_catalog
    from kb.core.config.addresses import address_of
    from kb.query import catalog, connect, find_views, select
    from kb.query.formats import choose, write_answer
    from kb.query.limits import for_people, limited
    from kb.query.statements import views_needed

    if [tables, sql is not None, file is not None].count(True) != 1:
        raise UsageError(
            "give exactly one of: a query, --file, --tables",
            hint='for example: kb query "FROM youtube_videos LIMIT 5"',
        )
    asked = format or (OutputFormat.json if options.json else None)
    chosen = choose(asked, out)
    if not tables:
        sql = _read(sql, file)
    run = options.make_run(needs="root", addresses=True)
    address = address_of(run.settings.kb_data)
    views = _views_at(address) if address else find_views(run.root)
    if not address:
        warn_stale(run)
    if tables and not address:
        table_catalog.read_catalog(run.root)
    limits = for_people(timeout)
    root = None if address else run.root
    needed = views if tables else views_needed(sql or "", views)
    with contextlib.closing(connect(root, needed, limits)) as db, limited(db, limits):
        if tables:
            answer = _listing(catalog(views), one_name=chosen == OutputFormat.table)
        else:
            answer = select(
                db,
                sql or "",
                root=root,
                views=views,
                text=chosen != OutputFormat.parquet,
                progress=run.progress,
            )
        write_answer(_first(answer, options.limit) if options.limit else answer, chosen, out)


def _views_at(place: str) -> Sequence[View]:
    """The tables of a folder, or of a release at an address. Raises as `read` and `read_views`."""
    from kb.artifacts import table_catalog
    from kb.core.config.addresses import address_of

    if address := address_of(place):
        from kb.artifacts import remote_release  # not for nothing: its import takes long

        return remote_release.read_views(address)
    return table_catalog.read_catalog(Path(place)).views


def _read(sql: str | None, file: Path | None) -> str:
    """The query as typed, or from the file or standard input. Raises UsageError."""
    try:
        if sql is not None and sql != "-":  # where the locale is C, bytes of UTF-8 come singly
            return sql.encode("utf-8", "surrogateescape").decode()
        if file is None or str(file) == "-":
            return sys.stdin.buffer.read().decode("utf-8-sig")
        return read_regular(file).decode("utf-8-sig")
    except OSError as error:
        raise UsageError(f"--file {file}: {error.strerror}", hint="check the name") from None
    except UnicodeDecodeError:
        what = "standard input" if file is None and sql in (None, "-") else file or "the query"
        raise UsageError(f"{what} is not UTF-8 text") from None


def _listing(views: list[ViewInfo], *, one_name: bool) -> pa.RecordBatchReader:
    """The catalog as rows; with `one_name` schema and view are one column."""
    import pyarrow as pa

    columns: dict[str, Any] = {
        name: [getattr(view, name) for view in views]
        for name in ("schema", "view", "rows", "columns", "about")
    }
    if one_name:
        names = [f"{view.schema}.{view.view}" for view in views]
        columns = {"table": names, **{name: columns[name] for name in ("rows", "columns", "about")}}
    kinds = {"rows": pa.int64(), "columns": pa.int64()}
    arrays = {name: pa.array(values, kinds.get(name)) for name, values in columns.items()}
    return pa.table(arrays).to_reader()


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


diff_app = group("Compare two data roots or releases, row by row.")


@command(
    diff_app,
    raw=True,
    without=("data", "profile"),
    limit="Print only the first N rows (exit code 0).",
    json="the rows, as with --format json",
    resumable=False,
    data="makes",
    examples=[
        "kb diff release-1.0 release-1.1              came, went and changed, a line a table",
        "kb diff release-1.0 data --table youtube_videos     each row, and why some went",
        "kb diff hf://datasets/ORG/NAME@v1.0 data --table pairs --out pairs.parquet",
    ],
)
def diff(
    options: Options,
    old: Annotated[
        str, typer.Argument(metavar="OLD", help="A data root, a release, or an address of one.")
    ],
    new: Annotated[str, typer.Argument(metavar="NEW", help="The same, of a later time.")],
    table: Annotated[
        str,
        typer.Option(
            "--table", metavar="NAME", help="The rows of this table, as `youtube_videos`."
        ),
    ] = "",
    format: Annotated[
        OutputFormat | None,
        typer.Option("--format", help="As of `kb query`. [default: by --out's suffix, else table]"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Write to FILE instead of stdout."),
    ] = None,
) -> None:
    """Compare two data roots, releases or restored roots; the exit code is 0 if they differ, too.

    Rows of one declared key are one row. Without --table a line a table: rows that came, went and
    changed. With it the rows: key, change, and of those that went stage, reason, value and
    threshold, where NEW knows why: a removal, a rejection, a failure. Of a row that belongs to a
    video, page or thread the reason is also that of its video, page or thread. A source is
    compared in the fullest form that both sides have: clean, released, restored.
    """
    from kb.query.diff import Comparison
    from kb.query.formats import choose, write_answer

    chosen = choose(format or (OutputFormat.json if options.json else None), out)
    with Comparison(_views_at(old), _views_at(new)) as compared, contextlib.ExitStack() as stack:
        if table:
            answer = stack.enter_context(compared.rows(table))
        else:
            answer = compared.counts().to_reader()
        write_answer(_first(answer, options.limit) if options.limit else answer, chosen, out)
        if left_out := compared.not_compared():
            show(left_out, err=True)
