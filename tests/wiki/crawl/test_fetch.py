"""Tests of the requests for titles, pages and image files."""

from kb.wiki.crawl.connector import crawl
from tests.wiki.crawl.test_connector import faults, make_run, one_date, sandbox, tables  # noqa: F401  fixtures


def test_named_titles(make_run, tmp_path):  # noqa: F811
    names = tmp_path / "titles.txt"
    names.write_text("Rock salt\nlamp_buoy\nNo such page\nBad[title\n")
    run = make_run(tmp_path / "data")
    summary = crawl(run, names)
    assert (summary["crawled"], summary["missing"]) == (4, 2), "as the filter counts them"
    found = tables(run)
    assert {(row["key"], row["stage"], row["reason"]) for row in found["rejected"]} == {
        ("No such page", "missing", "missing"),
        ("Bad[title", "missing", "invalid"),
    }
    read = {row["title"] for row in found["pages"]}
    assert read == {"Lamp buoy", "Saltstone"}, "a named redirect leads to its target"


def test_maxlag_is_waited_for(make_run, faults, sandbox, tmp_path, hasty):  # noqa: F811
    names = tmp_path / "titles.txt"
    names.write_text("Fog\n")
    lag = {"error": {"code": "maxlag", "info": "Waiting for a database server", "lag": 6}}
    faults.add("titles=Fog", status=200, body=lag, headers={"Retry-After": "1"})
    run = make_run(tmp_path / "data")
    assert crawl(run, names)["crawled"] == 1
    assert all("maxlag=5" in seen.query for seen in sandbox.ledger.requests("/w/api.php")[-3:])
