"""clean/youtube → release/open-text: transcripts of videos that their uploaders marked as Creative
Commons, with what credit needs. Only where the profile asks for it (`[release] open_text = true`).
The collector's own transcripts are left out.
"""

from collections.abc import Iterator
from contextlib import closing

import duckdb
import pyarrow as pa

from kb.artifacts import freshness, manifest
from kb.core import signals
from kb.core.context import Run
from kb.core.summary import Summary
from kb.store.artifact_registry import ARTIFACTS
from kb.store.atomic import remove_path
from kb.store.layout import Layout
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan
from kb.store.tables.shard_writer import write_sorted

NAME = "release/open-text"
LICENCE = "creativeCommon"
_GROUP = 1_024  # rows: a transcript has some 20 kB
_BATCH = 256  # rows in memory at once
# What an uploader licenses is not what a collector's speech recognition heard.
_OPEN = f"v.license = '{LICENCE}' AND v.transcript_origin = 'service'"
_CREDIT = ("title", "link", "channel_id", "channel_title")  # and the date


def export(run: Run) -> Summary:
    """Writes the folder, or removes it where the profile does not ask for it or there is nothing to
    write. Videos without what credit needs are left out and counted as `uncredited`.

    The same clean rows give the same bytes. Raises DamagedData, DiskFull.
    """
    return _export(run) if run.profile.release.open_text else _remove(run)


def _export(run: Run) -> Summary:
    videos = manifest.rows(run.root, "youtube/videos")
    transcripts = manifest.rows(run.root, "youtube/transcripts")
    if not videos or not transcripts:
        return _remove(run)
    files, inputs = [*videos, *transcripts], manifest.inputs(run.root, NAME)
    settings = freshness.settings(run, NAME)
    with reading(files), database.over(files, run.root) as con:
        parquet.verify_files(*files)
        named = (f"trim(coalesce(v.{column}, '')) <> ''" for column in _CREDIT)
        credited = " AND ".join(["v.published_at IS NOT NULL", *named])
        rows = f"FROM {scan(transcripts)} AS t JOIN {scan(videos)} AS v USING (video_id)"
        open_, uncredited = con.sql(
            f"SELECT count(*) FILTER ({credited}), count(*) FILTER (NOT ({credited})) {rows}"
            f" WHERE {_OPEN}"
        ).fetchall()[0]
        if not open_:
            run.progress.say("no kept video with a transcript is under Creative Commons")
            removed = _remove(run)
            nothing = manifest.new_manifest(NAME, inputs, settings, {})
            manifest.write_manifest(ARTIFACTS[NAME].manifest(run.root), nothing)
            return Summary(removed, uncredited=uncredited)
        asked = con.sql(
            f"""SELECT video_id, v.title, v.link, v.channel_id, v.channel_title, v.published_at,
                v.license, t.kind, t.language, v.word_count,
                array_to_string([cue.text FOR cue IN t.cues], ' ') AS text, t.cues
            {rows} WHERE {_OPEN} AND {credited} ORDER BY video_id"""
        )
        with manifest.replacing(
            run.root.absolute(), NAME, inputs=inputs, settings=settings
        ) as fresh:
            write_sorted(
                _batches(asked),
                fresh.folder,
                "open-text/open_text",
                shard_bytes=run.profile.release.shard_mb * 1e6,
                group_rows=_GROUP,
            )
    path = str(Layout(run.root.absolute()).release("open-text"))
    return Summary(open_text=open_, uncredited=uncredited, path=path)


def _batches(asked: duckdb.DuckDBPyRelation) -> Iterator[pa.Table]:
    with closing(asked.to_arrow_reader(_BATCH)) as reader:
        for batch in reader:
            signals.stop.raise_if_asked()
            yield pa.Table.from_batches([batch])


def _remove(run: Run) -> Summary:
    """Nothing that an earlier export wrote stays."""
    folder = Layout(run.root).release("open-text")
    if folder.exists():
        remove_path(folder)
        run.progress.say(f"{NAME} was removed: the profile does not ask for it, or it has no rows")
    ARTIFACTS[NAME].manifest(run.root).unlink(missing_ok=True)
    return Summary(open_text=0)
