"""What an archive says of its records reaches every table, whatever the order of what is read."""

import tempfile
from collections.abc import Iterable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.config.pipeline import Recipe
from kb.core.config.profile.products import Toxicity
from kb.core.context import Run
from kb.filters.filter_run import run_clean
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.crawl.refresh import due
from kb.reddit.parse.latest_state import latest_state
from kb.reddit.restore.reconstruct import rebuild
from tests.reddit import raw
from tests.reddit.dumped import post as dumped_post
from tests.reddit.dumped import run_in, write
from tests.reddit.work import rows, texts

FIRST = 1_712_000_000
SECOND = FIRST + 130_000
BETWEEN, AFTER = FIRST + 1_000, SECOND + 1_000
SECRET = "the seed of my island"
SEEN = {"retrieved_2nd_on": SECOND}
LATER = {**SEEN, "was_deleted_later": True}


def post(key: str, meta: Any = "none", **fields: Any) -> dict[str, Any]:
    """A post of the archive; its `_meta` unless that is "none"."""
    made = {"created_utc": FIRST - 60, "retrieved_on": FIRST, "selftext": "how to smelt sand"}
    more = {} if meta == "none" else {"_meta": meta}
    return dumped_post(key, **{**made, **more, **fields})


def comment(key: str, meta: Any = "none", **fields: Any) -> dict[str, Any]:
    """An answer to the post `p` of the archive."""
    record = {
        "id": key,
        "subreddit": "Minecraft",
        "author": "tidy_pebble",
        "link_id": "t3_p",
        "parent_id": "t3_p",
        "body": "in a furnace",
        "score": 2,
        "created_utc": FIRST - 30,
        "retrieved_on": FIRST,
    }
    return {**record, **({} if meta == "none" else {"_meta": meta}), **fields}


class Found(NamedTuple):
    """What became of the records in every road: kept rows and reasons, by full name."""

    clean: dict[str, dict[str, Any]]
    rejected: dict[str, tuple[str, str]]
    restored: dict[str, dict[str, Any]]
    missing: dict[str, str]
    gone: dict[str, str | None]

    def same(self) -> None:
        """The filter, a reconstruction, and what refresh and purge go by agree."""
        assert self.clean.keys() == self.restored.keys()
        for name, row in self.clean.items():
            for column in ("score", "fetched_at", "body", "score_source"):
                assert row[column] == self.restored[name][column], (name, column)
        removed = {name: why for name, (stage, why) in self.rejected.items() if stage == "removed"}
        assert removed == self.missing == {name: why for name, why in self.gone.items() if why}


def off(root: Path) -> Run:
    """The data root of `root`, without a model."""
    run = run_in(root / "data")
    profile = run.profile.model_copy(update={"toxicity": Toxicity(toxicity="off")})
    return replace(run, profile=profile)


def by_name(folder: Path) -> dict[str, dict[str, Any]]:
    """The rows of posts and comments."""
    return {
        f"{prefix}_{row[key]}": row
        for name, prefix, key in (("posts", "t3", "post_id"), ("comments", "t1", "comment_id"))
        for row in rows(folder / name)
    }


def filtered(root: Path) -> tuple[dict[str, dict[str, Any]], dict[str, tuple[str, str]]]:
    """Kept rows, and stage and reason of the others."""
    run_clean(off(root), "reddit")
    clean = off(root).root / "clean" / "reddit"
    return by_name(clean), {
        row["key"]: (row["stage"], row["reason"]) for row in rows(clean / "rejected")
    }


def missing(out: Path) -> dict[str, str]:
    found = pq.read_table(out / "missing.parquet").to_pylist()
    return {row["key"]: row["reason"] for row in found}


def read(root: Path, files: list[Path], ids: Iterable[str]) -> Found:
    """Import, filter and reconstruct these dumps, one command each, in their order."""
    for file in files:
        import_dumps(off(root), [file])
    with latest_state(off(root)) as things:
        gone = {row["fullname"]: row["gone"] for part in things for row in part.to_pylist()}
    (root / "ids.txt").write_text("\n".join(ids))
    for file in files:
        rebuild(off(root), root / "ids.txt", root / "out", dumps=[file])
    clean, rejected = filtered(root)
    return Found(clean, rejected, by_name(root / "out"), missing(root / "out"), gone)


