"""`kb clips` as a user: films that carry frame numbers, cut at the pairs of a made release."""

import csv
import io
import itertools
import json
import math
import os
import shutil
import subprocess
import sys
import tarfile
import threading
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import duckdb
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from kb.clips import build
from kb.clips.clip_files import CutOptions
from kb.core.context import Run
from kb.core.errors import UsageError
from kb.pairs.clip_tokens import token_ids
from tests.clips.films import film, number_of
from tests.conftest import ROOT
from tests.release.conftest import a_run
from tests.release.made import build as made

IDS = [f"vid{n:08d}" for n in range(4)]  # 0: whole, 1: short, 2: no film, 3: no file
OPTIONS = CutOptions(frames=4, size=(90, 160))


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A data root with eight pairs of four videos, and the folder with the films."""
    root = made(tmp_path_factory.mktemp("root"), sources=("pairs",), n=4, export=False)
    films = tmp_path_factory.mktemp("films")
    (root / "state").mkdir()
    for key, frames in ((IDS[0], 700), (IDS[1], 260)):
        path = films / f"A film [{key}].mp4"
        film(path, "libx264", range(frames), Fraction(1, 25), (160, 90), {"preset": "veryfast"})
    (films / f"{IDS[2]}.mp4").write_bytes(b"no film")
    return root, films


@pytest.fixture
def run(places: tuple[Path, Path]) -> Run:
    return replace(a_run(places[0]), workers=1)


def _pairs(root: Path) -> dict[str, dict]:
    rows = duckdb.sql(f"FROM '{root}/pairs/p*.parquet'").to_arrow_table().to_pylist()
    return {row["pair_id"]: row for row in rows}


def _shards(out: Path) -> Iterator[tuple[str, bytes]]:
    for path in sorted(out.glob("*.tar")):
        with tarfile.open(path) as tar:
            for member in tar:
                yield member.name, tar.extractfile(member).read()


def test_every_pair_is_a_clip_or_has_a_reason(run: Run, places, tmp_path: Path) -> None:
    root, films = places
    summary = build.build(run, [films], tmp_path / "out", OPTIONS, build.Chosen())
    counts = {name: summary[name] for name in ("clips", "missing", "short", "undecodable")}
    assert counts == {"clips": 2, "missing": 2, "short": 2, "undecodable": 2}
    with (tmp_path / "out/left_out.csv").open() as file:
        text = file.read()
    reasons = {row["video_id"]: row["reason"] for row in csv.DictReader(text.splitlines())}
    assert reasons == {IDS[1]: "short", IDS[2]: "undecodable", IDS[3]: "missing"}
    assert str(films) not in text  # the list may be shared
    pairs = {key for key, row in _pairs(root).items() if row["video_id"] == IDS[0]}
    assert {name.partition(".")[0] for name, _ in _shards(tmp_path / "out")} == pairs


def test_frames_are_those_of_the_clip(run: Run, places, tmp_path: Path) -> None:
    root, films = places
    build.build(run, [films], tmp_path / "out", OPTIONS, build.Chosen())
    files = dict(_shards(tmp_path / "out"))
    for key in {name.partition(".")[0] for name in files}:
        row, about = _pairs(root)[key], json.loads(files[f"{key}.json"])
        images = [np.asarray(Image.open(io.BytesIO(files[f"{key}.{n:02d}.jpg"]))) for n in range(4)]
        length = row["clip_end_s"] - row["clip_start_s"]
        times = [row["clip_start_s"] + (n + 0.5) / 4 * length for n in range(4)]
        assert about["frame_times_s"] == pytest.approx(times)
        assert about["keyword"] == row["keyword"]
        shown = [math.floor(Fraction(time) * 25) for time in about["frame_times_s"]]
        assert [number_of(image) for image in images] == shown
        assert (np.load(io.BytesIO(files[f"{key}.tokens.npy"])) == token_ids(row["text"])).all()


def test_archives_have_the_shape_that_models_take(run: Run, places, tmp_path: Path) -> None:
    options = CutOptions(frames=16, format="npz")
    build.build(run, [places[1]], tmp_path, options, build.Chosen())
    archives = list((tmp_path / IDS[0]).glob("*.npz"))
    assert len(archives) == 2
    with np.load(archives[0], allow_pickle=False) as one:
        assert one["video"].shape == (16, 3, 160, 256)
        assert one["video"].dtype == np.uint8
        assert one["tokens"].shape == (77,)


def test_a_second_run_cuts_nothing_and_a_changed_film_is_cut_again(
    run: Run, places, tmp_path: Path
) -> None:
    _, films = places
    mine = tmp_path / "films"
    mine.mkdir()
    for path in films.iterdir():
        (mine / path.name).write_bytes(path.read_bytes())
    first = build.build(run, [mine], tmp_path / "out", OPTIONS, build.Chosen())
    (tar,) = (tmp_path / "out").glob("*.tar")
    before = tar.stat().st_mtime_ns, tar.read_bytes()
    assert build.build(run, [mine], tmp_path / "out", OPTIONS, build.Chosen()) == first
    assert tar.stat().st_mtime_ns == before[0]
    (mine / f"{IDS[2]}.mp4").write_bytes((mine / f"A film [{IDS[0]}].mp4").read_bytes())
    again = build.build(run, [mine], tmp_path / "out", OPTIONS, build.Chosen())
    assert (again["clips"], again["undecodable"]) == (4, 0)
    assert build.build(run, [films], tmp_path / "fresh", OPTIONS, build.Chosen())["clips"] == 2
    (fresh,) = (tmp_path / "fresh").glob("*.tar")
    assert fresh.read_bytes() == before[1]


@pytest.mark.parametrize("name", ["clips-00000.tar", f"{IDS[0]}/{IDS[0]}.npz"])
def test_what_a_killed_run_left_goes_and_a_running_one_keeps_its_own(
    run: Run, places, tmp_path: Path, name: str
) -> None:
    script = (
        "import pathlib, sys\n"
        "from kb.store.atomic import writing\n"
        "with writing(pathlib.Path(sys.argv[1])) as path:\n"
        "    path.write_bytes(b'half')\n"
        "    print(flush=True)\n"
        "    sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path / name)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    killed, running = (subprocess.Popen(command, cwd=ROOT, **pipes) for _ in range(2))
    for process in (killed, running):
        assert process.stdout.readline() == b"\n"
    killed.kill()
    killed.communicate()
    build.build(run, [places[1]], tmp_path, OPTIONS, build.Chosen())
    assert len(list(tmp_path.rglob(".*.tmp"))) == 1
    running.communicate(b"")
    assert (tmp_path / name).read_bytes() == b"half"
    assert running.returncode == 0


@pytest.fixture
def shard_a_video(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shard for each video, so that few videos are many shards."""
    monkeypatch.setattr(build, "_VIDEOS", 1)
    monkeypatch.setattr(build, "_SHARD", "dense_rank() OVER (ORDER BY video_id) - 1")


