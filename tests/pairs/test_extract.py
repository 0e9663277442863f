"""Rows of pairs: what holds for every pair of any transcript."""

import re
from itertools import pairwise

import pyarrow as pa
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from kb.pairs.clip_tokens import ENDS, Tokens
from kb.pairs.extract import Tools, pairs_of
from kb.pairs.matching import phrase
from kb.pairs.transcript_batch import Text
from kb.schema import conform
from tests.pairs.conftest import transcripts
from tests.pairs.reference import joined
from tests.pairs.test_matching import _PARTS


def rows_of(tools: Tools, rows: pa.Table, lengths: list | None = None) -> list[dict]:
    """Pairs of a batch, sorted as they are written."""
    made = pairs_of(Text(rows, pa.array(lengths, pa.float64()) if lengths else None), tools).rows
    return sorted(
        made.to_pylist(), key=lambda row: (row["video_id"], row["clip_start_s"], row["pair_id"])
    )


# No shrinking: a failing example is printed as it is, where making it small takes longer than
# reading it.
_FILLER = [
    "the",
    "so",
    "Ünïcödé",
    "supercalifragilisticexpialidocious",
    "x" * 300,
    "https://example.com/a/b/c?d=e&f=g",
    "我们今天玩我的世界真的非常好玩",
    "🎉🎉",
]
_text = st.lists(
    st.one_of(st.sampled_from(_PARTS + _FILLER), st.sampled_from(["creeper", "oak log"])),
    max_size=14,
).map(" ".join)
_time = st.one_of(st.floats(0, 120), st.sampled_from([0.0, -3.0, float("nan")]))
_video = st.tuples(
    st.sampled_from(["asr", "manual", "translated"]),
    st.lists(st.tuples(_time, _time, _text), max_size=10),
    st.one_of(st.none(), st.floats(0.5, 200), st.just(0.0)),
)
_rules = st.fixed_dictionaries(
    {},
    optional={
        "center": st.just("grown"),
        "min_gap_s": st.sampled_from([-8.0, 3.0]),
        "max_pairs_per_video": st.integers(1, 3),
        "max_tokens": st.sampled_from([16, 30]),
    },
)


@settings(max_examples=100, deadline=None, phases=(Phase.explicit, Phase.generate))
@given(st.lists(_video, min_size=1, max_size=3), _rules)
def test_every_pair(keywords, with_section, tools, videos, rules):
    tools_ = with_section(**rules)
    section = tools_.section
    rows = transcripts(
        *((f"v{number}", kind, cues) for number, (kind, cues, _) in enumerate(videos))
    )
    text = Text(rows, pa.array([length for _, _, length in videos], pa.float64()))
    made, counts, *_ = pairs_of(text, tools_)
    conform("pairs/pairs", made)
    whole = {row["video_id"]: joined(row["cues"]) for row in rows.to_pylist()}
    length = dict(zip(text.ids.to_pylist(), (text.length / 1000).tolist(), strict=True))
    clips: dict[str, list[tuple[float, float]]] = {}
    assert counts.totals["pairs"] == made.num_rows
    for row in made.to_pylist():
        spoken, end = whole[row["video_id"]], length[row["video_id"]]
        match = spoken[row["match_start_char"] : row["match_end_char"]]
        owner = keywords.every[keywords.of[keywords.phrases.index(phrase(match))]]
        assert (row["keyword"], row["keyword_kind"]) == (owner.name, owner.kind)
        assert f" {phrase(match)} " in f" {phrase(row['text'])} "
        assert (
            row["text_start_char"]
            <= row["match_start_char"]
            < row["match_end_char"]
            <= row["text_end_char"]
        )
        assert row["text"] == " ".join(
            spoken[row["text_start_char"] : row["text_end_char"]].split()
        )
        assert row["token_count"] == tools.tokens.count(row["text"]) + 2 <= section.max_tokens
        assert row["token_count"] >= section.min_tokens or _stuck(
            tools, spoken, row, section.max_tokens
        )
        assert 0 <= row["clip_start_s"] <= row["center_s"] <= row["clip_end_s"] <= end + 1e-9
        assert row["clip_end_s"] - row["clip_start_s"] == pytest.approx(
            min(end, max(8, min(16, row["clip_end_s"] - row["clip_start_s"]))), abs=1e-6
        )
        phrase_s = row["match_end_s"] - row["match_start_s"]
        clip_s = row["clip_end_s"] - row["clip_start_s"]
        within = (
            row["clip_start_s"] <= row["match_start_s"] and row["match_end_s"] <= row["clip_end_s"]
        )
        assert row["match_in_clip"] == within
        assert within or phrase_s > clip_s
        low = high = "text" if section.center == "grown" else "segment"
        # Times of cues that are out of order need not hold the phrase; the clip does.
        if (
            row[f"{low}_start_s"]
            <= row["match_start_s"]
            < row["match_end_s"]
            <= row[f"{high}_end_s"]
        ):
            assert row[f"{low}_start_s"] <= row["center_s"] <= row[f"{high}_end_s"]
        assert (
            row["segment_start_s"]
            <= row["match_start_s"]
            < row["match_end_s"]
            <= row["segment_end_s"]
            <= end
        )
        clips.setdefault(row["video_id"], []).append((row["clip_start_s"], row["clip_end_s"]))
    for one in clips.values():
        one.sort()
        assert section.max_pairs_per_video == 0 or len(one) <= section.max_pairs_per_video
        if section.min_gap_s >= 0:
            assert all(
                after[0] - before[1] >= section.min_gap_s - 1e-6 for before, after in pairwise(one)
            )


