"""`kb status`: progress of a collection, for a person or as JSON."""

import json
from collections.abc import Iterator
from typing import Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show
from kb.cli.framework.options import Options
from kb.core import terminal
from kb.core.progress import span
from kb.core.sources import SOURCES
from kb.core.summary import phrases

_COPIES = "restored", "released"
_SHOWN_REASONS = 5
_NOTHING_YET = (
    "nothing collected yet; try `kb demo` to see the whole job,"
    " `kb youtube crawl --plan` to see what a crawl costs,"
    " or without a key `kb youtube import DIR…` for folders of yt-dlp and"
    " `kb reddit import FILE…` for archive dumps"
)

app = group("Show progress, quota, age of the data and what is left.")


@command(
    app,
    raw=True,
    resumable=False,
    json="sources (each with phases, quota, rows and age), disk_bytes, next; with --runs: runs",
    data="may read",
    examples=[
        "kb status",
        "kb status --json",
        "kb status --data data/demo",
        "kb status --runs               the last runs: when, how long, exit code, what they made",
    ],
)
def status(
    options: Options,
    runs: Annotated[
        bool, typer.Option("--runs", help="The runs that wrote here, the newest first.")
    ] = False,
) -> None:
    """Show progress by phase, quota spent and left, age of the data, what is left, and disk use.

    Only reads, and can run during a crawl. --runs shows the last 1,000 runs instead; one that was
    killed leaves no record.
    """
    from kb.cli.commands.overview import overview

    if runs:
        _show_runs(options)
        return
    about = overview(options.make_run(needs="root"))
    if options.json:
        print(json.dumps(about, default=str))
    else:
        for line in lines(about):
            show(line)


def _show_runs(options: Options) -> None:
    from msgspec import to_builtins

    from kb.store.state.run_records import kept, made_in_words

    records = list(kept(options.make_run(needs="root").root))
    if options.json:
        print(json.dumps({"runs": [to_builtins(record) for record in records]}))
    elif not records:
        show("no run has written here yet")
    else:
        rows = [("start", "took", "exit", "command")]
        rows += [
            (record.start, span(record.seconds), str(record.exit_code), record.command)
            for record in records
        ]
        more = ["", *map(made_in_words, records)]
        for cells, made in zip(terminal.table(rows), more, strict=True):
            show(f"{cells}  {made}".rstrip())


def lines(about: dict[str, Any]) -> list[str]:
    """The overview as a person reads it."""
    folder = "download" if about["download"] else "data root"
    size = terminal.size(about["disk_bytes_total"])
    shown = [f"{folder} {about['data']}, profile {about['profile']}, {size}"]
    if not (about["sources"] or any(about["pairs"].values()) or about["links"]):
        return [*shown, _NOTHING_YET]
    for source, facts in about["sources"].items():
        own = list(_of_source(source, facts))
        shown += own if len(own) > 1 or facts["running_pid"] else []
    rows = {"pairs": next(filter(None, about["pairs"].values()), 0), "tasks": about["tasks"]}
    if made := {name: n for name, n in (rows | about["links"]).items() if n}:
        shown.append(f"made of them: {phrases.nouns(made)}")
    if about["stale"]:
        shown.append("out of date:")
        shown += [f"  {old['artifact']}: {', '.join(old['reasons'])}" for old in about["stale"]]
    disk = ", ".join(f"{name} {terminal.size(n)}" for name, n in about["disk_bytes"].items())
    shown.append(f"disk: {disk}")
    shown += [f"next: {step}" for step in about["next"]]
    return [*shown, *filter(None, [_outlook(about)])]


def _outlook(about: dict[str, Any]) -> str:
    """What is left to do, or what a download is for; "" where the next steps say it."""
    if about["download"]:
        return "next: `kb restore` restores its content; `kb search` and `kb query` read it"
    sources = about["sources"].values()
    if any(facts["running_pid"] for facts in sources):
        return "next: wait for the running command"
    if about["next"]:
        return ""
    waits = {
        "to read": about["left"],
        "pending": sum(facts.get("pending", 0) for facts in sources),
        "failed": sum(max(facts.get("failed", 0), _failed(facts)) for facts in sources),
        "too old": about["too_old"],
    }
    if not any(waits.values()):
        return "nothing is left to do"
    unfinished = (facts for facts in sources if facts["left"] or _failed(facts) or facts["too_old"])
    lacking = [name.upper() for facts in unfinished if (name := facts["lacks"])]
    without = f"; {' and '.join(lacking)} not set" if lacking else ""
    return f"left: {', '.join(f'{n:,} {name}' for name, n in waits.items() if n)}{without}"


def _failed(facts: dict[str, Any]) -> int:
    return sum(counts.get("error", 0) for counts in facts["phases"].values())


