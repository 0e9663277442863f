"""Tables: every column has a description and an origin,
and code can't write what is not declared.
"""

import json
from pathlib import Path

import pyarrow as pa
import pytest

from kb.core.errors import SchemaMismatch, UsageError
from kb.core.installation import folder
from kb.schema import conform, raw, table, tables
from kb.schema.tables import load_table, parse_type
from kb.schema.wiki_page import ancestors, is_outermost
from kb.store.tables.shard_writer import write_table

FILES = sorted((folder("schemas") / "tables").glob("*/*.toml"))
# The contract's columns, by its own words: (table, released ones, others that the clean table has)
CONTRACT = {
    "youtube/videos": (
        (
            "video_id title link channel_id published_at view_count view_rule like_count duration_s"
            " width height fps category_id topic_evidence transcript_kind transcript_origin"
            " word_count license fetched_at toxicity_title toxicity_description"
        ),
        "toxicity_title_insult toxicity_description_threat",
    ),
    "youtube/transcripts": ("", "video_id kind language cues"),
    "wiki/pages": (
        (
            "page_id title url revision_id revision_timestamp fetched_at license contributors_url"
            " screenshot_path page_width page_height viewport_width device_pixel_ratio"
            " settled word_count toxicity"
        ),
        "",
    ),
    "wiki/elements": (
        (
            "page_id element_id parent_id kind tag region heading_level text x y width height"
            " visible folded reading_order address lines"
        ),
        "",
    ),
    "wiki/cells": (
        (
            "page_id table_id row_index column_index row_span column_span is_header text x y"
            " width height"
        ),
        "",
    ),
    "wiki/images": (
        (
            "page_id element_id src path sha256 media_type width height alt_text caption"
            " frame_index frame_duration_ms license"
        ),
        "",
    ),
    "wiki/facts": (
        "page_id fact_id subject field value unit element_id visible revision_id",
        "",
    ),
    "wiki/recipes": (
        (
            "page_id recipe_index slot role row_index column_index alternative item quantity"
            " element_id visible revision_id"
        ),
        "",
    ),
    "reddit/posts": (
        "post_id type created_utc score num_comments upvote_ratio score_source fetched_at",
        "title body author_hash source_url link_kind is_crosspost poll_options",
    ),
    "reddit/comments": ("comment_id post_id parent_id depth created_utc score", "body author_hash"),
    "pairs/pairs": (
        (
            "pair_id video_id keyword keyword_kind token_count match_start_s match_end_s"
            " segment_start_s segment_end_s text_start_s"
            " text_end_s center_s clip_start_s clip_end_s transcript_kind"
        ),
        "text",
    ),
    "shared/rejected": ("", "key stage reason value threshold"),
    "shared/failed": ("", "key reason"),
    "shared/pending": ("", "key reason"),
    "shared/tombstones": ("key source removed_at reason", ""),
    "reddit/missing": ("", "key reason"),
}


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_column_has_a_description_and_an_origin(path: Path) -> None:
    for column in load_table(path).columns:
        assert column.doc.endswith("."), column.name
        assert "\n" not in column.doc, column.name
        assert column.source.kind, column.name
        assert column.source.path, column.name


@pytest.mark.parametrize("name", CONTRACT)
def test_the_contract_s_columns(name: str) -> None:
    released, others = (set(words.split()) for words in CONTRACT[name])
    declared = table(name)
    assert released <= set(declared.names(released=True))
    assert others <= set(declared.names()) - set(declared.names(released=True))


def test_reddit_releases_no_content() -> None:
    for name in ("reddit/posts", "reddit/comments"):
        assert not [
            column.name for column in table(name).columns if column.content and column.released
        ]
    assert not table("youtube/transcripts").released


