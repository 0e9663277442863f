"""What is no regular file never hangs a command: each says in one line what it was given."""

import contextlib
import os
import shutil
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from kb.clips.frames import UndecodableVideo, frames_at
from tests.conftest import ROOT
from tests.inprocess import Here
from tests.youtube.ytdlp.folder import write_video

pytestmark = pytest.mark.timeout(60)  # one that waits never ends


def bound(path: Path) -> None:
    """A socket, by its name alone: an address has about a hundred bytes at most."""
    with socket.socket(socket.AF_UNIX) as listening, contextlib.chdir(path.parent):
        listening.bind(path.name)


def zeros(path: Path) -> None:
    path.symlink_to("/dev/zero")


KINDS: dict[str, tuple[Callable[[Path], None], str]] = {
    "FIFO": (os.mkfifo, "it is a FIFO, not a file"),
    "socket": (bound, "it is a socket, not a file"),
    "device": (zeros, "it is a device, not a file"),
}
SETTINGS = {
    "YOUTUBE_API_KEY": "k" * 39,
    "REDDIT_CLIENT_ID": "c" * 22,
    "REDDIT_CLIENT_SECRET": "",
    "KB_CONTACT": "me@lorecrawl.net",
    "KB_YOUTUBE_ENDPOINT": "http://127.0.0.1:9",  # nothing gets there
}
OPTIONS = [  # PATH is the file; in "IN" it lies in a folder that is given
    (2, "youtube crawl --ids PATH", "list.txt"),
    (2, "wiki crawl --titles IN", "Creeper/data.json"),
    (2, "wiki crawl --titles PATH", "list.txt"),
    (2, "purge youtube --ids PATH", "list.txt"),
    (2, "purge reddit --authors PATH", "list.txt"),
    (2, "purge youtube --channels PATH", "list.txt"),
    (2, "reddit reconstruct --ids PATH --out out", "list.txt"),
    (2, "reddit import PATH", "RS_2024-01.zst"),
    (1, "youtube import IN", "abcdefghijk.info.json"),
    (1, "youtube import IN", "abcdefghijk.en.vtt"),
    (1, "youtube import --own-transcripts IN", "abcdefghijk.json"),
    (2, "label import PATH", "export.json"),
    (2, "query --file PATH", "query.sql"),
    (2, "status --profile PATH", "profile.toml"),
    (2, "profile check IN/profile.toml", "keywords.tsv"),
    (2, "youtube export --format text --chunk-tokens 32 --tokenizer PATH", "tokenizer.json"),
    (2, "annotate youtube", "KB_TOXICITY_MODEL"),
]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("code", "words", "name"), OPTIONS, ids=lambda value: str(value))
def test_a_file_that_is_none(
    here: Here, tmp_path: Path, code: int, words: str, name: str, kind: str
) -> None:
    make, what = KINDS[kind]
    folder = tmp_path / "given"
    (folder / name).parent.mkdir(parents=True)
    make(folder / name)
    (tmp_path / "here" / "data" / "state").mkdir(parents=True)
    if name == "keywords.tsv":
        shutil.copy(ROOT / "data/profiles/minecraft/profile.toml", folder)
    env = SETTINGS | ({name: str(folder / name)} if name.startswith("KB_") else {})
    given = words.replace("PATH", str(folder / name)).replace("IN", str(folder))
    done = here(*given.split(), env=env)
    assert (done.code, what in done.out + done.err) == (code, True), done


IN_ROOT = [
    ("status", "clean/youtube/videos/part-00000.parquet"),
    ("query --tables", "clean/youtube/_manifest.json"),
    ("status", "state/youtube.sqlite"),
    ("verify", "state/youtube.sqlite-wal"),
    ("query --tables", "clean/reddit/posts/part-00000.parquet"),
    ("query --tables", "restored/pairs/pairs-00000-of-00001.parquet"),
    ("youtube crawl", "raw/youtube/tombstones.parquet"),
    ("reddit crawl", "state/reddit.key"),
    ("status", "release/youtube/videos-00000-of-00001.parquet"),
    ("verify data/release/reddit", "release/reddit/posts-00000-of-00001.parquet"),
    ("verify", "raw/youtube/videos/000001-abcdefgh.ndjson.zst"),
    ("verify", "state/youtube.sqlite"),
]


# A link is no part of a release, so `kb status` counts nothing of it.
CASES = [
    (words, name, kind)
    for words, name in IN_ROOT
    for kind in KINDS
    if (words, kind) != ("status", "device") or "release" not in name
]


@pytest.mark.parametrize(("words", "name", "kind"), CASES)
def test_a_file_of_a_data_root_that_is_none_is_named(
    here: Here, tmp_path: Path, words: str, name: str, kind: str
) -> None:
    make, _ = KINDS[kind]
    place = tmp_path / "here" / "data" / name
    place.parent.mkdir(parents=True)
    (tmp_path / "here" / "data" / "state").mkdir(exist_ok=True)
    make(place)
    done = here(*words.split(), env=SETTINGS)
    assert (done.code, str(place.name) in done.out + done.err) == (1, True), done


def test_a_walk_counts_and_names_it_and_reads_the_rest(here: Here, tmp_path: Path) -> None:
    folder = tmp_path / "videos"
    write_video(folder, 0, ("vtt",))
    os.mkfifo(folder / "abcdefghijk.info.json")
    zeros(folder / "abcdefghijk.en.vtt")
    done = here("youtube", "import", str(folder))
    assert done.code == 0, done.err
    assert "unreadable: abcdefghijk." in done.out
    assert "(it is a FIFO, not a file)" in done.out
    assert "(it is a device, not a file)" in done.out


@pytest.mark.parametrize("kind", KINDS)
def test_a_film_that_is_none_has_no_frames(tmp_path: Path, kind: str) -> None:
    make, what = KINDS[kind]
    make(tmp_path / "film.mp4")
    with pytest.raises(UndecodableVideo, match=what):
        next(iter(frames_at(tmp_path / "film.mp4", [1.0], (8, 8))))


def test_settings_in_a_fifo_are_refused(here: Here, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "here" / ".env")
    done = here("status")
    assert (done.code, "it is a FIFO, not a file" in done.said) == (2, True)
