"""Tests of `kb.pairs.transcripts`."""

from dataclasses import replace

import pytest

from kb.core.config.pipeline import load, locate
from kb.core.context import Run
from kb.core.errors import FatalError, ProfileError

pipeline = load(str(locate("pairs")))


def test_without_transcripts_or_section(run: Run) -> None:
    with pytest.raises(FatalError, match="no transcripts"):
        pipeline.pairs(replace(run, root=run.root / "empty"), "parquet")
    with pytest.raises(ProfileError, match=r"\[pairs\]"):
        pipeline.pairs(
            replace(run, profile=run.profile.model_copy(update={"pairs": None})), "parquet"
        )
