"""Plants errors and repetitions in the talk of the invented world, and lists them.

What is planted, in videos that are kept and spoken in the domain's language:

    hearing     automatic tracks in which names are lost or swapped, at a rate of the seed's own
    shifted     manual tracks beside an automatic one, off by up to 3 s
    copies      videos whose talk is another one's with a few words changed
    recurring   a channel's intro and sponsor text, word for word in many of its videos
    languages   passages of some sentences in another language
    tasks       titles that say what is done; where there are chapters, when it begins

The truth (docs/new-domain.md) is an answer sheet for what is measured on such texts. Its times are
those of the talk, in s.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any

from kb.core import clock
from kb.core.languages import primary_language
from kb.sandbox.speech import MUSIC, Sentence, Speech, grammar, letters
from kb.sandbox.youtube.captions import Mishearing, Rates, SpokenCue, SpokenWord, misheard
from kb.sandbox.youtube.cases import Channel, Video

INTRO, SPONSOR = "intro", "sponsor"
LANGUAGES = ("de", "es", "fr")
FARTHEST = 3.0  # s that a manual track is off, at most
_COPIED = 0.15  # of the plain videos
_ORDINARY = ("manual", "asr")  # cases that a copy may be of
_INTROS, _SPONSORS, _SPONSORED, _FOREIGN = 0.7, 0.5, 0.5, 0.12
_FEWEST = 3  # videos in which a text recurs
_LONGEST = 3_600  # s; in longer videos pauses are minutes
_EDITS = 100  # words of a copy for each changed one
_SINGLE = ("often", "few", "times", "degree", "asked", "told", "nth", "explain")


def replaced(
    talk: Sequence[Sentence], place: int, texts: Iterable[str], label: str
) -> list[Sentence]:
    """The talk with other sentences from `place` on, in place of those that they overlap. The same
    talk where they would reach into its last sentence.
    """
    pace = talk[0].seconds / letters(talk[0].text)
    at, sentences = talk[place].start, list[Sentence]()
    for text in texts:
        sentences.append(Sentence(at, round(pace * letters(text), 2), text, label))
        at = round(at + sentences[-1].seconds + 0.3, 2)
    if at > talk[-1].start:
        return list(talk)
    return [
        *talk[:place],
        *sentences,
        *(sentence for sentence in talk[place:] if sentence.start >= at),
    ]


def reworded(rng: random.Random, talk: Sequence[Sentence]) -> list[Sentence]:
    """The talk with a few words changed, none of them in what is planted."""
    # Single words of the grammar, and what may stand in their place.
    lists = [[word for word in grammar().rules[rule] if word.isalpha()] for rule in _SINGLE]
    others = {word: words for words in lists for word in words if len(words) > 1}
    places = [
        (number, at)
        for number, sentence in enumerate(talk)
        if not sentence.planted
        for at, word in enumerate(sentence.text.split())
        if word in others
    ]
    wanted = max(2, sum(len(sentence.text.split()) for sentence in talk) // _EDITS)
    made = list(talk)
    for number, at in rng.sample(places, min(wanted, len(places))):
        words = made[number].text.split()
        words[at] = rng.choice([word for word in others[words[at]] if word != words[at]])
        made[number] = made[number]._replace(text=" ".join(words))
    return made


def shifted(cues: Sequence[SpokenCue], shift_s: float) -> list[SpokenCue]:
    """Cues that begin later by as much."""
    return [cue._replace(start=round(cue.start + shift_s, 3)) for cue in cues]


class Planted:
    """What is planted in which videos.

    `rates`: of names that automatic tracks mishear; `copies`: original by copy (video ids);
    `texts`: by channel, what recurs in it (label, text).
    """

    def __init__(self, seed: int, channels: Sequence[Channel], speech: Speech, language: str):
        self.seed, self.speech, self.language = seed, speech, primary_language(language)
        rng = clock.rng(seed, "planted")
        self.rates = Rates(lost=rng.uniform(0.02, 0.05), swapped=rng.uniform(0.01, 0.04))
        self.copies: dict[str, str] = {}
        self._said: dict[str, list[tuple[str, str]]] = {}
        self._foreign: dict[str, str] = {}
        usual = [
            video
            for channel in channels
            for video in channel.videos
            if video.case.stage is None and self.own_kinds(video) and video.seconds <= _LONGEST
        ]
        self._copy(rng, usual)
        for number, channel in enumerate(channels):
            own = [
                video for video in usual if video.channel is channel and video.id not in self.copies
            ]
            self._repeat(clock.rng(seed, "planted", number), own)
        languages = [language for language in LANGUAGES if language != self.language]
        for video in usual:
            if video.id not in self.copies and rng.random() < _FOREIGN:
                self._foreign[video.id] = rng.choice(languages)

    def own_kinds(self, video: Video) -> set[str]:
        """The kinds of its tracks in the domain's language: "" and "asr"."""
        languages = {(primary_language(track.language), track.kind) for track in video.tracks}
        return {kind for language, kind in languages if language == self.language}

    def _copy(self, rng: random.Random, usual: Sequence[Video]) -> None:
        """Some plain videos repeat an earlier one, of which each is repeated once."""
        # The first video of a case is what tests look at.
        firsts: dict[str, str] = {}
        for video in sorted(usual, key=lambda video: video.number):
            firsts.setdefault(video.case.name, video.id)
        plain = [
            video
            for video in usual
            if video.case.name in _ORDINARY and video.id not in firsts.values()
        ]
        plain.sort(key=lambda video: (video.published_at, video.id))
        free = list(plain)
        for _ in range(round(_COPIED * len(plain))):
            first, other = sorted(rng.sample(range(len(free)), 2))
            original, copy = free[first], free[other]
            free = [video for video in free if video not in (original, copy)]
            self.copies[copy.id] = original.id
            copy.seconds, copy.cast = original.seconds, original.cast
            copy.title = f"{original.title} (Again)"
            copy.task, copy.task_start = original.task, original.task_start

    def _repeat(self, rng: random.Random, videos: Sequence[Video]) -> None:
        """A channel's intro, and in some channels a sponsor's text."""
        cast = self.speech.cast(rng)
        sponsored = rng.random() < _SPONSORED
        for label, share in ((INTRO, _INTROS), (SPONSOR, _SPONSORS if sponsored else 0.0)):
            text = self.speech.line(label, rng, cast)
            chosen = [video for video in videos if rng.random() < share]
            for video in chosen if len(chosen) >= _FEWEST else ():
                self._said.setdefault(video.id, []).append((label, text))

    def talk(self, video: Video, plain: list[Sentence]) -> list[Sentence]:
        """What is said in a video in the domain's language, with what is planted in it. `plain`:
        the talk of the video, or of the one that it copies.
        """
        original = self.copies.get(video.id, video.id)
        talk = plain
        rng = clock.rng(self.seed, "passages", original)
        for label, text in self._said.get(original, ()):
            # An intro follows the greeting.
            place = 1 if label == INTRO else _within(rng, talk, 0.3, 0.5)
            if place < len(talk):
                talk = replaced(talk, place, [text], label)
        if (code := self._foreign.get(original)) and len(talk) > 8:
            rule, size = f"say_{code}", rng.randint(4, 8)
            lines = [self.speech.line(rule, rng, video.cast) for _ in range(2 * size)]
            texts = list(dict.fromkeys(lines))[:size]
            talk = replaced(talk, _within(rng, talk, 0.55, 0.7), texts, code)
        if original != video.id:
            talk = reworded(clock.rng(self.seed, "reworded", video.id), talk)
        return talk

    def heard(
        self, video: Video, talk: Sequence[Sentence], words: Sequence[Sequence[SpokenWord]]
    ) -> tuple[list[list[SpokenWord]], list[Mishearing]]:
        """The words that the automatic track has, and the names misheard. What is planted is heard
        right, and a copy's track has its original's errors.
        """
        original = self.copies.get(video.id, video.id)
        rng = clock.rng(self.seed, "hearing", original)
        own = [
            number
            for number, sentence in enumerate(talk)
            if not sentence.planted and sentence.text != MUSIC
        ]
        heard, errors = misheard(rng, [words[n] for n in own], self.speech.nouns, self.rates)
        made = [list(sentence) for sentence in words]
        for number, sentence in zip(own, heard, strict=True):
            made[number] = sentence
        return made, errors

    def shift(self, video: Video, cues: Sequence[SpokenCue]) -> float:
        """How much later the manual track begins than what is said (s): 0 without an automatic
        track. It stays inside the video.
        """
        if self.own_kinds(video) != {"", "asr"} or not cues:
            return 0.0
        drawn = clock.rng(self.seed, "shift", video.id).uniform(-FARTHEST, FARTHEST)
        latest = max(0.0, video.seconds - cues[-1].start - 0.1)
        return round(min(max(drawn, -cues[0].start), latest), 3)


