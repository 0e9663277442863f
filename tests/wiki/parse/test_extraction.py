"""Tests of `kb.wiki.parse.extraction`."""

from pathlib import Path

import pytest
import zstandard

from kb.core.errors import DamagedData
from kb.wiki.parse import extraction


def test_an_extraction_of_an_earlier_version_has_no_recipes(tmp_path: Path) -> None:
    text = b'{"page": {"page_id": 7}, "elements": [], "cells": []}'
    (tmp_path / "extraction.json.zst").write_bytes(zstandard.compress(text))
    content = extraction.read(tmp_path, tmp_path)
    assert content["facts"] == content["recipes"] == []
    assert extraction.is_foreign(content["page"], 8)
    assert not extraction.is_foreign({}, 8)


@pytest.mark.parametrize("data", [None, b"", b"{}", zstandard.compress(b'{"page"')])
def test_an_unreadable_extraction_is_damage(tmp_path: Path, data: bytes | None) -> None:
    if data is not None:
        (tmp_path / "extraction.json.zst").write_bytes(data)
    with pytest.raises(DamagedData):
        extraction.read(tmp_path, tmp_path)
