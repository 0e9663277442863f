"""How close together the browser's requests come, and what it asks for besides the page."""

import dataclasses
import io
import itertools
import socket

import pytest
from PIL import Image
from werkzeug.wrappers import Request, Response

from kb.core import clock
from kb.wiki.browser.browser import Browser, reach
from kb.wiki.crawl.connector import crawl

TEXT = "<!DOCTYPE html><div id=content><p>A page that has something to say.</p>"


def dot() -> bytes:
    held = io.BytesIO()
    Image.new("RGB", (9, 9), (1, 2, 3)).save(held, "PNG")
    return held.getvalue()


@pytest.fixture
def wiki(stage, tiny):
    """A small wiki that notes when it was asked for what: `seen`, a list of (seconds, path), by the
    browser and of pages; `plain`, the seconds of the front page and the API.
    """
    held = tiny.SmallWiki()
    held.seen, held.plain = [], []
    held.answers = {}

    def hook(request):
        # The original picture files are fetched later by another client, at a pace of their own.
        if request.headers.get("Sec-Fetch-Dest") or request.path.startswith("/wiki/"):
            held.seen.append((clock.monotonic(), request.path))
        elif request.path in ("/", "/w/api.php"):
            held.plain.append(clock.monotonic())
        if queue := held.answers.get(request.path):
            return queue.pop(0)
        # How often the files are asked for by the other client is no matter here.
        return image() if request.path.endswith(".png") else None

    held.hook = hook
    held.url, stage.application = stage.url, held.application
    return held


@pytest.fixture(scope="session")
def tiny():
    from tests.wiki import small_wiki

    return small_wiki


def times(wiki, path):
    return [moment for moment, asked in wiki.seen if asked == path]


def image(status=200, **headers):
    return Response(dot() if status == 200 else b"", status, headers, content_type="image/png")


def go(run_on, wiki, root, **section):
    run = run_on(root, wiki.url, wiki=section)
    off = run.profile.toxicity.model_copy(update={"toxicity": "off"})
    run = dataclasses.replace(run, profile=run.profile.model_copy(update={"toxicity": off}))
    return crawl(run)


def gaps(moments):
    ordered = sorted(moments)
    return [later - before for before, later in itertools.pairwise(ordered)]


def test_failed_images_wait_for_the_crawl_delay(run_on, wiki, programs, tmp_path, turns, hasty):
    """Over all workers together: pages and images that are asked for again take turns."""
    wiki.robots = "User-agent: *\nCrawl-delay: 1\n"
    for key in (1, 2):
        wiki.add(key, f"Page {key}", f"<p>{'word ' * 30}</p><img src=/i{key}.png>")
        wiki.answers[f"/i{key}.png"] = [image(503), image(503)]
    assert go(run_on, wiki, tmp_path)["crawled"] == 2
    again = []
    for key in (1, 2):
        asked = times(wiki, f"/i{key}.png")
        assert len(asked) == 3, "the first time, and twice more"
        again += asked[1:]
        assert len(times(wiki, f"/wiki/Page_{key}")) == 1
    pages = [moment for moment, path in wiki.seen if path.startswith("/wiki/")]
    assert turns.before(1, [*wiki.plain, *pages, *again])


def test_failed_images_wait_as_long_as_the_server_asks(run_on, wiki, programs, tmp_path, hasty):
    wiki.add(1, "Page", f"<p>{'word ' * 30}</p><img src=/slow.png><img src=/never.png>")
    wiki.answers["/slow.png"] = [image(503, **{"Retry-After": "2"})]
    wiki.answers["/never.png"] = [image(429, **{"Retry-After": "62"})]
    assert go(run_on, wiki, tmp_path, settle_seconds=60.0)["crawled"] == 1
    first, second = times(wiki, "/slow.png")
    assert second - first >= 2
    assert len(times(wiki, "/never.png")) == 1, "longer than a page may take to settle"


