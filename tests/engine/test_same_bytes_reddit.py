"""Dumps imported by one worker, by two, and by a cluster that loses one: the same raw bytes."""

import json
import shutil
from pathlib import Path

import pytest
import zstandard

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.parse.anonymize import load_key
from tests.conftest import needs
from tests.engine.test_same_bytes_youtube import digests

needs("distributed")


pytestmark = pytest.mark.dask

FILES, COMMENTS = 10, 1500


@pytest.fixture(scope="module")
def dumps(tmp_path_factory):
    """Comments of two subreddits, one file a month."""
    folder = tmp_path_factory.mktemp("dumps")
    for month in range(FILES):
        lines = [
            json.dumps(
                {
                    "id": f"c{month:02d}{n:04d}",
                    "body": f"comment {n} about creepers " * 8,
                    "author": f"p{n % 37}",
                    "subreddit": "Minecraft" if n % 3 else "elsewhere",
                    "link_id": f"t3_p{n // 20}",
                    "parent_id": f"t3_p{n // 20}",
                    "created_utc": 1_600_000_000 + n,
                    "retrieved_on": 1_600_100_000,
                    "score": n,
                }
            )
            for n in range(COMMENTS)
        ]
        text = "\n".join(lines).encode() + b"\n"
        (folder / f"RC_2020-{month + 1:02d}.zst").write_bytes(
            zstandard.ZstdCompressor().compress(text)
        )
    return sorted(folder.iterdir())


def imported(dumps: list[Path], root: Path, key: Path, **options) -> dict[str, str]:
    (root / "state").mkdir(parents=True)
    shutil.copy(key, root / "state" / key.name)
    run = Run(
        settings=load_settings(dotenv=False),
        profile=load_profile("minecraft"),
        root=root,
        **options,
    )
    assert import_dumps(run, dumps)["crawled"] == FILES * COMMENTS * 2 // 3
    return digests(root, "raw")


def test_both_engines_import_the_same_bytes(dumps, cluster, kill_a_worker, tmp_path):
    load_key(tmp_path)
    key = tmp_path / "state" / "reddit.key"
    expected = imported(dumps, tmp_path / "one", key, workers=1)
    assert len(expected) == FILES
    assert imported(dumps, tmp_path / "two", key, workers=2) == expected
    root = tmp_path / "dask"
    killed = kill_a_worker(lambda: any((root / "raw").rglob("*.zst")))
    assert (
        imported(dumps, root, key, workers=2, engine="dask", scheduler=cluster.scheduler_address)
        == expected
    )
    assert killed
