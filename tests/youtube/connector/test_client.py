"""The services below other addresses."""

from pathlib import Path
from typing import Any

from kb.sandbox.server import Sandbox, Server
from kb.sandbox.world import World
from kb.sandbox.youtube import service
from tests.youtube.connector.test_fetch import CRAWL, check
from tests.youtube.job import Job


def test_the_site_below_a_path(tmp_path: Path) -> None:
    """Game labels and sizes come from pages whose address begins with the root's own path."""
    sandbox = Sandbox(World(n_channels=9, n_videos=30), services=["youtube"])
    inner = service.app(sandbox.world, sandbox.faults)

    def below(environ: dict[str, Any], start: Any) -> Any:
        path = environ["PATH_INFO"]
        return inner(
            environ
            | {
                "PATH_INFO": path.removeprefix("/mirror/yt")
                if path.startswith("/mirror/yt/")
                else "/nowhere"
            },
            start,
        )

    sandbox.servers["youtube"] = Server(below)
    with sandbox:
        root = f"{sandbox.servers['youtube'].url}/mirror/yt"
        job = Job(sandbox, tmp_path, KB_YOUTUBE_ENDPOINT=root, KB_YOUTUBE_WEB=root)
        job.done(*CRAWL)
        check(job)
        found = [one["response"]["player"] for one in job.raw("transcripts")]
        assert any(one["game_label_id"] for one in found)
        assert any(one["fps"] for one in found)