def _of_source(source: str, facts: dict[str, Any]) -> Iterator[str]:
    """The lines of a source; the first is its name."""
    running = f" (running: pid {facts['running_pid']})" if facts["running_pid"] else ""
    yield f"{source}{running}"
    for part in (_collected, _to_read, _age_and_cost, _incomplete):
        for line in part(source, facts):
            yield f"  {line}"


def _collected(source: str, facts: dict[str, Any]) -> Iterator[str]:
    """What was crawled, what the filter made of it, and where else it is."""
    if facts["unread"]:
        yield f"raw data that no table is made of yet: run `kb {source} filter`"
    for counted, numbers in facts["tally"].items():
        yield phrases.tally(counted, numbers)
    filtered = facts["tally"].get(facts["counted"], {}).get("crawled", 0)
    if (more := facts["crawled_so_far"] - filtered) > 0:
        crawled = phrases.count(more, f"{{n}} {facts['counted']} crawled")
        yield f"{crawled} but not filtered yet"
    if facts["left_by"]:
        yield f"left: {phrases.nouns(facts['left_by'])}"
    own = (*facts["tally"], "rejected", "failed", "pending")  # in the lines above
    if extra := {name: n for name, n in facts["rows"].items() if name not in own}:
        yield f"kept with them: {phrases.nouns(extra)}"
    if copies := [f"{copy}: {phrases.nouns(facts[copy])}" for copy in _COPIES if facts[copy]]:
        yield "; ".join(copies)


def _to_read(source: str, facts: dict[str, Any]) -> Iterator[str]:
    """What a crawl would go on with, and what keeps it from that."""
    states = ("done", "left", "error", "skipped")
    phases = {
        kind: [counts.get(state, 0) for state in states]
        for kind, counts in facts["phases"].items()
        if counts["left"] or counts.get("error", 0)  # what is done says nothing about what to do
    }
    if phases:
        cells = [(kind, *(f"{n:,}" for n in numbers)) for kind, numbers in phases.items()]
        yield from terminal.table([("to read", "done", "left", "failed", "skipped"), *cells], 10)
    if failures := facts["failures"]:
        shown = [f"{reason} ({n:,})" for reason, n in failures.items()][:_SHOWN_REASONS]
        rest = ", …" if len(failures) > _SHOWN_REASONS else ""
        yield f"failed: {', '.join(shown)}{rest}"
    if facts["stopped"]:
        yield f"stopped: {facts['stopped']}; it waits for: {facts['waits_for']}"
    if facts["quota"] and not facts["lacks"]:
        buckets = facts["quota"].items()
        shares = [f"{name} {bucket['spent']:,} of {bucket['limit']:,}" for name, bucket in buckets]
        resets = next(iter(facts["quota"].values()))["resets_at"]
        yield f"quota spent today: {', '.join(shares)}; resets {resets}"
    for reason, n in facts["waiting"].items():
        if reason != "po_token":  # they have a line of their own
            hint = SOURCES[source].waiting.get(reason, "the next crawl asks for them again")
            yield f"{n:,} pending ({reason}): {hint}"


def _age_and_cost(source: str, facts: dict[str, Any]) -> Iterator[str]:
    """How old the rows are, and what was asked for them."""
    parts = []
    if facts["oldest"]:
        parts.append(f"read between {facts['oldest']} and {facts['newest']}")
    if facts["too_old"]:
        parts.append(f"{facts['too_old']:,} rows older than {facts['max_age_days']} days")
    spent = ("requests",) if facts["lacks"] else ("units", "requests")  # a quota is a key's
    if cost := [*filter(None, (phrases.phrase(name, facts[name], {}) for name in spent))]:
        parts.append(f"asked so far: {', '.join(cost)}")
    if parts:
        yield "; ".join(parts)


def _incomplete(source: str, facts: dict[str, Any]) -> Iterator[str]:
    """What the service did not give or Lorecrawl did not understand."""
    if facts.get("po_token"):
        yield (
            f"{phrases.phrase('po_token', facts['po_token'], {})};"
            " a crawl on a later day tries them again. Or make transcripts of your own:"
            " `kb youtube missing-transcripts` lists what lacks one, `kb youtube import"
            " --own-transcripts DIR` takes them"
        )
    if facts.get("incomplete_posts"):
        names = ", ".join(facts["incomplete"])
        rest = ", …" if facts["incomplete_posts"] > len(facts["incomplete"]) else ""
        yield (
            f"{phrases.phrase('incomplete_posts', facts['incomplete_posts'], {})}:"
            f" {names}{rest}; the next `kb reddit crawl` tries their comments again"
        )
    if facts["unknown_keys"]:
        keys = ", ".join(f"{key} ({n:,})" for key, n in facts["unknown_keys"].items())
        yield f"unknown keys in answers: {keys}"