def _stuck(tools, spoken, row, most):
    """Whether one more character on either side would be too many tokens:
    the only reason for a short text.
    """
    left, right = len(spoken[: row["text_start_char"]].rstrip()), row["text_end_char"]
    right += len(spoken[right:]) - len(spoken[right:].lstrip())
    longer = [spoken[left - 1 : row["text_end_char"]]] if left else []
    longer += [spoken[row["text_start_char"] : right + 1]] if right < len(spoken) else []
    return all(tools.tokens.count(" ".join(one.split())) + 2 > most for one in longer)


@settings(max_examples=60, deadline=None, phases=(Phase.explicit, Phase.generate))
@given(st.lists(_video, min_size=2, max_size=4), st.randoms())
def test_a_pair_depends_on_its_own_video_alone(tools, videos, random):
    named = [(f"v{number}", kind, cues) for number, (kind, cues, _) in enumerate(videos)]
    lengths = [length for _, _, length in videos]
    together = rows_of(tools, transcripts(*named), lengths)
    apart = [
        row
        for one, length in zip(named, lengths, strict=True)
        for row in rows_of(tools, transcripts(one), [length])
    ]
    order = list(range(len(named)))
    random.shuffle(order)
    mixed = rows_of(tools, transcripts(*(named[at] for at in order)), [lengths[at] for at in order])
    assert together == apart == mixed


def test_another_seed_draws_other_pairs(tools) -> None:
    rows = transcripts(
        (
            "v",
            "asr",
            [
                (at * 4, 4, "and then the creeper walks to the oak log over there")
                for at in range(40)
            ],
        )
    )
    first, again, other = (
        rows_of(tools, rows),
        rows_of(tools, rows),
        rows_of(tools._replace(seed=1), rows),
    )
    assert first == again
    assert {row["pair_id"] for row in first}.isdisjoint(row["pair_id"] for row in other)
    assert len({row["token_count"] for row in first}) > 5


def test_times_inside_a_cue_follow_the_place_of_the_word(tools) -> None:
    rows = transcripts(
        ("a", "manual", [(10, 4, "one two creeper four")]),
        ("b", "manual", [(20, 8, "an iron"), (28, 2, "golem there")]),
    )
    times = [
        (
            row["keyword"],
            row["match_start_s"],
            row["match_end_s"],
            row["segment_start_s"],
            row["segment_end_s"],
        )
        for row in rows_of(tools, rows, [300.0] * 2)
    ]
    assert times == [("Creeper", 12.0, 13.0, 10.0, 14.0), ("Iron Golem", 24.0, 29.0, 20.0, 30.0)]


def test_cues_of_automatic_tracks_end_where_the_next_begins(tools) -> None:
    cues = [(0.0, 5.0, "a creeper comes"), (2.0, 5.0, "very very slowly")]
    asr, manual = (
        rows_of(tools, transcripts(("v", kind, cues)), [60.0])[0] for kind in ("asr", "manual")
    )
    assert (asr["segment_end_s"], manual["segment_end_s"]) == (2.0, 5.0)


def test_everyday_words_need_an_unmistakable_one_nearby(tools) -> None:
    def found(said: str) -> set[str]:
        counts = pairs_of(Text(transcripts(("v", "asr", [(0, 9, said)]))), tools).counts
        every = [
            (keyword.name, counts.of(number)) for number, keyword in enumerate(tools.keywords.every)
        ]
        return {
            name for name, hits in every if hits.get("matches", 0) > hits.get("ambiguous_alone", 0)
        }

    assert found("i went to bed") == set()
    assert found("a bed and a chest") == set()  # two everyday words prove nothing
    assert found("a creeper by the bed") == {"Creeper", "Bed"}
    assert found("a creeper one two three four five six bed") == {"Creeper"}
    assert found("bed one two three four creeper") == {"Creeper", "Bed"}
    assert found("creeper air") == {"Creeper"}
    assert found("creeper chest day") == {"Creeper"}


def test_counts(tools) -> None:
    rows = transcripts(
        ("v", "asr", [(0, 9, "creeper bed air chest day")]), ("w", "asr", [(0, 9, "my bed")])
    )
    counts = pairs_of(Text(rows), tools).counts
    totals = {
        name: counts.totals[name]
        for name in (
            "videos",
            "words",
            "matches",
            "ambiguous",
            "ambiguous_alone",
            "excluded",
            "pairs",
        )
    }
    assert totals == {
        "videos": 2,
        "words": 7,
        "matches": 4,
        "ambiguous": 3,
        "ambiguous_alone": 2,
        "excluded": 1,
        "pairs": 1,
    }


