"""Whoever has only downloaded a release gets its content back: all that is still there, and
nothing that was removed.
"""

import hashlib
import json
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zstandard

import kb
from kb import query
from kb.core.config.pipeline import Recipe
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import DamagedData, LimitReached, MissingCredential, QuotaSpent, SettingError
from kb.net import retry
from kb.reddit.parse.anonymize import keyed, load_key
from kb.release.folders import find
from kb.schema import table
from kb.store.state import tombstones
from kb.youtube.parse.channels import mark
from tests import recipes
from tests.reddit.dumped import write
from tests.reddit.restore.test_tables import archived
from tests.reddit.work import NOW, rows, texts
from tests.release.conftest import a_run
from tests.release.made import build
from tests.restore.conftest import Made
from tests.youtube.job import Job

KEYS = ("youtube_api_key", "reddit_client_id", "reddit_client_secret")
TABLES = {"youtube": ("videos", "transcripts"), "reddit": ("posts", "comments")}
# Of the maker's own machine: hashes by its own key, and what a model of theirs said.
OWN = ("author_hash", "score_source")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KB_NOW", NOW)
    monkeypatch.setattr(retry, "FIRST_S", 0.001)


@pytest.fixture
def release(made: Made, tmp_path: Path) -> Path:
    """The release folders alone, as somebody downloaded them."""
    return shutil.copytree(made.release, tmp_path / "downloaded")


class Reader:
    """Somebody with a fresh folder and the services' addresses."""

    def __init__(self, made: Made, root: Path) -> None:
        self.made, self.root = made, root

    def run(self, *, without: tuple[str, ...] = (), **options: Any) -> Run:
        values = {name.lower(): value for name, value in self.made.sandbox.settings().items()}
        kept = {name: value for name, value in values.items() if name not in without}
        settings = load_settings(dotenv=False, kb_data=self.root, **kept)
        profile = load_profile("minecraft")
        return Run(settings=settings, profile=profile, root=self.root, workers=1, **options)

    def restore(self, *folders: Path, dumps: Any = (), only: Any = None, **options: Any) -> Any:
        return Recipe("restore").defined("restore")(self.run(**options), find(folders), dumps, only)

    def plan(self, *folders: Path, dumps: Any = (), only: Any = None, **options: Any) -> Any:
        return Recipe("restore").defined("plan")(self.run(**options), find(folders), dumps, only)

    def rows(self, sql: str) -> list[dict[str, Any]]:
        with query.connect(self.root) as db:
            return query.select(db, sql).read_all().to_pylist()


@pytest.fixture
def reader(made: Made, tmp_path: Path) -> Reader:
    return Reader(made, tmp_path / "data")


