"""A driver that does not start at once is tried again; one that never does is named."""

import threading

from kb.wiki.browser.browser import Browser


def test_what_follows_gets_its_own_time() -> None:
    """A page's limit follows its height, which is known only once it was loaded."""
    ended = threading.Event()

    class Idle(Browser):
        def __init__(self) -> None:
            self.overdue = self._limited = False

        def _late(self) -> None:
            ended.set()

    browser = Idle()
    with browser.within(1_000):
        browser.allow(0.01)
        assert ended.wait(60)
    ended.clear()
    with browser.within(60):
        before = browser._timer
        browser.allow(1_000)
        assert before.finished.is_set(), "it was called off"
        assert browser._timer.interval == 1_000
    browser.allow(0.01)  # nothing is limited behind the block
    assert not ended.wait(0.1)
