"""No name of a person is left in an answer, wherever it stands; what names nobody stays."""

from __future__ import annotations

import json
from typing import Any

import pytest

from kb.reddit.authors import Scrubber

NAME = "SecretName77"
SCRUBBER = Scrubber(b"k" * 64)
HASH = SCRUBBER.hash(NAME)


@pytest.mark.parametrize(
    "record",
    [
        {"author": NAME, "author_fullname": f"t2_{NAME}", "author_flair_text": NAME},
        {
            "url": f"/user/{NAME}/comments/p1/my_title/",
            "url_overridden_by_dest": f"https://old.reddit.com/u/{NAME}",
        },
        {
            "permalink": f"/r/u_{NAME}/comments/p1/my_title/",
            "link_permalink": f"https://www.reddit.com/user/{NAME}/comments/p1/",
        },
        {
            "subreddit": f"u_{NAME}",
            "subreddit_name_prefixed": f"u/{NAME}",
            "domain": f"self.u_{NAME}",
        },
        {
            "crosspost_parent_list": [
                {
                    "subreddit": f"u_{NAME}",
                    "link_url": f"https://reddit.com/user/{NAME}/comments/p1/?a=b",
                }
            ]
        },
        {
            "sr_detail": {
                "display_name": f"u_{NAME}",
                "title": NAME,
                "public_description": f"I am {NAME}",
                "url": f"/user/{NAME}/",
            }
        },
        {
            "mod_reason_by": NAME,
            "mod_note": f"by {NAME}",
            "approved_by": NAME,
            "mod_reports": [["spam", NAME]],
            "awarders": [NAME],
        },
        {"media": {"oembed": {"author_name": NAME, "author_url": f"https://youtube.com/{NAME}"}}},
    ],
)
def test_a_name_is_hashed_wherever_it_stands(record: dict[str, Any]) -> None:
    before = json.dumps(record)
    assert NAME in before
    after = json.dumps(SCRUBBER.scrub(json.loads(before)))
    assert NAME not in after
    assert set(json.loads(before)) == set(json.loads(after))


def test_an_address_of_a_profile_keeps_its_form() -> None:
    record = SCRUBBER.scrub(
        {
            "url": f"https://www.reddit.com/user/{NAME}/comments/p1/a_title/",
            "subreddit_name_prefixed": f"u/{NAME}",
        }
    )
    assert record == {
        "url": f"https://www.reddit.com/user/{HASH}/comments/p1/a_title/",
        "subreddit_name_prefixed": f"u/{HASH}",
    }


def test_a_name_of_digits_that_came_as_a_number() -> None:
    assert SCRUBBER.scrub({"author": 4711}) == SCRUBBER.scrub({"author": "4711"})


def test_what_names_nobody_stays() -> None:
    record = {
        "subreddit": "Minecraft",
        "title": f"a word of {NAME}",
        "url": "https://example.com/user/guide/page",
        "permalink": "/r/Minecraft/comments/p1/my_title/",
        "domain": "self.Minecraft",
        "author": "[deleted]",
        "author_created_utc": 1_500_000_000,
        "author_premium": False,
        "sr_detail": {"display_name": "Minecraft", "title": "The blocks"},
    }
    assert SCRUBBER.scrub(json.loads(json.dumps(record))) == record
