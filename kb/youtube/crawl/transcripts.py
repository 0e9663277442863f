"""One video's transcript through youtube-transcript-api, with the facts of the player answer that
comes with it.

Three requests a video (watch page, player, timed text) and no further one, unless a track is empty.
Preference: manual track of the language, automatic one, manual of another language translated,
automatic translated. The library reads YouTube's plain form, which has no word times; automatic
tracks are read in the form srv3, which has them, and in the plain form where that fails.
"""

from collections.abc import Iterator
from typing import Any
from urllib.parse import parse_qs, urljoin, urlsplit
from xml.etree.ElementTree import ParseError

import requests
import urllib3
import youtube_transcript_api as lib
from youtube_transcript_api import YouTubeTranscriptApi

from kb.core.errors import Challenged, Retryable
from kb.core.languages import is_same_language, tag
from kb.crawl.connector import Opened
from kb.net.rate import Pace
from kb.net.retry import Note
from kb.net.session import Door, HttpSession, Ledger, failure, refusal
from kb.youtube.crawl import player, quota
from kb.youtube.parse.answers import FORMAT
from kb.youtube.section import YouTubeSection
from kb.youtube.ytdlp import subtitles
from kb.youtube.ytdlp.tracks import TrackLanguage, language_of

SITE = "https://www.youtube.com/"
EMPTY_TRIES = 2  # of a track without text in one run
REDIRECTS = 5  # in a row
# names of requests in the ledger
_CONSENT = "shows a consent wall instead of the watch page"
_ENDPOINTS = {"/watch": "watch", "/youtubei/v1/player": "player", "/api/timedtext": "timedtext"}
WORD_TIMES = "fmt=srv3"  # what the site adds to a track's address, and the library takes away


