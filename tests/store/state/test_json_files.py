"""What a data root remembers, when it is damaged: named, with what to do about it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from kb.store.layout import Layout
from tests.inprocess import Here
from tests.reddit.dumped import post, write

DEEP = b"[" * 100_000
DAMAGE = (b"", b"\xff\xfe", b"null", b"[]", b'{"a": 1}', DEEP)
IMPORT = ("reddit", "import")
ENV = {"KB_NOW": "2026-11-20T12:00:00Z", "KB_CONTACT": "me@example.org"}


@pytest.fixture(scope="module")
def dump(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("dump") / "RS_2020-09.zst", [post("p1"), post("p2")])


@pytest.fixture
def root(tmp_path: Path, dump: Path, here: Here) -> Path:
    """A data root with one imported dump."""
    root = tmp_path / "data"
    assert here(*IMPORT, str(dump), "--data", str(root), env=ENV).code == 0
    return root


def note(root: Path) -> Path:
    (found,) = Layout(root).importing("reddit").glob("*.json")
    return found


@pytest.mark.parametrize("data", DAMAGE, ids=["empty", "binary", "null", "list", "other", "deep"])
@pytest.mark.parametrize(
    "place",
    [lambda root: Layout(root).identity("reddit"), lambda root: Layout(root).profile, note],
    ids=["identity", "profile", "import"],
)
def test_a_damaged_note_is_named_with_what_to_do(
    root: Path, dump: Path, here: Here, place: Callable[[Path], Path], data: bytes
) -> None:
    words = (*IMPORT, str(dump), "--data", str(root))
    path = place(root)
    path.write_bytes(data)
    done = here(*words, env=ENV)
    assert done.code == 1
    assert done.said.startswith(f"kb: {path} can't be read: ")
    assert "; delete it" in done.said
    assert "unexpected" not in done.err
    path.unlink()
    assert here(*words, env=ENV).code == 0
