"""Tests of reading responses from Chromium's performance log."""

import json
from typing import Any

from kb.wiki.browser.traffic import PageTraffic

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
    traffic = PageTraffic(log)  # type: ignore[arg-type]
    log.sent("1", PAGE, type="Document", frameId="main")
    log.received(PAGE, 200)
    log.sent("2", IMAGE)
    log.received(IMAGE, 503, **{"Retry-After": "7"})
    log.failed("2")
    traffic.read()
    assert traffic.served[PAGE].status == 200
    assert not traffic.served[PAGE].may_come_back
    assert (traffic.served[IMAGE].status, traffic.served[IMAGE].after) == (503, 7.0)
    assert traffic.served[IMAGE].may_come_back
    assert not traffic.cut_off
    log.received(IMAGE, 404)
    traffic.read()
    assert not traffic.served[IMAGE].may_come_back


def test_requests_that_fail_and_requests_that_the_browser_blocks() -> None:
    log = Log()
    traffic = PageTraffic(log)  # type: ignore[arg-type]
    log.sent("1", PAGE, type="Document", frameId="main")
    log.received(PAGE, 200)
    log.failed("1")
    log.sent("2", IMAGE)
    log.failed("2", blockedReason="inspector")
    traffic.read()
    assert traffic.cut_off
    assert traffic.served[PAGE].may_come_back
    assert traffic.served[IMAGE].barred
    assert not traffic.served[IMAGE].may_come_back
