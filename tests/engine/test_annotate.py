"""`kb annotate wiki` and `kb annotate reddit` as a user types them: every text is scored once,
and the filter finds it.
"""

import pytest

from kb.sandbox.world import World
from tests.conftest import needs
from tests.faults import Sandbox
from tests.wiki.handmade_data import many
from tests.youtube.job import Job

needs("torch", "detoxify")


@pytest.fixture(scope="module")
def sandbox():
    with Sandbox(World(n_channels=1, n_videos=1, n_posts=24, depth=8), services=["reddit"]) as held:
        yield held


@pytest.fixture(params=["wiki", "reddit"])
def crawled(request, sandbox, tmp_path):
    """(source, job): raw data of a source, nothing scored."""
    job = Job(sandbox, tmp_path, toxicity=True)
    if request.param == "wiki":
        many(job.root, 30)
    else:
        job.done("reddit", "crawl")
    return request.param, job


def test_each_text_is_scored_once(crawled):
    source, job = crawled
    first = job.done("annotate", source)
    assert first["scored"] == first["texts"] > 20
    assert first["model"] == "lorecrawl_tiny"
    scores = job.digests("annotations")
    assert {path.split("/")[0] for path in scores} == {source}
    again = job.done("annotate", source)
    assert (again["scored"], again["known"]) == (0, first["scored"])
    filtered = job.done(source, "filter")
    assert filtered["kept"] > 0
    assert "toxicity" not in filtered  # "not scored" otherwise
    assert job.digests("annotations") == scores
    table, column = {
        "wiki": ("wiki_pages", "toxicity"),
        "reddit": ("reddit_posts", "toxicity_title"),
    }[source]
    assert job.rows(f"SELECT count(*) n FROM clean.{table} WHERE {column} IS NULL") == [{"n": 0}]
