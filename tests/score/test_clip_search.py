"""`kb search --clips`, in a data root whose pairs were scored by a small model."""

import html
import json
import re
import shutil
from pathlib import Path
from urllib.parse import quote

import duckdb
import numpy as np
import pytest

from tests.conftest import needs

needs("av", "cv2", "scenedetect", "torch", "transformers")

from kb.score.clip_search import _CHUNK, _similarities  # noqa: E402
from kb.score.film_store import Vectors, keep_vectors  # noqa: E402
from kb.score.models import model_name  # noqa: E402
from tests.explore.conftest import explored  # noqa: E402
from tests.inprocess import Here  # noqa: E402
from tests.score.test_score import made, place  # noqa: E402, F401  fixtures

LONG = "a wolf sits beside a player " * 15


@pytest.fixture
def scored(place: Path, here: Here) -> Path:  # noqa: F811
    """The data root of test_score, scored."""
    words = ("--model", str(place / "small.pt"), "--videos", str(place / "films"))
    done = here("pairs", "score", *words, "--workers", "1", *at(place))
    assert done.code == 0, done.err
    return place


def at(place: Path) -> tuple[str, ...]:  # noqa: F811
    return ("--data", str(place / "data"), "--profile", str(place / "profile.toml"))


def test_answers_are_the_clips_most_like_the_words(scored: Path, here: Here) -> None:
    """By the same figures as the scores of pairs; one of each video unless asked for more."""
    data = scored / "data"
    pairs = duckdb.sql(
        f"SELECT * FROM '{data}/pairs/pairs-*.parquet' JOIN '{data}/pairs/scores-*.parquet'"
        " USING (pair_id) ORDER BY pair_id"
    ).to_arrow_table()
    for pair in pairs.to_pylist():
        done = here("search", "--clips", pair["text"], "--all", "--format", "json", *at(scored))
        assert done.code == 0, done.err
        hits = json.loads(done.out)
        assert len(hits) == 3
        assert sorted((hit["similarity"] for hit in hits), reverse=True) == [
            hit["score"] for hit in hits
        ]
        (hit,) = (hit for hit in hits if hit["pair_id"] == pair["pair_id"])
        assert hit["similarity"] == pytest.approx(pair["similarity"], abs=0.002)
        same = ("video_id", "keyword", "text", "clip_start_s", "clip_end_s")
        assert {name: hit[name] for name in same} == {name: pair[name] for name in same}
        start = int(pair["clip_start_s"])
        assert hit["url"] == f"https://www.youtube.com/watch?v={pair['video_id']}&t={start}s"
        assert (hit["title"], hit["source"], hit["key"]) == (
            "minecraft",
            "youtube",
            hit["video_id"],
        )
    done = here("search", "--clips", "creeper", "--json", *at(scored))
    summary = json.loads(done.out.splitlines()[-1])
    assert len(summary["answers"]) == 2
    assert summary["cut_tokens"] == 0
    done = here("search", "--clips", LONG, "--limit", "1", "--size", "20", *at(scored))
    assert done.code == 0
    assert "their last 15 tokens are left out" in done.err
    assert done.out.count("https://www.youtube.com/watch?v=") == 1
    assert here("verify", *at(scored)).code == 0


def test_the_index_follows_its_clips_and_holds_nothing_that_was_purged(
    scored: Path, here: Here
) -> None:
    data, asked = scored / "data", ("search", "--clips", "wolf", "--all", "--format", "json")
    found = here(*asked, *at(scored))
    folder = data / "index" / "clips"
    made_at = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert here(*asked, *at(scored)).out == found.out
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == made_at
    next(folder.glob("*.npy")).unlink()
    assert here(*asked, *at(scored)).out == found.out
    (scored / "ids.txt").write_text("alpha000001\n")
    assert here("purge", "youtube", "--ids", str(scored / "ids.txt"), *at(scored)).code == 0
    assert not folder.exists()
    left = json.loads(here(*asked, *at(scored)).out)
    assert [hit["video_id"] for hit in left] == ["alpha000002"]
    for path in folder.iterdir():
        assert b"alpha000001" not in path.read_bytes()
    assert here("release", *at(scored)).code in (0, 2)
    assert not [path for path in (data / "release").rglob("*") if path.suffix in (".npy", ".arrow")]


