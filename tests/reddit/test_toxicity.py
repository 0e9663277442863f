"""The toxicity stage on titles, bodies and comments, and scores of texts that a purge took away."""

from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from kb.annotate.scores import CATEGORIES
from tests.conftest import needs
from tests.faults import Sandbox
from tests.reddit.conftest import small_world
from tests.reddit.raw import comment, listing, post, write
from tests.reddit.work import NOW, Work, rows

needs("torch", "detoxify")


RUDE, PLAIN, ONLY = (
    "you are a stupid idiot",
    "how to build a house in minecraft",
    "how to find a diamond",
)
SHARED, BELOW = "the creeper explodes near the player", "this is below a rude title"
POSTS = [
    post("good", title=PLAIN, selftext=SHARED),
    post("bare", title=ONLY),
    post("title", title=RUDE),
    post("body", title=PLAIN, selftext=RUDE),
    post("low", title="nobody liked this", score=1),
]
COMMENTS = [
    comment("kind", body=SHARED),
    comment("rude", body=RUDE),
    comment("below", link_id="t3_title", body=BELOW),
    comment("under", link_id="t3_low", body="nobody read this"),
]


def text_hash(text: str) -> str:
    return sha256(text.encode()).hexdigest()


def scored_work(place: Path) -> Any:
    """The rows above, filtered with the tiny model."""
    with (
        pytest.MonkeyPatch.context() as patch,
        Sandbox(small_world(1), services=["reddit"]) as sandbox,
    ):
        patch.setenv("KB_NOW", NOW)
        work = Work(sandbox, place, scored=True)
        write(work.root, "listings", {}, listing(*POSTS))
        write(work.root, "comments", {"article": "good"}, [listing(*COMMENTS)])
        work.filtered = work.filter()
        yield work


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Any:
    yield from scored_work(tmp_path_factory.mktemp("judged"))


@pytest.fixture
def fresh(tmp_path: Path) -> Any:
    yield from scored_work(tmp_path)


def scores(work: Work) -> dict[str, dict[str, Any]]:
    return {row["text_hash"]: row for row in rows(work.root / "annotations" / "reddit")}


def test_a_rude_title_body_or_comment_is_rejected_by_its_stage(judged: Work) -> None:
    found = {row["key"]: row for row in judged.table("clean", "reddit", "rejected")}
    assert {key: (row["stage"], row["reason"]) for key, row in found.items()} == {
        "t3_title": ("toxicity", "title"),
        "t3_body": ("toxicity", "body"),
        "t1_rude": ("toxicity", "body"),
        "t1_below": ("post", "not_kept"),
        "t3_low": ("score", "below"),
        "t1_under": ("post", "not_kept"),
    }
    for key in ("t3_title", "t3_body", "t1_rude"):
        assert float(found[key]["value"]) > float(found[key]["threshold"]) == 0.5
    assert judged.filtered["stages"] == {"toxicity": 3, "post": 2, "score": 1}
    assert judged.filtered["kept"] == 3


def test_kept_rows_have_every_category_and_the_largest(judged: Work) -> None:
    by_text = scores(judged)
    posts, comments = (
        judged.table("clean", "reddit", "posts"),
        judged.table("clean", "reddit", "comments"),
    )
    texts = [(row, "toxicity_title", row["title"]) for row in posts] + [
        (row, "toxicity_body", row["body"]) for row in (*posts, *comments)
    ]
    assert len(texts) == 5
    for row, column, text in texts:
        found = {name: row[f"{column}_{name}"] for name in CATEGORIES}
        if text is None:
            assert (row[column], set(found.values())) == (None, {None})
        else:
            assert found == {name: by_text[text_hash(text)][name] for name in CATEGORIES}
            assert [name for name, score in found.items() if score is None] == [
                "sexual_explicit"
            ], "no class of this model"
            assert row[column] == max(score for score in found.values() if score is not None) <= 0.5


def test_each_text_that_reaches_the_stage_is_scored_once(judged: Work) -> None:
    hashes = [row["text_hash"] for row in rows(judged.root / "annotations" / "reddit")]
    # A post below the score costs nothing, nor do its comments.
    assert sorted(hashes) == sorted(map(text_hash, (RUDE, PLAIN, SHARED, ONLY, BELOW)))


def test_a_purge_takes_the_scores_of_texts_that_are_nowhere_else(fresh: Work) -> None:
    ids = fresh.place / "ids"
    ids.write_text("t3_bare\nt1_kind\nt3_title\n")  # with its comment
    before = scores(fresh)
    summary = fresh.purge(ids)
    after = scores(fresh)
    assert before.keys() - after.keys() == {text_hash(ONLY), text_hash(BELOW)}
    # Another post says the same as the comment that went, and a body the same as the title.
    assert {text_hash(SHARED), text_hash(PLAIN), text_hash(RUDE)} <= after.keys()
    assert summary["scores"] == 2
    fresh.filter()
    assert scores(fresh) == after, "what is left is scored already, and nothing comes back"
