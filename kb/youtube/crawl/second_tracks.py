"""Fetches the automatic tracks of videos whose manual track is already their transcript, to compare
the two.

Which videos have both is known from the lists of tracks that came with the transcripts.
"""

from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

import msgspec

from kb.core import clock
from kb.core.context import Run
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.core.summary.plan import plan
from kb.crawl.connector import Phase
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.store.rawlog import rawlog
from kb.store.state.frontier import Frontier
from kb.youtube.crawl.connector import YouTubeConnector
from kb.youtube.crawl.quota import WEB
from kb.youtube.crawl.reduce import FINAL, RAW_SECOND_TRACKS, RAW_TRANSCRIPTS, SECOND_TRACKS
from kb.youtube.parse.answers import PO_TOKEN
from kb.youtube.plan import phase_of_tracks
from kb.youtube.section import YouTubeSection
from kb.youtube.ytdlp.tracks import TrackLanguage

PHASE = Phase(
    kind=SECOND_TRACKS, unit="tracks", name="second tracks", workers=4, down=6, service=WEB
)


class _Track(msgspec.Struct, gc=False):
    language: str = ""
    kind: str = ""


class _Player(msgspec.Struct, gc=False):
    tracks: list[_Track] = []


class _Transcript(msgspec.Struct, gc=False):
    video_id: str
    outcome: str
    kind: str | None = None
    player: _Player | None = None


class _Answer(msgspec.Struct, gc=False):
    """Of an envelope, when it came, which video it is about, and the tracks that this one has."""

    fetched_at: str
    response: _Transcript


def with_both(run: Run) -> set[str]:
    """Ids of videos whose transcript is a manual track, and that have an automatic one in the
    profile's language as well. Reads every raw transcript.
    """
    spoken = TrackLanguage(run.profile.section(YouTubeSection).language).spoken
    both: dict[str, bool] = {}
    for answer in _answers(run.root, RAW_TRANSCRIPTS):
        transcript = answer.response
        if transcript.outcome in FINAL:
            tracks = transcript.player.tracks if transcript.player else []
            heard = any(one.kind == "asr" and spoken(one.language) for one in tracks)
            both[transcript.video_id] = transcript.kind == "manual" and heard
    return {key for key, has_both in both.items() if has_both}


def has_second_tracks(root: Path) -> bool:
    """Whether any second track was asked for."""
    return bool(rawlog.segments(root, "youtube", RAW_SECOND_TRACKS))


def not_fetched(root: Path, ids: Iterable[str]) -> list[str]:
    """Those of the videos whose second track is to be asked for: without an answer that is final,
    and not turned down today for want of a PO token.
    """
    today = clock.stamp()[:10]
    known = {
        answer.response.video_id
        for answer in _answers(root, RAW_SECOND_TRACKS)
        if answer.response.outcome in FINAL
        or (answer.response.outcome == PO_TOKEN and answer.fetched_at[:10] == today)
    }
    return [key for key in ids if key not in known]


def _answers(root: Path, kind: str) -> Iterator[_Answer]:
    decoder = msgspec.json.Decoder(_Answer)
    for path in rawlog.segments(root, "youtube", kind):
        for _, line in rawlog.Frames(path):
            yield decoder.decode(line)


def plan_second_tracks(run: Run, ids: Collection[str]) -> Summary:
    """What `fetch_second_tracks` would ask for now. Sends and writes nothing."""
    phase = phase_of_tracks(run, "second tracks", len(not_fetched(run.root, ids)))
    return Summary(plan("pairs measure", "youtube", [phase]))


def fetch_second_tracks(run: Run, ids: Collection[str]) -> Summary:
    """Fetch the automatic tracks of these videos that are not there yet, three requests each.

    Raises Stopped with `summary` when something is left, NothingRead.
    """
    source = YouTubeSecondTracks(run, ids)
    return work(run, source, source.summary, phases=source.chosen, facts=source.facts)


class YouTubeSecondTracks(YouTubeConnector):
    """The second tracks of a sample of videos."""

    def __init__(self, run: Run, ids: Collection[str]) -> None:
        super().__init__(run)
        self.chosen = [PHASE]
        self._ids = ids

    def discover(self, frontier: Frontier) -> None:
        """The tracks of the sample that have no answer yet."""
        frontier.replace(SECOND_TRACKS, not_fetched(self.run.root, self._ids))

    def summary(self, session: CrawlSession, loop: Loop) -> Summary:
        """What was fetched, and what is left."""
        left = SOURCES["youtube"].left_by({SECOND_TRACKS: session.frontier.counts(SECOND_TRACKS)})
        return Summary(
            command="pairs measure",
            source="youtube",
            fetched=self.counts["second_tracks"],
            failed=session.frontier.counts(SECOND_TRACKS).get("error", 0),
            requests=session.requests()[0],
            left=sum(left.values()),
            left_by=left,
        )
