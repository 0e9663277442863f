"""Tests of `kb.verify.cross_checks`."""

import shutil
from pathlib import Path

from kb.artifacts import manifest
from kb.store.artifact_registry import MANIFEST
from tests.verify.test_root import one, verify


def test_a_key_with_two_answers_is_told(root: Path) -> None:
    path = one(root, "clean/youtube/videos/*.parquet")
    shutil.copyfile(path, path.with_name("part-00001.parquet"))
    known = manifest.read(root, "clean/youtube")
    assert known is not None
    known.files["videos/part-00001.parquet"] = manifest.entry_of(path)
    manifest.write(root / "clean/youtube" / MANIFEST, known)
    (told,) = verify(root).entries
    assert "keys are in two of kept, rejected, failed and pending" in told.what
