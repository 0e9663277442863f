"""Who took a post or comment away, and when that was known: Reddit's word and the archive's."""

from typing import Any

import pytest

from kb.reddit.parse.removal import removal, retrieved


@pytest.mark.parametrize(
    ("thing", "expected"),
    [
        ({"selftext": "words", "title": "t", "author": "x"}, None),
        ({"body": "[deleted]", "author": "[deleted]"}, ("deleted", "[deleted]")),
        ({"body": "words", "author": "[deleted]"}, None),
        ({"body": "[removed]"}, ("removed", "[removed]")),
        ({"body": "[ Removed by Reddit ]"}, ("removed", "[ Removed by Reddit ]")),
        ({"selftext": "", "removed_by_category": "moderator"}, ("removed", "moderator")),
        (
            {"selftext": "", "removed_by_category": "automod_filtered"},
            ("removed", "automod_filtered"),
        ),
        ({"selftext": "", "removed_by_category": "deleted"}, ("deleted", "deleted")),
        ({"selftext": "[deleted]", "removed_by_category": "author"}, ("deleted", "author")),
        ({"selftext": "", "title": "[deleted by user]"}, ("deleted", "[deleted by user]")),
        (
            {"selftext": "", "title": "[ Removed by moderator ]"},
            ("removed", "[ Removed by moderator ]"),
        ),
        (
            {"selftext": "words", "is_robot_indexable": False},
            ("removed", "is_robot_indexable is false"),
        ),
    ],
)
def test_who_took_it_away(thing: dict[str, Any], expected: tuple[str, str] | None) -> None:
    gone = removal(thing)
    assert (gone and gone[:2]) == expected


PLACEHOLDERS = {
    "deleted": (
        *("[deleted]", "[Deleted]", " [deleted]\n", "[ deleted ]", "[deleted by user]"),
        *(
            "[ Deleted by User ]",
            "[deleted by its author]",
            "[removed by user]",
            "\N{NO-BREAK SPACE}[deleted]",
        ),
    ),
    "removed": (
        *("[removed]", "[REMOVED]", "\t[removed] \n", "[ Removed ]", "[removed by reddit]"),
        *("[ Removed by Reddit ]", "[Removed by moderator]", "[ removed by moderators ]"),
        *("[deleted by moderator]", "[removed by a mod]", "[removed by AutoModerator]"),
        *("[removed by the admins]", "[ Removed by Anti-Evil Operations ]"),
        "[ Removed by Reddit in response to a legal request. ]",
        "[ removed by reddit in response to a copyright notice ]",
        "[ Removed by Reddit on account of violating the [content policy](/help/contentpolicy). ]",
        *(
            "[removed too quickly to be archived]",
            "\\[removed\\]",
            "**[removed]**",
            "[removed]\u200b",
        ),
        *("[removed by the subreddit moderators]", "[ Removed by Reddit admins ]"),
        *("[Comment removed by moderator]", "[ Post removed by moderator ]"),
        *(
            "[[removed]](https://www.reddit.com/r/a)",
            "[\\[removed\\]](/r/a)",
            "[ [removed] ](a_(b))",
        ),
        *('**[[ Removed by Reddit ]](/help "Why")**', "[**[removed]**](a)", "[[removed]]()"),
        "[[Removed by Reddit]](https://www.reddit.com/" + "long/" * 100 + ")",
        '<a href="/r/a">[removed]</a>',
    ),
    None: (
        *("removed", "deleted", "[removed", "removed]", "[]", "", "[removed] and [deleted]"),
        *("[removed] sorry, wrong world", "the answer was [removed]", "> [removed]"),
        *("[removed the torches]", "[removed by me, it was wrong]", "[deleted my world]"),
        *("[removed by mods] again?", "[removed by reddit] in response to [what]", "[removed](a)"),
        *("[[removed]](a) was the answer", "[[removed] it](a)", "[[removed]](a) [[removed]](b)"),
        *("see [[removed]](a)", "[[my world]](a)", '<a href="a">removed</a>', "[[removed]]"),
        *("[moderators]", "[remove]", "[deleted.schematic]", "`[deleted]`", 5, None, ["[deleted]"]),
        "[removed by reddit in response to " + "words " * 60 + "]",
    ),
}


@pytest.mark.parametrize(
    ("text", "reason"), [(text, why) for why, texts in PLACEHOLDERS.items() for text in texts]
)
@pytest.mark.parametrize("field", ["selftext", "body", "title"])
def test_words_of_the_site_in_place_of_a_text(field: str, text: Any, reason: str | None) -> None:
    gone = removal({field: text, "author": "0" * 32})
    assert (gone and gone.reason) == reason


LATER = {"was_deleted_later": True}


