"""`kb search`: ranked answers out of the local index."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.core.sources import SOURCES

if TYPE_CHECKING:
    from kb.cli.framework.options import Options
    from kb.core.verdict import Summary
    from kb.search.answers import SearchHit

app = group("Ranked answers from transcripts, wiki and threads, with links to the place.")
LIMIT = 10


SearchSource = StrEnum("SearchSource", SOURCES)  # type: ignore[misc]  # where an answer comes from


class HitKind(StrEnum):
    """What an answer may be."""

    video = "video"
    transcript = "transcript"
    section = "section"
    table = "table"
    post = "post"
    comment = "comment"


@command(
    app,
    raw=True,
    limit="Print at most N answers instead of 10 (exit code 0).",
    json="answers, each with text, snippet, source, key, score, url and licence",
    resumable=False,
    examples=[
        'kb search "how to tame a wolf"',
        "kb search '\"tide table\" harbour* -net'    a phrase, a beginning, a word that is barred",
        "kb search saltstone --source wiki --kind table --json",
        "kb search tame --entity Wolf",
        "kb search creeper --since 2023-01-01 --each 3 --limit 30",
    ],
)
def search(
    options: Options,
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="WORDS",
            help='Words; "a phrase", +needed, -barred and begin* as well, all in quotes of the'
            " shell.",
        ),
    ],
    source: Annotated[
        list[SearchSource] | None,
        typer.Option(
            "--source",
            help="Answers from there only; may be given several times.",
        ),
    ] = None,
    kind: Annotated[
        list[HitKind] | None,
        typer.Option("--kind", help="Answers of that kind only; may be given several times."),
    ] = None,
    entity: Annotated[
        str,
        typer.Option(
            "--entity",
            metavar="NAME",
            help="Answers out of what names that keyword of the profile only; `kb links` finds it.",
        ),
    ] = "",
    since: Annotated[
        str, typer.Option("--since", metavar="DATE", help="Not before that day: 2023-01-31.")
    ] = "",
    until: Annotated[
        str, typer.Option("--until", metavar="DATE", help="Not after that day: 2023-01-31.")
    ] = "",
    least: Annotated[
        float, typer.Option("--least-score", min=0, metavar="X", help="Not below that score.")
    ] = 0.0,
    each: Annotated[
        int, typer.Option("--each", min=1, metavar="N", help="Of one video, page or thread.")
    ] = 1,
    every: Annotated[
        bool, typer.Option("--all", help="As many of one video, page or thread as there are.")
    ] = False,
    size: Annotated[
        int, typer.Option("--size", min=1, metavar="N", help="Characters of an answer's text.")
    ] = 1000,
) -> Summary | None:
    """Search everything that was kept: the best places first, each with a link that opens it.

    Passages with the words in the order asked come before all others, then BM25 decides. Prints
    title, source, date, licence and score, a snippet with the words marked, and the address.
    --limit N gives N answers instead of 10, with exit code 0; --json all of them in one object.
    An index that is missing or out of date is made first, as `kb index` does. --data may be a data
    root, a restored one or a downloaded release, whose index is kept in the user's cache.
    """
    from kb.core import terminal
    from kb.core.verdict import Summary
    from kb.search.answers import search as ask
    from kb.search.answers import suggest
    from kb.search.build import ensure
    from kb.search.ranking import Only, day_given

    only = Only(
        kinds=tuple(map(str, kind or ())),
        since=day_given("--since", since),
        until=day_given("--until", until),
        least=least,
        each=None if every else each,
        limit=options.limit or LIMIT,
    )
    run = options.make_run(exists=True)
    sources = [str(one) for one in SearchSource if not source or one in source]
    ensure(run, sources)
    query = " ".join(words)
    answers = ask(run.root, query, sources=sources, only=only, size=size, entity=entity)
    meant = suggest(run.root, query, sources=sources)
    if options.json:
        import msgspec

        hits = [msgspec.to_builtins(one) for one in answers]
        return Summary(command="search", answers=hits, suggestion=meant or None)
    for number, one in enumerate(answers, 1):
        for line in _lines(number, one):
            typer.echo(terminal.one_line(line))
    if not answers or meant:
        said = [] if answers else ["no answers"]
        quoted = meant if '"' in meant else f'"{meant}"'
        said += [f"did you mean {quoted}?"] if meant else []
        typer.echo(terminal.one_line("; ".join(said)), err=True)
    return None


def _lines(number: int, one: SearchHit) -> Iterator[str]:
    """An answer for a person; text of others, in one line each."""
    yield f"{number:2}. {one.title} › {one.path}" if one.path else f"{number:2}. {one.title}"
    facts = [
        f"source: {one.source} {one.kind}",
        f"date: {one.date}" if one.date else "",
        f"licence: {one.licence or 'none given'}",
        f"score: {one.score:.2f}",
    ]
    yield f"    {' · '.join(fact for fact in facts if fact)}"
    if one.text != one.title:  # else the passage has no text of its own
        for line in textwrap.wrap(one.snippet, 96):
            yield f"    {line}"
    yield f"    {one.url}"
