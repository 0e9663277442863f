"""Pages that mean harm, or don't know better: each ends with a clear record, and no process
stays.
"""

import contextlib
import json
import os
import socket
import struct
import zlib
from typing import Any

import pytest

from kb.core.errors import ItemFinal, Retryable
from kb.wiki.browser import chromium
from kb.wiki.browser.browser import Browser
from kb.wiki.capture.page import PageTraffic
from kb.wiki.errors import PageTimeout

LATE = {"still_seconds": 0.5}  # for pages that do something only after a while
TEXT = "<!DOCTYPE html><div id=content><p>A page that has something to say.</p>"


def bomb(width: int, height: int) -> bytes:
    """A PNG of one colour: small as a file, large when decoded."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    pack = zlib.compressobj(9)
    rows = b"".join(pack.compress(bytes(1 + width)) for _ in range(height)) + pack.flush()
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
        + chunk(b"IDAT", rows)
        + chunk(b"IEND", b"")
    )


def texts(found) -> list[str]:
    return [e["text"] for e in found.extraction["elements"] if e["kind"] == "text"]


def test_bomb_image(pages, look, section):
    sides = [9_000, 8_000]
    assert sides[0] * sides[1] > section.max_pixels
    pages.put("/bomb.png", bomb(*sides), "image/png")
    found = look(pages.put("/bomb", TEXT + "<img src=/bomb.png width=50 height=50>"))
    image = next(e for e in found.extraction["elements"] if e["kind"] == "image")
    assert image["natural"] == sides
    assert image["box"][2:] == [50, 50]


def test_three_thousand_cells(pages, look):
    rows = "".join(
        "<tr>" + "".join(f"<td>{r}.{c}</td>" for c in range(30)) + "</tr>" for r in range(100)
    )
    found = look(pages.put("/cells", f"{TEXT}<table>{rows}</table>"))
    cells = found.extraction["cells"]
    assert len(cells) == 3000
    assert all(cell["text"] == f"{cell['row']}.{cell['column']}" for cell in cells)


def test_infinite_animation_and_timers(pages, look):
    body = (
        TEXT
        + """<style>@keyframes spin { to { transform: rotate(1turn) } }
    p { animation: spin .1s infinite }</style>
    <p id=n>0</p><script>setInterval(() => { n.textContent = +n.textContent + 1 }, 1);
    (function again() { document.title += "x"; requestAnimationFrame(again) })();</script>"""
    )
    found = look(pages.put("/animation", body))
    assert found.settled
    assert "A page that has something to say." in texts(found)


def test_page_that_grows_for_ever(pages, look):
    body = (
        TEXT + "<script>setInterval(() => document.body.append(Object.assign("
        "document.createElement('p'), {textContent: 'more'})), 20)</script>"
    )
    found = look(pages.put("/growing", body), rules={"settle_seconds": 1.0})
    assert not found.settled
    assert found.extraction["page"]["height"] >= 1024


def test_dialogs_and_windows(pages, look):
    body = (
        TEXT
        + """<script>alert(1); confirm(2); prompt(3); print(); window.open('/other');
    window.onbeforeunload = (e) => { e.preventDefault(); return 'stay' };</script>"""
    )
    assert texts(look(pages.put("/dialogs", body))) == ["A page that has something to say."]
    assert texts(look(pages.put("/after-dialogs", TEXT))) == ["A page that has something to say."]


@pytest.fixture
def loop(pages, pool):
    """A script that never ends; soon after it has begun, its page's time is over."""

    def begun(request):
        for browser in list(pool._all):
            browser.allow(0.1)
        return "begun"

    pages.put("/begun", begun)
    asked = "const asked = new XMLHttpRequest(); asked.open('GET', '/begun', false); asked.send();"
    return f"{asked} while (true) {{}}"


def test_endless_loop_is_ended_with_its_browser(pages, look, pool, loop):
    before = set(pool._all)
    with pytest.raises(Retryable, match="page_timeout"):
        look(pages.put("/loop", f"{TEXT}<script>{loop}</script>"))
    # A fresh browser takes the next page.
    assert texts(look(pages.put("/after-loop", TEXT))) == ["A page that has something to say."]
    assert len(pool._all - before) == 1


