"""The question of `kb profile check --online` to Reddit: the subreddit's description."""

from collections.abc import Callable

from kb.core.config.profile.base import (
    ERROR,
    NOTE,
    WARNING,
    WRONG,
    OnlineAnswer,
    QuestionCost,
)
from kb.core.config.profile.collecting import RedditSection
from kb.core.context import Run
from kb.core.errors import ItemFinal
from kb.reddit.crawl.client import Client


def question(run: Run, cost: QuestionCost) -> OnlineAnswer:
    """The subreddit's own page; the token before it is a request as well."""
    section = run.profile.section(RedditSection)

    def spend(endpoint: str, units: int) -> Callable[[str], None]:
        cost.requests += 1
        return lambda outcome: None

    client = Client(
        run.settings, spend, requests_per_minute=section.requests_per_minute, max_tries=1
    )
    name = section.subreddit
    try:
        about = client.get(f"r/{name}/about/", {"raw_json": 1}).get("data", {})
    except ItemFinal as fact:
        why = {
            "redirect": "there is no subreddit of that name",
            "not_found": "it was banned, or there is none of that name",
            "forbidden": "it is private or quarantined",
        }.get(fact.reason, fact.reason)
        return OnlineAnswer(ERROR, "reddit.subreddit", f"r/{name} can't be read", why, WRONG)
    answer = f"r/{about.get('display_name', name)}"
    if isinstance(about.get("subscribers"), int):
        answer += f", {about['subscribers']:,} subscribers"
    if about.get("over18"):
        fix = "its posts will be rejected at the stage nsfw"
        return OnlineAnswer(WARNING, "reddit.subreddit", f"{answer}, for adults only", fix, 0)
    return OnlineAnswer(NOTE, "reddit.subreddit", answer)