def test_what_was_gone_at_the_second_visit_is_removed_and_what_came_back_is_kept(
    tmp_path: Path,
) -> None:
    records = [
        post("p", SEEN),
        post("taken", {**LATER, "removal_type": "author"}, selftext=SECRET, title=SECRET),
        post("held", {**SEEN, "was_initially_deleted": True, "removal_type": "automod_filtered"}),
        comment("stays", SEEN),
        comment("own", {**LATER, "removal_type": "deleted"}, body=SECRET),
        comment("mod", {**LATER, "removal_type": "removed by reddit"}, body=SECRET),
        comment("below", SEEN, parent_id="t1_own"),
        comment("odd", {"was_deleted_later": [], "removal_type": 7, "retrieved_2nd_on": "soon"}),
        comment("no", None),
        comment("list", [LATER]),
    ]
    names = [f"{'t3' if 'title' in one else 't1'}_{one['id']}" for one in records]
    found = read(tmp_path, [write(tmp_path / "RC_2024-04.zst", records)], names)
    found.same()
    assert found.missing == {"t3_taken": "deleted", "t1_own": "deleted", "t1_mod": "removed"}
    assert found.clean.keys() == {
        *("t3_p", "t3_held", "t1_stays", "t1_below", "t1_odd", "t1_no", "t1_list")
    }
    below = found.clean["t1_below"]
    assert (below["parent_id"], below["depth"], below["parent_in_release"]) == ("t1_own", 1, False)
    ages = {name: int(row["fetched_at"].timestamp()) for name, row in found.clean.items()}
    assert {name for name, at in ages.items() if at == FIRST} == {"t1_odd", "t1_no", "t1_list"}
    assert set(ages.values()) == {FIRST, SECOND}
    for place in (tmp_path / "out", tmp_path / "data" / "clean"):
        assert not [path for path, text in texts(place).items() if SECRET in text]


def test_a_purge_takes_what_the_archive_says_is_gone(tmp_path: Path) -> None:
    records = [post("p", SEEN), comment("own", {**LATER, "removal_type": "deleted"}, body=SECRET)]
    import_dumps(off(tmp_path), [write(tmp_path / "RC_2024-04.zst", records)])
    assert any(SECRET in text for text in texts(tmp_path / "data").values())
    purge = Recipe("purge").defined("purge")
    assert purge(off(tmp_path), "reddit", None)["also"] == 1
    assert not [path for path, text in texts(tmp_path / "data").items() if SECRET in text]


OLD = comment("c", body=SECRET, score=1)
VERDICTS = [
    comment("c", {**LATER, "removal_type": "moderator"}, body=SECRET, score=5),
    comment("c", {"was_deleted_later": True}, body=SECRET),  # no word of when
    comment("c", {"was_deleted_later": True, "retrieved_2nd_on": "soon"}, retrieved_on=None),
    comment("c", body="[removed]"),  # of the same moment
]


@pytest.mark.parametrize(
    ("verdict", "apart"), [*((one, True) for one in VERDICTS), (VERDICTS[0], False)]
)
@pytest.mark.parametrize("order", [1, -1])
def test_an_older_copy_brings_nothing_back_in_either_order(
    tmp_path: Path, verdict: dict[str, Any], apart: bool, order: int
) -> None:
    copies = [post("p", SEEN), *[OLD, verdict][::order]]
    files = [copies[:2], copies[2:]] if apart else [copies]
    dumps = [write(tmp_path / f"RC_{place}.zst", part) for place, part in enumerate(files)]
    found = read(tmp_path, dumps, ["t3_p", "t1_c"])
    found.same()
    assert (found.clean.keys(), found.missing) == ({"t3_p"}, {"t1_c": "removed"})


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_a_removal_without_a_date_is_undone_by_no_copy(
    tmp_path: Path, order: tuple[int, ...]
) -> None:
    """Whichever of the three is read last, a dated removal in between included."""
    copies = [
        comment("c", {"was_deleted_later": True, "removal_type": "deleted"}),
        comment("c", body="[removed]"),
        comment("c", SEEN, body=SECRET),
    ]
    files = [write(tmp_path / f"RC_{n}.zst", [post("p"), copies[n]]) for n in order]
    found = read(tmp_path, files, ["t3_p", "t1_c"])
    found.same()
    assert found.missing == {"t1_c": "deleted"}


@pytest.mark.parametrize("order", [1, -1])
def test_the_score_is_of_the_second_visit_in_either_order(tmp_path: Path, order: int) -> None:
    copies = [post("p", SEEN, score=40), post("p", score=9, retrieved_on=BETWEEN)]
    files = [write(tmp_path / f"RS_{n}.zst", [one]) for n, one in enumerate(copies[::order])]
    found = read(tmp_path, files, ["t3_p"])
    found.same()
    row = found.clean["t3_p"]
    assert (row["score"], int(row["fetched_at"].timestamp())) == (40, SECOND)


