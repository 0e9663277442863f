"""Generated pages are about the keywords, in the markup of the profile."""

from pathlib import Path

import requests

from kb.core.config.profile import load_profile
from kb.sandbox.domain import domain_of
from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.sandbox.answers import ask
from tests.sandbox.domains import written


def test_wiki_pages_are_about_the_keywords_in_the_profiles_markup(tmp_path: Path) -> None:
    profile = load_profile(written("astronomy", tmp_path))
    with Sandbox(World(domain=domain_of(profile)), services=["wiki"]) as services:
        root = services.settings()["KB_WIKI_URL"]
        listed = ask(root, list="allpages", aplimit="50", apfilterredir="nonredirects")
        titles = {one["title"] for one in listed["query"]["allpages"]}
        names = titles & {one.name for one in domain_of(profile).keywords}
        assert len(names) == len(titles) - 1  # and the main page
        pages = {
            name: requests.get(f"{root}/wiki/{name}", timeout=9).text for name in sorted(names)
        }
        page = next(text for text in pages.values() if '<table class="about">' in text)
        assert " - Astronomy Wiki</title>" in page
        assert 'class="icon"' in page
        parts = next(text for text in pages.values() if 'class="made"' in text)
        assert "turning" in parts
        for name in ("made", "place", "outcome", "how-many", "mcui-row"):
            assert f'class="{name}"' in parts
        css = requests.get(f"{root}/static/common.css", timeout=9).text
        assert ".made {" in css
        assert ".how-many {" in css
        assert ".about {" in requests.get(f"{root}/static/site.css", timeout=9).text
        assert "turning-now" in requests.get(f"{root}/static/common.js", timeout=9).text
