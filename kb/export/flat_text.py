"""`--format text`: a JSON line a video with the text of its transcript, for text pipelines such as
datatrove's JsonlReader. For one's own use: transcripts are the uploaders', and are not released.
"""

from kb.artifacts import manifest
from kb.core.context import Run
from kb.core.summary import Summary
from kb.export.rows import check_rows
from kb.store.atomic import writing
from kb.store.layout import Layout
from kb.store.tables import database
from kb.store.tables.reading import scan

_BATCH = 1_000  # rows


def youtube(run: Run) -> Summary:
    """Writes `id`, `text` (its cues, parted by spaces), `language`, `kind`, `title` and `link` of
    each kept video with a transcript, by id. Raises FatalError without clean rows, DiskFull.
    """
    check_rows(run.root, "youtube/transcripts")
    path = Layout(run.root).export("text", "youtube.jsonl")
    files = (
        manifest.rows(run.root, "youtube/transcripts"),
        manifest.rows(run.root, "youtube/videos"),
    )
    transcripts, videos = map(scan, files)
    count = 0
    with (
        writing(path) as temporary,
        temporary.open("w", encoding="utf-8") as file,
        database.over([*files[0], *files[1]], run.root) as con,
    ):
        lines = con.sql(
            f"""
            SELECT to_json({{
                id: video_id,
                text: coalesce(array_to_string([cue.text FOR cue IN cues], ' '), ''),
                language: t.language, kind: t.kind, title: v.title, link: v.link
            }})::VARCHAR AS line
            FROM {transcripts} AS t JOIN {videos} AS v USING (video_id) ORDER BY video_id"""
        )
        for batch in lines.to_arrow_reader(_BATCH):
            file.writelines(f"{line}\n" for line in batch["line"].to_pylist())
            count += batch.num_rows
    return Summary(format="text", videos=count, path=str(path))