@pytest.mark.parametrize("order", [1, -1])
def test_what_came_back_is_there_beside_a_copy_of_the_first_visit(
    tmp_path: Path, order: int
) -> None:
    back = comment("c", {**SEEN, "was_initially_deleted": True, "removal_type": "removed"})
    copies = [comment("c", body="[removed]"), back][::order]
    files = [write(tmp_path / f"RC_{n}.zst", [post("p"), one]) for n, one in enumerate(copies)]
    found = read(tmp_path, files, ["t3_p", "t1_c"])
    found.same()
    assert found.clean.keys() == {"t3_p", "t1_c"}


@pytest.mark.parametrize(
    ("at", "meta", "kept"),
    [
        (AFTER, LATER, True),  # moderators may have put it back, and Reddit shows it
        (BETWEEN, LATER, False),
        (BETWEEN, {"was_deleted_later": True}, True),  # nobody knows that the removal is newer
    ],
)
def test_the_newer_of_reddits_answer_and_the_archives_word_counts(
    tmp_path: Path, at: int, meta: dict[str, Any], kept: bool
) -> None:
    dump = write(tmp_path / "RC.zst", [post("p", SEEN), comment("c", meta, body=SECRET)])
    import_dumps(off(tmp_path), [dump])
    when = f"{datetime.fromtimestamp(at, UTC):%Y-%m-%dT%H:%M:%SZ}"
    shown = raw.comment("c", link_id="t3_p", parent_id="t3_p", score=8)
    raw.write(off(tmp_path).root, "info", {"id": "t1_c", "posts": ["p"]}, raw.listing(shown), when)
    clean, rejected = filtered(tmp_path)
    assert ("t1_c" in clean, "t1_c" in rejected) == (kept, not kept)
    assert not kept or (clean["t1_c"]["score"], clean["t1_c"]["score_source"]) == (8, "live")
    with latest_state(off(tmp_path)) as things:
        [row] = [one for part in things for one in part.to_pylist() if one["fullname"] == "t1_c"]
    assert (row["gone"], row["live"]) == ((None, True) if kept else ("removed", False))


def test_a_refresh_asks_for_what_others_removed_but_not_for_what_its_author_deleted(
    tmp_path: Path,
) -> None:
    kinds = {"own": "deleted", "mod": "moderator", "unsaid": None}
    records = [comment(key, {**LATER, "removal_type": kind}) for key, kind in kinds.items()]
    import_dumps(off(tmp_path), [write(tmp_path / "RC.zst", [post("p", SEEN), *records])])
    with latest_state(off(tmp_path)) as things:
        asked = {
            name for part in due(things, (), None, False) for name in part["fullname"].to_pylist()
        }
    assert asked == {"t3_p", "t1_mod", "t1_unsaid"}


class Copy(NamedTuple):
    """A copy of a comment in an archive: when it was visited, and what was there then."""

    first: int | None
    second: int | None
    word: str  # there, gone (the text is the site's), later, back

    def record(self, score: int) -> dict[str, Any]:
        meta: dict[str, Any] = {} if self.second is None else {"retrieved_2nd_on": self.second}
        meta |= {"later": {"was_deleted_later": True}, "back": {"was_initially_deleted": True}}.get(
            self.word, {}
        )
        text = "[removed]" if self.word == "gone" else f"text {score}"
        return comment("c", meta or None, body=text, score=score, retrieved_on=self.first)

    def weight(self) -> tuple[Any, ...]:
        """The greatest copy counts."""
        gone = self.word in ("gone", "later")
        at = self.second or self.first
        unknown = gone and (self.second is None if self.word == "later" else at is None)
        return unknown, at or 0, gone


moments = st.sampled_from([None, FIRST, BETWEEN])
copies = st.builds(
    Copy,
    moments,
    st.sampled_from([None, SECOND, AFTER]),
    st.sampled_from(["there", "gone", "later", "back"]),
)


@settings(max_examples=6, deadline=None)
@given(st.lists(copies, min_size=2, max_size=4), st.data())
def test_any_order_of_any_copies_says_the_same(found: list[Copy], data: st.DataObject) -> None:
    """In any files, imported and reconstructed one after the other in any order."""
    files = data.draw(st.lists(st.integers(0, 2), min_size=len(found), max_size=len(found)))
    score = {one: n for n, one in enumerate(sorted({one.weight() for one in found}))}
    with tempfile.TemporaryDirectory() as folder:
        root, dumps = Path(folder), []
        for number in data.draw(st.permutations(sorted(set(files)))):
            here = zip(found, files, strict=True)
            records = [one.record(score[one.weight()]) for one, file in here if file == number]
            dumps.append(write(root / f"RC_{number}.zst", [post("p", SEEN), *records]))
        outcome = read(root, dumps, ["t3_p", "t1_c"])
    outcome.same()
    top = max(score)
    if top[2]:
        assert outcome.missing == {"t1_c": "removed"}
    else:
        assert outcome.clean["t1_c"]["score"] == score[top]