@pytest.mark.parametrize("body", [b"", b"busy"])
def test_a_page_is_not_asked_for_before_its_time(run_on, wiki, programs, tmp_path, hasty, body):
    """Neither by the browser nor by the plain client, whether or not the error has a text."""
    wiki.add(1, "Page")
    wiki.answers["/wiki/Page"] = [Response(body, 503, {"Retry-After": "2"})]
    assert go(run_on, wiki, tmp_path)["crawled"] == 1
    first, second, *_ = times(wiki, "/wiki/Page")
    assert second - first >= 2


def test_a_style_sheet_is_not_asked_for_before_its_time(run_on, wiki, programs, tmp_path, hasty):
    wiki.add(1, "Page", f"<link rel=stylesheet href=/x.css><p>{'word ' * 30}</p>")
    wiki.answers["/x.css"] = [
        Response("busy", 503, {"Retry-After": "2"}),
        Response("p {}", content_type="text/css"),
    ]
    assert go(run_on, wiki, tmp_path)["crawled"] == 1
    first, second = times(wiki, "/x.css")
    assert second - first >= 2
    assert gaps(times(wiki, "/wiki/Page"))[0] >= 2


def test_an_empty_image_is_not_the_page_to_ask_for_again(pages, look):
    found = look(pages.put("/own", f"{TEXT}<img src=''><img src><img srcset=''><img>"))
    assert found.settled
    assert pages.asked.count("/own") == 1


def test_a_page_may_not_fetch_ahead(pages, look):
    """Prefetch, prerender, speculation rules, service workers and the tab's icon."""
    pages.put("/worker.js", "fetch('/from-worker')", "text/javascript")
    pages.put("/ahead", TEXT)
    rules = '{"prefetch": [{"urls": ["/ahead"], "eagerness": "immediate"}],'
    rules += '"prerender": [{"urls": ["/ahead"], "eagerness": "immediate"}]}'
    look(
        pages.put(
            "/eager",
            f"<link rel=icon href=/favicon.ico><script type=speculationrules>{rules}</script>"
            f"{TEXT}<script>navigator.serviceWorker?.register('/worker.js')</script>",
        )
    )
    for path in ("/ahead", "/worker.js", "/from-worker", "/favicon.ico"):
        assert path not in pages.asked


@pytest.mark.parametrize("where", ["window", "frame.contentWindow"])
def test_a_page_reaches_no_stun_server(pages, look, where):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stun:
        stun.bind(("127.0.0.1", 0))
        port = stun.getsockname()[1]
        name = "called-" + where.partition(".")[0]
        look(
            pages.put(
                f"/{name}",
                f"""{TEXT}<iframe id=frame></iframe><script>
                const held = {where}.RTCPeerConnection;
                if (held) {{
                  const own = new held({{iceServers: [{{urls: "stun:127.0.0.1:{port}"}}]}});
                  own.createDataChannel("x");
                  own.createOffer().then((offer) => own.setLocalDescription(offer));
                }}</script>""",
            )
        )
        stun.settimeout(1)
        with pytest.raises(TimeoutError):
            stun.recv(100)


def test_a_wiki_behind_a_proxy_is_asked_through_it_and_nothing_else(programs, serve, monkeypatch):
    asked = []

    def proxy(request):
        asked.append(request.url)
        return Response(TEXT + "<img src=http://other.example/i.png>", content_type="text/html")

    for name in ("http_proxy", "https_proxy"):
        monkeypatch.setenv(
            name, serve(Request.application(proxy)).replace("://", "://user:secret@")
        )
    hosts, origins = reach("http://wiki.example", ())
    browser = Browser(
        programs,
        hosts=hosts,
        origins=origins,
        user_agent="lorecrawl/test",
        viewport=(800, 600),
        page_seconds=60.0,
    )
    try:
        browser.go("http://wiki.example/wiki/Page")
        text = browser.script("return document.body.innerText")
    finally:
        browser.end()
    assert "something to say" in text
    assert asked == ["http://wiki.example/wiki/Page"]
