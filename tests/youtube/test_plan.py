"""A plan sends nothing and costs what the crawl costs."""

from tests.youtube.crawl.test_fetch import CRAWL
from tests.youtube.job import Job


def test_a_plan_sends_nothing_and_is_what_the_crawl_costs(job: Job) -> None:
    job.done(*CRAWL, "--only", "channels")
    job.done(*CRAWL, "--only", "uploads")
    before = len(job.sandbox.ledger)
    plan = job.done(*CRAWL, "--plan")
    assert len(job.sandbox.ledger) == before
    used = job.sandbox.ledger.units()
    job.done(*CRAWL)
    assert plan["units"] == job.sandbox.ledger.units() - used
