"""The question of `kb profile check --online` to YouTube: one channel search."""

import tempfile
from pathlib import Path
from typing import Any

from kb.core import terminal
from kb.core.config.profile.base import ERROR, NOTE, WRONG, OnlineAnswer, QuestionCost
from kb.core.config.profile.collecting import YouTubeSection
from kb.core.context import Run
from kb.crawl.connector import Opened
from kb.store.state.frontier import Frontier
from kb.youtube.crawl.client import YouTubeApi


def question(run: Run, cost: QuestionCost) -> OnlineAnswer:
    """One channel search: 1 of the search bucket's units."""
    section = run.profile.section(YouTubeSection)
    words = section.keywords[0]
    with tempfile.TemporaryDirectory() as place:
        ledger = Frontier(Path(place) / "ledger.sqlite")
        try:
            once = section.model_copy(update={"max_tries": 1})
            api = YouTubeApi(run, once, Opened(run=run, frontier=ledger), service="api")
            cost.requests = cost.units = 1
            answer = api.search(q=words, type="channel", part="snippet", maxResults=5)
            api.close()
        finally:
            ledger.close()
    titles = [_title(one) for one in answer.get("items", [])]
    searched = f"a search for {terminal.shown(words)}"
    if not titles:
        fix = "search for words that channels of the domain use in their names"
        return OnlineAnswer(ERROR, "youtube.keywords", f"{searched} finds no channel", fix, WRONG)
    shown = ", ".join(titles[:3])
    return OnlineAnswer(NOTE, "youtube.keywords", f"{searched} finds channels such as {shown}")


def _title(item: dict[str, Any]) -> str:
    return terminal.shown(str(item.get("snippet", {}).get("title", "")))
