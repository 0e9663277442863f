"""The sandbox's Reddit for people: what a permalink opens, a post or one of its comments."""

from __future__ import annotations

import re
from html import escape

from werkzeug.wrappers import Response

from kb.sandbox.reddit.subreddit import Subreddit

_PERMALINK = re.compile(r"r/(\w+)/comments/(\w+)(?:/([^/]*)(?:/(\w+))?)?")


def permalink(subreddit: Subreddit, path: str) -> Response | None:
    """The page under a permalink; None for another path, and 404 for what is not there."""
    match = _PERMALINK.fullmatch(path)
    if match is None:
        return None
    name, post, _, comment = match.groups()
    above = subreddit.shown(f"t3_{post}")
    below = subreddit.shown(f"t1_{comment}") if comment else None
    elsewhere = below is not None and below["link_id"] != f"t3_{post}"
    lost = above is None or (comment and below is None) or elsewhere
    if above is None or lost or name.lower() != subreddit.name.lower():
        return Response("<!DOCTYPE html><title>page not found</title>", 404, mimetype="text/html")
    text = f"<h1>{escape(above['title'])}</h1>\n<p>{escape(above['selftext'])}</p>"
    parts = [f'<article id="t3_{post}">{text}</article>']
    if below is not None:
        parts.append(f'<article id="t1_{comment}"><p>{escape(below["body"])}</p></article>')
    page = "\n".join(["<!DOCTYPE html>", f"<title>{escape(above['title'])}</title>", *parts])
    return Response(page.encode("utf-8", "replace"), mimetype="text/html")
