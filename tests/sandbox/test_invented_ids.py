"""Ids of the invented world can't exist on the real services, and our own readers take them."""

import base64

from kb.sandbox.invented_ids import PEOPLE
from kb.sandbox.world import World


def test_no_id_can_exist_on_the_real_service() -> None:
    world = World(n_channels=9, n_videos=60, n_posts=30, width=40, depth=6)
    for video in world.youtube.videos.values():
        for token, size in ((video.id, 8), (video.channel.id[2:], 16)):
            whole = base64.urlsafe_b64decode(token + "=" * (-len(token) % 4))[:size]
            assert base64.urlsafe_b64encode(whole).decode().rstrip("=") != token
    reddit, (old_posts, old_comments) = world.reddit, world.reddit.archive
    keys = [*reddit.posts, *reddit.comments, *old_posts, *old_comments]
    assert len(set(keys)) == len(keys)
    assert all(int(key, 36) >= 2**63 for key in keys)
    people = {post["author"] for post in reddit.posts.values()} - {"[deleted]"}
    assert people <= set(PEOPLE)
    assert all(len(name) > 20 for name in people)
