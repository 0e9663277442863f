"""One browser pool, one small page server and one MediaWiki for all tests of the wiki room."""

import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from werkzeug.serving import WSGIRequestHandler, make_server
from werkzeug.wrappers import Request, Response

from kb.core import clock
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import MissingExtra
from kb.net.rate import Pace
from kb.wiki.browser import chromium
from kb.wiki.browser.browser import Browser, Pool, reach
from kb.wiki.capture import page
from tests.conftest import skip_or_fail


class Quiet(WSGIRequestHandler):
    """No line a request."""

    def log(self, type: str, message: str, *args: Any) -> None:
        """Nothing."""


@pytest.fixture(scope="session")
def programs() -> chromium.Programs:
    """Chromium and its driver."""
    try:
        return chromium.find_programs()
    except MissingExtra as error:
        skip_or_fail(str(error))


@pytest.fixture(scope="session")
def serve() -> Iterator[Callable[[Any], str]]:
    """serve(application) → its root address; all are ended after the session."""
    servers = []

    def start(application: Any) -> str:
        server = make_server("127.0.0.1", 0, application, threaded=True, request_handler=Quiet)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.port}"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


class Turns:
    """The turns that paces gave, each with the moment at which its wait was over."""

    def __init__(self) -> None:
        self.taken: list[tuple[Pace, float]] = []
        self.delays: list[tuple[Pace, float]] = []

    def before(self, delay: float, asked: list[float]) -> bool:
        """Whether each request at these moments had a turn of its own before it, all of the one
        pace that was slowed to `delay`. How a pace spaces its turns, tests/net/test_rate.py says.
        """
        (pace,) = {pace for pace, seconds in self.delays if seconds == delay}
        moments = sorted(moment for one, moment in self.taken if one is pace)
        return len(moments) == len(asked) and all(
            turn <= seen for turn, seen in zip(moments, sorted(asked), strict=True)
        )


@pytest.fixture
def turns(monkeypatch: pytest.MonkeyPatch) -> Turns:
    """Which turns are taken from now on."""
    noted, wait, slow = Turns(), Pace.wait_within, Pace.at_least

    def wait_within(pace: Pace, seconds: float) -> bool:
        given = wait(pace, seconds)
        if given:
            noted.taken.append((pace, clock.monotonic()))
        return given

    def at_least(pace: Pace, seconds: float) -> None:
        slow(pace, seconds)
        noted.delays.append((pace, seconds))

    monkeypatch.setattr(Pace, "wait_within", wait_within)
    monkeypatch.setattr(Pace, "at_least", at_least)
    return noted


class Stage:
    """One address, at which each test has a wiki of its own, so that browsers can be shared."""

    def __init__(self, serve: Callable[[Any], str]) -> None:
        self.url = serve(lambda environ, start: self.application(environ, start))
        self.application: Callable[..., Any] = Response("nothing here", 404)


@pytest.fixture(scope="module")
def stage(serve: Callable[[Any], str], shared_browsers: None) -> Stage:
    """stage.application = …: what is served at stage.url from now on."""
    return Stage(serve)


class Pages:
    """A server of own pages: `put` a body under a path, see what was asked."""

    def __init__(self) -> None:
        self.bodies: dict[str, Any] = {}
        self.asked: list[str] = []
        self.url = ""

    def put(self, path: str, body: Any, type: str = "text/html; charset=utf-8") -> str:
        """Serve a body (text, bytes, or a function of the request); its address."""
        self.bodies[path] = (body, type)
        return self.url + path

    @Request.application
    def application(self, request: Request) -> Response:
        """The WSGI side."""
        self.asked.append(request.full_path.rstrip("?"))
        if request.path not in self.bodies:
            return Response("nothing here", 404)
        body, type = self.bodies[request.path]
        answer = body(request) if callable(body) else body
        return answer if isinstance(answer, Response) else Response(answer, content_type=type)


@pytest.fixture(scope="session")
def pages(serve: Callable[[Any], str]) -> Pages:
    """The page server."""
    held = Pages()
    held.url = serve(held.application)
    return held


@pytest.fixture(scope="session")
def section() -> Any:
    """[wiki] of the shipped profile; its limits are for what hangs, and for no busy machine."""
    return load_profile("minecraft").wiki.model_copy(
        update={"settle_seconds": 60.0, "page_seconds": 60.0}
    )


@pytest.fixture(scope="session")
def pool(programs: chromium.Programs, pages: Pages, section: Any) -> Iterator[Pool]:
    """Browsers that may ask the page server only."""
    hosts, origins = reach(pages.url, ())

    def start() -> Browser:
        return Browser(
            programs,
            hosts=hosts,
            origins=origins,
            user_agent="lorecrawl/test (+test@example.org)",
            viewport=(1280, 1024),
            page_seconds=section.page_seconds,
            before=page.page_script("settle.js"),
        )

    with Pool(start, section.page_seconds + 3) as held:
        yield held


@pytest.fixture
def look(pool: Pool, section: Any, tmp_path: Path) -> Callable[..., Any]:
    """look(url) → what was captured, with `.picture`, the path of the screenshot."""

    def capture_page(url: str, **options: Any) -> Any:
        picture = tmp_path / "screenshot.png"
        rules = {**section.rules, **options.pop("rules", {})}
        options = {"max_height": section.max_page_height, **options}
        found = pool.use(lambda browser: page.capture(browser, url, picture, rules, **options))
        found.picture = picture
        return found

    return capture_page


@pytest.fixture(scope="module")
def shared_browsers(programs: chromium.Programs) -> Iterator[None]:
    """Crawls in this process share browsers."""
    from tests.wiki import shared_browsers

    with shared_browsers.kept():
        yield


@pytest.fixture(scope="session")
def mediawiki(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A running, seeded MediaWiki."""
    from tests.wiki import mediawiki as room
    from tests.wiki import mediawiki_pages

    if reason := room.install():
        skip_or_fail(reason)
    drawn = tmp_path_factory.mktemp("drawn")
    mediawiki_pages.draw(drawn)
    wiki = room.MediaWiki(tmp_path_factory.mktemp("mediawiki") / "site")
    wiki.create()
    wiki.seed(mediawiki_pages.PAGES, drawn)
    shutil.copy(drawn / "sheet.png", wiki.images / "sheet.png")
    wiki.edit(
        "File:Tall.png", "A jar, under [https://creativecommons.org/licenses/by/4.0/ CC BY 4.0]."
    )
    with wiki.serving():
        yield wiki


@pytest.fixture(scope="session")
def run_on() -> Callable[..., Run]:
    """run_on(root, url, …) → a Run of the shipped profile against a wiki."""

    def make(root: Path, url: str, *, wiki: dict[str, Any] | None = None, **options: Any) -> Run:
        profile = load_profile("minecraft")
        profile = profile.model_copy(
            update={
                "wiki": profile.wiki.model_copy(
                    update={"page_seconds": 60.0, "settle_seconds": 60.0, **(wiki or {})}
                )
            }
        )
        settings = load_settings(dotenv=False, kb_wiki_url=url, kb_contact="test@example.org")
        asked = "workers" in options  # browsers two by default, filters in this process
        options = {"workers": 2, "asked": asked, **options}
        return Run(settings=settings, profile=profile, root=root, **options)

    return make
