"""The web application: routes, security headers, and errors as pages.

A page is asked for with GET and made from the tables as they are. Another Host than this machine is
refused, so that no web site can reach the pages through a name of its own (DNS rebinding), and the
content security policy lets no script run but the one in static/. The only page that takes answers
is Judge (kb.explore.judge), and only from itself.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from hmac import compare_digest
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from kb.core import terminal
from kb.core.config.profile import Profile
from kb.core.errors import DamagedData, FatalError, KbError, UsageError
from kb.core.progress import span
from kb.core.templates import environment
from kb.explore import clip, documents, judge, overview, pairs, rows, search, thresholds
from kb.explore.judge import JudgeDesk
from kb.explore.tables import CurrentTables
from kb.labels.sample import PLAYER
from kb.look.charts import number
from kb.mcp.documents import Readers
from kb.store.state import demo_mark
from kb.store.state.run_records import kept, made_in_words

HOST = "127.0.0.1"
_HOSTS = [HOST, "localhost"]  # with any port
_HERE = Path(__file__).parent
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self';"
    " form-action 'self'; base-uri 'none'"
)
_HEADERS = {
    "content-security-policy": f"{_POLICY}; frame-ancestors 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cache-control": "no-store",
}
# Judge shows the page of a clip within it. A form says its origin where it may refer to its page.
_OF_JUDGE = {
    "content-security-policy": f"{_POLICY}; frame-src 'self'; frame-ancestors 'none'",
    "referrer-policy": "same-origin",
}
# The service's player wants to know which site shows it.
_OF_CLIP = {
    "content-security-policy": f"{_POLICY}; media-src 'self'; frame-src {PLAYER};"
    " frame-ancestors 'self'",
    "referrer-policy": "strict-origin-when-cross-origin",
}
_OF_PICTURE = {"content-security-policy": "default-src 'none'; style-src 'unsafe-inline'"}
_LARGEST = 100_000  # bytes of a form


def clock_time(seconds: float) -> str:
    """1:23, or 1:02:03 from an hour on."""
    minutes, second = divmod(int(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"


_FILTERS: dict[str, Callable[[Any], str]] = {
    "commas": lambda n: f"{n:,}",
    "percent": lambda share: f"{share:.1%}",
    "number": lambda n: f"{n:,.0f}" if n == int(n) else f"{n:,.6g}",
    "short": number,
    "moment": lambda at: f"{at[:10]} {at[11:16]}" if at else "never",
    "seconds": clock_time,
    "span": span,
    "size": terminal.size,
}


PAGES = {
    "/": "Overview",
    "/search": "Search",
    "/rows": "Rows",
    "/thresholds": "Thresholds",
    "/pairs": "Pairs",
    "/judge": "Judge",
    "/status": "Status",
    "/runs": "Runs",
}

Page = Callable[[Path, Mapping[str, str]], Any]
Instead = Callable[[Mapping[str, str], KbError], Any]


def make(
    root: Path,
    profile: Profile,
    about: Callable[[], Mapping[str, Any]],
    readers: Readers,
    graph: Callable[[], bytes],
    desk: JudgeDesk | None = None,
) -> Starlette:
    """The application over a data root or a release; `profile` has its thresholds, `about` returns
    what `kb status` knows, `readers` read the documents of sources, `graph` draws what is made of
    what as SVG, and whoever sits at the `desk` may judge.
    """
    templates = environment(_HERE / "templates", _FILTERS, autoescape=True)
    language = profile.language
    style = resources.files("kb.look").joinpath("style.css").read_bytes()
    # Of a stranger's release: a link leads to the web, never to a script.
    templates.tests["web"] = re.compile("https?://", re.IGNORECASE).match

    def html(name: str, status: int = 200, **values: Any) -> HTMLResponse:
        text = templates.get_template(f"{name}.html.jinja").render(
            **values, root=str(root), nav=PAGES, notes=demo_mark.note(root)
        )
        return HTMLResponse(text, status)

    def page(
        name: str, read: Page, instead: Instead | None = None, headers: Mapping[str, str] = {}
    ) -> Callable[[Request], Response]:
        """`instead`: the data of the same page when `read` raises."""

        def answer(request: Request) -> Response:
            path, query, status = request.url.path, request.query_params, 200
            try:
                data = _read(read, root, query)
            except KbError as error:
                if instead is None:
                    raise
                data, status = instead(query, error), status_of(error)
            shown = html(name, status, path=path, page=data)
            shown.headers.update(headers)
            return shown

        return answer

    def picture(request: Request) -> Response:
        return Response(
            documents.screenshot(root, request.query_params, readers), media_type="image/png"
        )

    def judging() -> JudgeDesk:
        if desk is None:
            raise HTTPException(403, "Nobody judges here: start `kb explore --judge NAME`.")
        return desk

    async def answered(request: Request) -> Response:
        body = b""
        if judging() and request.headers.get("origin") == f"http://{request.headers.get('host')}":
            async for part in request.stream():
                body += part
                if len(body) > _LARGEST:
                    raise HTTPException(413)
        given = dict(parse_qsl(body.decode("utf-8", "replace"), keep_blank_values=True))
        if not compare_digest(given.get("token", "").encode(), judging().token.encode()):
            raise HTTPException(403, "Only the page Judge itself may answer: load it again.")
        address = await run_in_threadpool(judge.answered, judging(), given)
        return RedirectResponse(address, 303)

    def film(request: Request) -> Response:
        path, why = clip.film_of(judging(), request.query_params.get("video", ""))
        if path is None:
            raise HTTPException(404, why)
        return FileResponse(path)

    def frames(request: Request) -> Response:
        return Response(clip.frames_png(judging(), request.query_params), media_type="image/png")

    def problem(request: Request, error: Exception) -> Response:
        what = error.detail if isinstance(error, HTTPException) else str(error)
        hint = getattr(error, "hint", "")
        headers = getattr(error, "headers", None)
        answer = html("error", status_of(error), path=request.url.path, what=what, hint=hint)
        answer.headers.update(headers or {})
        return answer

    return Starlette(
        routes=[
            Route("/", page("overview", lambda at, _: overview.read(CurrentTables(at), about()))),
            Route(
                "/search",
                page("search", lambda at, q: search.read(at, profile, q), search.without_answers),
            ),
            Route(
                "/document",
                page("document", lambda at, q: documents.read(at, language, q, readers)),
            ),
            Route("/screenshot", picture),
            Route("/rows", page("rows", lambda at, q: rows.read(CurrentTables(at), rows.parse(q)))),
            Route(
                "/thresholds",
                page("thresholds", lambda at, q: thresholds.read(CurrentTables(at), profile, q)),
            ),
            Route("/status", page("status", lambda _, __: about())),
            Route(
                "/graph.svg",
                lambda _: Response(graph(), media_type="image/svg+xml", headers=_OF_PICTURE),
            ),
            Route(
                "/runs", page("runs", lambda at, _: [(run, made_in_words(run)) for run in kept(at)])
            ),
            Route(
                "/pairs", page("pairs", lambda at, q: pairs.read(CurrentTables(at), language, q))
            ),
            Route(
                "/judge",
                page(
                    "judge",
                    lambda _, q: judge.read(desk, q),
                    headers=_OF_JUDGE,
                ),
            ),
            Route("/judge", answered, methods=["POST"]),
            Route("/clip", page("clip", lambda _, q: clip.read(judging(), q), headers=_OF_CLIP)),
            Route("/film", film),
            Route("/frames", frames),
            Route("/static/style.css", lambda _: Response(style, media_type="text/css")),
            Route("/favicon.ico", lambda _: RedirectResponse("/static/icon.svg")),
            Mount("/static", StaticFiles(directory=_HERE / "static")),
        ],
        middleware=[
            Middleware(_SecurityHeaders),
            Middleware(TrustedHostMiddleware, allowed_hosts=_HOSTS, www_redirect=False),
        ],
        exception_handlers={KbError: problem, HTTPException: problem},
    )


def _read(read: Page, root: Path, query: Mapping[str, str]) -> Any:
    """A page's data. A command may have replaced files after they were listed: then read again."""
    try:
        return read(root, query)
    except (DamagedData, FileNotFoundError):
        pass
    try:
        return read(root, query)
    except FileNotFoundError as error:
        message = f"{error.filename or root} was replaced while this page was made"
        raise FatalError(message, hint="load it again") from None


def status_of(error: Exception) -> int:
    """The HTTP status of a page that an error is shown on."""
    known: int | None = getattr(error, "status_code", None)
    return known or (400 if isinstance(error, UsageError) else 500)


class _SecurityHeaders:
    """Adds the headers to every answer, also to refusals; those that a page sets count."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in message["headers"]}
                added = [(name.encode(), value.encode()) for name, value in _HEADERS.items()]
                message["headers"] += [line for line in added if line[0] not in own]
            await send(message)

        await self._app(scope, receive, with_headers)
