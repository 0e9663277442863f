"""Which stages the page offers, and whose profile has their thresholds."""

import html
import re
import shutil
from pathlib import Path

from tests.explore.conftest import Explored, explored, figures


def test_the_current_threshold_changes_nothing(demo_pages: Explored) -> None:
    text = demo_pages.ask("/thresholds").text
    addresses = [html.unescape(one) for one in re.findall(r'href="(/thresholds\?.*?)"', text)]
    assert len(addresses) == 8
    for address in addresses:
        text = demo_pages.ask(address).text
        then, now, waiting = figures(text)
        assert then == now > 0
        assert waiting == 0
        places = [html.unescape(one) for one in re.findall(r'href="(/document\?.*?)"', text)]
        assert demo_pages.ask(places[0]).status == 200


def test_a_release_is_read_with_its_own_profile(demo: Path, tmp_path: Path) -> None:
    release = tmp_path / "release"
    shutil.copytree(demo / "data" / "demo" / "release", release)
    profile = release / "youtube" / "profile.toml"
    for path in release.glob("*/profile.toml"):
        path.write_text(profile.read_text().replace("min_views = 100", "min_views = 150"))
    with explored(release) as pages:
        assert "views ≥ 150" in pages.ask("/thresholds?stage=views").text
