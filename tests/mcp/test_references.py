"""References and links name places."""

import pytest

from kb.core.errors import UsageError
from kb.core.sources import SOURCES
from kb.mcp.documents import parse_reference
from tests.mcp.conftest import right
from tests.search.made import combinations


def test_links_and_refs_are_places() -> None:
    for source, number in ((one, number) for one in SOURCES for number in (3, 4)):
        _, action, animal = list(combinations())[number]
        link, ref = right(source, number, action, animal)
        assert parse_reference(f" {ref} ").ref == ref
        at = parse_reference(link)
        assert (at.source, at.at) == (parse_reference(ref).source, parse_reference(ref).at)
    assert parse_reference("reddit:t3_abc/t1_def").ref == "reddit:abc/def"
    with pytest.raises(UsageError):
        parse_reference("file:///etc/passwd")
