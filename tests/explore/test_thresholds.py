"""The figures of another threshold are those of a filter run with it."""

import html
import json
import re
import shutil
from pathlib import Path

import duckdb
import pytest

from tests.conftest import ROOT
from tests.explore.conftest import Explored, figures, number
from tests.inprocess import Here

KEYS = {
    "views": "min_views = 100",
    "aspect_ratio": "min_aspect_ratio = 1.0",
    "duration": "min_duration_s = 60",
    "toxicity youtube": "youtube = 0.5",
    "toxicity reddit": "reddit = 0.5",
    "words": "min_words = 20",
    "score": "min_score = 5",
}


@pytest.fixture(scope="module")
def root(demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the demo's root whose tables may be filtered again."""
    copy = tmp_path_factory.mktemp("thresholds") / "demo"
    shutil.copytree(demo / "data" / "demo", copy)
    return copy


def comments_of_the_same_posts(before: Path, after: Path, limit: float) -> int:
    """Comments within the limit, of the posts that were kept before."""
    old, new = (str(one / "clean/reddit/{}/*.parquet") for one in (before, after))
    (count,) = duckdb.sql(
        f"""WITH old AS (SELECT * FROM read_parquet('{old.format("comments")}')),
            new AS (SELECT * FROM read_parquet('{new.format("comments")}')),
            posts_before AS (SELECT post_id FROM read_parquet('{old.format("posts")}')),
            posts_after AS (SELECT post_id FROM read_parquet('{new.format("posts")}'))
        SELECT (SELECT count(*) FROM new WHERE post_id IN (FROM posts_before))
            + (SELECT count(*) FROM old WHERE post_id NOT IN (FROM posts_after)
                AND coalesce(toxicity_body <= {limit}, true))"""
    ).fetchall()[0]
    return int(count)


@pytest.mark.parametrize(
    ("source", "table", "stage", "value"),
    [
        ("youtube", "videos", "views", "500"),
        ("youtube", "videos", "views", "20"),
        ("youtube", "videos", "aspect_ratio", "1.5"),
        ("youtube", "videos", "aspect_ratio", "0.5"),
        ("youtube", "videos", "duration", "300"),
        ("youtube", "videos", "duration", "10"),
        ("youtube", "videos", "toxicity", "0.01"),
        ("youtube", "videos", "toxicity", "0.99"),
        ("wiki", "pages", "words", "60"),
        ("wiki", "pages", "words", "5"),
        ("reddit", "posts", "score", "50"),
        ("reddit", "posts", "score", "1"),
        ("reddit", "posts", "toxicity", "0.01"),
        ("reddit", "comments", "toxicity", "0.01"),
        ("reddit", "comments", "toxicity", "0.99"),
    ],
)
def test_figures_are_those_of_a_filter_with_that_threshold(
    root: Path,
    demo: Path,
    demo_pages: Explored,
    here: Here,
    tmp_path: Path,
    source: str,
    table: str,
    stage: str,
    value: str,
) -> None:
    answer = demo_pages.ask(
        f"/thresholds?source={source}&table={table}&stage={stage}&value={value}"
    )
    then, _, waiting = figures(answer.text)
    line = KEYS.get(f"{stage} {source}") or KEYS[stage]
    changed = f"{line.partition(' =')[0]} = {value}"
    assert re.findall(r'id="line">(.*?)</code>', answer.text) == [changed]

    profile = tmp_path / "profile"
    shutil.copytree(ROOT / "data/profiles/minecraft", profile)
    text = (profile / "profile.toml").read_text()
    assert text.count(f"\n{line}") == 1
    (profile / "profile.toml").write_text(text.replace(f"\n{line}", f"\n{changed}"))
    given = ("--data", str(root), "--profile", str(profile / "profile.toml"), "--json", "--quiet")
    summary = json.loads(here(source, "filter", *given).out.splitlines()[-1])
    tally = summary["tally"][table]
    kept = tally["kept"]
    if table == "comments":  # the same setting decides posts, whose comments come and go with them
        kept = comments_of_the_same_posts(demo / "data" / "demo", root, float(value))
    unscored = kept - then
    assert 0 <= unscored <= waiting
    if stage != "score":  # whose rejected posts have no toxicity score yet
        assert unscored == 0
        assert tally["pending"] == waiting


def test_changes_by_channel_add_up(demo_pages: Explored) -> None:
    text = demo_pages.ask("/thresholds?source=youtube&stage=toxicity&value=0.99").text
    then, now, _ = figures(text)
    rows = re.findall(r'<td class="n">([\d,]+)</td><td class="n">([\d,]+)</td></tr>', text)
    assert sum(number(more) - number(fewer) for more, fewer in rows) == then - now > 0


def test_a_release_can_only_be_made_stricter(release_pages: Explored) -> None:
    text = release_pages.ask("/thresholds?source=youtube&stage=views&value=500").text
    assert "only a stricter threshold can be tried here" in text
    then, now, _ = figures(text)
    assert then < now
    assert figures(release_pages.ask("/thresholds?source=youtube&value=1").text)[0] == now


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ("value=many", "the threshold is 'many', not a number"),
        ("value=nan", "the threshold is 'nan', not a number"),
        ("step=x", "the threshold is 'x', not a number"),
        ("source=usenet", "there is no threshold of 'usenet'"),
        ("source=youtube&stage=score", "there is no threshold of 'youtube score'"),
    ],
)
def test_a_wrong_question_is_refused(demo_pages: Explored, query: str, message: str) -> None:
    answer = demo_pages.ask(f"/thresholds?{query}")
    assert answer.status == 400
    assert message in html.unescape(answer.text)