def test_loop_that_starts_while_settling(pages, look, loop):
    late = f"<script>setTimeout(() => {{ {loop} }}, 100)</script>"
    with pytest.raises(Retryable, match="page_timeout"):
        look(pages.put("/late-loop", TEXT + late), rules=LATE)


@pytest.mark.parametrize(
    "away",
    [
        "<meta http-equiv=refresh content='0;url=http://elsewhere.example/'>",
        "<script>location.href = 'http://elsewhere.example/'</script>",
        "<script>setTimeout(() => { location.href = 'http://localhost:9/' }, 200)</script>",
    ],
)
def test_page_that_leaves(pages, look, away):
    with pytest.raises(ItemFinal, match="redirected_away") as error:
        look(pages.put("/away", TEXT + away), rules=LATE)
    assert error.value.value.startswith(("http://elsewhere.example", "http://localhost:9"))


def test_page_that_leaves_whatever_the_driver_calls_it(pages, look, monkeypatch):
    """It says that the script has timed out, at once, when it notices too late."""
    promise = Browser.promise

    def timed_out(browser, *asked):
        with contextlib.suppress(Retryable):
            promise(browser, *asked)
        raise PageTimeout

    monkeypatch.setattr(Browser, "promise", timed_out)
    away = "<script>setTimeout(() => { location.href = 'http://localhost:9/' }, 200)</script>"
    with pytest.raises(ItemFinal, match="redirected_away: http://localhost:9"):
        look(pages.put("/away-late", TEXT + away), rules=LATE)
    with pytest.raises(PageTimeout):
        look(pages.put("/there", TEXT))


def test_http_redirect_away(pages, look):
    from werkzeug.utils import redirect

    with pytest.raises(ItemFinal, match="redirected_away"):
        look(pages.put("/redirect", lambda request: redirect("http://elsewhere.example/page")))


def test_too_tall_and_too_many(pages, look):
    with pytest.raises(ItemFinal, match="too_tall: 30"):
        look(pages.put("/too-tall", TEXT + "<div style='height:3000px'></div>"), max_height=2000)
    with pytest.raises(ItemFinal, match="too_many_elements"):
        look(pages.put("/too-many", TEXT + "<p>x</p>" * 30), rules={"max_elements": 20})


def test_server_errors_are_no_pages(pages, look):
    from werkzeug.wrappers import Response

    with pytest.raises(Retryable, match="http_503"):
        look(pages.put("/busy", lambda request: Response("busy", 503)))
    with pytest.raises(ItemFinal, match="http_404"):
        look(pages.url + "/not-there")


def test_a_page_that_is_not_served_costs_no_browser(pages, look, pool):
    """Neither a connection that is lost nor an error without a text, which Chromium hides alike."""
    from werkzeug.wrappers import Response

    def drop(request):
        request.environ["werkzeug.socket"].shutdown(socket.SHUT_RDWR)

    look(pages.put("/before-drop", TEXT))
    before = set(pool._all)
    for answer in (drop, lambda request: Response(b"", 503)):
        with pytest.raises(Retryable, match="not_loaded"):
            look(pages.put("/drop", answer))
    assert texts(look(pages.put("/after-drop", TEXT))) == ["A page that has something to say."]
    assert pool._all == before


def test_dropped_pictures_and_styles_are_asked_again(pages, look, tmp_path):
    from PIL import Image
    from werkzeug.wrappers import Response

    Image.new("RGB", (20, 20), (1, 2, 3)).save(tmp_path / "dot.png")
    data, tries = (tmp_path / "dot.png").read_bytes(), []

    def flaky(request):
        tries.append(1)
        return (
            Response("busy", 503) if len(tries) == 1 else Response(data, content_type="image/png")
        )

    pages.put("/flaky.png", flaky)
    found = look(
        pages.put(
            "/flaky",
            TEXT + "<img src=/flaky.png loading=lazy><div style='height:9000px'></div>"
            "<img src=/flaky.png?far loading=lazy>",
        )
    )
    images = [e for e in found.extraction["elements"] if e["kind"] == "image"]
    assert [e["loaded"] for e in images] == [True, True]
    pages.put("/broken.css", lambda request: Response("busy", 503))
    url = pages.put("/styled", "<link rel=stylesheet href=/broken.css>" + TEXT)
    with pytest.raises(Retryable, match="resource_failed"):
        look(url)
    assert texts(look(url, strict=False))


