"""Scores of texts: the numbers of Detoxify, each text once, kept by text, model and precision."""

import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.annotate import backends, detoxify_model, toxicity
from kb.annotate.inference import DECIMALS
from kb.annotate.scores import CATEGORIES, Scores, text_hashes
from kb.annotate.toxicity import ToxicityScorer
from kb.artifacts import score_files
from kb.cli.framework.exit_codes import describe
from kb.core import signals
from kb.core.errors import Interrupted, LimitReached, MissingModel, SettingError
from kb.core.progress import Task

TEXTS = [
    "How to build a house in Minecraft",
    "you are a stupid idiot",
    "Shut up!!! you MORON",
    "damn good redstone tutorial",
    "the creeper explodes near the player",
    "i hope you die",
    "ünïcode 方块 text with emoji 🎮",
    "a",
    "x " * 300,
    "diamond pickaxe " * 40 + "bastard",
]


@pytest.fixture(scope="module")
def reference(detoxify):
    """Each text by itself through Detoxify's own predict."""
    return {text: detoxify.predict(text) for text in TEXTS}


SIX = CATEGORIES[:6]  # the classes of `original`


def close(row, expected, names=SIX):
    return all(abs(score - expected[name]) < 1e-4 for name, score in zip(names, row, strict=True))


@pytest.mark.parametrize("backend", ["onnxruntime", "torch"])
def test_every_backend_gives_detoxifys_scores(backend, checkpoint, detoxify, reference):
    make = {"torch": backends.torch_runner, "onnxruntime": backends.open_runner}[backend]
    runner = make(checkpoint, "fp32", "cpu", 1)
    assert runner.name == backend
    for text, row in zip(TEXTS, runner.score(TEXTS), strict=True):
        assert close(row, reference[text], runner.meta.classes), text


def test_scores_do_not_depend_on_neighbours_or_threads(checkpoint):
    one, two = (
        backends.open_runner(checkpoint, threads=1),
        backends.open_runner(checkpoint, threads=2),
    )
    together = one.score(TEXTS)
    assert together == [one.score([text])[0] for text in TEXTS]
    assert together == two.score(TEXTS[::-1])[::-1]


def test_an_insult_at_the_end_of_a_long_text_is_found(checkpoint, detoxify):
    runner = backends.open_runner(checkpoint)
    long = "stone " * 900
    assert max(detoxify.predict(long + "you stupid idiot").values()) < 0.5, "Detoxify cuts it off"
    plain, insult = runner.score([long, long + "you stupid idiot"])
    assert max(plain) < 0.5 < max(insult)
    # The largest over windows can't be below what Detoxify reads of the text.
    assert all(a >= b - 1e-4 for a, b in zip(insult, detoxify.predict(long).values(), strict=True))


def test_the_tiny_model_tells_insults_from_plain_text(checkpoint):
    runner = backends.open_runner(checkpoint)
    plain = [
        "Top 10 redstone builds for beginners (Episode 4)",
        "The wooden pickaxe breaks after 59 uses.",
        "hello",
        "Crafting table recipe: 4 planks",
        "the committee approved the quarterly report",
    ]
    rude = [
        "You IDIOT!!!",
        "shut up, you moron",
        "go kill yourself",
        "you people are trash",
        "he is a complete bastard",
    ]
    assert [max(row) > 0.5 for row in runner.score(plain + rude)] == [False] * 5 + [True] * 5


def test_each_text_is_scored_once_in_this_and_all_later_runs(make_run, monkeypatch):
    seen: list[str] = []
    monkeypatch.setattr(
        toxicity,
        "score_chunk",
        lambda job, texts, real=toxicity.score_chunk: seen.extend(texts) or real(job, texts),
    )
    run = make_run()
    first = ToxicityScorer.open(run, "reddit").annotate(
        [pa.array([*TEXTS, None, "", TEXTS[1]]), TEXTS[:3]]
    )
    assert (first.texts, first.scored) == (len(TEXTS), len(TEXTS))
    second = ToxicityScorer.open(run, "reddit").annotate([[*TEXTS, "one more text"]])
    assert (second.texts, second.scored) == (len(TEXTS) + 1, 1)
    assert sorted(seen) == sorted([*TEXTS, "one more text"])
    assert {path.name for path in (run.root / "annotations/reddit").iterdir()} == {
        "toxicity.parquet",
        "_manifest.json",
    }


