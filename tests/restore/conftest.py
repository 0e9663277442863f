"""A release that somebody made, and the services that its content is still on."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.artifacts.makers import make_and_export, make_artifact
from kb.core.config.pipeline import Recipe
from kb.filters.filter_run import run_clean
from kb.sandbox.reddit.subreddit import Subreddit
from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.recipes import release
from tests.reddit.work import NOW, Work


class Made:
    """The maker's data root, released without a model; tests must not change it."""

    def __init__(self, sandbox: Sandbox, place: Path) -> None:
        self.sandbox = sandbox
        work = Work(sandbox, place, listings=("new",), search=())
        work.crawl()
        run = work.run()
        Recipe("youtube").defined("crawl")(run, None, None, None)
        for source in ("youtube", "reddit"):
            run_clean(run, source)
            make_artifact(run, f"release/{source}")
        make_and_export(run, "pairs")
        release(run)
        self.work, self.root = work, work.root
        self.release = self.root / "release"


def small() -> World:
    world = World(n_channels=4, n_videos=70)
    world.reddit = Subreddit(0, 24, width=130, depth=12)
    return world


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Made]:
    """Crawled, filtered, exported and described once."""
    with (
        pytest.MonkeyPatch.context() as patch,
        Sandbox(small(), services=["youtube", "reddit"]) as sandbox,
    ):
        patch.setenv("KB_NOW", NOW)
        yield Made(sandbox, tmp_path_factory.mktemp("made"))
