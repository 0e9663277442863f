"""A user's work on the sandbox: `kb` with the settings that point at the services."""

import hashlib
import json
import subprocess
from pathlib import Path
from typing import Any

from kb.core.installation import folder
from kb.sandbox.youtube.cases import Playlist
from kb.store.rawlog import rawlog
from tests import inprocess, processes
from tests.cli.conftest import clean_environment
from tests.faults import Sandbox

NOW = "2026-11-20T12:00:00Z"


class Job:
    """One data root and one sandbox. `toxicity` False: a profile that scores no text, so that no
    model is loaded.
    """

    def __init__(
        self,
        sandbox: Sandbox,
        place: Path,
        *,
        toxicity: bool = False,
        fresh: bool = False,
        **env: str,
    ) -> None:
        self.sandbox, self.place, self.root = sandbox, place, place / "data"
        self.fresh = fresh  # a new interpreter for each command, see tests/processes.py
        place.mkdir(parents=True, exist_ok=True)
        self.env = (
            clean_environment()
            | sandbox.settings(model=toxicity)
            | {"KB_DATA": str(self.root), "KB_NOW": NOW}
            | env
        )
        if not toxicity:
            self.profile(('toxicity = "on"', 'toxicity = "off"'))

    def profile(self, *changes: tuple[str, str]) -> Path:
        """The shipped profile with some text replaced, as this job's own; a second call changes it
        further.
        """
        shipped = folder("profiles") / "minecraft"
        path = self.place / "profile" / "profile.toml"
        if not path.exists():
            path.parent.mkdir()
            for file in shipped.iterdir():
                if file.is_file():
                    (path.parent / file.name).write_bytes(file.read_bytes())
        text = path.read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")
        self.env["KB_PROFILE"] = str(path)
        return path

    def start(self, *words: str, **env: str) -> processes.ForkedProcess:
        """`kb WORDS` in the background: for signals and kills."""
        return processes.start(words, env=self.env | env, cwd=self.place)

    def kb(self, *words: str, **env: str) -> subprocess.CompletedProcess[str]:
        """`kb WORDS`, finished, in this process unless it has to be a new interpreter."""
        at = {"env": self.env | env, "cwd": self.place}
        if self.fresh:
            return processes.run(words, **at, fresh=True)
        return subprocess.CompletedProcess(words, *inprocess.run(words, **at))

    def done(self, *words: str, code: int = 0, **env: str) -> dict[str, Any]:
        """The summary of `kb WORDS --json`, which must end with `code`."""
        result = self.kb(*words, "--json", **env)
        assert result.returncode == code, (
            f"kb {' '.join(words)} ended with {result.returncode}:\n{result.stderr[-3000:]}"
        )
        return json.loads(result.stdout.splitlines()[-1]) if result.stdout else {}

    def stopped(self, *words: str, code: int, **env: str) -> str:
        """The one line of a `kb WORDS` that ends with `code`, and no traceback."""
        result = self.kb(*words, **env)
        assert result.returncode == code, (
            f"kb {' '.join(words)} ended with {result.returncode}:\n{result.stderr[-3000:]}"
        )
        assert "Traceback" not in result.stderr
        lines = [line for line in result.stderr.splitlines() if line.startswith("kb: ")]
        assert len(lines) == 1, result.stderr
        return lines[0]

    def rows(self, sql: str) -> list[dict[str, Any]]:
        """The answer of `kb query`, asked in this process."""
        from kb import query
        from kb.query.statements import views_needed

        needed = views_needed(sql, query.find_views(self.root))
        with query.connect(self.root, needed) as db:
            return query.select(db, sql).read_all().to_pylist()

    def released(self) -> list[dict[str, Any]]:
        """The released videos without the time that they were read at."""
        return self.rows(
            "SELECT * EXCLUDE (fetched_at) FROM release.youtube_videos ORDER BY video_id"
        )

    def digests(self, *parts: str) -> dict[str, str]:
        """sha256 by path of every file below a folder of the data root."""
        top = self.root.joinpath(*parts)
        return {
            str(path.relative_to(top)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(top.rglob("*"))
            if path.is_file()
        }

    def raw(self, kind: str) -> list[dict[str, Any]]:
        """Every envelope of a raw kind."""
        import zstandard

        found = []
        for path in rawlog.segments(self.root, "youtube", kind):
            with path.open("rb") as file:
                text = (
                    zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True).read()
                )
            found += [json.loads(line) for line in text.splitlines()]
        return found


def plain_units(sandbox: Sandbox) -> int:
    """What a whole crawl costs of the general bucket, reckoned from the world alone."""

    def pages(count: int) -> int:
        return -(-count // 50)

    world = sandbox.world.youtube
    lists = sum(
        max(1, pages(len(channel.entries))) if channel.listed else 1 for channel in world.channels
    )
    playlists = sum(max(1, pages(len(one.entries))) for one in searched_playlists(sandbox))
    return lists + playlists + pages(len(world.videos))


def searched_playlists(sandbox: Sandbox) -> list[Playlist]:
    """The playlists that the shipped profile's phrases find."""
    world = sandbox.world.youtube
    hits = (world.search_playlists(phrase) for phrase in sandbox.world.domain.phrases)
    return list({one.id: one for several in hits for one in several}.values())
