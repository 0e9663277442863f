"""No name of a person is left in an answer, wherever it stands; what names nobody stays."""

import hmac
import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kb.core.errors import DamagedData, LimitReached
from kb.reddit.parse.anonymize import Scrubber, load_key
from kb.store.layout import Layout
from tests.reddit.work import Work

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


@pytest.mark.parametrize("key", [b"k" * 64, b"short", b"long" * 50])
@pytest.mark.parametrize("name", [NAME, "ünïcode", "half \ud83d of one"])
def test_the_hash_is_the_standard_one(key: bytes, name: str) -> None:
    lower = name.lower().encode("utf-8", "replace")
    expected = hmac.new(key, lower, "sha256").hexdigest()[:32]
    assert Scrubber(key).hash(name) == expected


def test_a_field_is_looked_at_whatever_other_records_held() -> None:
    """Which fields name people is remembered for all records with the same fields."""
    for value, expected in (
        (None, None),
        ([], Scrubber(b"k" * 64).hash("[]")),
        ("", ""),
        ({"name": NAME}, []),
        (0, SCRUBBER.hash("0")),
        (NAME, HASH),
        (False, False),
    ):
        assert SCRUBBER.scrub({"author": value, "sr_detail": {}}) == {
            "author": expected,
            "sr_detail": {},
        }
    nested = SCRUBBER.scrub({"author": None, "sr_detail": {"author": NAME}})
    assert nested["sr_detail"] == {"author": HASH}


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


def one_post(work: Work) -> None:
    with pytest.raises(LimitReached):
        work.crawl(limit=1)


@pytest.mark.parametrize(
    ("spoil", "what"),
    [
        (lambda path: path.unlink(), "is lost"),
        (lambda path: shutil.rmtree(path.parent), "is lost"),
        (lambda path: path.write_text("0" * 64), "is another key"),
        (lambda path: path.write_text("0" * 63), "is damaged"),
    ],
    ids=["lost", "lost with the state", "another", "cut off"],
)
def test_no_other_key_takes_the_place_of_a_data_root_s(
    work: Work, spoil: Callable[[Path], None], what: str
) -> None:
    """Authors of rows before and after would no longer meet."""
    one_post(work)
    key = Layout(work.root).key("reddit")
    held = key.read_bytes()
    spoil(key)
    after = key.read_bytes() if key.exists() else None
    asked = len(work.sandbox.ledger)
    with pytest.raises(DamagedData, match=what) as error:
        work.crawl()
    assert error.value.exit_code == 1
    assert len(work.sandbox.ledger) == asked  # nothing was sent
    assert (key.read_bytes() if key.exists() else None) == after
    key.write_bytes(held)
    one_post(work)
    # What the line says to type when the key is lost for good.
    key.unlink()
    with pytest.raises(DamagedData) as error:
        work.crawl()
    subprocess.run(error.value.hint.split("`")[1], shell=True, check=True)
    one_post(work)


def test_a_data_root_that_noted_no_key_is_bound_to_the_one_it_has(tmp_path: Path) -> None:
    key = Layout(tmp_path).key("reddit")
    held = load_key(tmp_path)
    (noted,) = Layout(tmp_path).key_marks("reddit")
    noted.unlink()
    assert load_key(tmp_path) == held
    key.write_bytes(b"0" * 64)
    with pytest.raises(DamagedData, match="is another key"):
        load_key(tmp_path)
    assert held.decode() not in noted.name + noted.read_text()
