"""Reddit through PRAW: token, requests, one rate limit. Answers are the service's own JSON.

PRAW logs in and signs requests; retries and waiting are Lorecrawl's, so that every request is in
the ledger before it is sent and a signal ends every wait.
"""

import math
from collections.abc import Callable
from datetime import timedelta
from functools import partial
from typing import Any

import praw
import prawcore.exceptions as wrong
import requests
from prawcore.requestor import Requestor
from prawcore.sessions import FiniteRetryStrategy

from kb.core import clock
from kb.core.config.addresses import is_loopback
from kb.core.config.section import (
    ERROR,
    NOTE,
    WARNING,
    WRONG,
    OnlineAnswer,
    QuestionCost,
)
from kb.core.config.settings import REDDIT
from kb.core.context import Run
from kb.core.errors import Blocked, ItemFinal, Retryable
from kb.crawl.connector import Opened, Phase, asking
from kb.crawl.quota import Quota
from kb.net.rate import Pace
from kb.net.retry import PATIENCE_S, Note
from kb.net.session import HttpSession, host_of
from kb.reddit.crawl.errors import consequence, problem, too_deep
from kb.reddit.section import RedditSection

ROOT = "https://www.reddit.com"
OAUTH = "https://oauth.reddit.com"
LISTED = 100  # most things of a listing's page

_LONGEST_S = 86_400.0  # a window has 600 s


def _silent(text: str) -> None:
    """Says nothing."""


class Limiter:
    """Reddit's window as its headers announce it; stands in for prawcore's, whose sleep no signal
    ends.

    At the pace of a profile the window is never used up much before its end, which is waited for. A
    long wait means that somebody else uses the key as well: the run stops, or with --wait sleeps.
    """

    def __init__(self, pace: Pace, say: Callable[[str], None] = _silent) -> None:
        self._pace, self._say = pace, say
        self._until = 0.0

    def call(
        self,
        *,
        method: str,
        request_function: Any,
        set_header_callback: Any,
        url: str,
        **options: Any,
    ) -> requests.Response:
        """One signed request when there is room for it (prawcore's interface). Raises as `wait`."""
        self.wait()
        options["headers"] = set_header_callback()
        response: requests.Response = request_function(method, url, **options)
        self.heed(response.headers)
        return response

    def wait(self) -> None:
        """Wait for the pace, and for the window's end when it is used up. Raises Interrupted, and
        Blocked for a long wait.
        """
        self._pace.wait()
        self.refuse_long_wait()
        left = self._until - clock.monotonic()
        if left > 0:
            self._say(f"waiting {math.ceil(left)} s for Reddit's window")
        clock.sleep(left)

    def refuse_long_wait(self) -> None:
        """Raises Blocked where the window's end is too far to be waited for."""
        left = self._until - clock.monotonic()
        if left > PATIENCE_S:
            back = clock.now() + timedelta(seconds=math.ceil(left))
            raise Blocked(
                f"Reddit's rate limit is used up: it resets in {left:.0f} s,"
                f" at {clock.stamp(back)}",
                hint="run the same command then, or add --wait",
                after=left,
                until=back,
            )

    def heed(self, headers: Any) -> None:
        """Take in `x-ratelimit-*`; an answer without them, or with unreadable ones, changes
        nothing.
        """
        try:
            remaining, reset = (
                float(headers["x-ratelimit-remaining"]),
                float(headers["x-ratelimit-reset"]),
            )
        except (KeyError, ValueError):
            return
        if not (math.isfinite(remaining) and math.isfinite(reset)):
            return
        # Below one there is no room for a whole request (the header is a decimal). The seconds are
        # rounded down.
        self._until = (
            clock.monotonic() + min(max(reset, 0.0), _LONGEST_S) + 1 if remaining < 1 else 0.0
        )


