"""`kb index`, `kb search`, `kb mcp` and `kb explore`: looking at what was kept."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show, warn, warn_stale
from kb.cli.framework.options import Options
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.sources import KINDS, SOURCES
from kb.core.summary import Summary

if TYPE_CHECKING:
    from kb.core.search_hit import SearchHit


index_app = group("Build the local search index of all clean text.")
search_app = group("Search transcripts, wiki pages and threads.")
mcp_app = group("Serve search and tables to agents over the Model Context Protocol on stdio.")
LIMIT = 10


# Where an answer comes from.
SearchSource = StrEnum("SearchSource", list(SOURCES))  # type: ignore[misc]


class AnswerFormat(StrEnum):
    """Formats of answers."""

    text = "text"
    json = "json"


# Kinds of answers.
HitKind = StrEnum("HitKind", list(KINDS))  # type: ignore[misc]


@command(
    index_app,
    data="reads",
    records=True,
    resumable=False,
    again="Rebuild the index of every source, even if its clean tables have not changed.",
    json="passages, indexed, sources",
    examples=[
        "kb index                                 what has changed since the last run",
        "kb index --again                         everything again",
    ],
)
def index(run: Run) -> Summary:
    """Build the index that `kb search` reads: transcripts, wiki sections, tables, posts, comments.

    A source whose clean files have not changed is skipped. index/<source>/ holds texts and is
    never released.
    """
    from kb.search.build import index

    return index(run)


@command(
    search_app,
    raw=True,
    limit="Print at most N answers instead of 10 (exit code 0).",
    json="answers, each with text, snippet, source, key, score, url and licence",
    resumable=False,
    data="reads",
    examples=[
        'kb search "how to tame a wolf"',
        "kb search '\"tide table\" harbour* -net'    a phrase, a prefix, an excluded word",
        "kb search saltstone --source wiki --kind table --format json",
        "kb search tame --entity Wolf",
        "kb search creeper --since 2023-01-01 --each 3 --limit 30",
        'kb search --clips "a wolf sits beside a player"    by the pictures of scored clips',
    ],
)
def search(
    options: Options,
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="WORDS",
            help='Words, "a phrase", +required, -excluded, prefix*; quote them for the shell.',
        ),
    ],
    source: Annotated[
        list[SearchSource] | None,
        typer.Option("--source", help="Only answers from this source; may be repeated."),
    ] = None,
    kind: Annotated[
        list[HitKind] | None,
        typer.Option("--kind", help="Only answers of this kind; may be repeated."),
    ] = None,
    entity: Annotated[
        str,
        typer.Option(
            "--entity",
            metavar="NAME",
            help="Only answers that mention this keyword of the profile, as found by `kb links`.",
        ),
    ] = "",
    since: Annotated[
        str,
        typer.Option("--since", metavar="DATE", help="Only answers from this day on: 2023-01-31."),
    ] = "",
    until: Annotated[
        str,
        typer.Option("--until", metavar="DATE", help="Only answers up to this day: 2023-01-31."),
    ] = "",
    least: Annotated[
        float,
        typer.Option(
            "--least-score", min=0, metavar="X", help="Only answers with at least this score."
        ),
    ] = 0.0,
    each: Annotated[
        int,
        typer.Option(
            "--each", min=1, metavar="N", help="At most N answers from one video, page or thread."
        ),
    ] = 1,
    every: Annotated[
        bool, typer.Option("--all", help="Any number of answers from one video, page or thread.")
    ] = False,
    format: Annotated[
        AnswerFormat,
        typer.Option("--format", help="json: the answers alone, as one array on stdout."),
    ] = AnswerFormat.text,
    size: Annotated[
        int,
        typer.Option(
            "--size", min=1, metavar="N", help="At most N characters of an answer's text."
        ),
    ] = 1000,
    clips: Annotated[
        bool,
        typer.Option(
            "--clips",
            help="Search the pictures of clips that `kb pairs score` has seen, by its CLIP model.",
        ),
    ] = False,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            metavar="FILE",
            help="With --clips: the model, where clips were seen by several. [default: the one that"
            " has seen them]",
        ),
    ] = None,
) -> Summary | None:
    """Search everything that was kept: best passages first, each with a link that opens it.

    Passages with the words in the given order come first; BM25 ranks the rest. Prints title,
    source, date, licence, score, a snippet with the words marked, and the URL. An index that is
    missing or out of date is built first, as by `kb index`. --data may be a data root, a restored
    one or a downloaded release, whose index is kept in the user's cache.

    With --clips words are compared with what clips show, each clip of the pairs whose film was
    seen; the score is the cosine of clip and words. Answers have the clip's times, and what is
    spoken in it. No film is opened. Needs the extra `score`.
    """
    if clips:
        others = {"--source": source, "--kind": kind, "--entity": entity}
        _refuse("--clips", others | {"--since": since, "--until": until})
        each_ = None if every else each
        return _search_clips(options, " ".join(words), model or "", each_, least, size, format)
    if model is not None:
        raise SettingError("--model is for --clips", hint="add --clips, or leave it out")
    from kb.search.answers import search_as_meant
    from kb.search.build import ensure
    from kb.search.coverage import coverage
    from kb.search.ranking import Only, day_given

    only = Only(
        kinds=tuple(map(str, kind or ())),
        since=day_given("--since", since),
        until=day_given("--until", until),
        least=least,
        each=None if every else each,
        limit=options.limit or LIMIT,
    )
    run = options.make_run()
    warn_stale(run)
    sources = [str(searched) for searched in SearchSource if not source or searched in source]
    ensure(run, sources)
    query = " ".join(words)
    answers, meant, instead = search_as_meant(
        run.root, query, sources=sources, only=only, size=size, entity=entity
    )
    if options.json:
        return Summary(command="search", answers=_plain(answers), suggestion=meant or None)
    _show(answers, format)
    quoted = meant if '"' in meant else f'"{meant}"'
    if instead:
        show(f"nothing has these words; read as {quoted}", err=True)
    elif meant:
        show(f"did you mean {quoted}?", err=True)
    if not answers:
        show("no answers", err=True)
    if (known := coverage(run.root)).lacking or not answers:
        show(str(known), err=True)
    return None


def _refuse(option: str, others: Mapping[str, object]) -> None:
    if given := [name for name, value in others.items() if value]:
        raise SettingError(f"{given[0]} has no effect with {option}", hint=f"leave {given[0]} out")


def _search_clips(
    options: Options,
    words: str,
    model: str,
    each: int | None,
    least: float,
    size: int,
    format: AnswerFormat,
) -> Summary | None:
    """`kb search --clips`."""
    from kb.score.clip_search import ClipSearch

    run = options.make_run()
    warn_stale(run)
    asked = ClipSearch(run.root, run.profile, model)
    if not asked.is_current:
        asked.build(run)
    lowest = least or -1.0
    hits = asked.hits(words, options.limit or LIMIT, each=each, least=lowest, size=size)
    cut = asked.cut_tokens(words)
    if options.json:
        return Summary(command="search", answers=_plain(hits), cut_tokens=cut, model=asked.model)
    _show(hits, format)
    if cut:
        show(
            f"the words are too long for the model: their last {cut} tokens are left out", err=True
        )
    if not hits:
        show("no answers", err=True)
    return None


def _plain(hits: Sequence[SearchHit]) -> list[Any]:
    import msgspec

    return [msgspec.to_builtins(hit) for hit in hits]


def _show(hits: Sequence[SearchHit], format: AnswerFormat) -> None:
    """Print answers in the form that was asked for."""
    if format is AnswerFormat.json:
        import msgspec

        show(msgspec.json.encode(hits).decode())
        return
    for number, hit in enumerate(hits, 1):
        for line in lines(number, hit):
            show(line)


def lines(number: int, hit: SearchHit) -> Iterator[str]:
    """The lines that show an answer."""
    yield f"{number:2}. {hit.title} › {hit.path}" if hit.path else f"{number:2}. {hit.title}"
    facts = [
        f"source: {hit.source} {hit.kind}",
        f"date: {hit.date}" if hit.date else "",
        f"licence: {hit.licence or 'none given'}",
        f"score: {hit.score:.2f}",
    ]
    yield f"    {' · '.join(fact for fact in facts if fact)}"
    if hit.text != hit.title:  # else the passage has no text of its own
        for line in textwrap.wrap(hit.snippet, 96):
            yield f"    {line}"
    yield f"    {hit.url}"


@command(
    mcp_app,
    without=("json",),
    data="reads",
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
    from kb.registry import SOURCES as CLASSES

    serve(run, CLASSES)


explore_app = group("Search, rows, stages and pairs in a browser, on this machine.")


@command(
    explore_app,
    without=("json",),
    data="reads",
    resumable=False,
    examples=[
        "kb explore                                 opens the pages in your browser",
        "kb explore --data downloaded --port 8080 --no-browser",
        "kb explore --judge Anna --videos films     and judge pairs, with films of your own",
    ],
)
def explore(
    run: Run,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65_535, metavar="N", help="0: a free port.")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address only.")
    ] = False,
    judge: Annotated[
        str | None,
        typer.Option(
            "--judge", metavar="NAME", help="Let this person judge. The name is stored nowhere."
        ),
    ] = None,
    videos: Annotated[
        list[Path] | None,
        typer.Option(
            "--videos",
            metavar="DIR",
            help="With --judge: a folder with video files to play; may be given repeatedly.",
        ),
    ] = None,
) -> None:
    """Serve web pages over a data root or a downloaded release, until Ctrl-C.

    Pages: an overview with totals, the funnel of each source and what is out of date; search; kept
    and rejected rows with the stage and value that decided; what another threshold would keep; the
    pairs of a keyword. Each row, answer and pair leads to the page of its video, wiki page or
    thread. An index that is missing or out of date is built at the start, in the user's cache
    where the data root can't be written; nothing else is, but for the answers of --judge. Prints
    the address on stdout. Listens on 127.0.0.1 only, and asks no service; links to videos, threads
    and pages open when you follow them. Needs the extra `explore`.

    With --judge NAME the page Judge asks the questions of `kb label export`, one key for each
    answer. Answers are rows of labels/, as those of Label Studio are, under a number that the name
    always has. The clip is your own file where --videos names it (needs the extra `clips`), else
    the service's player once you open it.
    """
    from kb.artifacts.table_catalog import read_catalog
    from kb.cli.commands.overview import overview
    from kb.core.installation import require
    from kb.explore.judge import JudgeDesk
    from kb.explore.server import serve
    from kb.labels.judging import Judge, annotator_number
    from kb.registry import SOURCES as CLASSES
    from kb.report.graph import drawn, nodes

    if videos and judge is None:
        raise SettingError("--videos is for --judge", hint="add --judge NAME, or leave it out")
    if videos:
        require("clips", "av", "PIL")
    desk = None
    if judge is not None:
        desk = JudgeDesk(Judge(run, annotator_number(judge)), tuple(videos or ()))
        desk.judge.measure()  # where a run before was killed
    warn_stale(run)
    serve(
        read_catalog(run.root).path,
        run.profile,
        lambda: overview(run),
        CLASSES,
        port,
        graph=lambda: drawn(nodes(run)),
        desk=desk,
        browser=not no_browser,
        say=lambda address: print(address, flush=True),
        first=lambda: _build_index(run),
    )
    if desk is not None and desk.judge.changes:
        desk.judge.measure()


def _build_index(run: Run) -> None:
    from kb.core.errors import Interrupted, KbError
    from kb.core.sources import SOURCES
    from kb.score.clip_search import ClipSearch, has_clips
    from kb.search.build import ensure

    try:
        ensure(run, list(SOURCES))
        if has_clips(run.root) and not (asked := ClipSearch(run.root, run.profile)).is_current:
            asked.build(run)
    except Interrupted:
        raise
    except KbError as error:  # the other pages need none
        warn(f"no index for Search: {error}; {error.hint}")