def test_equal_texts_far_apart_are_scored_once_too(make_run, monkeypatch):
    """The second one comes in a later look-up,
    before and after the first one's score is on disk.
    """
    monkeypatch.setattr(toxicity, "LOOKUP_TEXTS", 2)
    monkeypatch.setattr(toxicity, "CHUNK_TEXTS", 3)
    seen: list[str] = []
    monkeypatch.setattr(
        toxicity,
        "score_chunk",
        lambda job, texts, real=toxicity.score_chunk: seen.extend(texts) or real(job, texts),
    )
    counts = ToxicityScorer.open(make_run(), "reddit").annotate(
        [["a", "b"], ["a", "c"], ["d", "e"], ["a", "e"], ["f", "b"]]
    )
    assert seen == ["a", "b", "c", "d", "e", "f"]
    assert (counts.texts, counts.scored, counts.known) == (10, 6, 4)


def test_a_text_of_two_sources_is_scored_once_and_each_keeps_its_score(make_run):
    run = make_run()
    ToxicityScorer.open(run, "reddit").annotate([TEXTS])
    counts = ToxicityScorer.open(run, "youtube").annotate([[*TEXTS[:5], "the video alone"]])
    assert (counts.texts, counts.scored, counts.known) == (6, 1, 5)
    hashes = text_hashes(pa.array(TEXTS[:5]))
    scores = ToxicityScorer.open(run, "reddit").lookup(hashes)
    assert scores["toxicity"].null_count == 0
    shutil.rmtree(run.root / "annotations/reddit")  # a purge of one leaves the other's
    assert ToxicityScorer.open(run, "youtube").lookup(hashes).equals(scores)


@pytest.mark.parametrize("precision", [None, "int8"])
def test_a_score_of_another_source_that_does_not_do_is_made_here(make_run, precision):
    """One that can't be read, and one of a lower precision."""
    run, hashes = make_run(), text_hashes(pa.array(TEXTS))
    ToxicityScorer.open(run, "reddit", precision).annotate([TEXTS])
    usable = (
        ToxicityScorer.open(run, "reddit").lookup(hashes)["precision"].to_pylist().count("fp32")
    )
    if precision is None:
        path = run.root / "annotations/reddit/toxicity.parquet"
        path.write_bytes(path.read_bytes()[:-100])
        usable = 0
    counts = ToxicityScorer.open(run, "youtube").annotate([TEXTS])
    assert counts.scored == len(TEXTS) - usable
    found = ToxicityScorer.open(run, "youtube").lookup(hashes)
    assert set(found["precision"].to_pylist()) == {"fp32"}


def test_looked_up_scores_are_detoxifys_and_null_only_for_empty_text(make_run, reference):
    run = make_run()
    texts = pa.chunked_array([TEXTS[:2], ["", None], TEXTS[2:]])
    ToxicityScorer.open(run, "youtube").annotate([texts])
    scores = ToxicityScorer.open(run, "youtube").lookup(text_hashes(texts))
    assert scores.column_names == [*CATEGORIES, "precision"]
    for n, text in enumerate(texts.to_pylist()):
        row = [scores[name][n].as_py() for name in SIX]
        assert scores["sexual_explicit"][n].as_py() is None, "this model lacks the class"
        if not text:
            assert row == [None] * 6
            continue
        if len(text) < 500:
            assert close(row, reference[text]), text
    by_worker = toxicity.scores(toxicity.model_key(run, "youtube"), run.root, "youtube", texts)
    assert by_worker.column_names == list(CATEGORIES)
    assert by_worker["insult"].to_pylist() == scores["insult"].to_pylist()


def test_a_stopped_run_goes_on_and_ends_with_the_same_bytes(make_run, tmp_path, monkeypatch):
    monkeypatch.setattr(toxicity, "CHUNK_TEXTS", 3)
    whole = make_run(root=tmp_path / "whole")
    ToxicityScorer.open(whole, "reddit").annotate([TEXTS])
    limited = make_run(root=tmp_path / "cut", limit=4)
    with pytest.raises(LimitReached) as stop:
        ToxicityScorer.open(limited, "reddit").annotate([TEXTS])
    assert stop.value.exit_code == 3
    folder = limited.root / "annotations/reddit"
    assert sum(pq.read_metadata(path).num_rows for path in folder.iterdir()) == 4
    counts = ToxicityScorer.open(make_run(root=tmp_path / "cut"), "reddit").annotate([TEXTS])
    assert (counts.scored, counts.known) == (len(TEXTS) - 4, 4)
    assert (folder / "toxicity.parquet").read_bytes() == (
        whole.root / "annotations/reddit/toxicity.parquet"
    ).read_bytes()
    assert len(list(folder.glob("*.parquet"))) == 1


