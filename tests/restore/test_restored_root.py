"""What `kb restore .` brings back of a downloaded release is a data root."""

import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import kb
from tests import inprocess
from tests.cli.conftest import clean_environment
from tests.inprocess import Done


@pytest.fixture(scope="module")
def restored(downloads: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what was made beside the folder where the command was typed."""
    assert sorted(path.name for path in downloads.iterdir() if path.name[0] != ".") == [
        "release",
        "release-restored",
    ]
    place = tmp_path_factory.mktemp("restored") / "root"
    return Path(shutil.copytree(downloads / "release-restored", place))


@pytest.fixture(scope="module")
def makers(demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what the maker's exports are made of."""
    place = tmp_path_factory.mktemp("makers")
    for name in ("clean", "pairs", "state"):
        shutil.copytree(demo / "data" / "demo" / name, place / name)
    return place


def run(place: Path, *words: str) -> Done:
    done = inprocess.run(words, env=clean_environment(), cwd=place)
    assert done.code == 0, done.err
    return done


@pytest.mark.parametrize("source", ["youtube", "reddit"])
@pytest.mark.parametrize("more", [[], ["--chunk-tokens", "300"]], ids=["whole", "chunks"])
def test_documents_are_those_of_the_maker(
    makers: Path, restored: Path, tmp_path: Path, source: str, more: list[str]
) -> None:
    texts = []
    for root in (restored, makers):
        words = (source, "export", "--format", "text", *more, "--json", "--data", str(root))
        path = Path(json.loads(run(tmp_path, *words).out.splitlines()[-1])["path"])
        lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        texts.append({line["id"]: line["text"] for line in lines})
    assert texts[0] == texts[1] != {}


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("youtube export", "youtube_full.json"),
        ("reddit export", "reddit.json"),
        ("pairs", "pairs.json"),
    ],
)
def test_lists_of_minedojo_are_those_of_the_maker(
    makers: Path, restored: Path, tmp_path: Path, command: str, name: str
) -> None:
    files = []
    for root in (restored, makers):
        run(tmp_path, *command.split(), "--format", "minedojo", "--data", str(root))
        files.append((root / "export" / "minedojo" / name).read_bytes())
    assert files[0] == files[1]


def test_clips_have_their_captions(restored: Path, tmp_path: Path) -> None:
    run(tmp_path, "pairs", "--format", "video2dataset", "--data", str(restored))
    rows = pq.read_table(restored / "export" / "video2dataset" / "pairs.parquet")
    assert rows.num_rows == len(kb.load(restored)["pairs"])
    assert all(rows["caption"].to_pylist())
    (tmp_path / "films").mkdir()
    plan = run(tmp_path, "clips", "--videos", "films", "--plan", "--json", "--data", str(restored))
    assert json.loads(plan.out.splitlines()[-1])["pairs"] == rows.num_rows


def test_search_and_python_read_it(restored: Path, tmp_path: Path) -> None:
    words = ["search", "diamond", "--format", "json", "--data", str(restored)]
    answers = json.loads(run(tmp_path, *words).out)
    assert {answer["kind"] for answer in answers} & {"transcript", "comment", "post"}
    data = kb.load(restored)
    assert data.video(data["pairs"][0]["video_id"]).transcript
    assert data.thread(data["reddit_posts"][0]["post_id"])


def test_an_export_is_current_until_something_is_removed(restored: Path, tmp_path: Path) -> None:
    import shutil

    root = Path(shutil.copytree(restored, tmp_path / "mine"))
    run(tmp_path, "youtube", "export", "--format", "text", "--data", str(root))
    video = kb.load(root)["youtube_videos"][0]["video_id"]
    (tmp_path / "ids.txt").write_text(f"{video}\n")
    text = root / "export" / "text" / "youtube.jsonl"
    assert video in text.read_text()
    done = run(tmp_path, "purge", "youtube", "--ids", "ids.txt", "--data", str(root))
    assert video not in text.read_text()
    assert "out of date" not in done.err
    assert "out of date" not in run(tmp_path, "status", "--data", str(root)).out


def test_nothing_is_left_to_plan(downloads: Path) -> None:
    plan = run(downloads / "release", "restore", ".", "--plan")
    assert plan.out == "restore --plan: nothing is left to do\n"
    again = json.loads(run(downloads / "release", "restore", ".", "--plan", "--json").out)
    assert again["phases"] == []


def test_of_one_folder_it_is_made_beside_that(downloads: Path, tmp_path: Path) -> None:
    """A card's own command makes a root beside the folders, which are still read together."""
    plan = run(downloads / "release" / "pairs", "restore", ".", "--data", "../restored", "--plan")
    assert plan.out == "restore --plan: nothing is left to do\n"
    both = kb.load(downloads / "release")
    assert {"wiki_pages", "youtube_videos"} <= {*both.tables}
    assert len(kb.load(downloads / "release" / "restored")["youtube_transcripts"])