def _within(rng: random.Random, talk: Sequence[Sentence], low: float, high: float) -> int:
    return int(len(talk) * rng.uniform(low, high))


def passages(talk: Sequence[Sentence]) -> list[tuple[str, float, float, str]]:
    """What is planted in a talk: label, start and end in s, text. Sentences of one language that
    follow each other are one passage.
    """
    planted = []
    for label, group in groupby(talk, key=lambda sentence: sentence.planted):
        if label:
            those = list(group)
            ends = round(those[-1].start + those[-1].seconds, 3)
            planted.append(
                (label, those[0].start, ends, " ".join(sentence.text for sentence in those))
            )
    return planted


def truth_of(
    planted: Planted, videos: Iterable[tuple[Video, list[Sentence], list[Mishearing], float]]
) -> dict[str, Any]:
    """The truth as plain values, from each video's talk, mishearings and shift."""
    errors, shifts, recurring, languages = [], [], [], []
    tasks: list[dict[str, Any]] = []
    for video, talk, missed, shift in videos:
        about = {"video_id": video.id}
        if video.task and video.case.stage is None:
            tasks.append(about | {"prompt": video.task, "start_s": video.task_start})
        errors += [about | mishearing._asdict() for mishearing in missed]
        shifts += [about | {"shift_s": shift}] if shift else []
        for label, start, end, text in passages(talk):
            times = {"start_s": start, "end_s": end}
            if label in (INTRO, SPONSOR):
                channel = {"channel_id": video.channel.id, "kind": label}
                recurring.append(about | channel | times | {"text": text})
            else:
                languages.append(about | {"language": label} | times)
    # A copy takes the texts of its original's channel along, which don't recur in its own.
    often = Counter((text["channel_id"], text["text"]) for text in recurring)
    recurring = [text for text in recurring if often[text["channel_id"], text["text"]] >= _FEWEST]
    return {
        "seed": planted.seed,
        "hearing": {"rates": planted.rates._asdict(), "errors": errors},
        "shifted": shifts,
        "copies": [{"video_id": copy, "copy_of": of} for copy, of in planted.copies.items()],
        "recurring": recurring,
        "languages": languages,
        "tasks": tasks,
    }
