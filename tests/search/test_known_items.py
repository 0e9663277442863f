"""Sixty questions a source, of which each has one right place in the invented world.

The world says in each of its places how one animal is treated, and in the same place names another
action and another animal apart. It is crawled by the real clients, and every link of an answer is
followed on the services to the very place that it names.
"""

import html
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote, urlsplit

import pytest
import requests

from kb.core.config.pipeline import Recipe
from kb.core.sources import SOURCES
from kb.filters.filter_run import run_clean
from kb.sandbox.reddit.subreddit import Subreddit
from kb.sandbox.wiki.generated import RecordedWiki
from kb.sandbox.world import World
from kb.sandbox.youtube.captions import SpokenCue
from kb.search.answers import search
from kb.search.build import index
from kb.search.ranking import Only
from kb.wiki.browser import chromium
from tests.conftest import skip_or_fail
from tests.faults import Sandbox
from tests.reddit.work import NOW, Work, rows

pytestmark = pytest.mark.slow
ANIMALS = (
    "badger", "camel", "dingo", "egret", "ferret", "gecko", "heron", "ibex", "jackal", "koala",
    "lemur", "marten",
)  # fmt: skip
ACTIONS = (
    "tame", "feed", "ride", "breed", "trap", "shear", "leash", "groom", "tether", "muzzle",
    "saddle", "pacify", "lure", "hatch", "wash",
)  # fmt: skip
PAIRS = [(action, animal) for animal in ANIMALS for action in ACTIONS]
QUESTIONS = 60


def told(number: int) -> str:
    action, animal = PAIRS[number]
    return f"to {action} the {animal} you need a handful of wheat"


