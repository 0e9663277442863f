"""What killed queries spilled: cleared by whoever gets a lock, never taken from a running one."""

import subprocess
import sys
from pathlib import Path

import pytest

from kb.store import leftovers, lock

PROGRAM = """
import sys
from pathlib import Path
from kb.store.tables import database
con = database.connect(Path(sys.argv[1]), threads=1, memory="60MB")
rows = con.sql(
    "SELECT range::VARCHAR || repeat('x', 100) AS t FROM range(1000000) ORDER BY hash(range)"
).to_arrow_reader(1000)
rows.read_next_batch()
print("spilled", flush=True)
sys.stdin.read()
print(1000 + sum(batch.num_rows for batch in rows))
"""


def spilling(folder: Path) -> subprocess.Popen[str]:
    """A query in a process of its own that has spilled and waits."""
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "spilled\n"
    return process


def spills(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"{leftovers.SPILL}*"))


@pytest.mark.parametrize("below", ["", "annotations/youtube"])
def test_what_a_killed_query_spilled_goes_and_a_running_one_keeps_its_own(
    tmp_path: Path, below: str
) -> None:
    folder = tmp_path / below
    folder.mkdir(parents=True, exist_ok=True)
    killed, running = spilling(folder), spilling(folder)
    killed.kill()
    killed.communicate()
    assert len(spills(folder)) == 2
    with lock.taking(tmp_path, *lock.of_purge("youtube")):
        assert len(spills(folder)) == 1
    assert running.communicate("")[0] == "1000000\n"
    assert running.returncode == 0
    assert spills(folder) == []


@pytest.mark.parametrize("source", ["youtube", "wiki", "reddit", "pairs"])
def test_what_a_killed_release_left_beside_its_notes_goes(tmp_path: Path, source: str) -> None:
    note = tmp_path / "state" / "releases" / source / ".1.0.0.parquet.1-2-ab.tmp"
    note.parent.mkdir(parents=True)
    exported = tmp_path / "state/manifests" / f".release-{source}.json.1-2-ab.tmp"
    exported.parent.mkdir(parents=True)
    for left in (note, exported):
        left.write_text("x")
    with lock.taking(tmp_path, f"release-{source}"):
        assert not note.exists()
        assert not exported.exists()


def test_what_a_killed_publication_left_beside_its_note_goes(tmp_path: Path) -> None:
    left = tmp_path / "state" / ".deposits.json.12-34-abcdef01.tmp"
    left.parent.mkdir()
    left.write_text("{}")
    with lock.writer(tmp_path, "deposits"):
        assert not left.exists()


@pytest.mark.parametrize(
    ("left", "source"),
    [
        ("restored/youtube/videos/.videos-00000.parquet.1-2-ab.tmp", "youtube"),
        ("restored/reddit/.posts.new/part-00000.parquet", "reddit"),
        ("restored/.missing.parquet.1-2-ab.tmp", "wiki"),
        ("export/reconstructed/comments/.part-00000.parquet.1-2-ab.tmp", "reddit"),
    ],
)
def test_a_purge_clears_what_was_left_where_content_was_brought_back(
    tmp_path: Path, left: str, source: str
) -> None:
    path = tmp_path / left
    path.parent.mkdir(parents=True)
    path.write_text("a purged text")
    with lock.taking(tmp_path, *lock.of_purge(source)):
        assert not path.exists()
