"""Known ids, and the parts of several machines."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import SettingError
from kb.youtube.crawl.ids import RULES
from tests.faults import Sandbox
from tests.youtube.crawl.test_fetch import CRAWL, check
from tests.youtube.job import Job


def test_two_parts_copied_together_are_the_whole(job: Job, few: Sandbox, tmp_path: Path) -> None:
    import shutil

    roots = []
    for part in ("1/2", "2/2"):
        one = Job(few, tmp_path / part[0])
        one.done(*CRAWL, "--part", part)
        roots.append(one.root)
    for number, root in enumerate(roots):
        for path in (root / "raw").rglob("*.zst*"):
            target = job.root / "raw" / path.relative_to(root / "raw")
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target.with_name(f"{number}-{path.name}"))
    check(job)
    watched = [seen.about for seen in few.ledger.requests("/watch")]
    assert len(watched) == len(set(watched))  # no video was in both parts


def test_one_part_after_the_other_in_one_root_is_the_whole(job: Job) -> None:
    job.done(*CRAWL, "--part", "1/2")
    listed = len(job.sandbox.ledger.requests("/playlistItems"))
    job.done(*CRAWL, "--part", "2/2")
    assert 0 < listed < len(job.sandbox.ledger.requests("/playlistItems"))
    check(job)


def test_known_ids_alone_leave_no_search_behind(job: Job) -> None:
    file = job.place / "ids.txt"
    file.write_text("\ufeff" + "\n".join(job.sandbox.world.youtube.videos), encoding="utf-8")
    assert job.done(*CRAWL, "--ids", str(file))["bad_lines"] == 0
    assert job.done("status")["left"] == 0
    check(job)
    assert "--again" in job.kb(*CRAWL, "--ids", str(file)).stderr
    assert "--again" not in job.kb(*CRAWL, "--ids", str(file), "--again").stderr


def test_ids_of_a_release_s_folder(tmp_path: Path) -> None:
    folder = tmp_path / "release"
    folder.mkdir()
    with pytest.raises(SettingError, match="contains no released videos or pairs"):
        RULES.read(folder)
    for number, key in enumerate(("aaaaaaaaaaa", "bbbbbbbbbbb")):
        rows = pa.table({"video_id": [key], "title": ["t"]})
        pq.write_table(rows, folder / f"videos-0000{number}-of-00002.parquet")
    pq.write_table(pa.table({"video_id": ["ccccccccccc"]}), folder / "sample-videos.parquet")
    assert RULES.read(folder)[::2] == (["aaaaaaaaaaa", "bbbbbbbbbbb"], 0)


def test_known_ids_skip_discovery(job: Job) -> None:
    ids = [video.id for video in job.sandbox.world.youtube.videos.values()]
    file = job.place / "ids.txt"
    file.write_text("\n".join([*ids[:20], "not an id", *ids[20:], ids[0]]) + "\n")
    summary = job.done(*CRAWL, "--ids", str(file))
    assert (summary["crawled"], summary["bad_lines"]) == (len(ids), 1)
    assert not job.sandbox.ledger.requests("/search|/playlistItems")
    assert job.sandbox.ledger.units() == 1
    check(job)
