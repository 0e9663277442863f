"""A data root remembers its services, from their first answer on."""

from pathlib import Path

import pytest

from kb.artifacts import domain_binding
from kb.artifacts.domain_binding import bind_service
from kb.core.config.profile import load_profile
from kb.core.errors import DamagedData, OtherService
from kb.sandbox.world import World
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request, Segment
from tests.faults import Sandbox
from tests.youtube.job import Job


def answered(root: Path) -> None:
    segment = Segment(rawlog.folder(root, "wiki", "titles"))
    segment.append(rawlog.encode(Envelope("2026-11-20T12:00:00Z", Request("api", {}), 200, {})))
    segment.close()


def test_another_host_is_refused_once_there_is_an_answer(tmp_path: Path) -> None:
    bind_service(tmp_path, "wiki", wiki="http://wiki.example:8000/")
    answered(tmp_path)
    bind_service(tmp_path, "wiki", wiki="http://wiki.example:9000")  # ports aside
    for _ in range(2):
        with pytest.raises(
            OtherService, match=r"holds wiki data of wiki wiki\.example, not other\.example"
        ) as refused:
            bind_service(tmp_path, "wiki", wiki="http://other.example")
        assert refused.value.exit_code == 2


def test_a_mistyped_host_that_never_answered_is_forgotten(tmp_path: Path) -> None:
    bind_service(tmp_path, "wiki", wiki="http://wkii.example")
    Segment(rawlog.folder(tmp_path, "wiki", "titles"))  # a folder is no answer
    torn = rawlog.folder(tmp_path, "wiki", "titles") / "000001-00000000.ndjson.zst.open"
    torn.write_bytes(b"\x28\xb5")  # nor is one that was cut off
    bind_service(tmp_path, "wiki", wiki="http://wiki.example")
    answered(tmp_path)
    with pytest.raises(OtherService):
        bind_service(tmp_path, "wiki", wiki="http://wkii.example")


def test_a_crawl_of_a_dead_address_leaves_room_for_the_right_one(tmp_path: Path) -> None:
    with Sandbox(World(n_channels=9, n_videos=30), services=["youtube"]) as services:
        job = Job(services, tmp_path)
        words = ("youtube", "crawl", "--only", "channels")
        job.profile(("[youtube]\n", "[youtube]\nmax_tries = 1\n"))
        assert "no connection" in job.stopped(
            *words, code=4, KB_YOUTUBE_ENDPOINT="http://127.0.0.9:9"
        )
        job.done(*words)
        assert "holds youtube data" in job.stopped(
            *words, code=2, KB_YOUTUBE_ENDPOINT="http://127.0.0.9:9"
        )


def test_a_damaged_memory_is_said_and_not_taken_for_none(tmp_path: Path) -> None:
    domain_binding.note(tmp_path, load_profile("minecraft"))
    (tmp_path / "state" / "profile.json").write_text('{"name"')
    with pytest.raises(DamagedData, match=r"profile\.json can't be read"):
        domain_binding.remembered(tmp_path)
