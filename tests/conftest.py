"""What tests share: recorded answers of the real services,
and what to do when something is not installed.
"""

import importlib.util
import os
import threading
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import NoReturn

import hypothesis
import pytest

from kb.core import clock, signals
from kb.net import retry
from kb.sandbox.youtube.captions import SpokenCue
from kb.sandbox.youtube.cases import Track, Video
from kb.sandbox.youtube.catalogue import Catalogue
from kb.wiki import section as wiki_section

# A slow machine is no defect; the same examples everywhere, so that a failure can be seen again.
hypothesis.settings.register_profile("lorecrawl", deadline=None, derandomize=True)
hypothesis.settings.load_profile("lorecrawl")

ROOT = Path(__file__).resolve().parent.parent
pytest_plugins = ["tests.inprocess", "tests.installed"]


SLOW = ("wheel", "dask", "crash", "mediawiki", "slow")  # marks; pyproject.toml says what they mean


# Files that take longest, the longest first.
LONG = (
    "crash/test_chaos.py",
    "package/test_demo.py",
    "wiki/test_mediawiki.py",
    "docs/test_readme.py",
    "fourth/test_fourth_source.py",
    "explore/test_browser.py",
    "wiki/crawl/test_render.py",
    "contract/test_update.py",
    "wiki/crawl/test_connector.py",
    "restore/test_restore.py",
    "release/publish/test_repository.py",
    "clips/test_training.py",
    "pairs/test_planted.py",
    "artifacts/test_merged_roots.py",
    "artifacts/test_linked_folders.py",
    "contract/test_build.py",
    "contract/test_any_domain.py",
    "report/test_build.py",
    "youtube/crawl/test_client.py",
    "release/publish/test_upload.py",
    "explore/test_thresholds.py",
    "artifacts/test_recipes.py",
    "search/test_known_items.py",
    "explore/test_app.py",
    "release/test_build.py",
    "mcp/test_server.py",
    "wiki/crawl/test_reduce.py",
    "youtube/crawl/test_fetch.py",
    "clips/test_torch_dataset.py",
    "wiki/capture/test_page.py",
    "explore/test_rows.py",
    "fourth/test_text_keys.py",
    "reddit/restore/test_tables.py",
    "explore/test_search.py",
    "reddit/test_archives_word.py",
    "youtube/test_playlists.py",
    "export/test_text.py",
    "store/test_out_of_memory.py",
)

# Files whose tests have the mark `smoke`: what may differ on another Python, in less than a minute.
# `.ci/others` runs them after the demo. They read nothing outside the clone, and need no torch.
SMOKE = (
    "cli/framework/test_exit_codes.py",
    "clips/test_build.py",
    "core/test_cached_property.py",
    "core/test_engine.py",
    "core/test_signals.py",
    "filters/test_predicates.py",
    "mcp/test_tools.py",
    "net/test_retry.py",
    "net/test_session.py",
    "pairs/test_clip_tokens.py",
    "pairs/test_matching.py",
    "query/test_execute.py",
    "reddit/dumps/test_files.py",
    "schema/test_tables.py",
    "store/rawlog/test_rawlog.py",
    "store/state/test_sqlite.py",
    "youtube/parse/test_answers.py",
)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of files named above, before `-m` chooses; put the long ones and the slow
    kinds first, as a worker that took one last would leave the others idle.
    """
    smoke = {ROOT / "tests" / name for name in SMOKE}
    long = {ROOT / "tests" / name: place for place, name in enumerate(LONG)}
    for item in items:
        if item.path in smoke:
            item.add_marker("smoke")
    slow = {item.path for item in items if any(item.get_closest_marker(name) for name in SLOW)}
    items.sort(key=lambda item: (long.get(item.path, len(LONG)), item.path not in slow))


@pytest.fixture(scope="session", autouse=True)
def _at_once() -> Iterator[None]:
    """Tries follow each other without a wait (Retry-After is still heeded), pages of wikis, which
    don't change late, are captured soon, and what the tracks of equal worlds say is made up once.
    """
    said: dict[tuple[object, ...], list[SpokenCue]] = {}
    make_up = Catalogue.cues

    def cues(
        world: Catalogue, video: Video, track: Track, to: str | None = None
    ) -> list[SpokenCue]:
        size = (len(world.channels), len(world.videos))
        of = (world.domain.speech, world.seed, *size, video.id, track.language, track.kind, to)
        if of not in said:
            said[of] = make_up(world, video, track, to)
        return said[of]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Catalogue, "cues", cues)
        patch.setattr(retry, "FIRST_S", 0.001)
        patch.setattr(wiki_section, "STILL_S", 0.1)
        yield


@pytest.fixture(autouse=True)
def _no_time_has_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test waited for by a date that is set counts for that test alone."""
    monkeypatch.setattr(clock, "_passed", timedelta())


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who waits in this process sets `clock.monotonic` ahead instead."""
    ahead, lock = [0.0], threading.Lock()

    def sleep(seconds: float) -> None:
        with lock:
            ahead[0] += max(0.0, seconds)
        signals.stop.raise_if_asked()

    monkeypatch.setattr(clock, "monotonic", lambda: time.monotonic() + ahead[0])
    monkeypatch.setattr(clock, "sleep", sleep)


def skip_or_fail(reason: str) -> NoReturn:
    """Skip with one line; under CI=true a missing thing is a failure,
    so that nothing goes untested unseen.
    """
    if os.environ.get("CI") == "true":
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


def needs(*modules: str) -> None:
    """Skip the file where a module is not installed; that it is there is all that is looked at.

    Every test process collects every file: importing torch for that would take each of them
    seconds.
    """
    for name in modules:
        if importlib.util.find_spec(name) is None:
            pytest.skip(f"{name} is not installed", allow_module_level=True)


@pytest.fixture(scope="session")
def recorded() -> Path:
    """The folder of recorded service answers, read in place: KB_RECORDED, or ../shared/recorded."""
    folder = Path(os.environ.get("KB_RECORDED") or ROOT.parent / "shared" / "recorded")
    if not (folder / "README.md").is_file():
        skip_or_fail(f"recorded answers are not at {folder} (set KB_RECORDED)")
    return folder


@pytest.fixture(scope="session")
def make_rows():
    """make_rows("youtube/videos", 5, view_count=[…]): a valid table of n rows;
    what is not given is made up, the same each time.
    """
    return _make_rows


def _make_rows(name, n, released=False, **given):
    import pyarrow as pa

    from kb.schema import table

    declared = table(name)
    data = {}
    for number, field in enumerate(declared.arrow(released)):
        kind = field.type
        if field.name in given:
            values = given[field.name]
        elif pa.types.is_string(kind):
            values = [f"{field.name} {row:05d}" for row in range(n)]
        elif pa.types.is_boolean(kind):
            values = [row % 2 == 0 for row in range(n)]
        elif pa.types.is_list(kind):
            values = [[] for _ in range(n)]
        else:
            least, most = declared.column(field.name).range or (0, 1000)
            least = max(least, 0)
            step = min(1, (most - least) / 1000)
            made = [least + step * ((row * 7 + number) % 1000) for row in range(n)]
            values = pa.array(made).cast(kind, safe=False) if n else []
        data[field.name] = values if isinstance(values, pa.Array) else pa.array(values, kind)
    return pa.table(data)
