"""What is stored as a page identifies itself as that page, and came to its end."""

import dataclasses
import io
import itertools
import json

import pyarrow.parquet as pq
import pytest
from PIL import Image
from werkzeug.wrappers import Response

from kb.core.errors import Challenged, FatalError, LimitReached
from kb.filters.filter_run import run_clean
from kb.wiki.crawl.connector import crawl
from tests.wiki.small_wiki import WORDS, SmallWiki

CHALLENGE = (
    "<!DOCTYPE html><html><head><title>Making sure you're not a bot!</title>"
    "<meta name=robots content='noindex,nofollow'></head>"
    f"<body><main><h1>Checking</h1><p>{WORDS}</p></main></body></html>"
)
AS_HTML = "text/html; charset=utf-8"


@pytest.fixture
def wiki(stage):
    held = SmallWiki()
    held.url, stage.application = stage.url, held.application
    for key, title in enumerate(("Alpha", "Beta", "Gamma"), 1):
        held.add(key, title)
    return held


@pytest.fixture
def run(wiki, run_on, tmp_path, monkeypatch):
    monkeypatch.setattr("kb.wiki.crawl.http_client.TRIES", 2)
    run = run_on(tmp_path / "data", wiki.url, wiki={"max_tries": 2}, workers=1)
    off = run.profile.toxicity.model_copy(update={"toxicity": "off"})
    return dataclasses.replace(run, profile=run.profile.model_copy(update={"toxicity": off}))


def challenges(*paths):
    """A hook that answers these paths with a challenge page."""
    return lambda request: (
        Response(CHALLENGE, content_type=AS_HTML) if request.path in paths else None
    )


def verdicts(run):
    """(kept titles, stage and reason by key of the others, the stage of those that failed being
    "failed").
    """
    run_clean(run, "wiki")
    kept = pq.read_table(run.root / "clean/wiki/pages")["title"].to_pylist()
    rows = pq.read_table(run.root / "clean/wiki/rejected").to_pylist()
    rows += pq.read_table(run.root / "clean/wiki/failed").to_pylist()
    return sorted(kept), {row["key"]: (row.get("stage", "failed"), row["reason"]) for row in rows}


def test_a_page_that_is_always_challenged_is_never_stored(wiki, run):
    wiki.hook = challenges("/wiki/Beta")
    summary = crawl(run)
    assert (summary["crawled"], summary["failed"]) == (2, 1)
    assert wiki.asked.count("/wiki/Beta") == run.profile.wiki.max_tries
    assert verdicts(run) == (["Alpha", "Gamma"], {"2": ("failed", "challenge")})
    wiki.hook = lambda request: None
    assert crawl(run)["crawled"] == 1
    assert verdicts(run) == (["Alpha", "Beta", "Gamma"], {})


def test_a_wiki_that_challenges_the_browser_blocks_us(wiki, run):
    """Its API and its front page may still answer a plain client."""
    wiki.hook = lambda request: (
        Response(CHALLENGE, content_type=AS_HTML)
        if request.headers.get("Sec-Fetch-Dest") == "document"
        else None
    )
    with pytest.raises(Challenged) as error:
        crawl(run)
    assert error.value.exit_code == 4
    assert wiki.shown()[:2] == ["Alpha"] * run.profile.wiki.max_tries
    assert verdicts(run) == ([], {})
    wiki.hook = lambda request: None
    assert crawl(run)["crawled"] == 3


def test_pages_that_are_all_challenged_block_us_whatever_the_front_page_shows(wiki, run):
    wiki.hook = challenges(*(f"/wiki/{page['title']}" for page in wiki.pages.values()))
    with pytest.raises(Challenged):
        crawl(run)
    assert verdicts(run) == ([], {})


def test_a_front_page_that_is_a_challenge_blocks_us(wiki, run):
    wiki.hook = challenges("/")
    with pytest.raises(Challenged):
        crawl(run)
    wait = Response("<html><title>Please wait</title></html>", content_type=AS_HTML)
    wiki.hook = lambda request: wait
    with pytest.raises(Challenged):
        crawl(run)
    shop = Response("<!DOCTYPE html><p>Welcome to our shop.</p>", content_type=AS_HTML)
    wiki.hook = lambda request: shop if request.path == "/" else None
    with pytest.raises(FatalError):
        crawl(run)
    wiki.hook = lambda request: None
    crawl(run)
    # What was this wiki before is not taken for another site.
    wiki.hook = lambda request: shop if request.path == "/" else None
    with pytest.raises(Challenged):
        crawl(dataclasses.replace(run, again=True))


