"""A data root in which every kind of file lies, also what killed commands and others left."""

import io
from datetime import UTC, datetime
from pathlib import Path

from PIL import Image

from kb.labels.imports import replace_answers
from kb.store.layout import Layout
from kb.store.rawlog import rawlog, sidefiles
from tests.wiki.handmade_data import MONDAY, captured, page, told
from tests.youtube.job import Job

LEFT = (
    "raw/youtube/videos/.000009-0000000a.ndjson.zst.part",
    "raw/youtube/videos/.000009-0000000b.ndjson.zst.7-7-ab.tmp",
    "raw/wiki/pages/.shot-abc/screenshot.png",
    "annotations/youtube/.toxicity.parquet.7-7-ab.tmp",
    "annotations/.youtube.new/toxicity.parquet",
    "labels/.labels-00000-of-00001.parquet.7-7-ab.tmp",
    "clean/.youtube.new/videos/part-00000.parquet",
    "state/reddit-import/x.lease",
)
"""What killed commands leave on their way."""

STRANGE = (
    "raw/.DS_Store",
    "raw/youtube/README.txt",
    "raw/youtube/videos/._000001-1f2e3d4c.ndjson.zst",
    "raw/youtube/videos/000001-1f2e3d4c.ndjson.zst.sha256",
    "raw/wiki/images/Thumbs.db",
    "annotations/youtube/notes.txt",
    "annotations/youtube/._toxicity.parquet",
    "annotations/reddit/_manifest.json~",
)
"""What other programs and people put beside."""


def add_everything(job: Job, machine: int, *, litter: bool = True) -> None:
    """Add to a root with clean tables and scores: a wiki, labels, set-aside bytes and litter."""
    root = job.root
    _wiki(root, machine)
    videos = [row["video_id"] for row in job.rows("FROM clean.youtube_videos ORDER BY video_id")]
    old, new = (datetime(2026, 11, day, tzinfo=UTC) for day in (1, machine + 2))
    for item, who, what, at in (
        ("both", 1, "yes" if machine == 1 else "no", new),
        (f"own{machine}", machine, "yes", old),
    ):
        answer = _answer("pair", item, videos[0], who, what, at)
        replace_answers(root, "pair", item, who, [answer])
    if not litter:
        return
    segment = rawlog.segments(root, "youtube", "videos")[0]
    segment.with_name(f"{segment.name}.damaged-77").write_bytes(b"damaged")
    image = next(Layout(root).images.glob("*.png"))
    image.with_name(f"{image.name}{sidefiles.QUARANTINE_SUFFIX}").write_bytes(b"damaged")
    for name in (*LEFT, *STRANGE):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"litter")


def _answer(
    kind: str, item: str, video: str, who: int, what: str, at: datetime
) -> dict[str, object]:
    return {
        "kind": kind, "item_id": item, "video_id": video, "annotator": who,
        "question": "visible", "answer": what, "labelled_at": at,
    }  # fmt: skip


def _wiki(root: Path, machine: int) -> None:
    key = machine * 10
    title = f"Kiln {machine}"
    asked = {"round": "1", "titles": title, "page_id": str(key)}
    for kind, answer in (
        ("pages", told(page(key, title))),
        ("renders", captured(root, key, title)),
    ):
        segment = rawlog.Segment(rawlog.folder(root, "wiki", kind))
        request = rawlog.Request("http://wiki.example/w/api.php", asked)
        segment.append(rawlog.encode(rawlog.Envelope(MONDAY, request, 200, answer)))
        segment.close()
    folder = Layout(root).captures / str(key) / "1"
    picture = io.BytesIO()
    Image.new("RGB", (1280, 2000), (key, 0, 0)).save(picture, "png")
    (folder / "screenshot.png").write_bytes(picture.getvalue())
    (folder / "page.html.zst").write_bytes(rawlog.compressor().compress(b"<html>"))
    sidefiles.write_sums(folder)
    image = Layout(root).images
    image.mkdir(exist_ok=True)
    data = picture.getvalue()
    sidefiles.write_named(image / f"{sidefiles.digest(folder / 'screenshot.png')}.png", data)
