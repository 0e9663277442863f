"""What a post is, by what it holds; which address is a picture, a film or neither."""

from typing import Any

import pytest

from kb.core.config.profile import load_profile
from kb.reddit.parse.records import is_crosspost, link_classifier, poll_options, post_type

CLASSIFY = link_classifier(load_profile("minecraft").section("reddit").links)


@pytest.mark.parametrize(
    ("address", "kind"),
    [
        ("https://i.redd.it/abc.png", "image"),
        ("https://i.redd.it/abc", "image"),
        ("https://imgur.com/abc", "image"),
        ("https://imgur.com/a/abc", "image"),
        ("https://m.imgur.com/gallery/abc", "image"),
        ("https://i.imgur.com/abc.gif", "image"),
        ("https://preview.redd.it/abc.jpg?width=640&auto=webp", "image"),
        ("https://example.org/wiki/Creeper.JPG", "image"),
        ("https://i.imgur.com/abc.gifv", "video"),
        ("https://v.redd.it/abc", "video"),
        ("https://streamable.com/abc", "video"),
        ("https://gfycat.com/Abc", "video"),
        ("https://www.youtube.com/watch?v=abc", "video"),
        ("https://youtu.be/abc", "video"),
        ("https://m.youtube.com/shorts/abc", "video"),
        ("https://music.youtube.com/watch?v=abc", "video"),
        ("https://www.youtube-nocookie.com/embed/abc", "video"),
        ("https://youtube.com/clip/Ugkabc", "video"),
        ("https://example.org/film.mp4", "video"),
        ("https://www.youtube.com/@somebody", "general"),
        ("https://www.youtube.com/", "general"),
        ("https://youtu.be/", "general"),
        ("https://notimgur.com/abc", "general"),
        ("https://imgur.com.example.org/abc", "general"),
        ("https://example.org/a.b/c", "general"),
        ("https://example.org", "general"),
        ("http://[broken", "general"),
        ("", "general"),
        ("/r/Minecraft/wiki", "general"),
    ],
)
def test_addresses(address: str, kind: str) -> None:
    assert CLASSIFY(address) == kind


SELF = {
    "is_self": True,
    "permalink": "/r/M/comments/a/t/",
    "url": "https://www.reddit.com/r/M/comments/a/t/",
}
FILM = {"is_self": False, "is_video": True, "url": "https://v.redd.it/x"}


@pytest.mark.parametrize(
    ("post", "expected"),
    [
        (SELF, ("text", None, None)),
        ({**SELF, "is_self": None}, ("text", None, None)),
        ({"is_self": False, "url": None}, ("text", None, None)),
        ({**SELF, "poll_data": {"options": [{"text": "a"}]}}, ("poll", None, None)),
        (
            {"is_gallery": True, "url": "https://www.reddit.com/gallery/a"},
            ("gallery", None, "https://www.reddit.com/gallery/a"),
        ),
        (
            {"url": "https://www.reddit.com/gallery/a"},
            ("gallery", None, "https://www.reddit.com/gallery/a"),
        ),
        (FILM, ("video", "video", "https://v.redd.it/x")),
        (
            {"url": "https://i.redd.it/a.png", "post_hint": "link"},
            ("image", "image", "https://i.redd.it/a.png"),
        ),
        (
            {"url": "https://a.org/x", "url_overridden_by_dest": "https://i.redd.it/a.png"},
            ("image", "image", "https://i.redd.it/a.png"),
        ),
        ({"url": "https://notes.example/a"}, ("link", "general", "https://notes.example/a")),
        (
            {"url": "https://v.redd.it/y", "crosspost_parent_list": [FILM]},
            ("video", "video", "https://v.redd.it/x"),
        ),
        ({"url": "/r/M/comments/a/t/", "crosspost_parent_list": [SELF]}, ("text", None, None)),
        (
            {"url": "https://a.org/x", "crosspost_parent_list": []},
            ("link", "general", "https://a.org/x"),
        ),
        (
            {"url": "https://a.org/x", "crosspost_parent": "t3_gone"},
            ("link", "general", "https://a.org/x"),
        ),
        (
            {"url": "/gallery/gone", "crosspost_parent": "t3_gone"},
            ("gallery", None, "/gallery/gone"),
        ),
        ({"url": "/r/M/comments/gone/t/", "crosspost_parent": "t3_gone"}, ("text", None, None)),
        (
            {"url": "https://www.reddit.com/r/M/comments/b/t/"},
            ("link", "general", "https://www.reddit.com/r/M/comments/b/t/"),
        ),
    ],
)
def test_types(post: dict[str, Any], expected: tuple[str, str | None, str | None]) -> None:
    assert post_type(post, CLASSIFY) == expected


def test_crossposts_and_polls() -> None:
    assert is_crosspost({"crosspost_parent": "t3_a"})
    assert not is_crosspost({"crosspost_parent_list": []})
    assert poll_options({"poll_data": {"options": [{"text": "oak"}, {"text": "spruce"}, 3]}}) == [
        "oak",
        "spruce",
    ]
    assert poll_options({"crosspost_parent_list": [{"poll_data": {"options": []}}]}) == []
    assert poll_options(SELF) is None