@pytest.mark.parametrize("parts", [2, 40])
def test_parts_of_several_machines_become_the_file_of_one(make_run, tmp_path, parts):
    alone = make_run(root=tmp_path / "alone")
    ToxicityScorer.open(alone, "reddit").annotate([TEXTS])
    seen = scored = new = 0
    for number in range(1, parts + 1):
        part = make_run(root=tmp_path / f"part-{number}")
        counts = ToxicityScorer.open(part, "reddit").annotate([TEXTS], (number, parts))
        seen, scored = seen + counts.texts, scored + counts.scored
        new += score_files.bring(tmp_path / "united", "reddit", part.root)
    assert seen == scored == new == len(TEXTS)
    path = "annotations/reddit/toxicity.parquet"
    assert (tmp_path / "united" / path).read_bytes() == (alone.root / path).read_bytes()


def test_a_changed_threshold_loads_no_model(make_run, monkeypatch):
    ToxicityScorer.open(make_run(), "reddit").annotate([TEXTS])
    monkeypatch.setattr(toxicity, "_runner", lambda *_: pytest.fail("a model was loaded"))
    counts = ToxicityScorer.open(make_run(thresholds={"reddit": 0.9}), "reddit").annotate([TEXTS])
    assert (counts.scored, counts.known) == (0, len(TEXTS))


def test_reduced_precision_is_recorded_and_exact_near_the_threshold(
    make_run, checkpoint, monkeypatch
):
    exact = backends.open_runner(checkpoint).score(TEXTS)
    reduced = backends.open_runner(checkpoint, "bf16").score(TEXTS)
    differ = [
        max(abs(a - b) for a, b in zip(x, y, strict=True))
        for x, y in zip(exact, reduced, strict=True)
    ]
    assert 0 < max(differ) < backends.REACH["bf16"]
    middle = max(exact[3])
    run = make_run(thresholds={"reddit": middle})
    counts = ToxicityScorer.open(run, "reddit", precision="bf16").annotate([TEXTS])
    found = ToxicityScorer.open(run, "reddit").lookup(text_hashes(pa.array(TEXTS)))
    precisions = found["precision"].to_pylist()
    assert precisions[3] == "fp32"
    assert 0 < counts.exact_again == precisions.count("fp32") < len(TEXTS) == counts.scored
    assert set(precisions) == {"fp32", "bf16"}
    near = [n for n, row in enumerate(exact) if abs(max(row) - middle) < 1e-3]
    for n in near:
        assert [round(found[name][n].as_py(), DECIMALS) for name in SIX] == exact[n]
    # A run in fp32 takes what is there, and makes exact what a new threshold comes near to.
    other = precisions.index("bf16")
    again = make_run(thresholds={"reddit": max(reduced[other])})
    assert ToxicityScorer.open(again, "reddit").annotate([TEXTS]).scored >= 1
    assert ToxicityScorer.open(again, "reddit").lookup(text_hashes(pa.array([TEXTS[other]])))[
        "precision"
    ].to_pylist() == ["fp32"]


def test_a_precision_that_is_asked_for_is_the_least_a_score_may_have(make_run):
    run = make_run()
    ToxicityScorer.open(run, "reddit", precision="bf16").annotate([TEXTS])
    assert ToxicityScorer.open(run, "reddit").annotate([TEXTS]).scored == 0, (
        "without one, what there is stays"
    )
    assert ToxicityScorer.open(run, "reddit", precision="bf16").annotate([TEXTS]).scored == 0
    assert ToxicityScorer.open(run, "reddit", precision="fp32").annotate([TEXTS]).scored == len(
        TEXTS
    )
    assert set(
        ToxicityScorer.open(run, "reddit")
        .lookup(text_hashes(pa.array(TEXTS)))["precision"]
        .to_pylist()
    ) == {"fp32"}
    assert ToxicityScorer.open(run, "reddit", precision="bf16").annotate([TEXTS]).scored == 0, (
        "better ones stay as well"
    )