@pytest.mark.usefixtures("shard_a_video")
@pytest.mark.parametrize("chosen", [build.Chosen(), build.Chosen(sample=5)], ids=["all", "sample"])
def test_parts_make_the_files_of_one_machine(
    run: Run, places, tmp_path: Path, chosen: build.Chosen
) -> None:
    """Some machines have the films elsewhere, and one has nothing to do."""
    films, united = places[1], tmp_path / "united"
    elsewhere = shutil.copytree(films, tmp_path / "elsewhere")
    alone = build.build(run, [films], tmp_path / "alone", OPTIONS, chosen)
    sums = Counter[str]()
    for number in range(1, 6):
        own = chosen._replace(part=(number, 5))
        place = films if number % 2 else elsewhere
        made_ = build.build(run, [place], tmp_path / "part", OPTIONS, own)
        assert build.plan(run, [place], OPTIONS, own)["pairs"] == made_["pairs"]
        sums.update({name: count for name, count in made_.items() if isinstance(count, int)})
        shutil.copytree(tmp_path / "part", united, dirs_exist_ok=True)
        shutil.rmtree(tmp_path / "part")
    assert sums == {name: alone[name] for name in sums}
    expected = _files(tmp_path / "alone", "clips-*")
    assert _files(united, "clips-*") == expected
    # A run of all pairs over them cuts nothing, and lists what was left out of any part.
    before = {path: path.stat().st_mtime_ns for path in united.glob("clips-*")}
    assert build.build(run, [films], united, OPTIONS, chosen)["clips"] == alone["clips"]
    assert {path: path.stat().st_mtime_ns for path in united.glob("clips-*")} == before
    assert _files(united, "*") == _files(tmp_path / "alone", "*")