def test_an_api_that_answers_with_challenges_blocks_us(wiki, run):
    wiki.hook = challenges("/w/api.php")
    with pytest.raises(Challenged):
        crawl(run)
    wiki.hook = lambda request: None
    assert crawl(run)["crawled"] == 3


@pytest.mark.parametrize("header", ["cf-mitigated", "x-amzn-waf-action"])
def test_a_challenge_that_its_header_names_blocks_us(wiki, run, header):
    wiki.hook = lambda request: (
        Response("Just a moment", 403, {header: "challenge"})
        if request.path == "/w/api.php"
        else None
    )
    with pytest.raises(Challenged):
        crawl(run)
    assert wiki.asked.count("/w/api.php") == 1


LOG_IN = f"<script>RLCONF={{'wgArticleId':0,'wgRevisionId':0}}</script><p>{WORDS}</p></html>"


@pytest.mark.parametrize(
    "turned_away",
    [
        *(
            Response(f"<p>{status}", status, content_type=AS_HTML)
            for status in (402, 404, 405, 418)
        ),
        *(Response("", status) for status in (403, 406)),
        Response("", 302, {"Location": "http://127.0.0.1:9/consent"}),
        Response(LOG_IN, content_type=AS_HTML),
    ],
    ids=lambda answer: f"{answer.status_code}{'' if answer.get_data() else ' without a body'}",
)
def test_a_crawl_that_is_turned_away_midway_costs_no_page(wiki, run, turned_away):
    for key in range(4, 7):
        wiki.add(key, f"Page {key}")
    away = []
    wiki.hook = lambda request: turned_away if away and request.path.startswith("/wiki/") else None
    with pytest.raises(LimitReached):
        crawl(dataclasses.replace(run, limit=1))
    away.append(True)
    wiki.shown()
    with pytest.raises(Challenged, match="turns the crawl away") as error:
        crawl(run)
    assert (error.value.exit_code, error.value.summary["pending"]) == (4, 5)
    assert len(wiki.shown()) <= 5
    assert verdicts(run) == (["Alpha"], {})
    wiki.hook = lambda request: None
    assert crawl(run)["crawled"] == 5


def test_few_pages_are_asked_for_where_pages_alone_are_refused(wiki, run):
    for key in range(4, 20):
        wiki.add(key, f"Page {key}")
    wiki.hook = lambda request: Response("", 403) if request.path.startswith("/wiki/") else None
    with pytest.raises(Challenged):
        crawl(dataclasses.replace(run, workers=4))
    assert len(wiki.shown()) <= 5
    assert verdicts(run) == ([], {})


@pytest.mark.parametrize(
    ("status", "verdict"), [(410, "render"), (404, "render"), (403, "failed"), (418, "failed")]
)
def test_a_status_is_about_a_page_while_others_are_shown(wiki, run, status, verdict):
    wiki.hook = lambda request: Response("", status) if request.path == "/wiki/Beta" else None
    assert crawl(run)["pending"] == 0
    assert verdicts(run) == (["Alpha", "Gamma"], {"2": (verdict, f"http_{status}")})


@pytest.mark.parametrize("status", [402, 404, 405, 418])
def test_an_api_that_turns_us_away_midway_is_no_other_site(wiki, run, status):
    crawl(run)
    wiki.hook = lambda request: Response("", status) if request.path == "/w/api.php" else None
    with pytest.raises(Challenged, match=f"http_{status}"):
        crawl(dataclasses.replace(run, again=True))
    # An address that has never answered is a wrong one, unless it says that it turns us away.
    kind = FatalError if status == 404 else Challenged
    with pytest.raises(kind):
        crawl(dataclasses.replace(run, root=run.root.with_name("fresh")))