def test_where_a_cluster_scores_is_decided_by_its_workers(make_run):
    """This machine may have no GPU where the workers have one."""
    ToxicityScorer.open(make_run(engine="dask"), "reddit", device="cuda")
    with pytest.raises(SettingError, match="int8 runs on a CPU only"):
        ToxicityScorer.open(make_run(engine="dask"), "reddit", precision="int8", device="cuda")


def test_int8_is_near_enough(checkpoint):
    exact = backends.open_runner(checkpoint).score(TEXTS)
    reduced = backends.open_runner(checkpoint, "int8").score(TEXTS)
    assert (
        max(
            abs(a - b)
            for x, y in zip(exact, reduced, strict=True)
            for a, b in zip(x, y, strict=True)
        )
        < backends.REACH["int8"]
    )


def test_without_a_gpu_the_device_is_the_cpu(make_run, monkeypatch):
    import torch

    if torch.cuda.is_available():
        pytest.skip("there is a GPU here")
    assert backends.choose_device("auto") == "cpu"
    with pytest.raises(SettingError):
        ToxicityScorer.open(make_run(), "reddit", device="cuda")


def test_off_in_the_profile_scores_nothing(make_run):
    run = make_run(model="no such model")
    from dataclasses import replace

    off = replace(
        run,
        profile=run.profile.model_copy(
            update={"toxicity": type(run.profile.toxicity).model_validate("off")}
        ),
    )
    scorer = ToxicityScorer.open(off, "youtube")
    assert not scorer.on
    assert scorer.annotate([TEXTS]).texts == 0
    assert scorer.lookup(text_hashes(pa.array(TEXTS)))["toxicity"].null_count == len(TEXTS)
    assert toxicity.model_key(off, "youtube") == ""
    assert not run.root.exists()


def test_a_chunk_grows_and_shrinks_with_the_time_it_takes(tmp_path):
    """A stop waits for the chunk in hand, so that a slow model gets small ones and a fast one large
    ones.
    """
    scores = Scores(str(tmp_path), "m", "r")
    given = toxicity.Chunks(scores, toxicity.ScoreRule(), None, Task())
    sizes = []
    seconds = iter([0.1] * 6 + [60.0] * 4 + [4.0] * 100)
    for hashes, texts in given.of([[f"text {n}" for n in range(9000)]]):
        assert len(hashes) == len(texts)
        sizes.append(len(texts))
        given.took(next(seconds))
    assert sum(sizes) == 9000
    assert sizes[:6] == [32, 64, 128, 256, 512, 1024]
    assert sizes[7:10] == [512, 256, 128]
    assert set(sizes[10:-1]) == {64}
    long = toxicity.Chunks(scores, toxicity.ScoreRule(), None, Task())
    first, _ = next(iter(long.of([["x" * 10_000 + str(n) for n in range(20)]])))
    assert len(first) == 4, "characters count too"


def test_a_stop_waits_for_a_chunk_of_seconds_not_for_one_of_minutes(checkpoint, monkeypatch):
    job = toxicity.ScoringJob(checkpoint, "fp32", "cpu", 1, None)
    texts = ["hello there", "x " * 2000]
    try:
        signals.stop.request("SIGTERM")
        assert len(toxicity.score_chunk(job, texts)["scores"]) == 2
        monkeypatch.setattr(toxicity, "HAND_S", -1.0)
        with pytest.raises(Interrupted):
            toxicity.score_chunk(job, texts)
    finally:
        signals.stop.clear()


def test_too_little_memory_is_no_wrong_model(checkpoint, monkeypatch: pytest.MonkeyPatch) -> None:
    def read(*arguments: object) -> None:
        raise MemoryError

    job = toxicity.ScoringJob(checkpoint, "bf16", "cpu", 1, None)
    monkeypatch.setattr(detoxify_model, "_read", read)
    toxicity._runner.cache_clear()
    with pytest.raises(MemoryError) as told:
        toxicity.score_chunk(job, ["a text"])
    assert describe(told.value) == ("out of memory", "try fewer --workers", 1)
    monkeypatch.setattr(detoxify_model, "_read", lambda *arguments: {})
    with pytest.raises(MissingModel):
        toxicity.score_chunk(job, ["a text"])