def test_no_other_host_is_asked(pages, serve, look):
    """Neither another host nor another port of this one, whatever the page refers to."""
    asked = []

    def other(environ, start):
        asked.append(environ["PATH_INFO"])
        start("200 OK", [("Content-Type", "text/css")])
        return [b""]

    elsewhere = serve(other)
    look(
        pages.put(
            "/leaky",
            f"{TEXT}<img src={elsewhere}/x.png><link rel=stylesheet"
            f" href={elsewhere}/x.css><script>fetch('{elsewhere}/f')</script>"
            f"<iframe src={elsewhere}/frame></iframe><iframe"
            f" src=http://localhost:{elsewhere.rsplit(':', 1)[1]}/frame2></iframe>"
            f"<script>navigator.sendBeacon('{elsewhere}/b')</script>",
        ),
        strict=False,
    )
    assert asked == []


def test_scripts_in_svg_never_run(pages, look):
    svg = (
        "<svg xmlns='http://www.w3.org/2000/svg' width='30'"
        " height='20'><script>fetch('/ran')</script><rect width='30' height='20'/></svg>"
    )
    pages.put("/picture.svg", svg, "image/svg+xml")
    look(pages.put("/svg", TEXT + "<img src=/picture.svg>"))
    assert "/ran" not in pages.asked


def test_nothing_is_left_of_a_browser(pool):
    """Every process of the browser's session is gone after `end`, its profile too."""
    browser = pool.use(lambda held: held)
    leader, folder = browser.process.pid, browser.process.folder
    assert len(chromium.family(leader, folder)) > 3

    def fail(held):
        assert held is browser
        raise Retryable("a browser that failed is replaced")

    with pytest.raises(Retryable):
        pool.use(fail)
    assert not os.path.exists(folder)
    assert [
        pid for pid in chromium.family(leader, folder) if os.path.exists(f"/proc/{pid}/exe")
    ] == []


PAGE, IMAGE = "https://wiki.example/wiki/Fog", "https://wiki.example/images/fog.png"


class Log:
    """A browser that has only its performance log."""

    def __init__(self) -> None:
        self.events: list[tuple[str, dict[str, Any]]] = [("Network.dataReceived", {})]

    def record(self) -> list[dict[str, str]]:
        taken, self.events = self.events, []
        return [
            {"message": json.dumps({"message": {"method": method, "params": params}})}
            for method, params in taken
        ]

    def sent(self, number: str, url: str, **more: str) -> None:
        params = {"requestId": number, "request": {"url": url}, **more}
        self.events.append(("Network.requestWillBeSent", params))

    def received(self, url: str, status: int, **headers: str) -> None:
        response = {"url": url, "status": status, "headers": headers}
        self.events.append(("Network.responseReceived", {"response": response}))

    def failed(self, number: str, **more: str) -> None:
        self.events.append(("Network.loadingFailed", {"requestId": number, **more}))


def test_the_last_response_of_each_url_counts() -> None:
    log = Log()
    traffic = PageTraffic(log)
    log.sent("1", PAGE, type="Document", frameId="main")
    log.received(PAGE, 200)
    log.sent("2", IMAGE)
    log.received(IMAGE, 503, **{"Retry-After": "7"})
    log.failed("2")
    traffic.take_in()
    assert traffic.served[PAGE].status == 200
    assert not traffic.served[PAGE].may_come_back
    assert (traffic.served[IMAGE].status, traffic.served[IMAGE].after) == (503, 7.0)
    assert traffic.served[IMAGE].may_come_back
    assert not traffic.cut_off
    log.received(IMAGE, 404)
    traffic.take_in()
    assert not traffic.served[IMAGE].may_come_back


def test_requests_that_fail_and_requests_that_the_browser_blocks() -> None:
    log = Log()
    traffic = PageTraffic(log)
    log.sent("1", PAGE, type="Document", frameId="main")
    log.received(PAGE, 200)
    log.failed("1")
    log.sent("2", IMAGE)
    log.failed("2", blockedReason="inspector")
    traffic.take_in()
    assert traffic.cut_off
    assert traffic.served[PAGE].may_come_back
    assert traffic.served[IMAGE].barred
    assert not traffic.served[IMAGE].may_come_back
