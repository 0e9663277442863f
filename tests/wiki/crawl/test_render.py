"""What is stored as a page identifies itself as that page, and came to its end."""

import dataclasses
import io
import json

import pyarrow.parquet as pq
import pytest
from PIL import Image
from werkzeug.wrappers import Response

from kb.core.errors import Challenged, FatalError
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