def near(number: int) -> str:
    """Both words of what is told in another video, page or thread, apart."""
    action, animal = PAIRS[(number + len(PAIRS) // 2) % len(PAIRS)]
    return f"yesterday a {animal} was there and nobody wanted to {action} anything"


class Known(NamedTuple):
    """The world's data root, and by source which pair is told where: number → key."""

    root: Path
    sandbox: Sandbox
    places: dict[str, dict[int, str]]


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Known]:
    try:
        chromium.find_programs()
    except Exception as error:  # noqa: BLE001
        skip_or_fail(str(error))
    world = World(n_channels=8, n_videos=100)
    world.reddit = Subreddit(0, 80, width=60, depth=12)
    places: dict[str, dict[int, str]] = {
        "youtube": _videos(world),
        "reddit": _comments(world.reddit),
        "wiki": {},
    }
    with pytest.MonkeyPatch.context() as patch, Sandbox(world, services=SOURCES) as sandbox:
        patch.setenv("KB_NOW", NOW)
        patch.setattr(RecordedWiki, "html", _sections(RecordedWiki.html, places["wiki"]))
        work = Work(sandbox, tmp_path_factory.mktemp("known"), listings=("new",), search=())
        work.crawl()
        Recipe("youtube").defined("crawl")(work.run(), None, None, None)
        Recipe("wiki").defined("crawl")(work.run(workers=1))  # one browser
        for source in SOURCES:
            run_clean(work.run(), source)
        index(work.run())
        yield Known(work.root, sandbox, places)


def _videos(world: World) -> dict[int, str]:
    """In the middle of each video one thing is told, near its beginning another is missed."""
    plain, catalogue = world.youtube.cues, world.youtube
    numbers = {key: number for number, key in enumerate(catalogue.videos)}

    def cues(video: Any, *rest: Any) -> list[SpokenCue]:
        made = plain(video, *rest)
        for at, text in ((1, near(numbers[video.id])), (len(made) // 2, told(numbers[video.id]))):
            made[at : at + 1] = [SpokenCue(*one[:2], text) for one in made[at : at + 1]]
        return made

    catalogue.cues = cues
    return {number: key for key, number in numbers.items()}


def _comments(subreddit: Subreddit) -> dict[int, str]:
    places = {}
    whole = [one for one in subreddit.comments.values() if not one["body"].startswith("[")]
    for number, (one, other) in enumerate(zip(whole[::2], whole[1::2], strict=False)):
        if number < len(PAIRS):
            one["body"], other["body"] = f"I say {told(number)}.", f"{near(number)}."
            places[number] = one["name"]
    return places


def _sections(
    plain: Callable[..., str | None], places: dict[int, str]
) -> Callable[..., str | None]:
    """Each page gets sections more, one for each action; every second one is in a table."""
    taken: dict[str, int] = {}

    def html(self: RecordedWiki, title: str, later: bool) -> str | None:
        text = plain(self, title, later)
        page = self.pages(later).get(title)
        if text is None or page is None or page.get("redirect"):
            return text
        first = taken.setdefault(title, len(taken)) * len(ACTIONS)
        parts = []
        for number in range(first, min(first + len(ACTIONS), len(PAIRS))):
            places[number] = str(page["pageid"])
            name = f"Way {number}"
            parts.append(
                f'<h2><span class="mw-headline" id="{name.replace(" ", "_")}">{name}</span></h2>'
                f"<p>{near(number)}.</p>"
                + (
                    f"<table><tbody><tr><th>Way</th></tr><tr><td>{told(number)}</td></tr></table>"
                    if number % 2
                    else f"<p>{told(number)}.</p>"
                )
            )
        end = "</div></div></div>"
        before, _, after = text.rpartition(end)
        return before + "".join(parts) + end + after

    return html


def kept(known: Known, source: str) -> dict[int, str]:
    """The first sixty of the places that the filter kept."""
    tables = {
        "youtube": ("youtube/transcripts", "video_id", ""),
        "wiki": ("wiki/pages", "page_id", ""),
        "reddit": ("reddit/comments", "comment_id", "t1_"),
    }
    table, column, before = tables[source]
    keys = {f"{before}{row[column]}" for row in rows(known.root / "clean" / table)}
    numbers = [number for number, key in sorted(known.places[source].items()) if key in keys]
    return {number: known.places[source][number] for number in numbers[:QUESTIONS]}


@pytest.mark.parametrize("source", SOURCES)
def test_a_known_item_is_among_the_first_five_and_its_link_leads_there(
    known: Known, source: str
) -> None:
    asked = kept(known, source)
    assert len(asked) == QUESTIONS
    found = 0
    for number, key in asked.items():
        action, animal = PAIRS[number]
        words = f"How do I {action} a {animal}?"
        answers = search(known.root, words, sources=[source], only=Only(limit=5))
        assert len(answers) == 5
        right = [one for one in answers if one.key == key and told(number) in one.text]
        found += bool(right)
        for one in right:
            assert told(number) in opened(known.sandbox, source, one.url, one.key), one.url
    assert found >= 0.95 * QUESTIONS


BY_HAND = {
    "what melts in the rain": "Saltstone",
    "how many pieces does a bed give in autumn": "Saltstone",
    "high water of the red moon": "Tide table",
    "what turns cord into nets": "Net loom",
    "who sees the harbour at dawn": "Harbour pictures",
    "soundings of the western sheet": "Charts",
    "a bell of fog in summer": "Weather",
    "how long is a fathom": "Sailors' words",
    "colours of a light for pilots": "Lamp buoy",
    "landing of an island with a difficult name": "Île d'Écume & 岩島 (100%)",
}


@pytest.mark.parametrize(("words", "title"), BY_HAND.items())
def test_a_question_by_hand_finds_its_page(known: Known, words: str, title: str) -> None:
    answers = search(known.root, words, sources=["wiki"], only=Only(limit=3))
    assert title in [one.title for one in answers], [(one.title, one.score) for one in answers]


def opened(sandbox: Sandbox, source: str, url: str, key: str) -> str:
    """What stands at the place that a link names, as the service gives it."""
    parts = urlsplit(url)
    root = sandbox.servers[source].url
    if source == "wiki":
        assert url.startswith(root)
    answer = requests.get(f"{root}{parts.path}?{parts.query}", timeout=30)
    assert answer.status_code == 200
    if source == "reddit":
        (text,) = re.findall(rf'<article id="{key}">(.*?)</article>', answer.text, re.DOTALL)
        return str(text)
    if source == "wiki":
        assert f'"wgRevisionId": {parts.query.removeprefix("oldid=")}' in answer.text
        named = re.escape(unquote(parts.fragment))
        (text,) = re.findall(rf'id="{named}">(.*?)(?=<h2>|</div>)', answer.text, re.DOTALL)
        return str(text)
    second = int(parts.query.rpartition("&t=")[2].removesuffix("s"))
    return _heard(root, key, answer.text, second)


def _heard(root: str, key: str, page: str, second: int) -> str:
    """What a video says in that second, by the captions that its player has."""
    (api,) = re.findall(r'"INNERTUBE_API_KEY":\s*"(\w+)"', page)
    player = requests.post(
        f"{root}/youtubei/v1/player?key={api}",
        json={"videoId": key, "context": {"client": {"clientName": "ANDROID"}}},
        timeout=30,
    ).json()
    said = []
    for track in player["captions"]["playerCaptionsTracklistRenderer"]["captionTracks"]:
        address = urlsplit(track["baseUrl"])
        for query in (address.query, f"{address.query}&tlang=en"):
            plain = query.replace("&fmt=srv3", "")  # as the client asks
            text = requests.get(f"{root}{address.path}?{plain}", timeout=30).text
            cues = re.findall(r'<text start="([\d.]+)"[^>]*>(.*?)</text>', text)
            said += [html.unescape(one) for at, one in cues if int(float(at)) == second]
    return " ".join(said)
