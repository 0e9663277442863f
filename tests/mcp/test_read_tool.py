"""`read`: the surroundings of a place."""

import pytest

from kb.core.sources import SOURCES
from tests.mcp.conftest import Ask, outside, right
from tests.search.made import combinations, told


@pytest.mark.parametrize("source", SOURCES)
def test_read_gives_what_stands_around_an_answer(ask: Ask, source: str) -> None:
    number, action, animal = list(combinations())[21]
    link, ref = right(source, number, action, animal)
    for one in (ref, link):
        text = ask("read", ref=one)
        assert told(number, action, animal) in text
        assert told(number, action, animal) not in outside(text)
        around = {
            "youtube": "A series about animals.",
            "wiki": "leather | 5",
            "reddit": "yesterday",
        }
        assert around[source] in text
        assert link.partition("&t=")[0].replace("r/Minecraft/", "") in outside(text)
    assert ("licence CC-BY-SA-3.0" in text) == (source == "wiki")
    assert ("revision 1004" in text) == (source == "wiki")