def test_of_several_models_one_is_asked_for(scored: Path, here: Here) -> None:
    other = scored / "other.pt"
    shutil.copy(scored / "small.pt", other)
    with other.open("ab") as file:
        file.write(b"\0")  # another digest
    vectors = {tick: np.ones(64, np.float16) for tick in range(90)}
    keep_vectors(scored / "data", "alpha000001", model_name(other), Vectors("film", vectors))
    done = here("search", "--clips", "wolf", *at(scored))
    assert (done.code, "--model" in done.said) == (2, True)
    done = here("search", "--clips", "wolf", "--model", str(other), *at(scored))
    assert done.code == 0, done.err
    for model in (str(scored / "small.pt"), "small"):
        done = here("search", "--clips", "wolf", "--model", model, "--json", *at(scored))
        summary = json.loads(done.out.splitlines()[-1])
        assert summary["model"] == model_name(scored / "small.pt")
        assert len(summary["answers"]) == 2
    assert len(list((scored / "data" / "index" / "clips").glob("*.npy"))) == 2
    shutil.move(scored / "small.pt", scored / "moved.pt")
    done = here("search", "--clips", "wolf", "--model", "small", *at(scored))
    assert (done.code, "name it with --model FILE" in done.said) == (2, True)


def test_what_cannot_be_searched_says_why(place: Path, here: Here) -> None:  # noqa: F811
    done = here("search", "--clips", "wolf", *at(place))
    assert (done.code, "kb pairs score" in done.said) == (2, True)
    for option, value in (("--entity", "Wolf"), ("--source", "wiki"), ("--since", "2023-01-31")):
        done = here("search", "--clips", "wolf", option, value, *at(place))
        assert (done.code, option in done.said) == (2, True)
    done = here("search", "wolf", "--model", "small", *at(place))
    assert (done.code, "--clips" in done.said) == (2, True)


def test_a_download_has_no_clips_to_search(demo: Path, here: Here) -> None:
    release = demo / "data" / "demo" / "release"
    done = here("search", "--clips", "wolf", "--data", str(release))
    assert (done.code, "no release has vectors" in done.said) == (2, True)


@pytest.mark.slow  # a process of its own with torch
def test_explore_leads_from_words_to_the_place_in_the_video(scored: Path, here: Here) -> None:
    done = here("search", "--clips", "creeper", "--format", "json", *at(scored))
    hits = json.loads(done.out)
    shutil.rmtree(scored / "data" / "index" / "clips")  # which the pages make at their start
    with explored(
        scored / "data", "--profile", str(scored / "profile.toml"), before=("env",)
    ) as pages:
        assert 'name="clips"' in pages.ask("/search").text
        text = html.unescape(pages.ask("/search?words=creeper&clips=1").text)
        found = re.findall(r'href="(/document\?ref=[^"]*)"', text)
        assert len(found) == len(hits) == 2
        for hit, address in zip(hits, found, strict=True):
            assert f"youtube%3A{hit['video_id']}%40{int(hit['clip_start_s'])}&" in address
            assert hit["url"] in text
            assert pages.ask(address.partition("#")[0]).status == 200
        assert "their last 15 tokens" in pages.ask(f"/search?clips=1&words={quote(LONG)}").text
        shutil.rmtree(scored / "data" / "index" / "clips")
        answer = pages.ask("/search?words=creeper&clips=1").text
        assert "the index of clips is missing or out of date" in answer


def test_the_search_is_exact() -> None:
    """Among more clips than are compared at a time, the same as by one product of matrices."""
    rng = np.random.default_rng(0)
    vectors = rng.standard_normal((2 * _CHUNK + 5, 16)).astype(np.float16)
    asked = rng.standard_normal(16)
    expected = vectors.astype(np.float64) @ asked
    assert np.allclose(_similarities(vectors, asked), expected, atol=1e-4)
