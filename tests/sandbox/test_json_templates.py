"""Tests of filling in the answers of the sandbox."""

import json
from pathlib import Path

import pytest

from kb.sandbox import json_templates


def test_values_keep_their_type_and_empty_fields_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    template = {
        "id": "$id",
        "likes": "$likes",
        "hidden": "$hidden",
        "link": "https://example.org/$id?n=$likes",
        "tags": ["$id", 1, None],
    }
    (tmp_path / "answers.json").write_text(json.dumps({"video": template}))
    monkeypatch.setattr(json_templates, "_DATA", tmp_path)
    made = json_templates.written(
        "answers.json", "video", {"id": "abc", "likes": 7, "hidden": None}
    )
    assert made == {
        "id": "abc",
        "likes": 7,
        "link": "https://example.org/abc?n=7",
        "tags": ["abc", 1, None],
    }