@pytest.mark.parametrize(
    ("meta", "reason"),
    [
        *((LATER | {"removal_type": kind}, "deleted") for kind in ("deleted", "author")),
        *((LATER | {"removal_type": kind}, "deleted") for kind in ("Deleted", " AUTHOR ")),
        *((LATER | {"removal_type": kind}, "deleted") for kind in ("[deleted]", "deleted_by_user")),
        *(
            (LATER | {"removal_type": kind}, "removed")
            for kind in (
                *("moderator", "reddit", "removed", "removed by reddit", "[ Removed by Reddit ]"),
                *("automod_filtered", "content_takedown", "copyright_takedown", "anti_evil_ops"),
                *("something new", "not deleted", "", None, 3, ["deleted"], {"author": "deleted"}),
            )
        ),
        (LATER, "removed"),
        ({"was_deleted_later": 1, "removal_type": "deleted"}, "deleted"),
        ({"was_deleted_later": "True"}, "removed"),
        ({**LATER, "was_initially_deleted": True, "removal_type": "deleted"}, "deleted"),
        # Nobody says at which visit it was gone.
        ({"removal_type": "author"}, "deleted"),
        ({"removal_type": "moderator", "was_deleted_later": "perhaps"}, "removed"),
        ({"removal_type": "moderator", "was_initially_deleted": False}, "removed"),
        ({"was_initially_deleted": True}, None),
        ({"was_initially_deleted": True, "removal_type": "removed"}, None),
        ({"was_initially_deleted": "true", "removal_type": "author", "x": 1}, None),
        ({"was_deleted_later": False, "removal_type": "removed"}, None),
        ({"was_deleted_later": None}, None),
        ({"was_deleted_later": "perhaps"}, None),
        ({"was_deleted_later": [True]}, None),
        ({"removal_type": 7}, None),
        ({"removal_type": " "}, None),
        ({"is_edited": True}, None),
        *((odd, None) for odd in ({}, None, "was_deleted_later", ["was_deleted_later"], 1, True)),
    ],
)
@pytest.mark.parametrize("text", [{"selftext": "words", "title": "t"}, {"body": "words"}])
def test_what_an_archive_found_at_its_second_visit(
    text: dict[str, str], meta: Any, reason: str | None
) -> None:
    gone = removal({**text, "author": "0" * 32, "_meta": meta})
    assert (gone and gone.reason) == reason


@pytest.mark.parametrize(
    ("record", "reason"),
    [
        # What came back between the visits keeps the fields of the first one.
        ({"selftext": "words", "removed_by_category": "automod_filtered"}, None),
        ({"selftext": "words", "is_robot_indexable": False}, None),
        ({"selftext": "[removed]"}, "removed"),
        ({"body": "[deleted]"}, "deleted"),
        ({"selftext": "", "title": "[deleted by user]"}, "deleted"),
    ],
)
def test_of_what_came_back_the_text_counts(record: dict[str, Any], reason: str | None) -> None:
    gone = removal({**record, "_meta": {"was_initially_deleted": True}})
    assert (gone and gone.reason) == reason


def test_the_record_says_who_where_the_archive_only_says_that() -> None:
    record = {"body": "[deleted]", "_meta": LATER}
    assert removal(record) == ("deleted", "[deleted]", False)


FIRST, SECOND = 1_720_000_000, 1_720_130_000


@pytest.mark.parametrize(
    ("record", "at"),
    [
        ({"retrieved_on": FIRST, "_meta": {"retrieved_2nd_on": SECOND}}, SECOND),
        ({"retrieved_on": str(FIRST), "_meta": {"retrieved_2nd_on": str(SECOND)}}, SECOND),
        ({"retrieved_utc": FIRST, "_meta": {"retrieved_2nd_on": float(SECOND)}}, SECOND),
        ({"_meta": {"retrieved_2nd_on": SECOND}}, SECOND),
        ({"retrieved_on": "soon", "_meta": {"retrieved_2nd_on": SECOND}}, SECOND),
        *(
            ({"retrieved_on": FIRST, "_meta": meta}, FIRST)
            for meta in (
                *(None, {}, [], "odd", SECOND, {"retrieved_2nd_on": None}),
                *({"retrieved_2nd_on": odd} for odd in ("soon", True, -1, [], {}, 10**13, 0)),
                {"retrieved_2nd_on": FIRST - 1},  # no second visit is before the first
            )
        ),
        ({"_meta": {"retrieved_2nd_on": "soon"}}, None),
    ],
)
def test_a_record_is_of_the_last_visit(record: dict[str, Any], at: int | None) -> None:
    assert retrieved(record) == at
    gone = removal({**record, "body": "[deleted]"})
    assert gone is not None
    assert gone.dated == (at is not None)


@pytest.mark.parametrize(
    ("second", "dated"), [(SECOND, True), (None, False), ("soon", False), (FIRST - 1, False)]
)
def test_a_later_removal_is_not_of_the_first_visit(second: Any, dated: bool) -> None:
    meta = {**LATER, "retrieved_2nd_on": second}
    gone = removal({"body": "words", "retrieved_on": FIRST, "_meta": meta})
    assert gone == ("removed", "was_deleted_later", dated)
