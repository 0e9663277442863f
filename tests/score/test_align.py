"""`kb pairs align`: planted vectors of which everything is known, and what takes aligned times."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.conftest import needs

needs("av", "tokenizers", "torch")

import duckdb  # noqa: E402

import kb  # noqa: E402
from kb.artifacts import release_folder  # noqa: E402
from kb.core.errors import UsageError  # noqa: E402
from kb.core.summary import interval_text  # noqa: E402
from kb.release.metadata.quality import pair_quality  # noqa: E402
from kb.sandbox.youtube.films import timeline, write_film  # noqa: E402
from kb.score.align import aligned_times, fitted  # noqa: E402
from kb.score.calibration import area, f1_of_clusters  # noqa: E402
from kb.score.film_store import Vectors, forget_film, keep_vectors, text_key, vectors_of  # noqa: E402
from tests.score.alignment_world import AlignmentWorld, measured  # noqa: E402

NAMES = ["Creeper", "Skeleton", "Enderman", "Zombie", "Spider", "Slime", "Ghast", "Blaze", "Witch"]
FIGURES = "films/film_figures-00000-of-00001.parquet"
PAIR = {"video_id": "v", "clip_start_s": 26.0, "clip_end_s": 36.0}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> AlignmentWorld:
    world = AlignmentWorld(tmp_path_factory.mktemp("align") / "w", NAMES, 6, 12, 45)
    world.plant_vectors("small@0")
    return world


@pytest.fixture
def world(made: AlignmentWorld, tmp_path: Path) -> AlignmentWorld:
    """With a data root of its own."""
    own = object.__new__(AlignmentWorld)
    own.__dict__.update(made.__dict__, root=tmp_path / "data")
    shutil.copytree(made.root, own.root)
    return own


def vectors_with(shown: dict[int, float], of: range, step_s: float = 1.0) -> Vectors:
    """Frames at these places, of which some look like the text "t" so much."""
    frames = {tick: np.array([1, shown.get(tick, 0), 0.1 * (tick % 2)], np.float16) for tick in of}
    return Vectors("f", frames, {text_key("t"): np.array([0, 1, 0], np.float16)}, step_s)


def times_of(vectors: Vectors, end_s: float = 100.0, **changed: object) -> list[float] | None:
    rows = [PAIR | {"pair_id": "p", "text": "t"} | changed]
    found = aligned_times(rows, end_s, vectors).get("p")
    return None if found is None else [found.start_s, found.end_s]


def test_a_picture_before_with_after_or_never_with_its_words(world: AlignmentWorld) -> None:
    """Half a picture's time off at most, whatever the step between a model's frames."""
    world.plant_vectors("other@1", step_s=0.5)
    for model in ("small", "other"):
        done = world.kb("pairs", "align", "--model", model, "--json")
        assert done.code == 0, done.err
        summary = json.loads(done.out.splitlines()[-1])
        assert summary["pairs"] == summary["aligned"] == len(world.rows("pairs/pairs"))
        found = measured(world)
        assert np.median(found.errors) <= 1
        assert len(found.errors) >= 0.9 * found.shown.sum()
        told = area(found.alignable[found.shown], found.alignable[~found.shown])
        assert told is not None
        assert told["auc"] >= 0.95
        assert found.share_aligned >= found.share_spoken + 0.1


def test_what_is_shown_for_a_moment_lies_in_the_middle_and_for_long_nothing_moves() -> None:
    every = range(100)
    assert times_of(vectors_with(dict.fromkeys((40, 41, 42), 1.0), every)) == [36, 46]
    assert times_of(vectors_with(dict.fromkeys(range(20, 45), 1.0), every)) == [26, 36]
    at_half_seconds = vectors_with(dict.fromkeys(range(80, 86), 1.0), range(200), 0.5)
    assert times_of(at_half_seconds) == [36.5, 46.5]
    # Further than 20 s, or outside of the film, is not looked for.
    far = times_of(vectors_with({75: 1.0, 45: 0.3}, every))
    assert far == [40, 50]
    late = times_of(vectors_with({40: 1.0}, range(43)), end_s=43.0)
    assert late is not None
    assert late[1] <= 43


def test_what_is_stored_in_part_counts_and_what_tells_nothing_is_null() -> None:
    shown = dict.fromkeys((40, 41, 42), 1.0)
    without = {tick for tick in range(100) if tick % 3 == 0 and tick not in shown}
    some = vectors_with(shown, range(100))
    some.frames = {tick: frame for tick, frame in some.frames.items() if tick not in without}
    assert times_of(some) == [36, 46]
    nothing = (
        (vectors_with(shown, range(31, 32)), {}),  # one stored second
        (vectors_with(shown, range(70, 99)), {}),  # seconds that are all too far away
        (vectors_with(shown, range(0)), {}),
        (vectors_with(shown, range(100)), {"text": "another text, which has no vector"}),
        (vectors_with(shown, range(100)), {"text": None}),
        (vectors_with(shown, range(100)), {"clip_start_s": 0.0, "clip_end_s": 120.0}),
    )
    for vectors, changed in nothing:
        assert times_of(vectors, **changed) is None
    same = vectors_with({}, range(100))
    same.frames = dict.fromkeys(same.frames, same.frames[0])
    assert times_of(same) is None


def test_aligned_times_are_derived_again_with_pairs_and_films(world: AlignmentWorld) -> None:
    """The same bytes when pairs are made again; null for what is no longer stored, and counted."""
    path = world.root / FIGURES
    assert world.kb("pairs", "align").code == 0
    whole = path.read_bytes()
    for words in (("pairs", "--again"), ("pairs", "align"), ("pairs", "align", "--model", "small")):
        assert world.kb(*words).code == 0
        assert path.read_bytes() == whole
    measures = world.root / "pairs" / "measures.json"
    noted = measures.read_bytes()
    for folder in ("pairs", "films"):
        shutil.rmtree(world.root / folder)
    assert world.kb("pairs").code == 0
    assert (path.read_bytes(), measures.read_bytes()) == (whole, noted)
    first, second, *_ = sorted(world.mentions)
    known = vectors_of(world.root, first, "small@0")
    keep_vectors(world.root, first, "small@0", Vectors("film", known.frames, {}))
    forget_film(world.root, second)
    assert world.kb("pairs", "--again").code == 0
    rows = world.rows("films/film_figures")
    assert {row["video_id"] for row in rows} == world.mentions.keys() - {second}
    assert {row["video_id"] for row in rows if row["alignable"] is None} == {first}
    noted = json.loads((world.root / "pairs" / "measures.json").read_bytes())["alignment"]
    assert noted["unknown"] == sum(row["alignable"] is None for row in rows) > 0
    # Pairs by other rules are aligned as far as vectors of their texts are stored.
    profile = world.path / "profile.toml"
    text = profile.read_text()
    try:
        profile.write_text(text.replace("max_tokens = 20", "max_tokens = 19"))
        assert world.kb("pairs").code == 0
        known = [row["alignable"] is None for row in world.rows("films/film_figures")]
        assert set(known) == {True, False}
    finally:
        profile.write_text(text)


def test_the_model_is_asked_for_where_it_is_not_clear(world: AlignmentWorld, here) -> None:
    world.plant_vectors("other@1")
    several = world.kb("pairs", "align")
    assert (several.code, "--model one of other@1, small@0" in several.said) == (2, True)
    assert world.kb("pairs", "align", "--model", "models/other.pt").code == 0
    unknown = world.kb("pairs", "align", "--model", "third")
    assert (unknown.code, "no vectors by third are stored" in unknown.said) == (2, True)
    shutil.rmtree(world.root / "annotations" / "films")
    none = world.kb("pairs", "align")
    assert (none.code, "run `kb pairs score" in none.said) == (2, True)
    assert here("pairs", "align", "--data", str(world.root / "none")).code == 2


def test_clips_draws_and_datasets_take_aligned_times(world: AlignmentWorld, tmp_path: Path) -> None:
    films = tmp_path / "films"
    films.mkdir()
    video = min(world.mentions)
    write_film(films / f"{video}.mp4", timeline(world.shown(video), world.seconds))
    cutting = ("clips", "--videos", films, "--frames", "2", "--size", "16x16", "--aligned")
    for words in (("pairs", "draw", "9", "--aligned"), cutting):
        early = world.kb(*words)
        assert (early.code, "kb pairs align" in early.said) == (2, True)
    assert world.kb("pairs", "align").code == 0
    figures = {row["pair_id"]: row for row in world.rows("films/film_figures")}
    likely = {pair for pair, row in figures.items() if row["alignable"] >= 0.5}

    drawn = (
        "pairs",
        "draw",
        len(likely),
        "--aligned",
        "--alignable",
        "0.5",
        "--out",
        tmp_path / "d",
    )
    assert world.kb(*drawn).code == 0
    rows = pq.read_table(tmp_path / "d" / "pairs.parquet").to_pylist()
    assert {row["pair_id"] for row in rows} == likely
    for row in rows:
        own = figures[row["pair_id"]]
        assert (row["clip_start_s"], row["clip_end_s"]) == (
            own["aligned_start_s"],
            own["aligned_end_s"],
        )
    assert "--aligned --alignable 0.5" in (tmp_path / "d" / "README.md").read_text()

    done = world.kb(*cutting, "--alignable", "0.5", "--out", tmp_path / "c", "--json")
    assert done.code == 0, done.err
    summary = json.loads(done.out.splitlines()[-1])
    left_out = list(csv.DictReader((tmp_path / "c" / "left_out.csv").open()))
    reasons = [row["reason"] for row in left_out]
    assert reasons.count("not_aligned") == summary["not_aligned"] == len(figures) - len(likely) > 0
    assert summary["pairs"] == len(figures) == summary["clips"] + len(left_out)
    mine = {pair for pair in likely if figures[pair]["video_id"] == video}
    assert summary["clips"] == len(mine) > 0
    planned = world.kb(*cutting, "--alignable", "0.5", "--plan", "--json")
    assert json.loads(planned.out.splitlines()[-1])["not_aligned"] == summary["not_aligned"]

    clips = kb.load(world.root).clips(None, f"video_id = '{video}'")
    how = {"frames": 2, "size": (16, 16)}
    dataset = clips.torch(videos=films, aligned=True, alignable=0.5, **how)
    assert dataset.left_out == {"not_aligned": len(clips) - len(mine)}
    for clip in dataset:
        own = figures[clip["pair_id"]]
        middle = (own["aligned_start_s"] + own["aligned_end_s"]) / 2
        assert float(clip["frame_times_s"].mean()) == pytest.approx(middle)
    with pytest.raises(UsageError, match="cut at"):
        clips.torch(shards=tmp_path / "c", aligned=True, **how)
    for words in (
        (*cutting, "--within-shot"),
        ("clips", "--videos", films, "--alignable", "0.5"),
        ("pairs", "draw", "1", "--aligned", "--release"),
    ):
        assert world.kb(*words).code == 2


def judge(world: AlignmentWorld, question: str, kinds: set[str], *options: str) -> None:
    """People judge every clip of a project: those of mentions of these kinds show what is named."""
    out = world.root.parent / question
    assert world.kb("label", "export", "pairs", "--out", out, *options).code == 0
    tasks = json.loads((out / "tasks.json").read_bytes())
    rows = {row["pair_id"]: row for row in world.rows("pairs/pairs")}
    for task in tasks:
        shown = world.mention_of(rows[task["data"]["item_id"]]).kind in kinds
        result = [{"from_name": question, "value": {"choices": ["Yes" if shown else "No"]}}]
        when = f"2026-01-0{1 + len(options)}T00:00:00Z"
        task["annotations"] = [{"completed_by": 1, "result": result, "updated_at": when}]
    (out / "answers.json").write_text(json.dumps(tasks))
    done = world.kb("label", "import", out / "answers.json")
    assert done.code == 0, done.err


def on_the_card(world: AlignmentWorld) -> str:
    folder = release_folder.read_release_folder(world.root / "release" / "pairs", "pairs")
    with duckdb.connect() as con:
        return " ".join(pair_quality(con, world.root, folder))


def test_judgements_of_spoken_and_aligned_clips_stand_side_by_side(world: AlignmentWorld) -> None:
    done = world.kb("pairs", "align")
    assert "nobody has judged these clips" in done.err
    assert "Nobody has looked at these clips" in on_the_card(world)
    refused = world.kb("pairs", "align", "--fit")
    assert (refused.code, "judged clips" in refused.said) == (2, True)
    judge(world, "visible", {"with"})
    judge(world, "visible_aligned", {"before", "with", "after"}, "--aligned")
    done = world.kb("pairs", "align", "--fit", "--json")
    assert done.code == 0, done.err
    summary = json.loads(done.out.splitlines()[-1])
    every, likely = summary["visible"]
    assert every["spoken"]["share"] == pytest.approx(0.25, abs=0.05)
    assert every["aligned"]["share"] == pytest.approx(0.75, abs=0.05)
    assert likely["aligned"]["share"] > 0.95
    shares = (interval_text(every[times]) for times in ("spoken", "aligned"))
    assert "at spoken times {} of 72 clips; at aligned times {} of 72 clips".format(
        *shares
    ) in on_the_card(world)
    lines = [line for line in done.out.splitlines() if line.startswith("score.align_")]
    assert len(lines) == 2
    profile = world.path / "profile.toml"
    text = profile.read_text()
    try:
        named = "\n".join(line.removeprefix("score.") for line in lines)
        profile.write_text(f"{text}\n[score]\n{named}\n")
        assert world.kb("pairs", "align").code == 0
    finally:
        profile.write_text(text)
    found = measured(world)
    assert found.alignable[found.shown].min() > 0.5 > found.alignable[~found.shown].max()


def test_the_fitted_curve_gives_the_shares_that_people_see() -> None:
    rng = np.random.default_rng(0)
    peaks = rng.uniform(0, 6, 20_000)
    shown = rng.random(20_000) < 1 / (1 + np.exp(-1.5 * (peaks - 2.5)))
    assert fitted(peaks, shown) == pytest.approx((2.5, 1.5), abs=0.1)
    apart = fitted(np.array([1.0, 1.1, 3.9, 4.0]), np.array([False, False, True, True]))
    assert apart is not None
    assert 1.1 < apart[0] < 3.9
    assert np.isfinite(apart[1])
    assert fitted(peaks, peaks < 3) is None


def test_f1_as_the_paper_counts_it() -> None:
    """Against every way to cut the scores in two, and the counts themselves."""
    rng = np.random.default_rng(1)
    for n in (2, 3, 10, 41):
        scores, visible = rng.integers(0, 12, n) / 10, rng.random(n) < 0.6
        ways = [(scores[scores <= end], scores[scores > end]) for end in np.unique(scores)[:-1]]
        if not ways:
            continue
        low, high = min(ways, key=lambda way: round(sum(len(c) * c.var() for c in way), 9))
        found = f1_of_clusters(scores, visible)
        assert found is not None
        assert found["boundary"] == pytest.approx((low.mean() + high.mean()) / 2, abs=1e-4)
        called = scores > found["boundary"]
        right, wrong = (called & visible).sum(), (called ^ visible).sum()
        assert found["f1"] == pytest.approx(2 * right / (2 * right + wrong), abs=1e-4)
        assert found["low"] <= found["f1"] <= found["high"]
        assert found["n"] == n
    assert f1_of_clusters(np.full(9, 0.3), np.ones(9, bool)) is None
    assert f1_of_clusters(np.zeros(0), np.zeros(0, bool)) is None