class Client:
    """One connection to Reddit. Not for several threads: one request at a time keeps to the limit
    anyway.
    """

    def __init__(self, opened: Opened, section: RedditSection) -> None:
        """Raises MissingCredential before anything is sent."""
        settings = opened.run.settings
        settings.require(*REDDIT)
        self._id = settings.need("reddit_client_id")
        self._secret = settings.need("reddit_client_secret")
        self._settings = settings
        self._root = settings.kb_reddit_endpoint or ""
        self._hosts = {host_of(root) for root in ((self._root,) if self._root else (ROOT, OAUTH))}
        self._opened, self._tries = opened, section.max_tries
        public = not (self._root and is_loopback(self._root))
        pace = Pace(60 / section.requests_per_minute if public else 0)
        self._limiter = Limiter(pace, opened.run.progress.say)
        self._reddit: Any = None

    def get(self, path: str, params: dict[str, Any]) -> Any:
        """The JSON answer of a GET. Raises as `_ask`."""
        return self._attempt("GET", path, params, None)

    def post(self, path: str, data: dict[str, Any]) -> Any:
        """The JSON answer of a POST that only reads (morechildren). Raises as `_ask`."""
        return self._attempt("POST", path, None, data)

    def info(self, fullnames: list[str]) -> Any:
        """The Listing of up to 100 full names, posts and comments together; unknown ones are left
        out.
        """
        return self.get("api/info/", {"id": ",".join(fullnames), "raw_json": 1})

    def _attempt(self, *asked: Any) -> Any:
        return self._opened.attempt(Phase.service, partial(self._ask, *asked), self._tries)

    def _ask(
        self, method: str, path: str, params: dict[str, Any] | None, data: dict[str, Any] | None
    ) -> Any:
        """One try. Raises CredentialRefused, ItemFinal ("not_found", "forbidden" …), FatalError,
        Retryable, Blocked, Challenged.

        Through PRAW's core: its `request` turns an HTTP 400 into an exception without status.
        """
        reddit = self._connected()
        try:
            try:
                answer = reddit._core.request(method=method, path=path, params=params, data=data)
            except wrong.InvalidToken:
                # Tokens last a day at most; prawcore has dropped this one and gets another.
                answer = reddit._core.request(method=method, path=path, params=params, data=data)
        except RecursionError:
            raise too_deep(path) from None
        except wrong.PrawcoreException as error:
            follows = consequence(error, path)
            if isinstance(follows, Retryable):
                self._limiter.refuse_long_wait()  # it knows when to come back
            raise follows from None
        wrong_form = problem(path, answer)
        if wrong_form:
            raise Retryable(f"{wrong_form} at {path}")
        return answer

    def _connected(self) -> Any:
        if self._reddit is None:
            session = HttpSession(self._settings, hosts=self._hosts, ledger=self._row)
            self._reddit = _praw(self._id, self._secret or None, session, self._root, self._limiter)
        return self._reddit

    def _row(self, request: requests.PreparedRequest) -> Note:
        """The row of a request, by its path without ids; the token's own requests cost nothing of
        the window.
        """
        url = request.url or ""
        path = url.partition("?")[0].partition("://")[2].partition("/")[2]
        parts = [part for part in path.split("/") if part]
        endpoint = "/".join(parts[:1] if parts[:1] == ["comments"] else parts[:3]) or "/"
        if "access_token" in url:
            return self._opened.spend(Quota("token"), endpoint, 0)
        return self._opened.spend(Quota("requests"), endpoint)


def _praw(
    client_id: str, secret: str | None, session: HttpSession, root: str, limiter: Limiter
) -> Any:
    class Ours(Requestor):
        """Sends by our session."""

        def __init__(self, *, session: Any = None, **options: Any) -> None:
            super().__init__(**options, session=ours)

    class Once(FiniteRetryStrategy):
        """No retries of prawcore's own: they would pass the ledger's back."""

        def should_retry_on_failure(self) -> bool:
            return False

    ours = session
    ours.hooks["response"].append(_in_reddits_form)
    roots: dict[str, Any] = (
        {"reddit_url": root, "oauth_url": root, "short_url": root} if root else {}
    )
    reddit = praw.Reddit(
        client_id=client_id,
        client_secret=secret,
        user_agent=str(session.headers["User-Agent"]),
        requestor_class=Ours,
        check_for_updates=False,
        check_for_async=False,
        **roots,
    )
    reddit.read_only = True
    core: Any = reddit._core
    core._rate_limiter, core._retry_strategy_class = limiter, Once
    return reddit


def _in_reddits_form(response: requests.Response, *_: Any, **__: Any) -> None:
    """prawcore decides by these headers, and fails on answers that don't have them in Reddit's own
    form.
    """
    token = "access_token" in (response.url or "")
    if token and response.status_code == 200:
        _check_token(response)
    if response.status_code == 401 and not token:
        response.headers["www-authenticate"] = 'Bearer realm="reddit", error="invalid_token"'
    elif response.status_code == 403:
        response.headers.pop("www-authenticate", None)
    elif response.status_code in (301, 302):
        response.headers.setdefault("location", "")


def _check_token(response: requests.Response) -> None:
    """prawcore reads on whatever it got. An error that is a number is a status, also in an answer
    of status 200. Raises Retryable.
    """
    try:
        answer = response.json()
        error = answer.get("error")
        if str(error).isdecimal() and 400 <= int(error) < 600:
            response.status_code = int(error)
        valid = error or (
            isinstance(answer["access_token"], str)
            and isinstance(answer["scope"], str)
            and isinstance(answer["expires_in"], (int, float))
        )
    except (ValueError, KeyError, AttributeError, RecursionError):
        valid = False
    if not valid:
        raise Retryable("the token's answer is unreadable")


def question(run: Run, cost: QuestionCost) -> OnlineAnswer:
    """The subreddit's own page; the token before it is a request as well."""
    section = run.profile.section(RedditSection)
    name = section.subreddit
    try:
        with asking(run, cost) as opened:
            client = Client(opened, section.model_copy(update={"max_tries": 1}))
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
