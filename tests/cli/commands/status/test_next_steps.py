"""Tests of the next steps that `kb status` names."""

from pathlib import Path
from typing import Any

from kb.core.summary import Summary, vocabulary
from kb.sandbox.server import Sandbox
from tests.contract.test_one_noun import MAIN, world
from tests.youtube.job import Job


def test_a_stopped_crawl_says_what_is_left_as_status_does(tmp_path: Path) -> None:
    with Sandbox(world()) as sandbox:
        job = Job(sandbox, tmp_path)
        for source, limit in (("youtube", "50"), ("reddit", "7")):
            stopped: dict[str, Any] = job.done(source, "crawl", "--limit", limit, code=3)
            about = job.done("status")["sources"][source]
            assert stopped["crawled"] == about["crawled_so_far"] == int(limit)
            assert stopped["left_by"] == about["left_by"] != {}
            assert stopped["left"] == about["left"] == sum(about["left_by"].values())
            assert stopped["pending"] == about["left_by"][MAIN[source]]
            left = f"left: {vocabulary.nouns(stopped['left_by'])}"
            assert left in Summary(stopped).line()
            text = job.kb("status").stdout
            assert left in text
            assert f"{limit} {MAIN[source]} crawled but not filtered yet" in text
            assert f"next: kb {source} crawl\n" in text
            rest = job.done(source, "crawl")
            assert rest["crawled_in_all"] == rest["crawled"] + int(limit)
            assert f"{rest['crawled_in_all']:,} in all" in Summary(rest).line()
