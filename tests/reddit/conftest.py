"""A small subreddit on loopback, and one whole job for what a finished data root shows."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.sandbox.reddit.service import dumps
from kb.sandbox.reddit.subreddit import Subreddit
from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.reddit.work import NOW, Work


def small_world(n_posts: int = 30, *, width: int = 1_200, depth: int = 40) -> World:
    """Every case once; the deep and the wide tree as the issue has them."""
    world = World()
    world.reddit = Subreddit(0, n_posts, width=width, depth=depth)
    return world


@pytest.fixture(autouse=True)
def one_date(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fixed date."""
    monkeypatch.setenv("KB_NOW", NOW)


@pytest.fixture
def work(tmp_path: Path) -> Iterator[Work]:
    """A fresh data root on a subreddit of each case once, with shorter trees and few listings."""
    with Sandbox(small_world(24, width=520, depth=24), services=["reddit"]) as sandbox:
        yield Work(sandbox, tmp_path, listings=("new", "hot"), search=("redstone",))


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Work]:
    """Crawled (40 deep, 1,200 wide), filtered and exported in every layout, without a word by a
    model; read only.
    """
    with (
        pytest.MonkeyPatch.context() as patch,
        Sandbox(small_world(), services=["reddit"]) as sandbox,
    ):
        patch.setenv("KB_NOW", NOW)
        done = Work(sandbox, tmp_path_factory.mktemp("whole"))
        done.crawled = done.crawl()
        done.asked = sandbox.ledger.requests()
        done.filtered = done.filter()
        for layout in ("parquet", "minedojo"):
            done.export(layout)
        yield done


@pytest.fixture(scope="session")
def old(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A pair of archive dumps of the same subreddit."""
    return dumps(Subreddit(0, 30), tmp_path_factory.mktemp("dumps"))


@pytest.fixture
def few(tmp_path: Path) -> Iterator[Work]:
    """A fresh data root on each case once, with small trees and one listing."""
    with Sandbox(small_world(24, width=12, depth=12), services=["reddit"]) as sandbox:
        yield Work(sandbox, tmp_path, listings=("new",), search=())


@pytest.fixture
def tiny(few: Work) -> Work:
    """The same, crawled."""
    few.crawl()
    return few
