"""Tests of `kb.wiki.crawl.http_client`."""

from kb.wiki.crawl.http_client import Robots, robots_url

RULES = (
    "User-agent: *\nDisallow: /private\nCrawl-delay: 5\n\nUser-agent: lorecrawl\nDisallow:"
    " /no\nCrawl-delay: 0.5\n"
)


def test_robots_by_agent() -> None:
    ours, others = Robots(RULES, "lorecrawl/1.0"), Robots(RULES, "other")
    assert (ours.allows("http://w/private/x"), ours.allows("http://w/no"), ours.crawl_delay) == (
        True,
        False,
        0.5,
    )
    assert (others.allows("http://w/private/x"), others.crawl_delay) == (False, 5.0)


def test_robots_know_us_by_our_product_token_alone() -> None:
    agent = "lorecrawl/1.0 (+mail@example.org)"
    assert Robots("User-agent: example\nDisallow: /\n", agent).allows("http://w/x")
    ours = Robots(
        "User-agent: *\nDisallow: /\n\nUser-Agent: Lorecrawl/2.1 # you\nDisallow: /no\n", agent
    )
    assert (ours.allows("http://w/x"), ours.allows("http://w/no"), ours.named) == (
        True,
        False,
        True,
    )
    assert not Robots("User-agent: *\nDisallow: /\n", agent).named


def test_robots_by_answer() -> None:
    assert Robots.of_answer(404, "<html>", "a").allows("http://w/x")
    assert not Robots.of_answer(503, "", "a").allows("http://w/x")
    assert Robots.of_answer(200, "", "a").crawl_delay is None
    assert robots_url("https://w.org:8443/wiki/A?b") == "https://w.org:8443/robots.txt"
