"""A sample of pairs or tasks as a project for Label Studio: config.xml, tasks.json, README.md.

The sample is that of kb.labels.sample.
"""

from html import escape
from pathlib import Path
from typing import Any

import msgspec

from kb.artifacts import freshness, table_catalog
from kb.core.context import Run
from kb.core.errors import FatalError, UsageError
from kb.core.summary import Summary
from kb.core.templates import environment
from kb.labels import questions
from kb.labels.questions import Labeling, LabelQuestion
from kb.labels.sample import (
    DescribedVideo,
    asked_questions,
    at_aligned_times,
    clip_times,
    described,
    drawn_rows,
    has_text,
    player_address,
    surroundings,
)
from kb.pairs.pair_selection import with_ids
from kb.store.atomic import replacing_folder
from kb.store.tables.reading import scan

CONFIG, TASKS, README = "config.xml", "tasks.json", "README.md"
_TEMPLATES = Path(__file__).with_name("templates")
_LONGEST_S = 60  # of a clip that people watch before they judge


def export(
    run: Run,
    labeling: Labeling,
    sample: int,
    seed: int,
    out: Path,
    pairs: Path | None = None,
    *,
    aligned: bool = False,
) -> Summary:
    """Write the project to `out`. The same tables and seed give the same bytes. `pairs`: a file
    with the ids of those that may be drawn; `aligned`: of clips at the times of `kb pairs align`.

    Raises UsageError for a folder that is no such project or inside the data and where no pair is
    aligned, FatalError where there is nothing to judge, DamagedData, DiskFull.
    """
    place = table_catalog.outside(run.root, out)
    if place.exists() and not (place / CONFIG).is_file():
        raise UsageError(
            f"--out {out} exists and is not a labelling project", hint="name a new folder"
        )
    catalog = table_catalog.read_catalog(run.root)
    files = catalog.files(labeling.table)
    if not files:
        raise FatalError(
            f"there are no {labeling.kind}s to judge",
            hint=f"run `{labeling.command}` first",
        )
    freshness.refuse(run, f"{labeling.kind}s")
    spoken = has_text(files)
    where = "text IS NOT NULL" if spoken else "true"
    if pairs is not None:
        where += f" AND pair_id IN (SELECT pair_id FROM {scan([with_ids(pairs)])})"
    figures = catalog.files("films/film_figures") if aligned else []
    if aligned and not figures:
        raise UsageError("no pair is aligned with its film yet", hint="run `kb pairs align` first")
    if aligned:
        known = f"SELECT pair_id FROM {scan(figures)} WHERE alignable IS NOT NULL"
        where += f" AND pair_id IN ({known})"
    rows = drawn_rows(catalog.spill, files, labeling, sample, seed, where)
    if not rows:
        none = (
            "none is aligned with its film" if aligned else f"the table {labeling.table} is empty"
        )
        none = none if pairs is None else f"none that --pairs {pairs} names is here"
        raise FatalError(f"there are no {labeling.kind}s to judge: {none}")
    if aligned:
        rows = at_aligned_times(catalog.spill, figures, rows)
    around = surroundings(run.root, files, rows) if spoken else {}
    videos = described(run.root, rows) if labeling is questions.TASKS else {}
    asked = asked_questions(labeling, files, aligned=aligned)
    tasks = [{"data": _data(row, labeling, around, videos)} for row in rows]
    watched = (times[1] - times[0] if (times := clip_times(row, labeling)) else 0 for row in rows)
    seconds = sum(min(one, _LONGEST_S) + labeling.seconds for one in watched)
    _write(place, labeling, asked, tasks, round(seconds / 3600, 1))
    return Summary(
        command="label export",
        items=len(rows),
        strata=len({row["stratum"] for row in rows}),
        out_of=round(sum(row["weight"] for row in rows)),
        hours=round(seconds / 3600, 1),
        path=str(place),
    )


def _data(
    row: dict[str, Any],
    labeling: Labeling,
    around: dict[str, tuple[str, str]],
    videos: dict[str, DescribedVideo],
) -> dict[str, Any]:
    """What Label Studio shows of an item, and what it gives back with the answers."""
    times = clip_times(row, labeling)
    before, after = around.get(row["item_id"], ("", ""))
    player = player_address(row["video_id"], times)
    text, subject = row.get("text") or "", row[labeling.subject]
    span = ", from {} to {} s".format(*times) if times else ""
    words = f"<p>{escape(before)} <b>{escape(text)}</b> {escape(after)}</p>" if text else ""
    own = {}
    if labeling is questions.TASKS:
        video = videos.get(row["video_id"], DescribedVideo())
        shown = (f"<b>{escape(video.title)}</b>", *map(escape, video.description.splitlines()))
        own["description"] = f"<p>{'<br>'.join(shown)}</p>"
    return {
        "item_id": row["item_id"],
        "kind": labeling.kind,
        "video_id": row["video_id"],
        labeling.subject: subject,
        "stratum": row["stratum"],
        "weight": round(row["weight"], 4),
        "clip": (
            f'<iframe width="560" height="315" src="{escape(player)}"'
            ' referrerpolicy="strict-origin-when-cross-origin" allowfullscreen></iframe>'
        ),
        "about": f"<p>{labeling.subject.capitalize()}: <b>{escape(subject)}</b>{span}</p>{words}",
        **own,
    }


def _write(
    place: Path,
    labeling: Labeling,
    questions: list[LabelQuestion],
    tasks: list[dict[str, Any]],
    hours: float,
) -> None:
    texts = environment(_TEMPLATES, {}, autoescape=False)
    values = {"labeling": labeling, "questions": questions, "tasks": len(tasks), "hours": hours}
    with replacing_folder(place) as folder:
        for name in (CONFIG, README):
            page = texts.get_template(f"{name}.jinja").render(values)
            (folder / name).write_text(page, encoding="utf-8")
        encoded = msgspec.json.format(msgspec.json.encode(tasks), indent=1)
        (folder / TASKS).write_bytes(encoded + b"\n")