def comparable(found: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    left = [
        {name: value for name, value in row.items() if name not in OWN and "toxicity" not in name}
        for row in found
    ]
    return sorted(left, key=lambda row: row[key])


def is_whole(made: Made, reader: Reader, *sources: str) -> None:
    """Every row that the maker kept, column by column."""
    for source in sources:
        for name in TABLES[source]:
            key = table(f"{source}/{name}").key[0]
            mine = comparable(rows(reader.root / "restored" / source / name), key)
            assert mine == comparable(rows(made.root / "clean" / source / name), key), name


def test_everything_comes_back_killed_three_times_on_the_way(
    made: Made, release: Path, tmp_path: Path
) -> None:
    job, faults = Job(made.sandbox, tmp_path / "far"), made.sandbox.faults
    since = len(made.sandbox.ledger)
    for path, after in (("/v3/videos", 0), ("/timedtext", 20), ("api/info", 1)):
        held = faults.add(path, after=after, hold=True)
        child = job.start("restore", str(release))
        assert held.arrived.wait(60)
        child.send_signal(signal.SIGKILL)
        child.communicate()
        held.release()
        faults.remove(held)
    summary = job.done("restore", str(release))
    reader = Reader(made, job.root)
    is_whole(made, reader, "youtube", "reddit")
    mine, theirs = (
        sorted((row["pair_id"], row["text"]) for row in rows(place, "pairs-*.parquet"))
        for place in (job.root / "restored" / "pairs", made.root / "pairs")
    )
    assert mine == theirs
    assert all(text for _, text in mine)
    assert (summary["missing"], summary["failed"]) == (0, 0)
    asked = [seen.path for seen in made.sandbox.ledger.requests(since=since)]
    assert sum("/v3/videos" in path for path in asked) == 2  # the one that was held, and again
    assert not [path for path in job.root.rglob("*") if ".work" in path.name]
    # A second time there is nothing to ask.
    since = len(made.sandbox.ledger)
    assert job.done("restore", str(release), YOUTUBE_API_KEY="")["requests"] == 0
    assert len(made.sandbox.ledger) == since
    listed = {row["view"] for row in _listed(job)}
    assert listed >= {
        *("youtube_videos", "youtube_transcripts", "reddit_posts", "reddit_comments"),
        *("pairs", "missing"),
    }
    assert len(kb.load(job.root)["youtube_transcripts"]) == summary["transcripts"]


def _listed(job: Job) -> list[dict[str, Any]]:
    return [
        one._asdict()
        for one in query.catalog(query.find_views(job.root))
        if one.schema == "restored"
    ]


@pytest.fixture(scope="session")
def month(made: Made, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Dumps of the moment of the crawl."""
    place, world = tmp_path_factory.mktemp("dumps"), made.work.world
    return [
        write(place / name, list(archived(shown for key in keys if (shown := world.shown(key)))))
        for name, keys in (
            ("RS_2026-11.zst", [f"t3_{key}" for key in world.posts]),
            ("RC_2026-11.zst", [f"t1_{key}" for key in world.comments]),
        )
    ]


def test_out_of_dumps_without_key_or_address(
    made: Made, reader: Reader, release: Path, month: list[Path]
) -> None:
    since = len(made.sandbox.ledger)
    off = (*KEYS, "kb_reddit_endpoint", "kb_youtube_endpoint", "kb_youtube_web", "kb_contact")
    summary = reader.restore(release, dumps=month, only="reddit", without=off)
    is_whole(made, reader, "reddit")
    assert (summary["missing"], summary["requests"]) == (0, 0)
    assert len(made.sandbox.ledger) == since


@pytest.fixture
def emptied(made: Made) -> Iterator[tuple[list[str], list[str]]]:
    """Removed at their source after the release: ids of videos, full names of posts; what they
    said.
    """
    videos = [row["video_id"] for row in rows(made.root / "clean" / "youtube" / "videos")][:2]
    posts = [row["post_id"] for row in rows(made.root / "clean" / "reddit" / "posts")][:2]
    world = made.sandbox.world
    mine = [video for video in world.youtube.videos.values() if video.id in videos]
    for video in mine:
        video.in_api = False
    world.reddit.gone.add(f"t3_{posts[0]}")
    world.reddit.removed.add(f"t3_{posts[1]}")
    yield videos, [f"t3_{key}" for key in posts]
    for video in mine:
        video.in_api = True
    world.reddit.gone.discard(f"t3_{posts[0]}")
    world.reddit.removed.discard(f"t3_{posts[1]}")


def said(made: Made, videos: list[str], posts: list[str]) -> list[str]:
    """Words that stand nowhere else: titles of what was removed, and what was spoken."""
    found = []
    for row in rows(made.root / "clean" / "youtube" / "videos"):
        found += [row["title"]] if row["video_id"] in videos else []
    for row in rows(made.root / "clean" / "youtube" / "transcripts"):
        if row["video_id"] in videos:
            found.append(" ".join(cue["text"] for cue in row["cues"])[:200])
    for row in rows(made.root / "clean" / "reddit" / "posts"):
        found += [row["title"]] if f"t3_{row['post_id']}" in posts else []
    others = {row["title"] for row in rows(made.root / "clean" / "reddit" / "posts")} - set(found)
    return [words for words in found if words and words not in others]


def test_nothing_that_was_removed_comes_back_from_any_source(
    made: Made,
    reader: Reader,
    release: Path,
    month: list[Path],
    emptied: tuple[list[str], list[str]],
) -> None:
    videos, posts = emptied
    reader.restore(release)
    reader.restore(
        release, dumps=_changed(month, reader.root.parent / "older", _a_day_before), only="reddit"
    )
    words = said(made, videos, posts)
    assert len(words) >= 4
    for path, text in texts(reader.root).items():
        assert not [one for one in words if one in text], path
    found = reader.rows("SELECT part, key, reason FROM restored.missing WHERE source <> 'pairs'")
    reasons = {(row["part"], row["key"]): row["reason"] for row in found}
    assert reasons[("video", videos[0])] == reasons[("video", videos[1])] == "missing"
    assert (reasons[("post", posts[0])], reasons[("post", posts[1])]) == ("missing", "removed")
    lost = reader.rows("SELECT DISTINCT video_id FROM restored.pairs WHERE text IS NULL")
    assert {row["video_id"] for row in lost} <= set(videos)
    kept = made.root / "clean" / "youtube" / "videos"
    assert len(rows(reader.root / "restored" / "youtube" / "videos")) == len(rows(kept)) - 2


def _a_day_before(record: dict[str, Any]) -> dict[str, Any]:
    return {**record, "retrieved_on": record["retrieved_on"] - 86_400}


def _changed(files: list[Path], place: Path, change: Any) -> list[Path]:
    """The same dumps, each record changed."""
    place.mkdir()
    found = []
    for file in files:
        text = zstandard.ZstdDecompressor().stream_reader(file.read_bytes()).read()
        records = [change(json.loads(line)) for line in text.splitlines()]
        found.append(write(place / file.name, records))
    return found


def test_what_the_archive_saw_deleted_later_is_not_restored_from_it(
    made: Made, reader: Reader, release: Path, month: list[Path]
) -> None:
    """The dumps still hold the text of its first visit."""
    kept = {
        f"{prefix}_{row[key]}": row["body"] or row["title"]
        for name, prefix, key in (("posts", "t3", "post_id"), ("comments", "t1", "comment_id"))
        for row in rows(made.root / "clean" / "reddit" / name)[:1]
    }

    def seen_again(record: dict[str, Any]) -> dict[str, Any]:
        kind = "t3" if "title" in record else "t1"
        meta = {"retrieved_2nd_on": record["retrieved_on"] + 130_000}
        if f"{kind}_{record['id']}" in kept:
            meta |= {"was_deleted_later": True, "removal_type": "deleted"}
        return {**record, "_meta": meta}

    older = _changed(month, reader.root.parent / "older", _a_day_before)
    later = _changed(month, reader.root.parent / "later", seen_again)
    for dumps in (later, older):
        reader.restore(release, dumps=dumps, only="reddit")
        found = reader.rows("SELECT key, reason FROM restored.missing WHERE source = 'reddit'")
        assert {row["key"]: row["reason"] for row in found} == dict.fromkeys(kept, "deleted")
        for path, text in texts(reader.root / "restored").items():
            assert not [one for one in kept.values() if one in text], path


def test_tombstones_of_a_release_are_never_asked_for(
    made: Made, reader: Reader, release: Path, month: list[Path]
) -> None:
    video = rows(made.root / "clean" / "youtube" / "videos")[3]["video_id"]
    post = rows(made.root / "clean" / "reddit" / "posts")[3]["post_id"]
    reader.restore(release)
    assert video in {row["video_id"] for row in reader.rows("FROM restored.youtube_videos")}
    _bury(release / "youtube", "youtube", video)
    _bury(release / "reddit", "reddit", f"t3_{post}")
    since = len(made.sandbox.ledger)
    for again in (False, True):
        reader.restore(release, again=again)
        reader.restore(release, dumps=month, only="reddit")
        assert not reader.rows(f"FROM restored.youtube_videos WHERE video_id = '{video}'")
        assert not reader.rows(f"FROM restored.youtube_transcripts WHERE video_id = '{video}'")
        assert not reader.rows(f"FROM restored.pairs WHERE video_id = '{video}'")
        assert not reader.rows(f"FROM restored.reddit_posts WHERE post_id = '{post}'")
    found = reader.rows("SELECT key, reason FROM restored.missing")
    reasons = {row["key"]: row["reason"] for row in found}
    assert reasons[video] == reasons[f"t3_{post}"] == "purged"
    asked = " ".join(str(seen.args) for seen in made.sandbox.ledger.requests(since=since))
    assert video not in asked
    assert f"t3_{post}" not in asked


def _bury(folder: Path, source: str, key: str) -> None:
    """A newer release's tombstone."""
    place = folder / "tombstones.ndjson"
    row = {"key": key, "source": source, "removed_at": "2023-11-14T22:13:20Z", "reason": "named"}
    place.write_text(f"{json.dumps(row)}\n")
    digest = hashlib.sha256(place.read_bytes()).hexdigest()
    sums = (folder / "SHA256SUMS").read_text().splitlines()
    kept = [line for line in sums if not line.endswith("  tombstones.ndjson")]
    lines = [*kept, f"{digest}  tombstones.ndjson"]
    (folder / "SHA256SUMS").write_text("".join(f"{line}\n" for line in lines))


def test_people_who_asked_this_reader_to_be_left_out_are_not_restored(
    made: Made, reader: Reader, release: Path
) -> None:
    """The maker knows nothing of it: the release has their items and no tombstone."""
    videos, world = rows(made.root / "clean" / "youtube" / "videos"), made.sandbox.world.reddit
    channel = videos[0]["channel_id"]
    theirs = {row["video_id"] for row in videos if row["channel_id"] == channel}
    name = world.posts[rows(made.root / "clean" / "reddit" / "posts")[0]["post_id"]]["author"]
    released = {
        **{
            f"t3_{row['post_id']}": world.posts
            for row in rows(release / "reddit", "posts-*.parquet")
        },
        **{
            f"t1_{row['comment_id']}": world.comments
            for row in rows(release / "reddit", "comments-*.parquet")
        },
    }
    own = {key for key, things in released.items() if things[key[3:]]["author"] == name}
    reader.root.mkdir()
    person = keyed(load_key(reader.root), name.lower())
    for source, mark_ in (("youtube", mark(channel)), ("reddit", person)):
        tombstones.add_tombstones(reader.root, source, [(f"{tombstones.PERSON}{mark_}", "named")])
    for again in (False, True):
        reader.restore(release, again=again)
        found = reader.rows("SELECT part, key, reason FROM restored.missing")
        purged = {row["key"] for row in found if row["reason"] == "purged"}
        assert purged == own | theirs
        restored = rows(reader.root / "restored" / "youtube" / "videos")
        assert {row["video_id"] for row in restored} == {row["video_id"] for row in videos} - theirs
    for path, text in texts(reader.root).items():
        marked = [one for one in (channel, person, name) if one in text]
        assert not marked or Path(path).stem == "tombstones", path


def test_a_purge_reaches_what_was_restored(made: Made, reader: Reader, release: Path) -> None:
    reader.restore(release)
    video = rows(reader.root / "restored" / "youtube" / "videos")[0]
    post = rows(reader.root / "restored" / "reddit" / "posts")[0]
    ids = reader.root.parent / "ids.txt"
    for source, key in (("youtube", video["video_id"]), ("reddit", f"t3_{post['post_id']}")):
        ids.write_text(key)
        assert Recipe("purge").defined("purge")(reader.run(), source, ids)["rows"] > 0
    reader.restore(release)
    assert tombstones.keys(reader.root, "youtube") == {video["video_id"]}
    for path, text in texts(reader.root / "restored").items():
        assert video["title"] not in text, path
        assert "missing" in path or video["video_id"] not in text, path
    assert not reader.rows(f"FROM restored.reddit_posts WHERE post_id = '{post['post_id']}'")
    of_it = f"FROM restored.reddit_comments WHERE post_id = '{post['post_id']}'"
    assert not reader.rows(of_it)


def test_a_credential_that_lacks_is_named_before_anything_is_sent(
    made: Made, reader: Reader, release: Path
) -> None:
    since = len(made.sandbox.ledger)
    with pytest.raises(MissingCredential, match="YOUTUBE_API_KEY"):
        reader.restore(release, without=("youtube_api_key",))
    with pytest.raises(MissingCredential, match="REDDIT_CLIENT_ID") as caught:
        reader.restore(release, without=("reddit_client_id",))
    assert "--dumps" in caught.value.hint
    assert len(made.sandbox.ledger) == since
    assert not (reader.root / "restored").exists()


def test_the_plan_says_what_of_whom_and_with_which_key(
    made: Made, reader: Reader, release: Path, month: list[Path]
) -> None:
    since = len(made.sandbox.ledger)
    phases = reader.plan(release, without=("reddit_client_id",))["phases"]
    told = [(one["phase"], one["items"], one["units"]) for one in phases]
    kept = {name: len(rows(made.root / "clean" / "youtube" / name)) for name in TABLES["youtube"]}
    assert told[0] == ("videos of YouTube's Data API, YOUTUBE_API_KEY", kept["videos"], 1)
    assert told[1][:2] == ("transcripts of youtube.com, no key", kept["videos"])
    assert told[2][0] == "posts and comments of Reddit, REDDIT_CLIENT_ID (not set)"
    assert told[3][1] == len(rows(made.root / "pairs", "pairs-*.parquet"))
    by_dump = reader.plan(release, dumps=month, only="reddit")["phases"]
    assert [one["phase"] for one in by_dump] == ["posts and comments of dumps, no key"]
    assert len(made.sandbox.ledger) == since
    assert not reader.root.exists()


def test_one_part_alone(made: Made, reader: Reader, release: Path) -> None:
    done = reader.restore(release, only="pairs", without=KEYS[1:])
    assert done["filled"] == done["pairs"] == len(rows(made.root / "pairs", "pairs-*.parquet"))
    assert not (reader.root / "restored" / "reddit").exists()
    assert (reader.root / "restored" / "profile.toml").is_file()
    answers = kb.load(reader.root).search("the", source="youtube").to_pylist()
    assert any(one["kind"] == "transcript" for one in answers)  # of what was restored
    with pytest.raises(SettingError, match="--only reddit"):
        reader.restore(release / "youtube", only="reddit")


def test_of_the_wiki_nothing_is_brought_back(reader: Reader, tmp_path: Path) -> None:
    root = build(tmp_path / "wiki", sources=("wiki",))
    recipes.release(a_run(root))
    since = len(reader.made.sandbox.ledger)
    assert reader.restore(root / "release", without=KEYS)["failed"] == 0
    assert not (reader.root / "restored").exists()
    assert len(reader.made.sandbox.ledger) == since


def test_a_stopped_source_leaves_the_others_and_what_it_had(
    made: Made, reader: Reader, release: Path
) -> None:
    with pytest.raises(LimitReached) as limit:
        reader.restore(release / "youtube", limit=10)
    assert limit.value.summary is not None
    assert limit.value.summary["videos"] == 10
    body = {"error": {"code": 403, "errors": [{"reason": "quotaExceeded"}]}}
    fault = made.sandbox.faults.add("/v3/videos", status=403, body=body, times=None)
    with pytest.raises(QuotaSpent) as spent:
        reader.restore(release)
    made.sandbox.faults.remove(fault)
    assert spent.value.summary is not None
    assert (spent.value.summary["videos"], spent.value.summary["failed"]) == (10, 0)
    is_whole(made, reader, "reddit")


@pytest.mark.parametrize("harm", ["changed", "gone", "foreign", "no sums", "no release"])
def test_a_folder_that_is_not_whole_is_refused(
    made: Made, reader: Reader, release: Path, harm: str
) -> None:
    folder, since = release / "reddit", len(made.sandbox.ledger)
    (shard,) = folder.glob("posts-*.parquet")
    wrong: type[Exception] = DamagedData
    if harm == "changed":
        (folder / "LICENSE").write_text("mine")
    elif harm == "gone":
        (folder / "DATASHEET.md").unlink()
    elif harm == "foreign":
        shutil.copy(shard, folder / "posts-00001-of-00002.parquet")
    elif harm == "no sums":
        (folder / "SHA256SUMS").unlink()
    else:
        folder, wrong = folder.parent.parent, SettingError
    with pytest.raises(wrong):
        reader.restore(folder)
    assert len(made.sandbox.ledger) == since
