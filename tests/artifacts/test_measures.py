"""pairs/measures.json: sections do not replace each other, and belong to the artifact."""

from pathlib import Path

import pytest

from kb.artifacts import manifest
from kb.artifacts.measures import FILE, read_measures, write_measure
from kb.core.errors import FatalError
from kb.core.progress import Silent
from kb.verify.root import verify


def test_sections_do_not_replace_each_other(tmp_path: Path) -> None:
    with pytest.raises(FatalError, match="there are no pairs"):
        write_measure(tmp_path, "one", {"n": 1})
    with manifest.replacing(tmp_path, "pairs", inputs={}):
        pass
    assert read_measures(tmp_path / "pairs") == {}
    write_measure(tmp_path, "two", {"n": 2})
    write_measure(tmp_path, "one", {"n": 1})
    write_measure(tmp_path, "two", {"n": 3})
    assert read_measures(tmp_path / "pairs") == {"one": {"n": 1}, "two": {"n": 3}}


def test_a_changed_byte_is_found(tmp_path: Path) -> None:
    with manifest.replacing(tmp_path, "pairs", inputs={}):
        pass
    path = write_measure(tmp_path, "one", {"n": 1})
    assert path == tmp_path / "pairs" / FILE
    assert not verify(tmp_path, Silent()).entries
    path.write_text(path.read_text().replace("1", "2"))
    assert [one.path for one in verify(tmp_path, Silent()).entries] == [path]
