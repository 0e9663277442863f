"""A crawl of a small wiki with pages and answers out of the ordinary: each counted, none asked
without end, nothing purged by mistake.
"""

import dataclasses
import json

import pyarrow.parquet as pq
import pytest
from werkzeug.wrappers import Response

from kb.core.config.pipeline import Recipe
from kb.core.errors import FatalError, NothingRead, SettingError
from kb.filters.filter_run import run_clean
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from kb.wiki.crawl.connector import crawl
from tests.artifacts.purged import purged
from tests.wiki.small_wiki import WORDS, SmallWiki

MOST = 3000  # pixels; a page of the default's 100,000 takes seconds to be pictured
TALL = f"<p>{WORDS}</p><div style='height:{MOST + 500}px'></div>"


@pytest.fixture
def wiki(stage):
    held = SmallWiki()
    held.url, stage.application = stage.url, held.application
    return held


@pytest.fixture
def run(wiki, run_on, tmp_path, monkeypatch):
    monkeypatch.setattr("kb.wiki.crawl.http_client.TRIES", 2)
    run = run_on(tmp_path / "data", wiki.url, wiki={"max_page_height": MOST}, workers=1)
    off = run.profile.toxicity.model_copy(update={"toxicity": "off"})
    return dataclasses.replace(run, profile=run.profile.model_copy(update={"toxicity": off}))


def filtered(run):
    """(summary, kept titles, verdict by key)."""
    summary = run_clean(run, "wiki")
    assert summary["crawled"] == sum(
        summary[name] for name in ("kept", "rejected", "failed", "pending")
    )
    found = {
        row["key"]: (row["stage"], row["reason"])
        for row in pq.read_table(run.root / "clean/wiki/rejected").to_pylist()
    }
    found |= {
        row["key"]: ("failed", row["reason"])
        for row in pq.read_table(run.root / "clean/wiki/failed").to_pylist()
    }
    return summary, sorted(pq.read_table(run.root / "clean/wiki/pages")["title"].to_pylist()), found


def test_every_line_of_a_file_of_titles_is_counted(wiki, run, tmp_path):
    for key, title in enumerate(("Alpha", "Beta", "Gamma", "Delta", "Lost"), 1):
        wiki.add(key, title)
    wiki.add(9, "Redir", redirect=True)
    names = tmp_path / "titles.txt"
    names.write_text(
        "\ufeffAlpha\nbeta\nGamma|Delta\nwp:Foo\nRedir\nNope\nLost\n\n#"
        f" note\n{wiki.url}/wiki/Delta\n"
    )

    def without_lost(request):
        answer = wiki.api(request) if "titles" in request.args else None
        if answer:
            answer["query"]["pages"] = [
                page for page in answer["query"]["pages"] if page["title"] != "Lost"
            ]
        return answer

    wiki.hook = without_lost
    summary = crawl(run, names)
    counted = ("crawled", "failed", "missing", "bad_lines", "pending")
    assert {name: summary[name] for name in counted} == {
        "crawled": 6, "failed": 1, "missing": 3, "bad_lines": 1, "pending": 0,
    }  # fmt: skip
    found, kept, odd = filtered(run)
    assert (kept, found["unknown_keys"]) == (["Alpha", "Beta", "Delta"], {})
    absent = {
        "wp:Foo": ("missing", "interwiki"),
        "Redir": ("missing", "redirect"),
        "Nope": ("missing", "missing"),
    }
    assert odd == {**absent, "Lost": ("failed", "unanswered")}
    wiki.hook = lambda request: None
    assert crawl(run, names)["failed"] == 0
    assert filtered(run)[1:] == (["Alpha", "Beta", "Delta", "Lost"], absent)
    assert crawl(run, names)["requests"] == 0
    # A page that became a redirect, or was deleted, leaves the tables; its title is no row either.
    wiki.pages[1] |= {"redirect": True, "revid": 77}
    del wiki.pages[2]
    crawl(dataclasses.replace(run, again=True), names)
    summary, kept, odd = filtered(run)
    assert kept == ["Delta", "Lost"]
    assert odd == absent | {"Beta": ("missing", "missing")}
    assert tombstones.keys(run.root, "wiki") == {"1", "2"}