@pytest.mark.parametrize("shown", [{"wgArticleId": 1, "wgRevisionId": 10}, {"wgArticleId": 0}])
def test_another_page_is_not_stored_as_the_page_asked_for(wiki, run, shown):
    conf = f"<script>RLCONF={json.dumps({'wgRevisionId': 0, **shown})}</script>"
    other = Response(f"{conf}<div id=content><p>{WORDS}</p></div></html>", content_type=AS_HTML)
    wiki.hook = lambda request: other if request.path == "/wiki/Beta" else None
    crawl(run)
    assert verdicts(run) == (["Alpha", "Gamma"], {"2": ("render", "other_page")})


@pytest.mark.parametrize("honest", [False, True])
def test_a_document_that_was_cut_off_is_read_again(wiki, run, honest):
    """By the network's account, or by its end that is missing."""
    wiki.pages[2]["html"] = f"<p>{WORDS}</p>" * 20 + "<p>The end of it.</p>"
    cut = []

    def hook(request):
        if request.path != "/wiki/Beta" or cut:
            return None
        body = wiki._page("Beta").get_data()
        half = body[: len(body) // 2]
        answer = Response(half, content_type=AS_HTML)
        answer.headers["Content-Length"] = str(len(half) if honest else len(body))
        answer.automatically_set_content_length = False
        cut.append(request.path)
        return answer

    wiki.hook = hook
    assert crawl(run)["failed"] == 0
    assert wiki.shown().count("Beta") == 2
    assert verdicts(run) == (["Alpha", "Beta", "Gamma"], {})
    texts = pq.read_table(run.root / "clean/wiki/elements", columns=["text"])["text"].to_pylist()
    assert "The end of it." in texts


# A page that grows by what a picture of it needs: a window as high as the page.
GROWS = (
    "<div style=height:3000px></div><script>addEventListener('resize', () => document.body.append("
    "Object.assign(document.createElement('div'), {style: 'height:700px'})), {once: true})</script>"
)


def test_a_page_that_moves_is_shown_alone_after_the_others(wiki, run):
    wiki.pages[1]["html"] += GROWS
    tries = run.profile.wiki.max_tries
    summary = crawl(run)
    assert (summary["crawled"], summary["failed"]) == (3, 0)
    assert wiki.shown() == ["Alpha"] * tries + ["Beta", "Gamma", "Alpha"]
    assert verdicts(run) == (["Alpha", "Beta", "Gamma"], {})


def test_a_page_that_never_stands_still_has_failed(wiki, run):
    wiki.pages[1]["html"] += GROWS.replace("{once: true}", "{}")
    assert crawl(run)["failed"] == 1
    assert verdicts(run) == (["Beta", "Gamma"], {"1": ("failed", "page_moved")})


@pytest.mark.parametrize("away", [Response("", 402), Response(CHALLENGE, content_type=AS_HTML)])
def test_images_that_are_refused_midway_stay_pending(wiki, run, away):
    made = io.BytesIO()
    Image.new("RGB", (9, 9), (1, 2, 3)).save(made, "PNG")
    dot = Response(made.getvalue(), content_type="image/png")
    wiki.pages[1]["html"] += "".join(f"<img src=/images/{n}.png>" for n in range(9))
    plain = itertools.count()
    wiki.hook = lambda request: (
        (dot if request.headers.get("Sec-Fetch-Dest") == "image" or next(plain) < 3 else away)
        if request.path.startswith("/images/")
        else None
    )
    with pytest.raises(Challenged):
        crawl(run)
    wiki.hook = lambda request: dot if request.path.startswith("/images/") else None
    summary = crawl(run)
    assert (summary["images"], summary["images_failed"]) == (9, 0)


def test_a_page_in_the_place_of_an_image_says_nothing_about_the_image(wiki, run):
    made = io.BytesIO()
    Image.new("RGB", (9, 9), (1, 2, 3)).save(made, "PNG")
    dot = Response(made.getvalue(), content_type="image/png")
    wiki.pages[1]["html"] += "<img src=/images/dot.png>"
    browser = lambda request: request.headers.get("Sec-Fetch-Dest") == "image"  # noqa: E731
    challenged = Response(CHALLENGE, content_type=AS_HTML)
    wiki.hook = lambda request: (
        (dot if browser(request) else challenged) if request.path == "/images/dot.png" else None
    )
    assert crawl(run)["images_failed"] == 1
    wiki.hook = lambda request: dot if request.path == "/images/dot.png" else None
    summary = crawl(run)
    assert (summary["images"], summary["images_failed"]) == (1, 0)
