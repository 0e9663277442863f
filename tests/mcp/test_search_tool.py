"""`search`: ranked answers of limited size."""

import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from kb.core.errors import UsageError
from kb.core.sources import SOURCES
from kb.mcp.documents import parse_reference, run_read
from kb.mcp.search_tool import run_search
from kb.mcp.untrusted_text import DEFAULT
from kb.search.ranking import Only
from tests.filters.made import run_at
from tests.mcp.conftest import FENCE, ORDER, Ask, inner, outside, right
from tests.search.made import combinations, reddit, told


def test_a_source_may_be_a_text_or_a_list(ask: Ask) -> None:
    for source in ("wiki", ["wiki"], '["wiki"]'):
        answer = ask("search", query="leather", source=source, kind="table")
        assert "wiki table" in answer
        assert "youtube" not in answer


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"source": "youtub"}, "source is 'youtub'; valid: 'youtube', 'wiki' or 'reddit'"),
        ({"source": ["wiki", "x"]}, "source is 'x'; valid: 'youtube', 'wiki' or 'reddit'"),
        ({"kind": "page"}, "kind is 'page'; valid: 'video', 'transcript', 'section'"),
        ({"limit": 1000}, "limit is 1000; valid: less than or equal to 100"),
        ({"limit": "ten", "each": -1}, "limit is 'ten'; valid: a valid integer"),
        ({"since": "today"}, "since is 'today'; write it like 2023-01-31"),
        ({"query": ""}, "the query '' contains no word to search for"),
    ],
)
def test_a_wrong_value_is_answered_in_one_line(ask: Ask, values: dict[str, Any], said: str) -> None:
    answer = ask("search", **{"query": "leather", **values})
    assert answer.error
    assert said in answer
    assert "\n" not in answer


def test_a_hundred_questions(ask: Ask) -> None:
    every = list(combinations())
    found = 0
    for count in range(100):
        number, action, animal = every[count % len(every)]
        source, size = [*SOURCES][count // len(every) % 3], 2000 + 37 * count
        text = ask("search", query=f"How to {action} a {animal}?", source=[source], max_chars=size)
        link, ref = right(source, number, action, animal)
        here = f"link: {link}\nref: {ref}\n" in outside(text)
        inside = f"to {action} the {animal} you need" in inner(text)
        found += here and inside
        assert text.count("link: ") == text.count("ref: ") >= 1
    assert found >= 95


def test_an_answer_has_whole_parts_and_says_what_was_left_out(ask: Ask) -> None:
    text = ask("search", query="camel wolf", limit=50, max_chars=2000)
    shown = int(text.count("ref: "))
    left = re.search(r"(\d+) more answers were left out: raise max_chars", text)
    assert left
    assert len(FENCE.findall(text)) == shown
    everything = ask("search", query="camel wolf", limit=50, max_chars=50_000)
    assert everything.count("ref: ") == shown + int(left[1])
    text = ask("read", ref="wiki:14#Ways_to_trap", max_chars=1000)
    assert told(24, "trap", "camel") in text
    before = re.search(r"parts were left out; .*the part before: (\S+)", text)
    assert before
    assert before[1] in ("wiki:14#Ways_to_breed", "wiki:14#Ways_to_ride", "wiki:14#Ways_to_feed")
    assert told(20, "tame", "camel") not in text
    assert told(20, "tame", "camel") in ask("read", ref="wiki:14", max_chars=1000)


def test_what_was_removed_is_not_found_any_more(data: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(data, tmp_path / "data"))
    run = run_at(root)
    assert ORDER in run_search(run, "xylophagous", [], Only(), DEFAULT)
    reddit(root)
    assert ORDER not in run_search(run, "xylophagous", [], Only(), DEFAULT)
    with pytest.raises(UsageError, match="has no comment 'c900'"):
        run_read(root, parse_reference("reddit:p000/c900"), DEFAULT)