def test_what_became_a_redirect_is_found_by_its_id_and_is_no_row(wiki, run):
    for key, title in enumerate(("Alpha", "Beta"), 1):
        wiki.add(key, title)
    crawl(run)
    wiki.pages[1] |= {"redirect": True, "revid": 77}
    assert crawl(dataclasses.replace(run, again=True))["gone"] == 1
    assert filtered(run)[1:] == (["Beta"], {})
    # An answer that is none is no fact: not in a new round, and not for a purge after it.
    wiki.hook = lambda request: (
        {"batchcomplete": True} if request.args.get("list") or "pageids" in request.args else None
    )
    with pytest.raises(NothingRead, match="none of 1 parts of the list"):
        crawl(dataclasses.replace(run, again=True))
    wiki.hook = lambda request: {"query": {"allpages": []}} if request.args.get("list") else None
    odd = {"query": {"pages": [{"pageid": 2, "ns": 0, "title": "Beta"}]}}
    wiki.hook = lambda request: (
        {"query": {"allpages": []}}
        if request.args.get("list")
        else odd
        if "pageids" in request.args
        else None
    )
    crawl(dataclasses.replace(run, again=True))
    assert Recipe("purge").defined("purge")(run, "wiki", None)["also"] == 1
    assert filtered(run)[1:] == (["Beta"], {})


def test_a_page_that_will_not_be_shown_is_final(wiki, run):
    wiki.add(1, "Alpha")
    wiki.add(7, "Tall", TALL)
    wiki.add(8, "Gone from the shelf")
    wiki.add(9, "Barred")
    wiki.robots = "User-agent: *\nDisallow: /wiki/Barred\n"
    broken = "/wiki/Gone_from_the_shelf"
    wiki.hook = lambda request: wiki._page("No such") if request.path == broken else None
    summary = crawl(run)
    counted = ("crawled", "rejected", "failed", "robots", "gone")
    assert {name: summary[name] for name in counted} == {
        "crawled": 4, "rejected": 2, "failed": 0, "robots": 1, "gone": 0,
    }  # fmt: skip
    verdicts = {
        "7": ("render", "too_tall"),
        "8": ("render", "http_404"),
        "9": ("robots", "disallowed"),
    }
    assert filtered(run)[2] == verdicts
    assert crawl(run)["requests"] == 0
    wiki.shown()
    # A new round tries what may have changed; the tall page has not.
    wiki.hook = lambda request: None
    crawl(dataclasses.replace(run, again=True))
    assert wiki.shown() == ["Gone_from_the_shelf"]
    # A profile that allows more shows it at once, a new revision in the next round.
    higher = run.profile.model_copy(
        update={"wiki": run.profile.wiki.model_copy(update={"max_page_height": MOST + 1000})}
    )
    assert crawl(dataclasses.replace(run, profile=higher))["rejected"] == 0
    assert wiki.shown() == ["Tall"]
    wiki.pages[7] |= {"html": f"<p>{WORDS}</p>", "revid": 71}
    crawl(dataclasses.replace(run, again=True))
    assert wiki.shown() == ["Tall"]
    assert filtered(run)[1:] == (
        ["Alpha", "Gone from the shelf", "Tall"],
        {"9": ("robots", "disallowed")},
    )


def test_purge_counts_what_it_knows(wiki, run, tmp_path):
    for key, title in enumerate(("Alpha", "Beta", "Gamma", "Zeta", "Eps"), 1):
        wiki.add(key, title)
    names = tmp_path / "titles.txt"
    names.write_text("alpha\nBeta\nGamma\nZeta\nEps\nNope\n")
    crawl(run, names)
    ids = tmp_path / "data.json"
    purge = Recipe("purge").defined("purge")
    ids.write_text(
        "\ufeff"
        + json.dumps([{"metadata": {"title": "Alpha", "url": f"{wiki.url}/wiki/Alpha"}}], indent=1)
    )
    summary = purge(run, "wiki", ids)
    assert {name: summary[name] for name in ("purged", "unknown", "bad_lines")} == {
        "purged": 1,
        "unknown": 0,
        "bad_lines": 0,
    }
    assert filtered(run)[1] == ["Beta", "Eps", "Gamma", "Zeta"]
    raw = [
        rawlog.encode(envelope).lower()
        for kind in rawlog.kinds(run.root, "wiki")
        for envelope in rawlog.envelopes(run.root, "wiki", kind)
    ]
    assert not [line for line in raw if b"alpha" in line]  # the way it was asked for, too
    lines = tmp_path / "ids.txt"
    lines.write_text("\ufeffbeta\n5\nNope\nNever heard of\n{\n\x00\nA|B\n")
    summary = purge(run, "wiki", lines)
    assert {name: summary[name] for name in ("purged", "unknown", "bad_lines")} == {
        "purged": 3,
        "unknown": 1,
        "bad_lines": 3,
    }
    assert tombstones.keys(run.root, "wiki") == {"1", "2", "5", "Nope", "Never heard of"}
    assert filtered(run)[1:] == (["Gamma", "Zeta"], {})
    for text in ("{", '{"a": '):
        ids.write_text(text)
        with pytest.raises(SettingError, match="can't be read"):
            purge(run, "wiki", ids)
    assert len(tombstones.keys(run.root, "wiki")) == 5
    # A plan says the same, whatever a page was named by; a crawl since brings nothing back.
    crawl(dataclasses.replace(run, again=True))
    lines = (f"{wiki.url}/wiki/Gamma", "Alpha", "1", "5", "Nope", "Never seen", "A|B")
    assert purged(run, "wiki", *lines) == (1, 0, 3, 1, 1)
    assert purged(run, "wiki", *lines) == (0, 0, 5, 0, 1)
    assert filtered(run)[1] == ["Zeta"]


