"""Tests of the invented subreddit."""

from kb.sandbox.reddit.subreddit import Subreddit


def test_every_comment_is_below_its_post_and_one_level_below_its_parent() -> None:
    subreddit = Subreddit(0, 12, width=20, depth=8)
    assert len(subreddit.posts) == 12
    depths = set()
    for comment in subreddit.comments.values():
        assert comment["link_id"].removeprefix("t3_") in subreddit.posts
        kind, _, parent = comment["parent_id"].partition("_")
        above = subreddit.comments[parent]["depth"] if kind == "t1" else -1
        assert comment["depth"] == above + 1
        depths.add(comment["depth"])
    assert max(depths) >= 2


def test_a_seed_makes_the_same_subreddit() -> None:
    first, second = (Subreddit(3, 6, width=5, depth=3) for _ in range(2))
    assert first.posts == second.posts
    assert first.comments == second.comments
    assert first.posts != Subreddit(4, 6, width=5, depth=3).posts


def test_what_is_removed_has_no_text_and_what_is_gone_is_not_shown() -> None:
    subreddit = Subreddit(0, 6, width=5, depth=3)
    removed, gone = list(subreddit.posts)[:2]
    subreddit.removed.add(f"t3_{removed}")
    subreddit.gone.add(f"t3_{gone}")
    shown = subreddit.shown(f"t3_{removed}")
    assert shown is not None
    assert shown["selftext"] == "[removed]"
    assert subreddit.shown(f"t3_{gone}") is None
