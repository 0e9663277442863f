"""`kb status`: progress of a collection, for a person or as JSON."""

import json
from typing import Any

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show
from kb.cli.framework.options import Options
from kb.core import terminal
from kb.core.sources import SOURCES
from kb.core.summary import vocabulary

app = group("Show progress, quota, age of the data and what is left.")


@command(
    app,
    raw=True,
    resumable=False,
    json="sources (each with phases, quota, rows and age), disk_bytes, next",
    examples=["kb status", "kb status --json", "kb status --data data/demo"],
)
def status(options: Options) -> None:
    """Show progress by phase, quota spent and left, age of the data, what is left, and disk use.

    Only reads, and can run during a crawl.
    """
    from kb.cli.commands.status.overview import overview

    about = overview(options.make_run(needs="root", exists=options.data is not None))
    if options.json:
        print(json.dumps(about, default=str))
    else:
        for line in lines(about):
            show(line)


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
                " or `kb reddit import FILE…` to read archive dumps without a key"
            ),
        ]
    for source, facts in about["sources"].items():
        shown += ["", *_source(source, facts)]
    if made := [f"{n:,} {schema}" for schema, n in about["pairs"].items() if n]:
        shown += ["", f"pairs: {', '.join(made)}"]
    if about["tasks"]:
        shown += ["", f"tasks: {about['tasks']:,}"]
    if about["links"]:
        shown += ["", f"links: {vocabulary.nouns(about['links'])}"]
    if about["stale"]:
        why = [f"{one['artifact']}: {', '.join(one['reasons'])}" for one in about["stale"]]
        shown += ["", "out of date:", *(f"  {line}" for line in why)]
    disk = ", ".join(f"{name} {terminal.size(n)}" for name, n in about["disk_bytes"].items())
    shown += ["", f"disk: {disk}"]
    shown += [f"next: {step}" for step in about["next"]]
    if about["download"]:
        shown.append("next: `kb restore` restores its content; `kb search` and `kb query` read it")
        return shown
    sources = about["sources"].values()
    waits = {name: sum(facts.get(name, 0) for facts in sources) for name in ("pending", "failed")}
    if any(facts["running_pid"] for facts in sources):
        shown += [] if about["next"] else ["next: wait for the running command"]
    elif any(waits.values()) and not about["next"]:
        shown.append("left: " + ", ".join(f"{n:,} {name}" for name, n in waits.items() if n))
    elif not about["next"]:
        shown.append("nothing is left to do")
    return shown


def _source(source: str, facts: dict[str, Any]) -> list[str]:
    """The lines of a source: crawled and kept, what is left, and the cost so far."""
    running = f" (running: pid {facts['running_pid']})" if facts["running_pid"] else ""
    lines = [f"{source}{running}"]
    for counted, numbers in facts["tally"].items():
        lines.append(f"  {vocabulary.tally(counted, numbers)}")
    sorted_so_far = facts["tally"].get(facts["counted"], {}).get("crawled", 0)
    if facts["crawled_so_far"] > sorted_so_far:
        more = vocabulary.count(
            facts["crawled_so_far"] - sorted_so_far, f"{{n}} {facts['counted']} crawled"
        )
        lines.append(f"  {more} but not filtered yet")
    for title, numbers in (
        ("left", facts["left_by"]),
        ("kept with them", {k: n for k, n in facts["rows"].items() if _is_extra(k, facts)}),
        ("restored", facts["restored"]),
        ("released", facts["released"]),
    ):
        if numbers:
            lines.append(f"  {title}: {vocabulary.nouns(numbers)}")
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
            for kind, counts in facts["phases"].items()
        },
    )
    for bucket, quota in facts["quota"].items():
        lines.append(
            f"  quota {bucket}: {quota['spent']:,} of {quota['limit']:,} spent today,"
            f" {quota['left']:,} left, resets {quota['resets_at']}"
        )
    for reason, n in facts["waiting"].items():
        if reason == "po_token":  # they have a line of their own
            continue
        hint = SOURCES[source].waiting.get(reason, "the next crawl asks for them again")
        lines.append(f"  {n:,} pending ({reason}): {hint}")
    asked = {name: facts[name] for name in ("units", "requests")}
    asked_for = [vocabulary.phrase(name, value, {}) for name, value in asked.items()]
    if any(asked_for):
        lines.append("  asked so far: " + ", ".join(filter(None, asked_for)))
    if facts["oldest"]:
        old = (
            f"; {facts['too_old']:,} rows older than {facts['max_age_days']} days"
            if facts["max_age_days"]
            else ""
        )
        lines.append(f"  read between {facts['oldest']} and {facts['newest']}{old}")
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


def _is_extra(name: str, facts: dict[str, Any]) -> bool:
    """Whether a clean table is neither filtered itself nor a list of verdicts."""
    return name not in facts["tally"] and name not in ("rejected", "failed", "pending")


def _table(head: str, columns: list[str], rows: dict[str, list[int]]) -> list[str]:
    if not rows:
        return []
    cells = [(name, *(f"{value:,}" for value in values)) for name, values in rows.items()]
    return [f"  {line}" for line in terminal.table([(head, *columns), *cells], 10)]