@pytest.mark.parametrize(
    "before", ["\ufeff", "<br />\n<b>Notice</b>: Undefined index in <b>/w/X.php</b><br />\n"]
)
def test_what_stands_before_the_apis_answers_is_left_out(wiki, run, before):
    wiki.add(1, "Alpha")

    def answer(request):
        if request.path != "/w/api.php":
            return None
        text = before + json.dumps(wiki.api(request))
        return Response(text, content_type="application/json; charset=utf-8")

    wiki.hook = answer
    assert crawl(run)["crawled"] == 1
    assert filtered(run)[1] == ["Alpha"]


def test_an_api_of_before_2015_is_one_line_with_the_reason(wiki, run):
    wiki.add(1, "Alpha")
    wiki.hook = lambda request: (
        {"query": {"pages": {"1": {"pageid": 1, "ns": 0, "title": "Alpha"}}}}
        if "titles" in request.args
        else None
    )
    with pytest.raises(FatalError, match=r"MediaWiki before 1\.25"):
        crawl(run)


def test_a_page_with_pending_changes_is_rendered_once_for_each_revision(wiki, run):
    """The wiki lists the newest revision and shows an older one until the edit is reviewed."""
    again = dataclasses.replace(run, again=True)
    wiki.add(1, "Kiln", revision=12, touched="2024-01-02T00:00:00Z")
    shown = {"revid": 10}
    told = wiki._told

    def page_of(request):
        if "revids" in request.args:
            page = told(1, {**wiki.pages[1], **shown}, request.host_url.rstrip("/"))
            return {"query": {"pages": [page]}}
        if request.path != "/wiki/Kiln":
            return None
        conf = f'RLCONF={{"wgArticleId":1,"wgRevisionId":{shown["revid"]}}}'
        return Response(
            f"<!DOCTYPE html><script>{conf};</script><div id=content>{WORDS}</div></html>",
            content_type="text/html",
        )

    wiki.hook = page_of
    wiki._told = lambda key, page, root: {**told(key, page, root), "touched": page["touched"]}
    crawl(run)
    assert wiki.shown() == ["Kiln"]
    for _ in range(2):
        crawl(again)
        assert wiki.shown() == []
        assert run_clean(run, "wiki")["kept"] == 1
    wiki.pages[1]["revid"] = 13  # another edit that waits
    crawl(again)
    assert wiki.shown() == ["Kiln"]
    wiki.pages[1]["touched"], shown["revid"] = "2024-01-03T00:00:00Z", 13  # both are accepted
    crawl(again)
    assert wiki.shown() == ["Kiln"]
    crawl(again)
    assert wiki.shown() == []
    run_clean(run, "wiki")
    (path,) = (run.root / "clean/wiki/pages").glob("*.parquet")
    assert pq.read_table(path)["revision_id"].to_pylist() == [13]


def test_a_page_without_revisions_fails_once_however_often_it_is_asked_for(wiki, run):
    wiki.add(1, "Kiln")
    wiki.add(2, "Broken")
    told = wiki._told

    def bare(key, page, root):
        return {k: v for k, v in told(key, page, root).items() if key == 1 or k != "revisions"}

    wiki._told = bare
    assert [crawl(run)["failed"]] == [1]
    for _ in range(2):
        assert crawl(dataclasses.replace(run, again=True))["failed"] == 1
    assert run_clean(run, "wiki")["failed"] == 1
