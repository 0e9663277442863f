"""Keywords, a section and ways to run a batch that the tests of pairs share."""

from pathlib import Path

import pyarrow as pa
import pytest

from kb.core.config.profile import load_profile
from kb.core.config.profile.products import Pairs
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.pairs.extract import Tools, make_tools
from kb.pairs.keywords import NEVER, Keyword, Keywords, make_keywords
from kb.schema import table
from tests.pairs.made import PHRASES, fill, tables

LIST = [
    Keyword("Creeper", "entity"),
    Keyword("Oak", "block"),
    Keyword("Oak Log", "block"),
    Keyword("Log", "block"),
    Keyword("Iron Golem", "entity"),
    Keyword("Jack o'Lantern", "block"),
    Keyword("Block of Diamond", "block"),
    Keyword("Cobblestone", "block"),
    Keyword("Ender Dragon", "entity"),
    Keyword("Café", "structure"),
    Keyword("苦力怕", "entity"),
    Keyword("Bed", "block", 5),
    Keyword("Chest", "block", 3),
    Keyword("Air", "block", NEVER),
]


@pytest.fixture(scope="session")
def keywords() -> Keywords:
    return make_keywords(LIST, ["chest day"])


@pytest.fixture(scope="session")
def tools(keywords: Keywords) -> Tools:
    return make_tools(Pairs(include=("x",)), 0, keywords)


@pytest.fixture(scope="session")
def minecraft() -> Tools:
    """The shipped profile's tools."""
    from kb.pairs.keywords import load

    profile = load_profile("minecraft")
    return make_tools(profile.section("pairs"), profile.seed, load(profile))


@pytest.fixture(scope="session")
def with_section(tools: Tools):
    """with_section(min_gap_s=5): the tools with other rules."""
    return lambda **rules: tools._replace(section=Pairs(include=("x",), **rules))


def transcripts(*videos: tuple[str, str, list]) -> pa.Table:
    """(id, kind, [(start, duration, text) or (…, word starts), …]) as rows of
    youtube/transcripts.
    """
    rows = [
        {
            "video_id": name,
            "kind": kind,
            "language": "en",
            "cues": [
                dict(zip(("start_s", "duration_s", "text", "word_start_s"), cue, strict=False))
                for cue in cues
            ],
        }
        for name, kind, cues in videos
    ]
    return pa.Table.from_pylist(rows, table("youtube/transcripts").arrow())


@pytest.fixture(scope="module")
def data():
    return tables(60, 400, PHRASES, share=0.06)


@pytest.fixture
def run(tmp_path: Path, data, make_rows) -> Run:
    root = tmp_path / "data"
    fill(root, *data, make_rows)
    return Run(load_settings(dotenv=False), load_profile("minecraft"), root, workers=1)
