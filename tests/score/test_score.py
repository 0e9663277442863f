"""`kb pairs score`: what is measured of films in which everything is known, and the command."""

import hashlib
import json
import shutil
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.conftest import needs

needs("av", "cv2", "scenedetect", "torch", "transformers")

import kb  # noqa: E402
from kb.core.config.profile import load_profile  # noqa: E402
from kb.core.installation import torch  # noqa: E402
from kb.pairs.clip_tokens import token_ids  # noqa: E402
from kb.sandbox.youtube.films import drawn, timeline, write_film  # noqa: E402
from kb.score.calibration import area, section  # noqa: E402
from kb.score.models import model_name  # noqa: E402
from tests.inprocess import Here  # noqa: E402
from tests.score.seen import scored  # noqa: E402
from tests.youtube.ytdlp import folder as ytdlp  # noqa: E402

WORDS = "and you to about it so that than day was up more because not now time once ask"
SAID = {"alpha000001": {20: "Creeper", 60: "Skeleton"}, "alpha000002": {30: "Enderman"}}
SECONDS = 90


class Colours:
    """A model that sees the mean colour of a frame, and reads the keyword's picture in a text."""

    size, fit, step_s = (64, 64), "stretch", 1.0

    def frames(self, images) -> np.ndarray:
        seen = [[*(image.reshape(-1, 3).mean(axis=0) - 48), 3] for image in images]
        return np.array(seen, np.float32).reshape(-1, 4)

    def texts(self, texts) -> np.ndarray:
        found = self.frames([drawn((text,)) for text in texts]) * (1, 1, 1, 0)
        return found / np.linalg.norm(found, axis=1, keepdims=True)

    def clip(self, frames) -> np.ndarray:
        return (frames / np.linalg.norm(frames, axis=1, keepdims=True)).mean(axis=0)


