"""Columns and values by names that people read."""

from pathlib import Path

import pytest

from kb.core.errors import SchemaMismatch
from kb.core.sources import SOURCES
from kb.look.headings import heading, reading
from kb.schema.tables import load_table


@pytest.mark.parametrize(
    ("table", "column", "shown"),
    [
        ("youtube/videos", "duration_s", "Duration (s)"),
        ("youtube/videos", "view_count", "Views"),
        ("youtube/videos", "published_at", "Published (UTC)"),
        ("reddit/posts", "created_utc", "Created (UTC)"),
        ("reddit/posts", "num_comments", "Comments"),
        ("wiki/pages", "revision_timestamp", "Revision (UTC)"),
        ("youtube/videos", "video_id", "Video ID"),
    ],
)
def test_columns_have_headings(table: str, column: str, shown: str) -> None:
    assert heading(table, column) == shown


@pytest.mark.parametrize(
    ("table", "column", "value", "shown"),
    [
        ("tasks/titles", "rejected_reason", "not_a_task", "not about a task"),
        ("shared/rejected", "stage", "nsfw", "adult content"),
        ("youtube/videos", "transcript_kind", "asr", "automatic"),
        ("shared/failed", "reason", "http_503", "http 503"),  # a service's own word
        ("youtube/videos", "video_id", "a_b-c_d", "a_b-c_d"),
        ("tasks/tasks", "prompt", "type snake_case", "type snake_case"),
    ],
)
def test_values_have_words(table: str, column: str, value: str, shown: str) -> None:
    assert reading(table, column, value) == shown


def test_every_stage_has_words() -> None:
    stages = {stage for source in SOURCES.values() for stage in source.stages}
    raw = {stage for stage in stages if "_" in reading("shared/rejected", "stage", stage)}
    assert stages
    assert not raw
    assert reading("shared/rejected", "stage", "missing") == "not available"


def test_words_are_of_declared_values(tmp_path: Path) -> None:
    path = tmp_path / "made.toml"
    path.write_text(
        'name = "a/b"\ndoc = "Made."\nkey = ["k"]\nsort_by = ["k"]\n[[column]]\nname = "k"\n'
        'type = "string"\ndoc = "Key."\nfrom = "rule: made"\nvalues = ["x"]\n'
        '[column.words]\ny = "why"\n'
    )
    with pytest.raises(SchemaMismatch, match=r"`words` name y, not in `values`"):
        load_table(path)
