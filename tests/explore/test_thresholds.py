"""The figures of another threshold are those of a filter run with it."""

import html
import json
import re
import shutil
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.core.config.profile.new import KEYWORDS, profile_text
from kb.explore.histogram import draw, edges_of
from kb.store.tables.shard_writer import write_table
from tests.conftest import ROOT
from tests.explore.conftest import Explored, explored, figures, number, total
from tests.inprocess import Here


def setting_of(line: str, folder: Path) -> float:
    """The value of a line that somebody pasted into what `kb profile new` made."""
    path = folder / "new.toml"
    text = profile_text(
        "x", values={"wiki.url": "https://wiki.example/", "reddit.subreddit": "abc"}
    )
    path.write_text(text.replace('"FILL-IN"', "20") + f"\n{line}\n")
    (folder / "keywords.tsv").write_text(KEYWORDS)
    found = load_profile(str(path)).model_dump()
    for name in line.partition(" =")[0].split("."):
        found = found[name]
    return float(found)


KEYS = {
    "views": "min_views = 100",
    "aspect_ratio": "min_aspect_ratio = 1.0",
    "duration": "min_duration_s = 60",
    "toxicity youtube": "youtube = 0.5",
    "toxicity reddit": "reddit = 0.5",
    "words": "min_words = 0",
    "score": "min_score = 5",
}

WHOLE = st.integers(-50, 10_000_000).map(float)
SHARES = st.floats(0, 1, width=32)
OUTCOMES = st.sampled_from(["kept", "pending", "rejected"])


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
        ("youtube", "videos", "duration", "10"),
        ("youtube", "videos", "toxicity", "0.01"),
        ("youtube", "videos", "toxicity", "0.99"),
        ("wiki", "pages", "words", "60"),
        ("reddit", "posts", "score", "50"),
        ("reddit", "posts", "score", "1"),
        ("reddit", "posts", "toxicity", "0.01"),
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
    (copied,) = re.findall(r'id="line">(.*?)</code>', answer.text)
    assert copied.endswith(f".{changed}")
    assert setting_of(copied, tmp_path) == float(value)

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
    result = text.partition('id="result"')[2]
    rows = re.findall(r'<td class="n">([\d,]+)</td><td class="n">([\d,]+)</td></tr>', result)
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


@settings(max_examples=30)
@given(
    st.lists(st.tuples(WHOLE | SHARES, st.booleans(), OUTCOMES), max_size=60),
    st.sampled_from([0.5, 5.0, 100.0]),
    st.booleans(),
)
def test_bars_hold_every_row_between_their_edges(
    rows: list[tuple[float, bool, str]], current: float, at_least: bool
) -> None:
    numbers, kept, outcomes = ([row[place] for row in rows] for place in range(3))
    with duckdb.connect() as con:
        con.register(
            "numbers",
            pa.table(
                {
                    "number": pa.array(numbers, pa.float64()),
                    "kept": pa.array(kept, pa.bool_()),
                    "outcome": pa.array(outcomes, pa.string()),
                }
            ),
        )
        edges = edges_of(con, current, at_least)
        histogram = draw(con, edges, current, current, at_least)
    assert edges == sorted(set(edges))
    assert edges[histogram.current] == edges[histogram.position] == current
    for bar in histogram.bars:
        inside = [
            (one, outcome)
            for number, one, outcome in rows
            if (bar.low <= number < bar.high if at_least else bar.low < number <= bar.high)
        ]
        assert bar.kept == sum(one for one, _ in inside)
        assert bar.others == sum(not one and outcome == "rejected" for one, outcome in inside)
        assert bar.kept + bar.deciding + bar.others == len(inside)
    counted = sum(bar.kept + bar.deciding + bar.others for bar in histogram.bars)
    assert counted == len(rows)


def test_examples_stand_on_both_sides_of_the_line(demo_pages: Explored) -> None:
    text = demo_pages.ask("/thresholds?source=youtube&stage=views&value=500").text
    sides = [
        [
            number(views)
            for views in re.findall(r'<td class="n">([\d,]+)</td><td class="word">', part)
        ]
        for part in text.partition("Just outside</h3>")[2].split("Just inside</h3>")
    ]
    assert [len(side) for side in sides] == [20, 20]
    assert sides[0] == sorted(sides[0], reverse=True)
    assert sides[1] == sorted(sides[1])
    assert sides[0][0] < 500 <= sides[1][0]


