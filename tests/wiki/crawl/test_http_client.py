"""Which addresses of a wiki may be asked."""

import pytest

from kb.core.errors import Challenged
from kb.wiki.browser.browser import reach
from kb.wiki.crawl.client import find_endpoint


def test_robots_rule_the_api_only_where_they_name_us(wiki, web, api) -> None:
    """MediaWiki's etiquette rules API clients; most wikis bar the folder of their scripts to all
    crawlers.
    """
    # the contact is test@example.org
    wiki.robots = "User-agent: *\nDisallow: /w/\n\nUser-agent: example\nDisallow: /\n"
    web.read_robots()
    web.barred(find_endpoint(web, wiki.url))
    assert web.allowed(f"{wiki.url}/wiki/Alpha")
    assert not web.allowed(f"{wiki.url}/w/index.php")
    wiki.robots = "User-agent: lorecrawl\nDisallow: /w/\n"
    web.read_robots()
    with pytest.raises(Challenged, match=r"names lorecrawl and bars http.*/w/api.php"):
        web.barred(find_endpoint(web, wiki.url))
    wiki.robots = "User-agent: Lorecrawl/9\nDisallow: /\n"
    web.read_robots()
    with pytest.raises(Challenged) as error:
        find_endpoint(web, wiki.url)
    assert error.value.exit_code == 4


def test_both_schemes_of_a_wiki_are_the_same_place() -> None:
    """KB_WIKI_URL=http://… for a wiki that names its pages with https, and the other way round."""
    for scheme in ("http", "https"):
        hosts, origins = reach(f"{scheme}://wiki.example", ("pictures.example",))
        assert hosts == ["wiki.example:80", "wiki.example:443", "pictures.example"]
        assert origins[:2] == ["http://wiki.example", "https://wiki.example"]
        assert "https://pictures.example" in origins
    assert reach("http://127.0.0.1:81", ())[0] == ["127.0.0.1:81"]
    assert reach("http://[::1]:81", ())[0] == ["[::1]:81"]
