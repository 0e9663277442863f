"""`kb status`: progress of a collection, for a person or as JSON."""

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show
from kb.cli.framework.options import Options
from kb.core import terminal
from kb.core.progress import span
from kb.core.sources import SOURCES
from kb.core.summary import vocabulary

if TYPE_CHECKING:
    from kb.store.state.run_records import RunRecord

_COPIES = "restored", "released"
_SHOWN_REASONS = 5

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

    from kb.store.state.run_records import kept

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
        more = ["", *map(_made, records)]
        for cells, made in zip(terminal.table(rows), more, strict=True):
            show(f"{cells}  {made}".rstrip())


def _made(record: "RunRecord") -> str:
    """What a run made, in a few words."""
    from kb.store.state.run_records import in_words

    words = [f"{outcome} {', '.join(names)}" for outcome, names in record.made.items()]
    words += [f"waits for {record.waits_for}"] if record.waits_for else []
    words += [in_words(record.figures)] if not record.made else []
    words += [f"changed: {', '.join(record.settings)}"] if record.settings else []
    return "; ".join(filter(None, words))


def lines(about: dict[str, Any]) -> list[str]:
    """The overview as a person reads it."""
    shown = [
        (
            f"{'download' if about['download'] else 'data root'} {about['data']},"
            f" profile {about['profile']}, {terminal.size(about['disk_bytes_total'])}"
        )
    ]
    if not (about["sources"] or any(about["pairs"].values()) or about["links"]):
        return [
            *shown,
            (
                "nothing collected yet; try `kb demo` to see the whole job,"
                " `kb youtube crawl --plan` to see what a crawl costs,"
                " or without a key `kb youtube import DIR…` for folders of yt-dlp and"
                " `kb reddit import FILE…` for archive dumps"
            ),
        ]
    for source, facts in about["sources"].items():
        about_it = _source(source, facts)
        shown += about_it if len(about_it) > 1 or facts["running_pid"] else []
    rows = {"pairs": next(filter(None, about["pairs"].values()), 0), "tasks": about["tasks"]}
    if made := {name: n for name, n in (rows | about["links"]).items() if n}:
        shown.append(f"made of them: {vocabulary.nouns(made)}")
    if about["stale"]:
        why = [
            f"{artifact['artifact']}: {', '.join(artifact['reasons'])}"
            for artifact in about["stale"]
        ]
        shown += ["out of date:", *(f"  {line}" for line in why)]
    disk = ", ".join(f"{name} {terminal.size(n)}" for name, n in about["disk_bytes"].items())
    shown.append(f"disk: {disk}")
    shown += [f"next: {step}" for step in about["next"]]
    if about["download"]:
        shown.append("next: `kb restore` restores its content; `kb search` and `kb query` read it")
        return shown
    sources = about["sources"].values()
    waits = {
        "to read": about["left"],
        "pending": sum(facts.get("pending", 0) for facts in sources),
        "failed": sum(max(facts.get("failed", 0), _failed(facts)) for facts in sources),
        "too old": about["too_old"],
    }
    if any(facts["running_pid"] for facts in sources):
        shown.append("next: wait for the running command")
    elif any(waits.values()) and not about["next"]:
        open_ = (
            source for source in sources if source["left"] or _failed(source) or source["too_old"]
        )
        lacking = [name.upper() for source in open_ if (name := source["lacks"])]
        without = f"; {' and '.join(lacking)} not set" if lacking else ""
        what = ", ".join(f"{n:,} {name}" for name, n in waits.items() if n)
        shown.append(f"left: {what}{without}")
    elif not about["next"]:
        shown.append("nothing is left to do")
    return shown


def _failed(facts: dict[str, Any]) -> int:
    return sum(counts.get("error", 0) for counts in facts["phases"].values())


