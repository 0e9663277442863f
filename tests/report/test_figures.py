"""Figures that several sources share."""

from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pytest

from kb.core.config.profile import load_profile
from kb.core.config.profile.products import Report
from kb.reddit.report import thread
from kb.registry import SOURCES
from kb.report import build, derived
from kb.report.data import ReportData
from kb.report.figures import funnel, toxicity
from kb.schema import table
from kb.store.tables.shard_writer import write_table
from kb.youtube.report import durations
from tests.release.made import build as build_release
from tests.report.made import a_run


def test_funnel_loses_exactly_what_the_stages_dropped(root: Path) -> None:
    figure = funnel(ReportData(a_run(root)), load_profile("minecraft"), "youtube/videos")
    assert figure is not None
    assert figure.rows[0] == ("crawled", 222, 0)
    assert ("number of views", 157, 31) in [tuple(row) for row in figure.rows]
    assert figure.rows[-1] == ("kept", 120, 0)
    gone = [row[2] for row in figure.rows]
    left = [row[1] for row in figure.rows]
    assert all(a - g == b for a, b, g in zip(left, left[1:], gone[1:], strict=False))


def test_scores_of_kept_and_dropped_rows_meet_at_the_threshold(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        for row in made if name == "youtube/videos" else []:
            row["toxicity_title"], row["toxicity_description"] = 0.01, 0.42

    build_release(tmp_path, edit, sources=("youtube",), export=False, n=20)
    figure = toxicity(
        ReportData(a_run(tmp_path)),
        load_profile("minecraft"),
        "youtube/videos",
        ("toxicity_title", "toxicity_description"),
    )
    assert figure is not None
    assert [row for row in figure.rows if row[1] or row[2]] == [
        ("0.40 to 0.45", 20, 0),
        ("0.90 to 0.95", 0, 4),
    ]
    assert "dropped above 0.5" in figure.caption


@pytest.mark.parametrize(
    ("figure", "name"),
    [
        (SOURCES["wiki"].figures()[2], "wiki/elements"),
        (SOURCES["reddit"].figures()[1], "reddit/posts"),
        (derived.lengths, "pairs/pairs"),
    ],
)
def test_a_figure_counts_every_row(root: Path, figure: object, name: str) -> None:
    with ReportData(a_run(root)) as data:
        made = figure(data, load_profile("minecraft"))
        rows = data.count(name)
    assert sum(n for _, n in made.rows) == rows > 0


def test_the_quality_of_pairs_is_what_the_table_says(root: Path) -> None:
    with ReportData(a_run(root)) as data:
        figure = derived.quality(data, load_profile("minecraft"))
        files = data.files("pairs/quality")
    counts = dict(figure.rows)
    with duckdb.connect() as con:
        ((verbs, timed, low, high),) = con.execute(
            "SELECT count(*) FILTER (has_verb), count(interpolation_error_s),"
            " quantile_cont(interpolation_error_s, 0.25),"
            " quantile_cont(interpolation_error_s, 0.75)"
            " FROM read_parquet(?)",
            [files],
        ).fetchall()
    assert counts["verb near the keyword"] == verbs > 0
    assert counts["time of the word known"] == timed > 0
    assert f"half of them between {low:.2f} and {high:.2f} seconds" in figure.caption


def test_durations_end_at_the_percentile_of_the_profile(root: Path) -> None:
    with ReportData(a_run(root)) as data:
        figure = durations(data, load_profile("minecraft"))
        videos = data.files("youtube/videos")
    with duckdb.connect() as con:
        ((limit, shown),) = con.execute(
            "WITH v AS (SELECT duration_s AS d FROM read_parquet(?)),"
            " m AS (SELECT quantile_disc(d, 0.85) AS high FROM v)"
            " SELECT any_value(high), count(*) FROM v, m WHERE d <= high",
            [videos],
        ).fetchall()
    assert sum(n for _, n in figure.rows) == shown
    assert 0.84 <= shown / 120 <= 0.87
    assert f"{limit / 60:.1f} minutes" in figure.caption


def test_what_is_spoken_of_and_who_knows_it(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "links/entities":
            made.append({**made[0], "entity": "never named", "wiki_page_id": None})
        if name == "links/links":
            for row in made:
                row["count"] = 2

    build_release(tmp_path, edit, sources=("links",), export=False, n=12)
    profile = load_profile("minecraft")
    profile = profile.model_copy(update={"report": Report(top_keywords=9)})
    with ReportData(a_run(tmp_path)) as data:
        named, known = (make(data, profile) for make in (derived.named, derived.known))
    assert named is not None
    assert known is not None
    assert named.head == ("entity", "youtube", "wiki", "reddit", "mentions")
    assert named.rows == [  # the three most frequent, then what is left of the three least
        ("oak log", 24, 24, 24, 72),
        ("diamond", 12, 12, 12, 36),
        ("iron pickaxe", 8, 8, 8, 24),
        ("wolf", 6, 6, 6, 18),
        ("wheat", 4, 0, 0, 4),
    ]
    assert "logarithmic" in named.caption
    assert named.caption.endswith("1 entities are named nowhere.")
    assert known.rows == [
        ("only videos", 1, "wheat"),
        ("only the wiki", 0, ""),
        ("only threads", 0, ""),
        ("two of the three", 0, ""),
        ("all three", 4, "oak log, diamond, iron pickaxe, wolf"),
    ]
    assert known.caption.endswith("one source alone names 1, none 1.")


def test_quota_adds_up_by_day(root: Path) -> None:
    figure = build.quota(ReportData(a_run(root)), load_profile("minecraft"))
    assert figure is not None
    assert sorted(tuple(row) for row in figure.rows) == sorted(
        [
            (f"2026-11-0{day}", f"youtube {bucket}", day * units)
            for day in (1, 2, 3)
            for bucket, units in (("general", 5), ("search", 1))
        ]
    )


def test_each_service_has_a_scale_of_its_own(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Thirty units beside six: each panel is as high as its own largest day."""
    sheets: list[Any] = []
    monkeypatch.setattr(build, "saved", lambda sheet: sheets.append(sheet) or {})
    build.quota(ReportData(a_run(root)), load_profile("minecraft"))
    tops = [panel.get_ylim()[1] for panel in sheets[0].axes]
    assert [panel.get_title(loc="left") for panel in sheets[0].axes] == [
        "YouTube: general",
        "YouTube: search",
    ]
    assert [panel.get_ylabel() for panel in sheets[0].axes] == ["units", "units"]
    assert tops == pytest.approx([15 * 1.08, 3 * 1.08])


def test_a_thread_is_drawn_with_the_places_of_what_was_left_out(tmp_path: Path) -> None:
    """a answers the post, b a, d c, e b; the filter dropped c and e."""
    comments = {"a": ("t3_p", 0), "b": ("t1_a", 1), "d": ("t1_c", 1)}

    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "reddit/posts":
            made[0].update(post_id="p", title="Which fish?", num_comments=4)
            del made[1:]
        if name == "reddit/comments":
            del made[len(comments) :]
            for row, (key, (parent, depth)) in zip(made, comments.items(), strict=True):
                row.update(comment_id=key, post_id="p", parent_id=parent, depth=depth, score=3)
                row.update(parent_in_release=key != "d", body=f"text of {key}")

    build_release(tmp_path, edit, sources=("reddit",), export=False, n=12)
    of_b = {"post_id": "p", "parent_id": "t1_b"}
    dropped = [  # of c the file of an earlier version says no parent
        {"key": "t1_c", "stage": "removed", "reason": "removed"},
        {"key": "t1_e", "stage": "toxicity", "reason": "body", **of_b},
    ]
    write_table(
        tmp_path / "clean" / "reddit" / "rejected" / "part-00000.parquet",
        pa.Table.from_pylist(dropped, table("shared/rejected").arrow()),
        "shared/rejected",
    )
    with ReportData(a_run(tmp_path)) as data:
        figure = thread(data, load_profile("minecraft"))
    assert figure is not None
    assert figure.rows == [
        (1, 3, "text of a"),
        (2, 3, "text of b"),
        (3, None, "[left out: toxicity]"),
        (1, None, "[left out: removed by moderators]"),
        (2, 3, "text of d"),
    ]
    assert "3 of its 4 comments" in figure.caption