def _files(folder: Path, names: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob(names)}


@pytest.mark.usefixtures("shard_a_video")
def test_parts_share_a_folder(run: Run, places, tmp_path: Path) -> None:
    """What another part has cut there stays; what this one has cut of films that are gone goes."""
    films, empty = places[1], tmp_path / "empty"
    empty.mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "clips-2024 mine.tar").touch()
    for part in ((1, 2), (2, 2)):
        build.build(run, [films], tmp_path / "out", OPTIONS, build.Chosen(part=part))
    there = {path.name for path in (tmp_path / "out").glob("clips-*")}
    assert {"clips-00000.tar", "clips-00001.tar", "clips-2024 mine.tar"} <= there
    build.build(run, [empty], tmp_path / "out", OPTIONS, build.Chosen(part=(2, 2)))
    left = {path.name for path in (tmp_path / "out").glob("clips-*")}
    assert there - left == {"clips-00001.tar", "clips-00001.json"}
    with pytest.raises(UsageError, match="no pair has the keyword"):
        build.build(run, [films], tmp_path / "out", OPTIONS, build.Chosen("no", part=(1, 2)))


def test_a_film_that_changes_while_it_is_read_has_no_clips(
    run: Run, places, tmp_path: Path
) -> None:
    _, films = places
    mine = tmp_path / "films"
    mine.mkdir()
    film_ = (films / f"A film [{IDS[0]}].mp4").read_bytes()
    for key in (IDS[0], IDS[3]):
        (mine / f"{key}.mp4").write_bytes(film_)
    stop, touched = threading.Event(), itertools.count(1)

    def touch() -> None:
        while not stop.is_set():
            os.utime(mine / f"{IDS[3]}.mp4", ns=(0, next(touched)))

    thread = threading.Thread(target=touch)
    thread.start()
    try:
        summary = build.build(run, [mine], tmp_path / "out", OPTIONS, build.Chosen())
    finally:
        stop.set()
        thread.join()
    assert (summary["clips"], summary["undecodable"]) == (2, 2)
    with (tmp_path / "out/left_out.csv").open() as file:
        reasons = {row["video_id"]: row["what"] for row in csv.DictReader(file)}
    assert reasons[IDS[3]] == "the file changed meanwhile"
    left = {name.partition(".")[0] for name, _ in _shards(tmp_path / "out")}
    assert {_pairs(run.root)[key]["video_id"] for key in left} == {IDS[0]}
    assert build.build(run, [mine], tmp_path / "out", OPTIONS, build.Chosen())["clips"] == 4


def test_a_plan_says_what_is_there(run: Run, places, tmp_path: Path) -> None:
    planned = build.plan(run, [places[1]], OPTIONS, build.Chosen())
    assert (planned["pairs"], planned["missing"], planned["undecodable"]) == (8, 2, 2)
    assert (planned["videos"], planned["unknown_length"]) == (2, 2)
    one = build.plan(run, [places[1]], OPTIONS, build.Chosen(sample=1))
    assert one["pairs"] == 1


def test_what_is_wrong_is_said_before_anything_is_cut(run: Run, places, tmp_path: Path) -> None:
    root, films = places
    with pytest.raises(UsageError, match="only reads"):
        build.build(run, [films], root / "clips", OPTIONS, build.Chosen())
    with pytest.raises(UsageError, match="not a folder"):
        build.build(run, [tmp_path / "none"], tmp_path / "out", OPTIONS, build.Chosen())
    for chosen, message in (
        (build.Chosen("no such thing"), "no pair has the keyword"),
        (build.Chosen(where="token_count > 999"), "no pair meets the condition"),
        (build.Chosen(where="nothing = 1"), "is not a valid condition"),
        (build.Chosen(pairs=tmp_path / "none.parquet"), "not a Parquet file with a column pair_id"),
    ):
        with pytest.raises(UsageError, match=message):
            build.build(run, [films], tmp_path / "out", OPTIONS, chosen)


