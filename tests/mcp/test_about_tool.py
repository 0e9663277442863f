"""`about`: contents, dates and licences."""

from kb.mcp.untrusted_text import LEAST
from tests.mcp.conftest import Ask, outside


def test_about(ask: Ask) -> None:
    text = outside(ask("about"))
    assert "youtube: 30 videos, published from 2023-01-01 to 2023-01-30" in text
    assert "wiki: 42 passages" in text
    assert "view clean.wiki_pages (also wiki_pages): 6 rows." in text
    assert "licence CC-BY-SA-3.0: 6" in ask("about")
    assert "left out" in ask("about", max_chars=LEAST)
