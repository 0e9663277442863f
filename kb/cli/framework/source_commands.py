"""The commands that every source has: `filter`, `export`, and a plain `crawl` for a source without
commands of its own.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import Group, command, group
from kb.cli.framework.options import CLUSTER, Part, Plan, parse_part
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.sources import SOURCES
from kb.core.summary import Summary


def add_filter(app: Group, source: str, what: str = "raw answers") -> None:
    """`kb <source> filter`, which sorts `what`."""

    @command(
        app,
        "filter",
        help=f"Sort {what} into clean/{source}: kept, rejected (with the reason), failed and"
        " pending.",
        uses=CLUSTER,
        limit="Stop after scoring N more texts for toxicity (exit code 3); the next run resumes.",
        json="crawled, kept, rejected, failed, pending, missing, stages, tables",
        checks=True,
        examples=[f"kb {source} filter", f"kb {source} filter --profile mine.toml"],
    )
    def filter_(run: Run) -> Summary:
        from kb.artifacts.makers import make_artifact

        return make_artifact(run, f"clean/{source}")


def add_export(
    app: Group, source: str, *, goes: str = "Parquet goes", tables: str = "the released tables"
) -> None:
    """`kb <source> export`, as Parquet and in its other formats."""
    others = SOURCES[source].formats
    formats = StrEnum("Format", ["parquet", *others])  # type: ignore[misc]
    parquet = formats("parquet")
    about = f"{goes} to release/, other formats to export/FORMAT/."

    @command(
        app,
        "export",
        help=f"Write clean/{source} as {tables}, or in another layout.",
        uses=("engine", "scheduler"),
        json="the rows of each table, and path",
        data="reads",
        examples=[
            f"kb {source} export",
            *(f"kb {source} export --format {name}" for name in others[-1:]),
        ],
    )
    def export(
        run: Run,
        format: Annotated[formats, typer.Option("--format", help=about)] = parquet,
        chunk_tokens: Annotated[
            int | None,
            typer.Option(
                "--chunk-tokens",
                min=32,
                metavar="N",
                help="With --format text: cut documents at headings, comments and pauses into"
                " chunks of at most N tokens, in a file of their own. A word counts as 1.3"
                " tokens, and so does each sign of a script without spaces.",
            ),
        ] = None,
        tokenizer: Annotated[
            Path | None,
            typer.Option(
                "--tokenizer",
                metavar="FILE",
                help="Count tokens with a model's tokenizer.json instead.",
            ),
        ] = None,
        keep_contacts: Annotated[
            bool,
            typer.Option(
                "--keep-contacts",
                help="With --format text: leave e-mail addresses, IP addresses and telephone"
                " numbers as they are.",
            ),
        ] = False,
        out: Annotated[
            Path | None,
            typer.Option(
                "--out",
                metavar="DIR",
                help="With another --format: write it there. A download stays as it is and needs"
                " it.",
            ),
        ] = None,
    ) -> Summary:
        from kb.artifacts.makers import make_export
        from kb.artifacts.table_catalog import Catalog, refuse_download
        from kb.registry import PUBLISHED as CLASSES

        options = {
            "chunk_tokens": chunk_tokens,
            "tokenizer": tokenizer and str(tokenizer.absolute()),
            "keep_contacts": keep_contacts,
        }
        options = {name: value for name, value in options.items() if value}
        if options and format.value != "text":
            option = "--" + next(iter(options)).replace("_", "-")
            raise SettingError(f"{option} is for --format text", hint=f"leave {option} out")
        if tokenizer and not chunk_tokens:
            raise SettingError(
                "--tokenizer counts the tokens of chunks", hint="give --chunk-tokens N too"
            )
        if format is parquet:
            refuse_download(run.root)
            if out is not None:
                raise SettingError("--out is for another --format", hint="leave --out out")
        elif out is not None:
            made = CLASSES[source].writers()[format.value](run, out=out.absolute(), **options)
            return Summary({"command": f"{source} export", "source": source} | made)
        elif Catalog(run.root.absolute()).is_download:
            raise SettingError(
                f"{run.root} is a download, into which nothing is written",
                hint="name a folder elsewhere with --out",
            )
        return make_export(run, source, format.value, options)


def app_of(name: str) -> Group:
    """The commands of a source that declares none: crawl, filter and export."""
    source = SOURCES[name]
    app = group(source.help)

    @command(
        app,
        help=f"Crawl what is left: {', '.join(source.nouns.values())}, as raw answers.",
        uses=("workers", "wait"),
        limit=f"Stop after N more {source.counted} (exit code 3); the next run resumes.",
        again="Start a new round: read the lists again, and only what is new in them.",
        json="crawled, failed, pending, requests, units",
        checks=True,
        planned=("ids", "part", "again"),
        data="makes",
        examples=[
            f"kb {name} crawl --plan                  what is left, in requests and units",
            f"kb {name} crawl --limit 100",
            f"kb {name} crawl --ids ids.txt           known ids, no lists",
        ],
    )
    def crawl(
        run: Run,
        plan: Plan = False,
        part: Part = None,
        ids: Annotated[
            Path | None,
            typer.Option(
                "--ids",
                metavar="FILE",
                help=f"Crawl these {source.counted} instead of what is listed: an id a line, CSV,"
                " JSON or a Parquet file.",
            ),
        ] = None,
    ) -> Summary:
        from kb.crawl.job import crawl_source
        from kb.crawl.purge import ids_of
        from kb.crawl.session import replay_unread_answers
        from kb.registry import SOURCES as CLASSES

        connector = CLASSES[name].connector(run)
        keys = list(ids_of(source).some_ids_in(ids, run.progress.say).keys) if ids else None
        connector.restrict(keys, parse_part(part))
        bounds = {"ids": str(ids.absolute()) if ids else "", "part": part or ""}
        connector.asked = {option: value for option, value in bounds.items() if value}
        command_ = f"{name} crawl"
        if plan:
            replay_unread_answers(run, name, CLASSES[name].connector)
            return CLASSES[name].plan(run) or connector.plan(command_)
        return crawl_source(run, source, connector, command_)

    add_filter(app, name)
    add_export(app, name)
    return app
