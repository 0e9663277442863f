"""The commands that every source has: `filter`, `export`, and a plain `crawl` for a source without
commands of its own.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import Group, command, group
from kb.cli.framework.options import CLUSTER
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
                " chunks of at most N tokens. A word counts as 1.3 tokens, and so does each sign of"
                " a script without spaces.",
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
    ) -> Summary:
        from kb.artifacts.makers import make_export

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
        json="crawled, failed, pending, requests",
        checks=True,
        data="makes",
        examples=[f"kb {name} crawl", f"kb {name} crawl --limit 100"],
    )
    def crawl(run: Run) -> Summary:
        from kb.crawl.job import crawl_source
        from kb.registry import SOURCES as CLASSES

        return crawl_source(run, source, CLASSES[name].connector(run))

    add_filter(app, name)
    add_export(app, name)
    return app
