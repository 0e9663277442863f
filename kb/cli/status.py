"""`kb status`: where a collection stands, for a person or as JSON."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from kb.cli.command import command, group

if TYPE_CHECKING:
    from kb.cli.options import Options

app = group("Progress, quota, age of the data, what is left.")


@command(
    app,
    raw=True,
    resumable=False,
    examples=["kb status", "kb status --json", "kb status --data data/demo"],
)
def status(options: Options) -> None:
    """Show progress by phase, quota spent and left, age of the data, what is left, and disk use.

    Only reads, also beside a running crawl.
    """
    from kb.cli.overview import overview

    about = overview(options.make_run())
    if options.json:
        print(json.dumps(about, default=str))
    else:
        print("\n".join(_lines(about)))


def _lines(about: dict[str, Any]) -> list[str]:
    lines = [
        f"data root {about['data']}, profile {about['profile']}, {_bytes(about['disk_bytes_total'])}"
    ]
    if not about["sources"]:
        return [
            *lines,
            "nothing collected yet; `kb demo` shows the whole job, `kb youtube crawl --plan` what a crawl costs",
        ]
    for source, facts in about["sources"].items():
        running = f" (being written by pid {facts['running_pid']})" if facts["running_pid"] else ""
        lines += ["", f"{source}{running}"]
        lines += _table(
            "phase",
            ["done", "left", "error", "skipped"],
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
                f"  quota {bucket}: {quota['spent']:,} of {quota['limit']:,} spent today, {quota['left']:,} left, resets {quota['resets_at']}"
            )
        if facts["requests"]:
            lines.append(
                f"  requests so far: {facts['requests']:,}"
                + (f", units {facts['units']:,}" if facts["units"] else "")
            )
        if facts["rows"]:
            lines.append(
                "  rows: " + ", ".join(f"{name} {rows:,}" for name, rows in facts["rows"].items())
            )
        if facts["oldest"]:
            old = (
                f"; {facts['too_old']:,} rows older than {facts['max_age_days']} days"
                if facts["max_age_days"]
                else ""
            )
            lines.append(f"  read between {facts['oldest']} and {facts['newest']}{old}")
        if facts.get("incomplete_posts"):
            names = ", ".join(facts["incomplete"])
            rest = ", …" if facts["incomplete_posts"] > len(facts["incomplete"]) else ""
            lines.append(
                f"  incomplete posts: {facts['incomplete_posts']:,} ({names}{rest}); "
                "the next `kb reddit crawl` tries their comments again"
            )
        if facts["unknown_keys"]:
            lines.append(
                "  unknown keys in answers: "
                + ", ".join(f"{key} ({n:,})" for key, n in facts["unknown_keys"].items())
            )
    lines += [
        "",
        "disk: "
        + ", ".join(f"{name} {_bytes(size)}" for name, size in about["disk_bytes"].items()),
    ]
    return lines


def _table(head: str, columns: list[str], rows: dict[str, list[int]]) -> list[str]:
    if not rows:
        return []
    width = max(len(head), *(len(name) for name in rows))
    lines = [f"  {head:<{width}}" + "".join(f"{column:>12}" for column in columns)]
    return lines + [
        f"  {name:<{width}}" + "".join(f"{value:>12,}" for value in values)
        for name, values in rows.items()
    ]


def _bytes(size: int) -> str:
    value = float(size)
    for unit in ("B", "kB", "MB", "GB"):
        if value < 1000:
            return f"{value:.0f} {unit}" if unit == "B" else f"{value:.1f} {unit}"
        value /= 1000
    return f"{value:.1f} TB"