def test_matches_after_the_end_of_the_video_make_no_pair(tools) -> None:
    made, counts, *_ = pairs_of(
        Text(transcripts(("v", "asr", [(0, 5, "creeper"), (100, 5, "creeper")])), pa.array([60.0])),
        tools,
    )
    assert made.num_rows == counts.totals["outside"] == 1


@pytest.mark.parametrize(
    ("cues", "match", "segment"),
    [
        ([(1.0, 2.0, "so a creeper came", [1.0, 30.0, 30.5, 31.0])], (30.5, 31.0), (1.0, 32.0)),
        ([(5.0, 1.0, "see the creeper", [5.0, 5.5, 6.0])], (6.0, 7.0), (5.0, 7.0)),
        ([(5.0, 1.0, "a creeper", [5.0, 6.0]), (6.25, 1.0, "x")], (6.0, 6.25), (5.0, 6.25)),
        ([(5.0, 9.0, "creeper came", [2.0, 5.0])], (2.0, 3.0), (2.0, 14.0)),
        ([(5.0, 1.0, "creeper came by", [5.0, 5.0, 5.5])], (5.0, 5.5), (5.0, 6.0)),
        ([(5.0, 0.0, "creeper")], (5.0, 6.0), (5.0, 6.0)),
        ([(5.0, 0.0, "creeper"), (5.5, 1.0, "x")], (5.0, 5.5), (5.0, 5.5)),
    ],
)
def test_a_cue_holds_its_words_and_a_match_has_a_length(tools, cues, match, segment) -> None:
    (row,) = rows_of(tools, transcripts(("v", "asr", cues)), [60.0])
    assert (row["match_start_s"], row["match_end_s"]) == match
    assert (row["segment_start_s"], row["segment_end_s"]) == segment


def test_words_after_the_end_of_the_video_make_no_pair(tools) -> None:
    cues = [(1.0, 2.0, "the creeper the creeper", [1.0, 2.0, 70.0, 71.0])]
    (row,) = rows_of(tools, transcripts(("v", "asr", cues)), [60.0])
    assert row["match_start_s"] == 2.0


@pytest.mark.parametrize(
    "cues",
    [
        [],
        [(0, 0, "")],
        [(0.0, 0.0, "creeper")],
        [(5.0, -3.0, "a creeper")],
        [(9.0, 1.0, "log"), (1.0, 1.0, "oak")],
        [(0.0, 5.0, "creeper 🎉 creeper"), (0.0, 5.0, "creeper")],
        [(0.0, 3.0, "我们 creeper 今天")],
        [(float("inf"), 1.0, "creeper")],
        [(0.0, 1.0, " \n\t "), (1.0, 1.0, "\u00a0")],
    ],
)
def test_strange_transcripts_have_defined_results(tools, cues) -> None:
    for lengths in ([None], [0.0], [4.0], [3600.0]):
        for row in rows_of(tools, transcripts(("v", "asr", cues)), lengths):
            assert row["text"]
            assert row["token_count"] >= 3


def test_sounds_are_in_no_text_and_no_match(tools) -> None:
    words = " ".join(f"word{n}" for n in range(30))
    said = f"[Música] {words} [Applause] >> a creeper [Creeper hissing] {words} [ __ ]"
    (row,) = rows_of(tools, transcripts(("v", "asr", [(0, 60, said)])))
    assert not set("[]>") & set(row["text"])
    assert "hissing" not in row["text"]
    assert said[row["match_start_char"] : row["match_end_char"]] == "creeper"
    cut = said[row["text_start_char"] : row["text_end_char"]]
    spoken = re.sub(r"\[[^\]]*\]|>>", "", cut)
    assert row["text"] == " ".join(spoken.split())
    assert row["token_count"] == Tokens().count(row["text"]) + ENDS


def test_cues_out_of_order_are_read_in_the_order_of_their_time(tools) -> None:
    rows = rows_of(tools, transcripts(("v", "asr", [(9.0, 1.0, "log"), (1.0, 1.0, "oak")])), [60.0])
    assert [(row["keyword"], row["text"]) for row in rows] == [("Oak Log", "oak log")]


def test_a_stream_of_ten_hours(minecraft) -> None:
    cues = [
        (at * 3.0, 5.0, "so the creeper blew up my oak log house again and") for at in range(12_000)
    ]
    rows = rows_of(minecraft, transcripts(("v", "asr", cues)), [36_000.0])
    assert 1500 < len(rows) < 4500
    assert rows[-1]["clip_end_s"] <= 36_000


def test_a_crowd_at_one_moment(tools) -> None:
    cues = [(0.0, 0.0, "creeper oak log creeper iron golem")] * 5_000
    assert len(rows_of(tools, transcripts(("v", "asr", cues)), [600.0])) == 1