def test_a_misspelt_keyword_and_texts_that_are_not_there_are_told(
    run: Run, places, tmp_path: Path
) -> None:
    root, films = places
    keyword = next(iter(_pairs(root).values()))["keyword"]
    misspelt = build.Chosen(f"{keyword[:-1]}q{keyword[-1]}")
    with pytest.raises(UsageError) as refused:
        build.plan(run, [films], OPTIONS, misspelt)
    assert refused.value.hint == f"did you mean {keyword!r}?"
    said: list[str] = []
    run.progress.say = said.append  # type: ignore[method-assign]
    build.plan(run, [films], OPTIONS, build.Chosen())
    assert said == []
    released = tmp_path / "release"
    shutil.copytree(
        root / "pairs", released / "pairs", ignore=shutil.ignore_patterns("_*", "*.json")
    )
    for path in released.rglob("pairs-*.parquet"):
        pq.write_table(pq.read_table(path).drop_columns(["text"]), path)
    build.plan(replace(run, root=released), [films], OPTIONS, build.Chosen())
    assert [one for one in said if one.startswith("the pairs have no texts")] == said != []


def test_only_the_pairs_of_a_file_or_condition_are_cut(run: Run, places, tmp_path: Path) -> None:
    root, films = places
    every = sorted(_pairs(root))
    pq.write_table(pa.table({"pair_id": every[:3]}), tmp_path / "drawn.parquet")
    drawn = build.Chosen(pairs=tmp_path / "drawn.parquet")
    assert build.plan(run, [films], OPTIONS, drawn)["pairs"] == 3
    narrower = drawn._replace(where=f"pair_id <> '{every[0]}'")
    assert build.plan(run, [films], OPTIONS, narrower)["pairs"] == 2


def test_tokens_are_those_of_clip() -> None:
    """The ids that OpenAI's tokenizer gives "a photo of a cat"."""
    ids = token_ids("a photo of a cat")
    assert ids[:8].tolist() == [49406, 320, 1125, 539, 320, 2368, 49407, 0]
    assert ids.shape == (77,)
    assert token_ids("cat " * 100)[-1] == 49407


def test_a_film_of_another_length_is_left_out_everywhere(tmp_path: Path) -> None:
    root = made(tmp_path / "root", sources=("youtube", "pairs"), n=3, export=False)
    (root / "state").mkdir()
    films = tmp_path / "films"
    films.mkdir()
    rows = duckdb.sql(f"SELECT video_id, duration_s FROM '{root}/clean/youtube/videos/*.parquet'")
    lengths = dict(rows.fetchall())
    for key, length in ((IDS[0], lengths[IDS[0]]), (IDS[1], lengths[IDS[1]] + 25)):
        path = films / f"{key}.mp4"
        film(path, "libx264", range(length), Fraction(1), (64, 36), {"preset": "veryfast"})
    run = replace(a_run(root), workers=1)
    of = Counter(row["video_id"] for row in _pairs(root).values())
    counts = {"missing": of[IDS[2]], "film_differs": of[IDS[1]], "unknown_length": 0}
    summary = build.build(run, [films], tmp_path / "out", OPTIONS, build.Chosen())
    planned = build.plan(run, [films], OPTIONS, build.Chosen())
    for said in (summary, planned):
        assert {name: said[name] for name in counts} == counts
    assert (
        summary["pairs"]
        == of.total()
        == sum(
            summary[name] for name in ("clips", "missing", "short", "undecodable", "film_differs")
        )
    )
    with (tmp_path / "out/left_out.csv").open() as file:
        what = {row["video_id"]: row["what"] for row in csv.DictReader(file)}
    length = lengths[IDS[1]]
    assert what[IDS[1]].startswith(f"the film lasts {length + 25:.1f} s, the video {length} s")