def test_tables_of_an_older_version_are_named(demo: Path, tmp_path: Path) -> None:
    root = tmp_path / "root"
    shutil.copytree(demo / "data" / "demo" / "clean" / "wiki", root / "clean" / "wiki")
    (root / "clean" / "wiki" / "_manifest.json").unlink()
    for path in (root / "clean" / "wiki" / "rejected").glob("*.parquet"):
        pq.write_table(pq.read_table(path).drop_columns(["number", "other_stages"]), path)
    with explored(root) as pages:
        answer = pages.ask("/thresholds?source=wiki&value=5")
    words = pq.read_table(root / "clean" / "wiki" / "pages")["word_count"].to_pylist()
    assert (answer.status, figures(answer.text)[0]) == (200, sum(one >= 5 for one in words))
    assert "run <code>kb wiki filter</code> again" in answer.text


def test_the_current_threshold_changes_nothing(demo_pages: Explored) -> None:
    text = demo_pages.ask("/thresholds").text
    addresses = [html.unescape(one) for one in re.findall(r'href="(/thresholds\?.*?)"', text)]
    assert len(addresses) == 8
    for address in addresses:
        text = demo_pages.ask(address).text
        then, now, waiting = figures(text)
        assert then == now > 0
        assert waiting == 0
        places = [html.unescape(one) for one in re.findall(r'href="(/document\?.*?)"', text)]
        assert demo_pages.ask(places[0]).status == 200


def test_a_release_is_read_with_its_own_profile(demo: Path, tmp_path: Path) -> None:
    release = tmp_path / "release"
    shutil.copytree(demo / "data" / "demo" / "release", release)
    profile = release / "youtube" / "profile.toml"
    for path in release.glob("*/profile.toml"):
        path.write_text(profile.read_text().replace("min_views = 100", "min_views = 150"))
    with explored(release) as pages:
        assert "views ≥ 150" in pages.ask("/thresholds?stage=views").text


def test_a_stage_without_values_says_what_gives_it_some(tmp_path: Path, make_rows: Any) -> None:
    """As after a filter without toxicity scores."""
    comments = make_rows("reddit/comments", 3, toxicity_body=[None] * 3)
    write_table(tmp_path / "clean/reddit/comments/part-0.parquet", comments, "reddit/comments")
    with explored(tmp_path) as pages:
        answer = pages.ask("/thresholds?source=reddit&table=comments&stage=toxicity")
    assert answer.status == 200
    assert "kb annotate reddit" in answer.text


@pytest.mark.parametrize("stage", ["source=youtube&stage=views", "source=youtube&stage=duration"])
def test_a_bar_leads_to_its_rows(demo_pages: Explored, stage: str) -> None:
    text = demo_pages.ask(f"/thresholds?{stage}").text.partition("<summary>The numbers")[2]
    links = re.findall(r'<td class="n"><a href="([^"]*)">([\d,]+)</a>', text)
    assert {"verdict=rejected" in link for link, _ in links} == {True, False}
    for link, count in links[:4] + links[-4:]:
        assert total(demo_pages.ask(html.unescape(link)).text) == number(count)


def test_films_have_histograms_whose_bars_lead_to_their_pairs(
    tmp_path: Path, make_rows: Any
) -> None:
    """Also of one value alone; a pair without a value is in no bar."""
    values = {
        "motion": [0.0, 0.5, 1.25, 1.25, 40.0, 199.0],
        "static_share": [0.0] * 6,
        "dark_share": [None, 0.0, 0.25, 0.25, 0.5, 1.0],
    }
    ids = [f"pair{number}" for number in range(6)]
    (tmp_path / "state").mkdir()
    films = make_rows("films/film_figures", 6, pair_id=ids, **values)
    pairs = make_rows("pairs/pairs", 6, pair_id=ids)
    for name, rows in (("films/film_figures", films), ("pairs/pairs", pairs)):
        write_table(tmp_path / f"{name}-00000-of-00001.parquet", rows, name)
    with explored(tmp_path) as pages:
        text = pages.ask("/thresholds").text
        charts = text.partition('id="films"')[2].split("<figcaption>")[:-1]
        assert len(charts) == 3
        for (name, given_), chart in zip(values.items(), charts, strict=True):
            bars = re.findall(r'<a href="([^"]*)" aria-label="(\d+) pairs', chart)
            assert sum(int(count) for _, count in bars) == sum(v is not None for v in given_), name
            assert all(html.unescape(link).count(f"={name}") == 2 for link, _ in bars)
            assert 'class="current"' not in chart
            for link, count in (bars[0], bars[-1]):
                cards = pages.ask(html.unescape(link)).text
                assert f"<p>{count} pairs" in cards, link
