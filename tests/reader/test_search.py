"""Search over a download."""

from pathlib import Path

import pytest

import kb
from kb.core.errors import KbError


def test_a_download_is_searched_and_nothing_is_written_into_it(
    release: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for place in (release, release / "wiki"):
        answers = kb.load(place).search("saltstone", source="wiki").to_pylist()
        assert answers[0]["title"] == "Saltstone"
        assert "**" in answers[0]["snippet"]
    assert kb.load(release).search("the", source="youtube").to_pylist()  # titles
    assert any(tmp_path.rglob("_manifest.json"))
    with pytest.raises(KbError, match="has no texts of reddit") as caught:
        kb.load(release / "reddit").search("saltstone", source="reddit")
    assert "kb restore" in caught.value.hint