def test_origins_in_raw_answers_are_declared_there() -> None:
    declared = set(raw.kinds())
    for each in tables().values():
        for column in (*each.columns, *each.inputs):
            for origin in (column.source, *column.also):
                kind = f"{each.source}/{origin.kind}"
                if kind in declared:
                    assert raw.at(kind, origin.path) is not None, (
                        f"{each.name}.{column.name}: {origin}"
                    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"doc": ""}, "`column a.doc`"),
        ({"doc": None}, "missing required field `doc` - at `column a`"),
        ({"doc": "Two\nlines."}, "`column a.doc`"),
        ({"from": None}, "missing required field `from` - at `column a`"),
        ({"from": "somewhere"}, "'somewhere' must read"),
        ({"type": "varchar"}, "unknown type 'varchar'"),
        ({"type": "list<struct<x>>"}, "'x' in 'struct<x>' is not `name: type`"),
        ({"null": " "}, "`column a.null`"),
        ({"unti": "s"}, "unknown field `unti` - at `column a`"),
        ({"name": "A b"}, "`column A b.name`"),
        ({"type": "int64", "pattern": "x"}, "`values` and `pattern` are for columns"),
        ({"pattern": "("}, "`pattern` is not a regular expression"),
    ],
)
def test_a_wrong_column_is_named(
    tmp_path: Path, change: dict[str, str | None], message: str
) -> None:
    block = {"name": "a", "type": "string", "doc": "Doc.", "from": "rule: made up"} | change
    lines = [f"{key} = {json.dumps(value)}" for key, value in block.items() if value is not None]
    path = tmp_path / "t.toml"
    path.write_text(
        'name = "x/t"\ndoc = "Doc."\nkey = ["a"]\nsort_by = ["a"]\n[[column]]\n' + "\n".join(lines)
    )
    with pytest.raises(SchemaMismatch) as caught:
        load_table(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("key", "names", "message"),
    [("b", "ac", "name b, not a column"), ("a", "aa", "declared twice: a")],
)
def test_keys_name_columns_that_are_declared_once(
    tmp_path: Path, key: str, names: str, message: str
) -> None:
    path = tmp_path / "t.toml"
    blocks = (
        f'[[column]]\nname = "{name}"\ntype = "string"\ndoc = "Doc."\nfrom = "rule: made up"\n'
        for name in names
    )
    head = f'name = "x/t"\ndoc = "Doc."\nkey = ["{key}"]\nsort_by = ["a"]\n'
    path.write_text(head + "".join(blocks))
    with pytest.raises(SchemaMismatch, match=message):
        load_table(path)


def test_an_unknown_table_names_the_known() -> None:
    with pytest.raises(UsageError) as caught:
        table("youtube/video")
    assert "youtube/videos" in caught.value.hint


def test_writing_an_undeclared_column_fails(tmp_path: Path, make_rows) -> None:
    rows = make_rows("shared/failed", 3)
    with pytest.raises(SchemaMismatch, match="column 'extra' is not declared"):
        write_table(
            tmp_path / "a.parquet",
            rows.append_column("extra", pa.array([1, 2, 3])),
            "shared/failed",
        )
    with pytest.raises(SchemaMismatch, match="column 'reason' is missing"):
        write_table(tmp_path / "a.parquet", rows.drop_columns(["reason"]), "shared/failed")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("chain", "wanted"),
    [
        (["text"], True),
        (["text", "text"], False),
        (["cell", "text"], False),
        (["text", "image", "text"], False),
        (["text", "image"], True),
        (["text", "table", "text"], True),
        (["cell", "table"], True),
        (["text", "cell", "table"], False),
    ],
)
def test_a_text_counts_where_no_other_one_of_its_table_contains_it(
    chain: list[str], wanted: bool
) -> None:
    """`chain` lists the kinds from the element to the outermost one around it."""
    kinds = dict(enumerate(chain))
    parents = {at: at + 1 for at in kinds}
    assert list(ancestors(0, parents)) == list(kinds)[1:]
    assert is_outermost(0, parents, kinds) == wanted


def test_parents_that_form_a_cycle_end() -> None:
    assert list(ancestors(1, {1: 2, 2: 3, 3: 2})) == [2, 3]
    assert list(ancestors(1, {1: 1})) == []
    assert list(ancestors(1, {1: None})) == []


def test_conform_casts_orders_and_refuses(make_rows) -> None:
    rows = make_rows("wiki/cells", 2)
    narrow = rows.set_column(
        rows.column_names.index("row_index"), "row_index", pa.array([0, 1], pa.int32())
    )
    shuffled = narrow.select(list(reversed(narrow.column_names)))
    done = conform("wiki/cells", shuffled)
    assert done.schema.equals(table("wiki/cells").arrow(), check_metadata=True)
    with pytest.raises(SchemaMismatch, match="column 'text' has 1 nulls and may have none"):
        conform("wiki/cells", make_rows("wiki/cells", 2, text=["a", None]))
    with pytest.raises(SchemaMismatch, match="column 'row_index' is double, not int64"):
        conform(
            "wiki/cells",
            rows.set_column(rows.column_names.index("row_index"), "row_index", pa.array([0.5, 1])),
        )
    nullable = make_rows("youtube/videos", 2, like_count=[None, 1], fps=[None, 30])
    assert conform("youtube/videos", nullable)["like_count"].null_count == 1
    # released tables need their own columns only
    assert (
        conform(
            "youtube/videos",
            nullable.select(table("youtube/videos").names(released=True)),
            released=True,
        ).num_rows
        == 2
    )


def test_types_nest() -> None:
    kind = parse_type("list<struct<a: int64, b: list<struct<c: string>>>>").arrow()
    assert kind == pa.list_(
        pa.struct([("a", pa.int64()), ("b", pa.list_(pa.struct([("c", pa.string())])))])
    )
