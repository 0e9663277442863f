"""`kb pairs` killed at any moment: the same command makes the same bytes."""

import signal
import time
from pathlib import Path

import pytest

from tests import processes
from tests.cli.conftest import clean_environment
from tests.pairs.made import fill, tables

pytestmark = pytest.mark.crash


def words(root: Path) -> list[str]:
    return ["pairs", "--data", str(root), "--workers", "1", "--quiet"]


def finish(root: Path) -> dict[str, bytes]:
    done = processes.run(words(root), env=clean_environment(), cwd=root.parent, timeout=120)
    assert done.returncode == 0, done.stderr
    return {
        str(path.relative_to(root)): path.read_bytes()
        for folder in ("pairs", "release/pairs")
        for path in (root / folder).glob("*.parquet")
    }


@pytest.fixture(scope="module")
def made():
    return tables(120, 300, ["creeper", "oak log", "iron golem"], share=0.05)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, made, make_rows) -> dict[str, bytes]:
    root = tmp_path_factory.mktemp("whole") / "data"
    fill(root, *made, make_rows)
    return finish(root)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_kill_leaves_nothing_in_the_way(
    tmp_path: Path, made, whole, make_rows, number: signal.Signals
) -> None:
    root = tmp_path / "data"
    fill(root, *made, make_rows, files=15)
    process = processes.start(words(root), env=clean_environment(), cwd=tmp_path)
    while process.poll() is None and not any(root.glob(".pairs.new/.parts/*.parquet")):
        time.sleep(0.005)
    process.send_signal(number)
    assert process.wait(60) == (3 if number == signal.SIGTERM else -number)
    assert not (root / "pairs").exists()
    assert finish(root) == whole
    assert not list(root.glob(".pairs*"))