def _source(source: str, facts: dict[str, Any]) -> list[str]:
    """The lines of a source: crawled and kept, what is left, and the cost so far."""
    running = f" (running: pid {facts['running_pid']})" if facts["running_pid"] else ""
    lines = [f"{source}{running}"]
    if facts["unread"]:
        lines.append(f"  raw data that no table is made of yet: run `kb {source} filter`")
    for counted, numbers in facts["tally"].items():
        lines.append(f"  {vocabulary.tally(counted, numbers)}")
    sorted_so_far = facts["tally"].get(facts["counted"], {}).get("crawled", 0)
    if facts["crawled_so_far"] > sorted_so_far:
        more = vocabulary.count(
            facts["crawled_so_far"] - sorted_so_far, f"{{n}} {facts['counted']} crawled"
        )
        lines.append(f"  {more} but not filtered yet")
    own = (*facts["tally"], "rejected", "failed", "pending")  # in the lines above
    extra = {name: n for name, n in facts["rows"].items() if name not in own}
    for title, numbers in (
        ("left", facts["left_by"]),
        ("kept with them", extra),
    ):
        if numbers:
            lines.append(f"  {title}: {vocabulary.nouns(numbers)}")
    copies = [f"{copy}: {vocabulary.nouns(facts[copy])}" for copy in _COPIES if facts[copy]]
    lines += [f"  {'; '.join(copies)}"] if copies else []
    phases = facts["phases"].items()
    lines += _table(
        "to read",
        ["done", "left", "failed", "skipped"],
        {
            kind: [
                counts.get("done", 0),
                counts["left"],
                counts.get("error", 0),
                counts.get("skipped", 0),
            ]
            for kind, counts in phases
            if counts["left"]
            or counts.get("error", 0)  # what is done says nothing about what to do
        },
    )
    if failures := facts["failures"]:
        shown = [f"{reason} ({n:,})" for reason, n in failures.items()][:_SHOWN_REASONS]
        rest = ", …" if len(failures) > _SHOWN_REASONS else ""
        lines.append(f"  failed: {', '.join(shown)}{rest}")
    if facts["stopped"]:
        lines.append(f"  stopped: {facts['stopped']}; it waits for: {facts['waits_for']}")
    if facts["quota"] and not facts["lacks"]:
        buckets = facts["quota"].items()
        shares = [f"{name} {bucket['spent']:,} of {bucket['limit']:,}" for name, bucket in buckets]
        resets = next(iter(facts["quota"].values()))["resets_at"]
        lines.append(f"  quota spent today: {', '.join(shares)}; resets {resets}")
    for reason, n in facts["waiting"].items():
        if reason == "po_token":  # they have a line of their own
            continue
        hint = SOURCES[source].waiting.get(reason, "the next crawl asks for them again")
        lines.append(f"  {n:,} pending ({reason}): {hint}")
    spent = ("requests",) if facts["lacks"] else ("units", "requests")  # a quota is a key's
    cost = [vocabulary.phrase(name, facts[name], {}) for name in spent]
    read = [f"read between {facts['oldest']} and {facts['newest']}"] if facts["oldest"] else []
    if facts["too_old"]:
        read.append(f"{facts['too_old']:,} rows older than {facts['max_age_days']} days")
    read += ["asked so far: " + ", ".join(filter(None, cost))] if any(cost) else []
    if read:
        lines.append(f"  {'; '.join(read)}")
    if facts.get("po_token"):
        lines.append(
            f"  {vocabulary.phrase('po_token', facts['po_token'], {})};"
            " a crawl on a later day tries them again. Or make transcripts of your own:"
            " `kb youtube missing-transcripts` lists what lacks one, `kb youtube import"
            " --own-transcripts DIR` takes them"
        )
    if facts.get("incomplete_posts"):
        names = ", ".join(facts["incomplete"])
        rest = ", …" if facts["incomplete_posts"] > len(facts["incomplete"]) else ""
        lines.append(
            f"  {vocabulary.phrase('incomplete_posts', facts['incomplete_posts'], {})}:"
            f" {names}{rest}; the next `kb reddit crawl` tries their comments again"
        )
    if facts["unknown_keys"]:
        keys = ", ".join(f"{key} ({n:,})" for key, n in facts["unknown_keys"].items())
        lines.append(f"  unknown keys in answers: {keys}")
    return lines


def _table(head: str, columns: list[str], rows: dict[str, list[int]]) -> list[str]:
    if not rows:
        return []
    cells = [(name, *(f"{value:,}" for value in values)) for name, values in rows.items()]
    return [f"  {line}" for line in terminal.table([(head, *columns), *cells], 10)]