def pair(keyword: str, at: float, clip_s: float = 8) -> dict[str, object]:
    return {
        "pair_id": f"{keyword} {at}",
        "text": keyword,
        "clip_start_s": at - clip_s / 2,
        "clip_end_s": at + clip_s / 2,
        "match_start_s": at,
        "match_end_s": at + 0.5,
    }


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Shapes at 20, 60 and 86 s; that at 60 s is shown six seconds late."""
    path = tmp_path_factory.mktemp("film") / "a.mp4"
    shown = [("Creeper", 20.0), ("Skeleton", 66.0), ("Enderman", 86.0)]
    write_film(path, timeline(shown, SECONDS))
    return path


def test_similarity_margin_and_offset_are_those_of_the_film(film: Path) -> None:
    rows = [pair("Creeper", 20), pair("Skeleton", 60), pair("Enderman", 86), pair("Creeper", 120)]
    found = {one.pair_id: one for one in scored(film, rows, Colours())}
    assert found.keys() == {"Creeper 20", "Skeleton 60", "Enderman 86"}  # the film has 90 s
    right, late = found["Creeper 20"], found["Skeleton 60"]
    assert (right.best_offset_s, late.best_offset_s) == (0, 6)
    assert right.similarity > late.similarity + 0.2
    assert right.margin > late.margin
    assert (right.frames, found["Enderman 86"].frames) == (8, 8)


def test_static_share_counts_neighbouring_frames_that_hardly_differ(tmp_path: Path) -> None:
    """A picture that changes each second in the first half of the clip, and stays in the second."""
    pictures = [(2 * s, (("Creeper",), ("Skeleton",))[s % 2] if s < 44 else ()) for s in range(60)]
    write_film(tmp_path / "a.mp4", [*pictures, (119, ())])
    (one,) = scored(tmp_path / "a.mp4", [pair("Creeper", 44, 16)], Colours())
    assert one.static_share == pytest.approx(7 / 15, abs=0.001)


PROFILE = """\
name = "shapes"
title = "Minecraft"
toxicity = "off"
[youtube]
keywords = ["Minecraft"]
category_ids = [20]
[pairs]
include = ["Creeper", "Skeleton", "Enderman"]
max_clip_s = 8
"""


def command(place: Path, *words: str) -> list[str]:
    at = ("--data", str(place / "data"), "--profile", str(place / "profile.toml"))
    return [sys.executable, "-m", "kb", *words, *at]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data root with pairs, their films, and a model with random weights."""
    place = tmp_path_factory.mktemp("score")
    (place / "profile.toml").write_text(PROFILE)
    (place / "given").mkdir()
    (place / "films").mkdir()
    for key, said in SAID.items():
        lines = []
        for at in range(2, SECONDS - 4, 4):
            words = [WORDS.split()[(at + n) % 18] for n in range(8)]
            words[2:3] = [name.lower() for s, name in said.items() if at <= s < at + 4] or ["go"]
            timed = [(240 * n, f" {word}" if n else word) for n, word in enumerate(words)]
            lines.append(ytdlp.Line(at * 1000, 1920, timed))
        about = ytdlp.info(key, duration=SECONDS, title="minecraft")
        (place / "given" / f"{key}.info.json").write_text(json.dumps(about))
        track = place / "given" / f"{key}.en-orig.json3"
        track.write_text(ytdlp.json3(lines, automatic=True))
        shown = [(name, float(at)) for at, name in said.items()]
        write_film(place / "films" / f"{key}.mp4", timeline(shown, SECONDS))
    from tests.score.checkpoints import of_openai, random_clip  # torch takes seconds to load

    torch.save(of_openai(random_clip()), place / "small.pt")
    for words in (("youtube", "import", str(place / "given")), ("youtube", "filter"), ("pairs",)):
        done = subprocess.run(command(place, *words), check=False, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    return place


@pytest.fixture
def place(made: Path, tmp_path: Path) -> Path:
    """A copy of the data root beside the same films, model and profile."""
    shutil.copytree(made / "data", tmp_path / "data")
    for name in ("films", "small.pt", "profile.toml"):
        (tmp_path / name).symlink_to(made / name)
    return tmp_path


def scores(place: Path) -> pa.Table:
    return pq.read_table(place / "data" / "pairs" / "scores-00000-of-00001.parquet")


def test_every_pair_is_scored_or_counted(place: Path, here: Here) -> None:
    at = ("--data", str(place / "data"), "--profile", str(place / "profile.toml"))
    films = place / "some"
    films.mkdir()
    (films / "alpha000001.mp4").symlink_to(place / "films" / "alpha000001.mp4")
    write_film(films / "alpha000002.mp4", timeline([], SECONDS / 2))
    with_model = ("--videos", str(films), "--model", str(place / "small.pt"), "--workers", "1")
    done = here("pairs", "score", *with_model, "--json", *at)
    assert done.code == 0, done.err
    summary = json.loads(done.out.splitlines()[-1])
    reasons = ("missing", "short", "undecodable", "film_differs", "no_text")
    assert summary["pairs"] == summary["scored"] + sum(summary[name] for name in reasons)
    assert summary["scored"] == scores(place).num_rows == 2
    assert summary["film_differs"] == 1
    # The film of the other video comes later: what was scored is not decoded again.
    before = {path: path.stat().st_mtime_ns for path in (place / "data/state/scores").iterdir()}
    (films / "alpha000002.mp4").unlink()
    (films / "alpha000002.mp4").symlink_to(place / "films" / "alpha000002.mp4")
    assert here("pairs", "score", *with_model, *at).code == 0
    assert scores(place).num_rows == 3
    assert before == {path: path.stat().st_mtime_ns for path in before}
    measured = json.loads((place / "data" / "pairs" / "measures.json").read_bytes())["scores"]
    assert measured["pairs"] == measured["similarity"]["n"] == 3
    assert measured["visible"] == {"judged": 0}
    assert here("verify", *at).code == 0
    drawn_ = here(
        "pairs", "draw", "1", "--where", "similarity > -1", "--out", str(place / "d"), *at
    )
    assert drawn_.code == 0, drawn_.err
    # A removed video leaves no score.
    (place / "ids.txt").write_text("alpha000001\n")
    assert here("purge", "youtube", "--ids", str(place / "ids.txt"), *at).code == 0
    assert scores(place)["video_id"].to_pylist() == ["alpha000002"]
    assert not (place / "data/state/scores/alpha000001.json").exists()
    assert [path.name for path in (place / "data/annotations/films").iterdir()] == ["alpha000002"]
    for name in ("shots", "film_figures"):
        rows = pq.read_table(place / "data" / "films" / f"{name}-00000-of-00001.parquet")
        assert set(rows["video_id"].to_pylist()) == {"alpha000002"}


def test_films_may_go_when_they_were_seen(place: Path, here: Here) -> None:
    """Scores and figures are computed of what is stored, here and where roots are merged."""
    at = ("--profile", str(place / "profile.toml"), "--data")
    scoring = ("pairs", "score", "--model", str(place / "small.pt"), "--workers", "1")
    data, other = place / "data", shutil.copytree(place / "data", place / "other")
    made = [f"{name}-00000-of-00001.parquet" for name in ("shots", "film_figures")]
    films = str(place / "films")
    for decoded in (2, 0):
        plan = here(*scoring[:4], "--videos", films, "--plan", "--json", *at, str(data))
        assert json.loads(plan.out.splitlines()[-1])["films"] == decoded, plan.err
        assert here(*scoring, "--videos", films, *at, str(data)).code == 0
    part = ("--part", "1/3", "--videos", films)
    done = here(*scoring, *part, "--json", *at, str(other))
    assert json.loads(done.out.splitlines()[-1])["videos"] == 1
    whole = [(data / "films" / name).read_bytes() for name in made], scores(place)
    shutil.rmtree(data / "state" / "scores")  # which would spare the computing
    assert here(*scoring, *at, str(data)).code == 0
    assert ([(data / "films" / name).read_bytes() for name in made], scores(place)) == whole
    # What another machine has seen comes by a merge, and only once.
    for files in (2, 0):
        done = here("merge", str(data), "--json", *at, str(other))
        assert done.code == 0, done.err
        assert json.loads(done.out.splitlines()[-1])["films"] == files
    assert here(*scoring, *at, str(other)).code == 0
    table = other / "pairs" / "scores-00000-of-00001.parquet"
    assert pq.read_table(table) == whole[1]
    drawn_ = ("pairs", "draw", "3", "--where", "cuts = 0 AND dark_share < 1 AND static_share >= 0")
    assert here(*drawn_, "--out", str(place / "d"), *at, str(data)).code == 0
    cutting = ("clips", "--videos", films, "--within-shot", "--out", str(place / "c"))
    done = here(*cutting, *at, str(data))
    assert done.code == 0, done.err
    vectors = next((data / "annotations" / "films").glob("*/small@*.npz"))
    vectors.write_bytes(vectors.read_bytes()[:-9])
    shutil.rmtree(data / "state" / "scores")
    done = here(*scoring, *at, str(data))
    assert (done.code, vectors.name in done.said) == (1, True)


@pytest.mark.slow
def test_mineclips_temporal_part_runs_over_stored_frames(place: Path, here: Here) -> None:
    """Against the model as it was published, on the frame features that were stored."""
    from tests.score.checkpoints import MineClip  # torch takes seconds to load

    published = MineClip()
    at = ("--data", str(place / "data"), "--profile", str(place / "profile.toml"))
    scoring = ("pairs", "score", "--model", str(published.save(place / "mine.pth")), *at)
    done = here(*scoring, "--videos", str(place / "films"), "--workers", "1")
    assert done.code == 0, done.err
    seen = scores(place)
    pairs = pq.read_table(next((place / "data" / "pairs").glob("pairs-*.parquet"))).to_pylist()
    similar = dict(zip(seen["pair_id"].to_pylist(), seen["similarity"].to_pylist(), strict=True))
    assert len(pairs) == len(similar) == 3
    for row in pairs:
        (path,) = (place / "data/annotations/films" / row["video_id"]).glob("mine@*.npz")
        with np.load(path) as stored:
            assert stored["frames"].dtype == np.float16
            times = (stored["ticks"] + 0.5) / 2  # two a second
            there = (times >= row["clip_start_s"]) & (times <= row["clip_end_s"])
            frames = torch.tensor(stored["frames"][there].astype(np.float32))
        taken = frames[((np.arange(16) + 0.5) / 16 * len(frames)).astype(int)]
        tokens = torch.tensor(token_ids(row["text"])[None])
        with torch.no_grad():
            text = torch.nn.functional.normalize(published.clip_model.text_model(tokens), dim=-1)
            expected = float(text[0] @ published.clip(taken))
        assert similar[row["pair_id"]] == pytest.approx(expected, abs=1e-3)
    shutil.rmtree(place / "data" / "state" / "scores")  # which would spare the computing
    assert here(*scoring).code == 0
    assert scores(place) == seen


def test_lost_scores_come_back_without_the_films(place: Path, here: Here) -> None:
    at = ("--data", str(place / "data"), "--profile", str(place / "profile.toml"))
    scoring = ("pairs", "score", "--videos", str(place / "films"), *at)
    scoring = (*scoring, "--model", str(place / "small.pt"), "--workers", "1")
    assert here(*scoring).code == 0
    found = kb.load(place / "data").clips(None, "similarity > -1 AND frames > 0").to_pylist()
    assert [row["margin"] for row in found] == scores(place)["margin"].to_pylist()
    path = place / "data" / "pairs" / "scores-00000-of-00001.parquet"
    whole = path.read_bytes()
    for damage in (path.unlink, lambda: path.write_bytes(whole[:-1] + b"?")):
        damage()
        found = here("verify", *at)
        assert (found.code, "run `kb pairs --again" in found.out) == (1, True)
        asked = ("pairs", "draw", "1", "--where", "MARGIN > -2", "--out", str(place / "d"), *at)
        assert here(*asked).code == 1
        assert path.name in here(*asked).said
        assert here("pairs", "--again", *at).code == 0
        assert path.read_bytes() == whole
    measures = place / "data" / "pairs" / "measures.json"
    noted = measures.read_bytes()
    for folder in ("pairs", "films"):
        shutil.rmtree(place / "data" / folder)
    assert here("pairs", *at).code == 0
    assert (path.read_bytes(), measures.read_bytes()) == (whole, noted)
    assert "nobody has judged these clips" in here(*scoring).err
    # Of three judged clips the two most similar show what is named.
    ranked = scores(place).sort_by("similarity")["pair_id"].to_pylist()
    labels = [
        {"kind": "pair", "item_id": key, "question": "visible", "answer": answer}
        for key, answer in zip(ranked, ("no", "yes", "yes"), strict=True)
    ]
    (place / "data" / "labels").mkdir()
    pq.write_table(pa.Table.from_pylist(labels), place / "data/labels/labels-0.parquet")
    rows = [line.split("\t") for line in here(*scoring).out.splitlines() if "\t" in line]
    assert rows[0] == ["similarity", "judged", "show what is named"]
    assert [row[1:] for row in rows[1:]] == [
        ["1", "0.000 (0.000 to 0.793)"],
        ["1", "1.000 (0.206 to 1.000)"],
        ["1", "1.000 (0.206 to 1.000)"],
    ]


def test_without_a_model_the_command_says_what_to_give(place: Path, here: Here) -> None:
    at = ("--data", str(place / "data"), "--profile", str(place / "profile.toml"))
    done = here("pairs", "score", "--videos", str(place / "films"), *at)
    assert done.code == 2
    assert "names no CLIP model; give `kb pairs score" in done.said
    done = here("pairs", "draw", "1", "--where", "margin > 0", *at)
    assert done.code == 2
    assert "kb pairs score" in done.said


def test_the_profiles_model_is_fetched_and_used(place: Path, here: Here) -> None:
    served = partial(SimpleHTTPRequestHandler, directory=str(place))
    with ThreadingHTTPServer(("127.0.0.1", 0), served) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/small.pt"
        digest = hashlib.sha256((place / "small.pt").read_bytes()).hexdigest()
        named = f'[score]\ncheckpoint = {{ url = "{url}", sha256 = "{digest}" }}\n'
        (place / "profile.toml").unlink()
        (place / "profile.toml").write_text(PROFILE + named)
        env = {"XDG_CACHE_HOME": str(place / "cache")}
        profile = ("--profile", str(place / "profile.toml"))
        at = ("pairs", "score", "--data", str(place / "data"), "--videos", str(place / "films"))
        done = here(*at, *profile, env=env)
        assert (done.code, "run `kb models fetch clip" in done.said) == (2, True)
        done = here("models", "fetch", "clip", *profile, env=env)
        assert done.code == 0, done.err
        server.shutdown()
    assert here(*at, *profile, "--workers", "1", env=env).code == 0
    assert scores(place)["model"].to_pylist() == [model_name(place / "small.pt")] * 3


@pytest.mark.crash
@pytest.mark.timeout(900)  # on a busy machine: five commands load torch, some in each worker
def test_workers_and_kills_change_no_byte(place: Path) -> None:
    """The table is the same with two workers, and after a kill before the first score or after."""
    words = ("pairs", "score", "--videos", str(place / "films"), "--model", str(place / "small.pt"))
    unscored = shutil.copytree(place / "data", place / "unscored")
    subprocess.run(command(place, *words, "--workers", "1"), check=True, capture_output=True)
    path = place / "data" / "pairs" / "scores-00000-of-00001.parquet"
    expected = path.read_bytes()
    state = place / "data" / "state" / "scores"
    for after_the_first in (False, True):
        shutil.rmtree(place / "data")
        shutil.copytree(unscored, place / "data")
        again = command(place, *words, "--workers", "2")
        with subprocess.Popen(again, stderr=subprocess.DEVNULL) as process:
            while after_the_first and process.poll() is None and not any(state.glob("*.json")):
                time.sleep(0.05)
            process.send_signal(signal.SIGKILL)
        done = subprocess.run(again, check=False, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert path.read_bytes() == expected


def test_the_area_is_the_share_of_right_pairs_that_score_higher() -> None:
    rng = np.random.default_rng(0)
    right, wrong = rng.integers(2, 9, 40) / 10, rng.integers(0, 7, 30) / 10
    share = np.mean([(a > b) + 0.5 * (a == b) for a in right for b in wrong])
    found = area(right, wrong)
    assert found is not None
    assert found["auc"] == pytest.approx(share, abs=1e-4)
    assert 0 < found["low"] < share < found["high"] < 1
    assert area(right, wrong[:0]) is None


def test_judgements_give_bins_and_where_the_wanted_precision_begins(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """200 pairs of which those above a similarity of 0.5 show what is named, but for one in ten."""
    rng = np.random.default_rng(0)
    similarity = rng.permutation(200) / 200
    visible = (similarity > 0.5) ^ (rng.random(200) < 0.1)
    keys = [f"{number:016x}" for number in range(200)]
    rows = {
        "pair_id": keys,
        "video_id": ["v"] * 200,
        "model": ["m@0"] * 200,
        "similarity": similarity.tolist(),
        "margin": similarity.tolist(),
        "best_offset_s": [0.0] * 150 + [6.0] * 50,
        "static_share": [0.5] * 200,
        "frames": [8] * 200,
    }
    labels = [
        {"kind": "pair", "item_id": key, "question": "visible", "answer": "yes" if yes else "no"}
        for key, yes in zip(keys, visible, strict=True)
    ]
    (place / "data" / "labels").mkdir()
    pq.write_table(pa.Table.from_pylist(labels), place / "data/labels/labels-0.parquet")
    profile = load_profile(place / "profile.toml")
    found = section(place / "data", profile, pa.table(rows))
    calibrated = found["visible"]
    assert calibrated["judged"] == sum(one["n"] for one in calibrated["bins"]) == 200
    assert len(calibrated["bins"]) == 10
    assert calibrated["bins"][0]["share"] < 0.3
    assert calibrated["bins"][-1]["share"] > 0.7
    assert calibrated["auc"]["low"] > 0.8
    reached = calibrated["reached_from"]
    assert reached["share"] > profile.score.wanted_precision
    assert 0.4 < reached["similarity"] < 0.55
    assert found["further_than_2_s"]["share"] == 0.25
