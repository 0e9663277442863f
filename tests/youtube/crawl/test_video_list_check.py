"""How much of a published list lives: counted by year, and nothing else is kept."""

import json
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import LimitReached, MissingCredential
from kb.sandbox.world import World
from kb.sandbox.youtube.cases import Video
from kb.schema.decode import holdable
from kb.youtube.crawl import video_list_check as room
from tests.faults import Sandbox
from tests.youtube.job import Job


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(World(n_channels=4, n_videos=130), services=["youtube"]) as sandbox:
        yield sandbox


@pytest.fixture
def videos(sandbox: Sandbox) -> list[Video]:
    """Those that are there, with all that a list says."""
    every = sandbox.world.youtube.videos.values()
    return [one for one in every if one.in_api and one.duration == "" and one.published_at]


def run(sandbox: Sandbox, root: Path, **options: Any) -> Run:
    values = {name.lower(): value for name, value in sandbox.settings().items()}
    values |= {name: options.pop(name) for name in list(options) if name == "youtube_api_key"}
    settings = load_settings(dotenv=False, kb_data=root, **values)
    profile = load_profile("minecraft")
    return Run(settings=settings, profile=profile, root=root, workers=1, **options)


def years(videos: list[Video]) -> dict[str, int]:
    found: dict[str, int] = {}
    for one in videos:
        found[one.published_at[:4]] = found.get(one.published_at[:4], 0) + 1
    return found


def test_there_changed_and_gone_by_year_of_mine_dojos_list(
    sandbox: Sandbox, videos: list[Video], tmp_path: Path
) -> None:
    listed = [
        {"id": one.id, "title": one.title, "duration": one.seconds, "link": ""} for one in videos
    ]
    listed[0]["title"] = "what it was called before"
    listed[1]["duration"] = videos[1].seconds + 60
    listed += [{"id": f"gone{n:07d}", "title": "x", "duration": 1} for n in range(3)]
    ids = tmp_path / "youtube_full.json"
    ids.write_text(json.dumps(listed))
    since, root = len(sandbox.ledger), tmp_path / "data"
    calls = -(-len(listed) // 50)
    assert room.plan(run(sandbox, root), ids)["units"] == calls
    assert len(sandbox.ledger) == since
    summary = room.check(run(sandbox, root), ids)
    assert (summary["there"], summary["changed"], summary["gone"]) == (len(videos) - 2, 2, 3)
    assert summary["units"] == calls == len(sandbox.ledger.requests(since=since))
    by_year = summary["by_year"]
    assert by_year.pop(room.UNKNOWN) == {"gone": 3}
    assert {year: sum(found.values()) for year, found in by_year.items()} == years(videos)
    # Counts, and not a word of any video.
    files = [path for path in root.rglob("*") if path.is_file()]
    assert [path.suffix for path in files if "check" in str(path)] == [".json"]
    for path in files:
        text = path.read_text(encoding="utf-8", errors="replace")
        assert not [one for one in videos if one.title in text or one.id in text], path
    table = list(room.lines(room.check(run(sandbox, root), ids)))
    assert len(table) == 2 + len(by_year)
    assert len(sandbox.ledger.requests(since=since)) == calls  # told again, not asked again
    again = room.check(run(sandbox, root, again=True), ids)
    assert (again["units"], again["there"]) == (calls, len(videos) - 2)


def test_what_is_gone_has_the_year_that_a_released_table_says(
    sandbox: Sandbox, videos: list[Video], tmp_path: Path, make_rows
) -> None:
    keys, titles = [one.id for one in videos], [str(holdable(one.title)) for one in videos]
    dates = [*(one.published_at for one in videos), "2013-05-01T00:00:00Z"]
    rows = make_rows(
        "youtube/videos",
        len(dates),
        released=True,
        video_id=[*keys, "gone0000001"],
        title=[*titles, "x"],
        duration_s=[*(one.seconds for one in videos), 1],
        published_at=[datetime.fromisoformat(date) for date in dates],
    )
    pq.write_table(rows, tmp_path / "videos-00000-of-00001.parquet")
    found = room.check(run(sandbox, tmp_path / "data"), tmp_path)
    assert found["by_year"]["2013"]["gone"] == found["gone"] == 1
    assert found["changed"] == 0


def test_stopped_it_goes_on_and_keeps_verdicts_alone(
    sandbox: Sandbox, videos: list[Video], tmp_path: Path
) -> None:
    ids, root = tmp_path / "ids.txt", tmp_path / "data"
    ids.write_text("".join(f"https://youtu.be/{one.id}\n" for one in videos))
    since = len(sandbox.ledger)
    with pytest.raises(LimitReached):
        room.check(run(sandbox, root, limit=50), ids)
    job = Job(sandbox, tmp_path)
    done = job.done("youtube", "check", "--ids", str(ids))
    assert (done["there"], done["changed"]) == (len(videos), 0)
    calls = -(-len(videos) // 50)
    assert len(sandbox.ledger.requests("/v3/videos", since=since)) == calls


def test_without_a_key_nothing_is_asked(sandbox: Sandbox, tmp_path: Path) -> None:
    (tmp_path / "ids.txt").write_text("abcdefghijk")
    with pytest.raises(MissingCredential):
        room.check(run(sandbox, tmp_path, youtube_api_key=None), tmp_path / "ids.txt")
