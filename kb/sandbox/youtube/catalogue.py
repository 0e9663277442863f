"""Generates the channels and videos of the invented world."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from typing import Any

from kb.core import clock
from kb.core.cached_property import cached_property
from kb.core.languages import primary_language
from kb.sandbox.domain import Domain
from kb.sandbox.invented_ids import channel_id, video_id
from kb.sandbox.speech import Sentence
from kb.sandbox.youtube import captions
from kb.sandbox.youtube.captions import Mishearing, SpokenCue
from kb.sandbox.youtube.cases import UNLISTED, Case, Channel, Playlist, Track, Video
from kb.sandbox.youtube.planted import Planted, shifted, truth_of
from kb.sandbox.youtube.playlists import planted_playlists

PAGE = 50
_TASKS, _IDLE = 0.25, 0.08  # of ordinary titles: that name a task, or its verb alone
_THINGS = 0.3  # of both: with a thing in place of the verb, with a noun in place of it


class Catalogue:
    """All channels and videos of a world. `unlisted` is a video of a channel that is in no list."""

    def __init__(self, seed: int, n_channels: int, n_videos: int, domain: Domain) -> None:
        self.seed, self.domain = seed, domain
        self.channels = [self._channel(number) for number in range(n_channels)]
        self.videos: dict[str, Video] = {}
        number = 0
        for channel, size in zip(self.channels, self._sizes(n_channels, n_videos), strict=True):
            for _ in range(size):
                video = self._video(number, channel)
                self.videos[video.id] = video
                channel.videos.append(video)
                number += 1
            channel.videos.sort(key=lambda video: video.published_at, reverse=True)
            channel.entries = list(channel.videos)
        self.unlisted = self._video(number, self.channels[0], UNLISTED)
        if n_channels >= 8:
            # An upload while somebody pages: the last entry of a page comes again as the first of
            # the next.
            first = self.channels[0]
            if len(first.entries) > PAGE:
                first.entries.insert(PAGE, first.entries[PAGE - 1])
            self.channels[4].listed = False
            self.channels[5].without_shorts = False
        self.playlists = planted_playlists(seed, self.channels, domain.phrases)
        self.planted = Planted(seed, self.channels, domain.speech, domain.rules.language)

    @cached_property
    def by_playlist(self) -> dict[str, tuple[Channel, list[Video]]]:
        """Playlist id → its channel and entries; UU… has all uploads,
        UULF… those that are no Shorts. Of made ones those that anybody may read.
        """
        playlists = {
            one.id: (one.channel, one.entries)
            for one in self.playlists
            if one.privacy in ("public", "unlisted")
        }
        for channel in self.channels:
            if channel.listed:
                playlists[channel.uploads] = (channel, channel.entries)
                if channel.without_shorts:
                    playlists["UULF" + channel.id[2:]] = (
                        channel,
                        [video for video in channel.entries if not video.short],
                    )
        return playlists

    def video_of(self, key: str) -> Video | None:
        """A video by its id, listed or not."""
        return self.unlisted if key == self.unlisted.id else self.videos.get(key)

    def search(self, query: str) -> list[Channel]:
        """Channels that know every word of `query`, in an order of the query's own."""
        wanted = query.lower().split()
        hits = [
            channel for channel in self.channels if all(word in channel.words for word in wanted)
        ]
        clock.rng(self.seed, "search", query.lower()).shuffle(hits)
        return hits

    def search_playlists(self, query: str) -> list[Playlist]:
        """Playlists whose title has every word of `query`, as channels are searched; also those
        that are private or gone by now.
        """
        wanted = query.lower().split()
        hits = [
            one
            for one in self.playlists
            if one.privacy != "unlisted" and all(word in one.title.lower() for word in wanted)
        ]
        clock.rng(self.seed, "search for playlists", query.lower()).shuffle(hits)
        return hits

    def talk(self, video: Video, language: str) -> list[Sentence]:
        """What is said in a video; in the domain's language with what is planted in it."""
        own = language == self.planted.language
        original = self.planted.copies.get(video.id, video.id) if own else video.id
        rng = clock.rng(self.seed, "talk", original)
        talk = self.domain.speech.talk(rng, video.cast, video.seconds, language)
        return self.planted.talk(video, talk) if own else talk

    def cues(self, video: Video, track: Track, translated_to: str | None = None) -> list[SpokenCue]:
        """What a caption track says: of one video they say the same, each in its form and with its
        errors.
        """
        language = primary_language(translated_to or track.language)
        talk = self.talk(video, language)
        own = translated_to is None and language == self.planted.language
        if track.kind == "asr":
            words = [captions.spoken_words(sentence) for sentence in talk]
            if own:
                words, _ = self.planted.heard(video, talk, words)
            return captions.automatic(clock.rng(self.seed, "cues", video.id), talk, words)
        cues = captions.manual(talk)
        return shifted(cues, self.planted.shift(video, cues)) if own else cues

    @cached_property
    def truth(self) -> dict[str, Any]:
        """What is planted in the videos (kb/sandbox/youtube/planted.py)."""
        lists = [
            {
                "playlist_id": one.id,
                "title": one.title,
                "teaches": one.teaches,
                "privacy": one.privacy,
                "videos": [video.id for video in one.entries],
            }
            for one in self.playlists
        ]
        planted = truth_of(self.planted, map(self._planted_in, self.videos.values()))
        return {**planted, "playlists": lists}

    def _planted_in(self, video: Video) -> tuple[Video, list[Sentence], list[Mishearing], float]:
        talk = self.talk(video, self.planted.language)
        kinds, errors, shift = self.planted.own_kinds(video), list[Mishearing](), 0.0
        if "asr" in kinds:
            words = [captions.spoken_words(sentence) for sentence in talk]
            _, errors = self.planted.heard(video, talk, words)
        if len(kinds) == 2:
            shift = self.planted.shift(video, captions.manual(talk))
        return video, talk, errors, shift

    def _sizes(self, n_channels: int, n_videos: int) -> list[int]:
        if n_channels < 8:
            return _shared(n_videos, n_channels)
        fixed = [130, 50, 51, 0, 0] if n_videos >= 250 else [0] * 5
        if n_videos < 250:
            fixed[:3] = _shared(n_videos // 2, 3)
        return fixed + _shared(n_videos - sum(fixed), n_channels - 5)

    def _channel(self, number: int) -> Channel:
        rng = clock.rng(self.seed, "channel", number)
        speech, names = self.domain.speech, self.domain.channels
        kinds = self.domain.channel_kinds[number % len(self.domain.channel_kinds)]
        name = names[number % len(names)] + (
            f" {number // len(names) + 1}" if number >= len(names) else ""
        )
        description = f"{speech.topic} {kinds}. {speech.text('about', rng, speech.cast(rng), 2)}"
        description = description.replace("\n", " ")
        made = datetime(2010, 1, 1, tzinfo=UTC) + timedelta(hours=rng.randrange(60_000))
        return Channel(
            channel_id(rng),
            name,
            description,
            f"{name} {description}".lower(),
            clock.stamp(made),
        )

    def _video(self, number: int, channel: Channel, case: Case | None = None) -> Video:
        rng = clock.rng(self.seed, "video", number)
        cases, rules, speech = self.domain.cases, self.domain.rules, self.domain.speech
        if case is None and number < len(cases):
            case = cases[number]
        elif case is None:
            case = rng.choices(cases, [case.often for case in cases])[0]
        # Ordinary videos pass every threshold: from 125 views and 75 seconds on, or the profile's.
        views = int(10 ** rng.uniform(2.1, 6.5)) * max(1, math.ceil(rules.min_views / 125))
        cast = speech.cast(rng)
        values: dict[str, Any] = {
            "title": speech.title(rng, cast),
            "description": speech.text("about", rng, cast, rng.randint(1, 4)),
            "published_at": clock.stamp(
                datetime(2012, 1, 1, tzinfo=UTC) + timedelta(minutes=rng.randrange(7_000_000))
            ),
            "view_count": str(views),
            "like_count": str(views // rng.randint(15, 90)),
            "comment_count": str(views // 400),
            # From 75 seconds to 40 minutes, most of them about ten.
            "seconds": int(75 * 32 ** rng.random()) + max(0, rules.min_seconds - 60),
            "tags": [*rules.tags, cast.subject.name],
            "category_id": str(rules.category),
            "language": rules.language,
            "tracks": [Track(rules.language)],
            "game": "topic",
        }
        plain = speech.plain_title(rng, cast)
        values |= case.change
        if values["title"] == "plain":
            values["title"] = plain
        label = self.domain.labels.get(values["game"])
        key = video_id(rng)
        video = Video(
            id=key, channel=channel, case=case, number=number, cast=cast, label=label, **values
        )
        if not case.change.keys() & {"title", "description"}:
            self._name_task(video)
        return video

    def _name_task(self, video: Video) -> None:
        """The titles of some videos say what is done in them, and half of these have chapters."""
        rng, speech = clock.rng(self.seed, "task", video.number), self.domain.speech
        drawn = rng.random()
        own = clock.rng(self.seed, "thing", video.number)
        named = bool(speech.things) and own.random() < _THINGS
        if drawn < _TASKS:
            video.title, video.task = speech.task_title(rng, video.cast)
            if named:
                video.title, video.task = speech.thing_title(own, video.cast)
            if rng.random() < 0.5:
                begin, end = (int(video.seconds * share) for share in (0.1, 0.8))
                video.task_start = float(begin)
                times = f"0:00 Hello\n{_clock(begin)} {video.task}\n{_clock(end)} Goodbye"
                video.description = f"{video.description}\n\n{times}"
        elif drawn < _TASKS + _IDLE:
            video.title = speech.title(rng, video.cast, "idle_title")
            if named and speech.task_nouns:
                video.title = speech.noun_title(own, video.cast)


def _clock(seconds: int) -> str:
    """As a description has it: 1:05, 1:02:03."""
    minutes, rest = divmod(seconds, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _shared(total: int, parts: int) -> list[int]:
    return [total // parts + (number < total % parts) for number in range(parts)]
