"""Commands in messages are completed with the options of this call."""

from pathlib import Path

import pytest

from kb.cli.framework.messages import set_options, with_options


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("run `kb youtube filter` first", "run `kb youtube filter --data 'my data' --profile x`"),
        ("`kb query --tables` lists", "`kb query --tables --data 'my data' --profile x` lists"),
        ("run `kb pairs --data y`", "run `kb pairs --data y --profile x`"),
        ("run `kb models fetch`", "run `kb models fetch`"),
        ("see `kb youtube crawl --help`", "see `kb youtube crawl --help`"),
        ("`kb demo` shows it", "`kb demo` shows it"),
        ("run `pip install x`", "run `pip install x`"),
    ],
)
def test_a_named_command_is_completed_with_what_this_call_was_given(text: str, wanted: str) -> None:
    set_options(Path("my data"), "x")
    try:
        assert wanted in with_options(text)
    finally:
        set_options()
    assert with_options(text) == text
