"""What is said in the invented world: as long as its video, grammatical, each video its own."""

import re
from collections import Counter

import pytest

from kb.core import clock
from kb.sandbox.speech import MUSIC, Noun, Speech, grammar
from kb.sandbox.world import World
from kb.sandbox.youtube.cases import Track


@pytest.fixture(scope="module")
def world() -> World:
    return World(n_channels=9, n_videos=60, n_posts=30, width=20, depth=6)


def noun(title: str) -> Noun:
    return Noun.of(title, grammar().mass.split(), grammar().singular.split())


@pytest.mark.parametrize(
    ("title", "a", "phrase", "are", "more"),
    [
        ("Iron Sword", "an iron sword", "the iron sword", "is", "another iron sword"),
        ("Oak Planks", "oak planks", "the oak planks", "are", "more oak planks"),
        ("White Wool", "white wool", "white wool", "is", "more white wool"),
        ("Blind Baking", "blind baking", "blind baking", "is", "more blind baking"),
        ("The Nether", "a nether", "the nether", "is", "another nether"),
        ("Bale of Hay", "a bale of hay", "the bale of hay", "is", "another bale of hay"),
        ("Compass", "a compass", "the compass", "is", "another compass"),
        ("Unicorn", "a unicorn", "the unicorn", "is", "another unicorn"),
    ],
)  # fmt: skip
def test_nouns_take_their_article_and_verb(
    title: str, a: str, phrase: str, are: str, more: str
) -> None:
    made = noun(title)
    assert (made.form("a"), made.form(), made.form("are"), made.form("more")) == (
        a, phrase, are, more,
    )  # fmt: skip


def test_transcripts_are_as_long_as_their_videos(world: World) -> None:
    for video in world.youtube.videos.values():
        for track in video.tracks:
            cues = world.youtube.cues(video, track)
            words = sum(len(text.split()) for _, _, text, _ in cues)
            assert all(start >= 0 for start, *_ in cues)
            assert max(start for start, *_ in cues) < video.seconds
            if 60 <= video.seconds < 2_400 and track.language.startswith("en"):
                assert cues[-1][0] > video.seconds - 15
                assert 110 < 60 * words / video.seconds < 210, (video.id, video.seconds)


def test_the_tracks_of_a_video_say_the_same_each_in_its_form(world: World) -> None:
    video = next(one for one in world.youtube.videos.values() if one.case.name == "asr")
    automatic = [text for _, _, text, _ in world.youtube.cues(video, Track("en", "asr"))]
    manual = [text for _, _, text, _ in world.youtube.cues(video, Track("en"))]
    said = " ".join(text for text in manual if text != MUSIC)
    heard = " ".join(text for text in automatic if text != MUSIC)
    assert heard == heard.lower()
    assert not re.search(r"[.,?!;:]", heard)
    misheard = {one["video_id"] for one in world.truth["hearing"]["errors"]}
    assert video.id not in misheard
    assert heard == re.sub(r"[.,?!;:]", "", said).lower()
    assert re.match(r"[A-Z].*[.?!]$", said)
    assert video.cast.subject.name in heard


def test_no_video_repeats_another_wholesale(world: World) -> None:
    spoken = []
    for video in world.youtube.videos.values():
        rng = clock.rng(world.seed, "talk", video.id)
        talk = world.domain.speech.talk(rng, video.cast, min(video.seconds, 3_600), "en")
        spoken.append({one.text for one in talk if len(one.text.split()) > 6})
    often = Counter(text for video in spoken for text in video)
    for video in spoken:
        if len(video) >= 20:
            assert sum(often[text] > 1 for text in video) <= len(video) / 5


def test_sentences_have_no_slot_left_and_agree(world: World) -> None:
    texts = [
        text
        for video in list(world.youtube.videos.values())[:40]
        for track in video.tracks[:1]
        for _, _, text, _ in world.youtube.cues(video, track)
    ]
    texts += [post["title"] + " " + post["selftext"] for post in world.reddit.posts.values()]
    said = " ".join(texts).lower()
    assert not re.search(r"[{}]", said)
    assert not re.search(r"\ba [aeio]\w", said)
    assert not re.search(r"[.?!] the oak planks (?:is|was|has)\b", said)


def test_comments_are_about_their_post(world: World) -> None:
    named = asked = 0
    for comment in world.reddit.comments.values():
        number = list(world.reddit.posts).index(comment["link_id"][3:])
        cast = world.reddit._cast(number)
        names = [one.name for one in (cast.subject, *cast.others)]
        asked += 1
        named += any(name in comment["body"].lower() for name in names)
        assert "watching" not in comment["body"]
    assert named > asked * 0.7


def test_a_domain_of_one_keyword_has_a_voice_too() -> None:
    speech = Speech(["Kiln"], ["Pottery"])
    rng = clock.rng("one keyword")
    cast = speech.cast(rng)
    assert "kiln" in speech.text("comment", rng, cast, 3).lower() + speech.title(rng, cast).lower()
    assert speech.talk(rng, cast, 90, "en")
