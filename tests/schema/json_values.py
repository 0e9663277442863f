"""Strategies for values of JSON, and for the cues of transcripts as services may send them."""

from datetime import datetime
from typing import Any

from hypothesis import strategies as st

scalars = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text()
)


anything = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)


def digits(value: Any) -> bool:
    return isinstance(value, str) and value.isascii() and value.isdigit() and int(value) < 2**63


digit_texts = st.integers(0, 10**6).map(str)


# hypothesis wants bounds without a zone.
moments = st.datetimes(datetime(1970, 1, 1), datetime(2100, 1, 1))  # noqa: DTZ001


# What stands in recorded answers, and what a service might send one day.
number = st.floats(0, 1e5) | st.integers(-5, 10**6)


odd_number = st.sampled_from([-0.0, 2**53, 2**53 + 1, -(2**53) - 1, 2**64, 10**30, True, "1", None])


nan = st.sampled_from([float("nan"), float("inf")])  # json.loads takes them


words = st.text("ab \n♪é", max_size=9)


odd_words = st.sampled_from(["a\0b", "\ud800", "\\u0000", None, 3, ["a"]])


good_cue = st.tuples(number, number, words)


odd_cue = st.tuples(number | odd_number | nan, number | odd_number, words | odd_words)


def in_columns(cues: list[Any]) -> dict[str, list[Any]]:
    """Cues as the raw answer has them: a list for each field."""
    return {name: [cue[at] for cue in cues] for at, name in enumerate(_FIELDS)}


_FIELDS = ("start_s", "duration_s", "text")
_some = number | odd_number | words | odd_words


good_cues = st.none() | st.lists(good_cue, max_size=4).map(in_columns)


odd_cues = (
    st.lists(good_cue | odd_cue, max_size=4).map(in_columns)
    | st.dictionaries(st.sampled_from(_FIELDS), st.lists(_some, max_size=2) | scalars)
    | st.lists(good_cue, max_size=2)
    | scalars
)


transcript = st.fixed_dictionaries(
    {"video_id": st.just("a"), "format": st.just(2)},
    optional={
        "outcome": st.sampled_from(["ok", "none", 5, None]),
        "cues": good_cues | odd_cues,
        "kind": st.sampled_from(["asr", None]) | anything,
        "player": st.none()
        | anything
        | st.fixed_dictionaries(
            {}, optional={"width": st.integers(-1, 9) | anything, "fps": anything}
        ),
        "brand_new": anything,
    },
)
