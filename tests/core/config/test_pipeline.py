"""Tests of `kb.core.config.pipeline`."""

from pathlib import Path

import pytest

from kb.core.config import pipeline
from kb.core.errors import SettingError


def test_a_file_of_the_user_s_own_wins(tmp_path: Path) -> None:
    own = tmp_path / "mine.py"
    own.write_text("ANSWER = 42\n")
    assert pipeline.load(str(pipeline.locate("youtube", str(own)))).ANSWER == 42
    assert pipeline.locate("youtube").parent.name == "pipelines"


@pytest.mark.parametrize("text", ["import no_such_module_of_ours", "def ("])
def test_a_file_that_cannot_be_loaded_is_named(tmp_path: Path, text: str) -> None:
    own = tmp_path / "mine.py"
    own.write_text(text)
    with pytest.raises(SettingError, match="can't be loaded"):
        pipeline.load(str(own))


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match="there is no pipeline file"):
        pipeline.locate("youtube", str(tmp_path / "mine.py"))
