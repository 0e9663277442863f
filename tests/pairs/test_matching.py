"""Matching: whole words, case-folded, leftmost-longest, across cues, at exact positions."""

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from kb.pairs.extract import Tools
from kb.pairs.matching import Matcher, phrase
from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts
from tests.pairs.reference import find, joined

_PARTS = [
    "creeper",
    "Creepers",
    "CREEPER'S",
    "oak",
    "log",
    "logic",
    "oak logs",
    "oaklog",
    "iron",
    "golem",
    "irongolem",
    "jack",
    "o",
    "lantern",
    "jack-o'-lanterns",
    "block of diamond",
    "blocks of diamonds",
    "cobble stone",
    "ender",
    "dragon",
    "enderdragon",
    "café",
    "CAFE\u0301",
    "CAFÉ",
    "苦力怕",
    "我的苦力怕世界",
    "chest",
    "day",
    "bed",
    "air",
    "the",
    "cree\u00adper",
    "cre\u200beper",
    "creeper\ufe0f",
    "⛏️",
    "🎉",
    "’",
    ",",
    "  ",
    "\n",
    "\u00a0",
    "\u3000",
    "ſtone",
    "K",
    "ẞ",
]
_text = st.lists(st.one_of(st.sampled_from(_PARTS), st.text(max_size=4)), max_size=12).flatmap(
    lambda parts: st.sampled_from([" ", "", ", ", "-"]).map(lambda between: between.join(parts))
)
_time = st.one_of(st.floats(-5, 60), st.sampled_from([0.0, float("nan"), float("inf"), -1.0]))
_cues = st.lists(st.tuples(_time, _time, _text), max_size=8)


@settings(max_examples=100, deadline=None, phases=(Phase.explicit, Phase.generate))
@given(st.lists(st.tuples(st.sampled_from(["asr", "manual"]), _cues), min_size=1, max_size=4))
def test_finds_what_a_slow_obvious_matcher_finds_and_nothing_else(keywords, tools, videos):
    rows = transcripts(*((f"v{number}", kind, cues) for number, (kind, cues) in enumerate(videos)))
    text = Text(rows)
    found = tools.keywords.matcher.find(text.raw)
    video = text.video_of(found.start)
    got = [
        (one, keywords.phrases[phrase], start, end)
        for one, phrase, start, end in zip(
            video.tolist(),
            found.phrase.tolist(),
            text.characters(found.start, video).tolist(),
            text.characters(found.end, video).tolist(),
            strict=True,
        )
    ]
    expected = [
        (number, *hit)
        for number, row in enumerate(rows.to_pylist())
        for hit in find(joined(row["cues"]), list(keywords.phrases))
    ]
    assert got == expected


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("oak logic", ["oak"]),
        ("oak log", ["oak log"]),
        ("oak oak log log", ["oak", "oak log", "log"]),
        ("Iron\nGOLEM", ["Iron\nGOLEM"]),
        ("a soakoak creepery creeper.", ["creeper"]),
        ("the creeper's jack-o'-lantern", ["creeper", "jack-o'-lantern"]),
        ("ender — dragon!", ["ender — dragon"]),
        ("minecraft_creeper_2", ["creeper"]),
    ],
)
def test_words(tools: Tools, said: str, expected: list[str]) -> None:
    raw = f" {said} ".encode()
    found = tools.keywords.matcher.find(raw)
    assert [
        raw[start:end].decode()
        for start, end in zip(found.start.tolist(), found.end.tolist(), strict=True)
    ] == expected


@pytest.mark.parametrize(
    ("keywords", "said", "expected"),
    [
        (("釉薬", "窯"), "窯を開けると釉薬が青い", ["窯", "釉薬"]),
        (("苦力怕", "下界"), "我的苦力怕在下界 苦力怕", ["苦力怕", "下界", "苦力怕"]),
        (("ดินเหนียว",), "ปั้นดินเหนียวก่อน", ["ดินเหนียว"]),
        (("ដីឥដ្ឋ",), "ខ្ញុំចូលចិត្តដីឥដ្ឋណាស់", ["ដីឥដ្ឋ"]),
        (("TNT", "TNT爆弾"), "大きなTNT爆弾とTNTを置く", ["TNT爆弾", "TNT"]),
        (("釉薬 皿",), "釉薬、皿。釉薬皿", ["釉薬、皿", "釉薬皿"]),
        (("kiln", "釉薬"), "the kilns 釉薬 kiln", ["釉薬", "kiln"]),
        (("가마",), "가마를 열고 가마 안을", ["가마"]),  # Korean has spaces
    ],
)
def test_a_keyword_is_found_where_no_spaces_are(
    keywords: tuple[str, ...], said: str, expected: list[str]
) -> None:
    raw = f" {said} ".encode()
    found = Matcher([phrase(one) for one in keywords]).find(raw)
    spans = zip(found.start.tolist(), found.end.tolist(), strict=True)
    assert [raw[start:end].decode() for start, end in spans] == expected


def test_a_phrase_may_cross_cues_but_not_videos(tools: Tools) -> None:
    rows = transcripts(
        ("a", "asr", [(0, 2, "look an iron"), (2, 2, "golem and an iron")]),
        ("b", "asr", [(0, 2, "golem here")]),
    )
    text = Text(rows)
    found = tools.keywords.matcher.find(text.raw)
    assert [
        text.raw[start:end]
        for start, end in zip(found.start.tolist(), found.end.tolist(), strict=True)
    ] == [b"iron golem"]


def test_no_keyword_at_all() -> None:
    assert len(Matcher([]).find(b" creeper ").phrase) == 0
    assert len(Matcher(["creeper"]).find(b"  ").phrase) == 0