class Fetcher:
    """Fetches transcripts, one at a time: one for each thread, as sessions are not thread-safe."""

    def __init__(self, profile: YouTubeSection, pace: Pace, opened: Opened) -> None:
        self._profile, self._pace, self._opened = profile, pace, opened
        settings = opened.run.settings
        # The library's own User-Agent would be Python's; the site serves any, so ours says who we
        # are.
        self._session = HttpSession(settings)
        self._session.max_redirects = REDIRECTS
        self._session.mount("", SiteDoor(settings.kb_youtube_web, self._row))
        self._session.hooks["response"].append(self._inspect)
        self._page, self._answer, self._needs_token, self._is_empty = "", None, False, False
        self._api = YouTubeTranscriptApi(http_client=self._session)

    def close(self) -> None:
        self._session.close()

    def fetch(self, video_id: str, *, second: bool = False) -> dict[str, Any]:
        """The `response` of a transcripts envelope; `outcome` says what became of it.

        `second`: the automatic track, of a video that has a manual one. Raises Blocked and
        Challenged, which are no facts about the video, and Retryable after the last try.
        """
        self._pace.wait()
        empty = 0

        def once() -> dict[str, Any]:
            nonlocal empty
            try:
                return self._once(video_id, second)
            except Retryable as error:
                empty += self._is_empty
                if empty == EMPTY_TRIES:  # it stays so for hours
                    return {"video_id": video_id, "outcome": "failed", "reason": error.reason}
                raise

        return self._opened.attempt(quota.WEB, once, self._profile.max_tries)

    def _row(self, request: requests.PreparedRequest) -> Note:
        """The ledger's row. Raises as `Opened.refuse_blocked`."""
        self._opened.refuse_blocked(quota.WEB)
        path = urlsplit(request.url or "").path
        return self._opened.spend(quota.SITE, _ENDPOINTS.get(path, "web"), 0)

    def _once(self, video_id: str, second: bool) -> dict[str, Any]:
        self._page, self._answer, self._needs_token, self._is_empty = "", None, False, False
        answer: dict[str, Any] = {
            "format": FORMAT,
            "video_id": video_id,
            "outcome": "ok",
            "reason": None,
            "kind": None,
            "language": None,
            "original_kind": None,
            "cues": None,
        }
        try:
            answer |= self._read(self._api.list(video_id), second)
        except (lib.RequestBlocked, lib.IpBlocked) as error:
            raise _challenged(f"blocks this address ({type(error).__name__})") from None
        except lib.FailedToCreateConsentCookie:
            raise _challenged(_CONSENT) from None
        except lib.NoTranscriptFound:
            answer |= {"outcome": "none"}
        except lib.TranscriptsDisabled:
            answer |= {"outcome": "disabled"}
        except lib.AgeRestricted:
            answer |= {"outcome": "age_restricted"}
        except (lib.VideoUnavailable, lib.InvalidVideoId, lib.VideoUnplayable) as error:
            answer |= {
                "outcome": "unavailable",
                "reason": getattr(error, "reason", None) or type(error).__name__,
            }
        except lib.PoTokenRequired:
            answer |= {"outcome": "po_token"}
        except (
            lib.YouTubeRequestFailed,
            lib.YouTubeDataUnparsable,
            ParseError,
            requests.JSONDecodeError,
        ) as error:
            # An empty body of the timed text raises the parser's own error.
            if not (self._needs_token and isinstance(error, ParseError)):
                # Without the address, which holds the page's key.
                code = str(getattr(error, "reason", "")).split(" ")[0]
                raise Retryable(
                    f"HTTP {code} from YouTube" if code.isdigit() else type(error).__name__
                ) from None
            answer |= {"outcome": "po_token"}
        except (requests.RequestException, urllib3.exceptions.HTTPError) as error:
            # Of an address that leads nowhere the site's own answers are to blame, not the video.
            broken = failure(error, SITE)
            unreachable = isinstance(broken, Retryable) and broken.unreachable
            raise Retryable(
                f"{type(error).__name__} at www.youtube.com", unreachable=unreachable
            ) from None
        except (LookupError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise Retryable(
                f"unreadable ({type(error).__name__})"
            ) from None  # an answer of another form than the library expects
        if second:  # these facts came with the first track
            return answer
        try:
            answer["player"] = player.facts(self._answer, self._page, self._profile.game_ids)
        except RecursionError:
            raise Retryable("unreadable (RecursionError)") from None
        return answer

    def _read(self, tracks: Any, second: bool) -> dict[str, Any]:
        """The best track with a word in it; NoTranscriptFound when none is in the language or can
        be translated. With `second` only automatic tracks of the language count.
        """
        language = self._profile.language
        for track, translate in self._by_preference(tracks):
            if second and (translate or not track.is_generated):
                continue
            shown = track
            try:
                if translate:  # the site has its own codes of the languages that it translates to
                    codes = (one.language_code for one in track.translation_languages)
                    own = (code for code in codes if is_same_language(code, language))
                    nearest = sorted(own, key=lambda code: (tag(code) != tag(language), code))
                    shown = track.translate(next(iter(nearest), language))
            except (lib.NotTranslatable, lib.TranslationLanguageNotAvailable):
                continue
            cues = (self._with_word_times(track) if shown is track else None) or [
                subtitles.Cue(cue.start, cue.duration, cue.text) for cue in shown.fetch()
            ]
            if not any(cue.text.split() for cue in cues):
                continue
            original = "asr" if track.is_generated else "manual"
            return {
                "kind": "translated" if translate else original,
                "original_kind": original,
                "language": track.language_code,
                "cues": subtitles.as_columns(cues),
            }
        raise lib.NoTranscriptFound(tracks.video_id, [language], tracks)

    def _with_word_times(self, track: Any) -> list[subtitles.Cue] | None:
        """The cues of an automatic track with the starts of their words; None where the site does
        not give that form.
        """
        address = track._url  # the library has no public name for it
        if not track.is_generated or _asks_for_token(address):
            return None
        response = self._session.get(f"{address}&{WORD_TIMES}")
        if not response.ok:
            return None
        try:
            return subtitles.read("srv3", response.text).cues
        except ValueError:
            return None

    def _by_preference(self, tracks: Any) -> Iterator[tuple[Any, bool]]:
        wanted = TrackLanguage(self._profile.language)
        listed = list(tracks)
        own = [track for track in listed if wanted.spoken(track.language_code)]
        own.sort(
            key=lambda track: (
                track.is_generated,
                language_of(track.language_code) != language_of(wanted.name),
                track.language_code,
            )
        )
        yield from ((track, False) for track in own)
        if self._profile.translate:
            other = sorted(
                (track for track in listed if track not in own),
                key=lambda track: track.is_generated,
            )
            yield from ((track, True) for track in other)

    def _inspect(self, response: requests.Response, *_: Any, **__: Any) -> None:
        """Sees every answer before the library does."""
        refused = refusal(response, SITE)
        if refused is not None and refused.throttled:
            # The library calls every 429 a block; with --wait it is not one yet.
            raise Retryable("429 from YouTube", after=refused.after, throttled=True)
        # People may be asked something instead of being shown the page.
        target = urlsplit(
            urljoin(response.url, response.headers["Location"])
            if response.is_redirect
            else response.url
        )
        if (target.hostname or "").startswith("consent."):
            raise _challenged(_CONSENT)
        if target.path == "/sorry" or target.path.startswith("/sorry/"):
            raise _challenged("blocks this address (automated queries)")
        path = urlsplit(response.url).path
        if path == "/watch":
            self._page = response.text
        elif path == "/youtubei/v1/player":
            try:
                self._answer = response.json()
            except ValueError:
                self._answer = None
        elif path == "/api/timedtext":
            # The body of such a track is empty for whoever sends no token.
            self._is_empty = response.ok and not response.content.strip()
            self._needs_token = _asks_for_token(response.url) and self._is_empty


def _challenged(what: str) -> Challenged:
    """The error for a page that asks a person something."""
    return Challenged(
        f"YouTube {what}",
        hint="open www.youtube.com in a browser on this network and answer what it asks, or use"
        " another network; then run the same command",
    )


def _asks_for_token(address: str) -> bool:
    """Whether a track can be had only with a proof-of-origin token."""
    return "xpe" in parse_qs(urlsplit(address).query).get("exp", ())


class SiteDoor(Door):
    """Sends to `root` what is for the web site, and nothing anywhere else.

    What comes back carries the site's own address again, so that paths and redirects mean the same
    under any root.
    """

    def __init__(self, root: str | None, ledger: Ledger) -> None:
        super().__init__(ledger=ledger)
        self._root = root

    def require_allowed(self, url: str) -> None:
        """Raises Retryable for an address that is not the site's."""
        if not self._own(url).startswith(SITE):
            raise Retryable("redirected away from YouTube")

    def pass_on(self, request: requests.PreparedRequest, *arguments: Any, **options: Any) -> Any:
        """To the root instead of the site, where there is one."""
        request.url = self._own(request.url or "")
        sent = request.copy()
        if self._root:
            sent.url = f"{self._root}/" + request.url.removeprefix(SITE)
        response = super().pass_on(sent, *arguments, **options)
        response.request, response.url = request, request.url
        return response

    def _own(self, url: str) -> str:
        """The site's address of one under the root: a redirect may name either."""
        if self._root and url.startswith(f"{self._root}/"):
            return SITE + url.removeprefix(f"{self._root}/")
        return url
