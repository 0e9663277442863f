"""What a post is, by what it holds and not by one unreliable hint (`post_hint` lacks on many)."""

from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import urlsplit

from kb.core.config.profile.collecting import Links

Post = Mapping[str, Any]
_SUBDOMAINS = ("www.", "m.", "old.", "new.", "i.")
_KINDS = {"image": "image", "video": "video", "general": "link"}


def link_classifier(links: Links) -> Callable[[str], str]:
    """A function from an address to "image", "video" or "general", by the profile's table.

    Endings of the path decide first (imgur's `.gifv` is a video, its `.gif` an image), then hosts.
    """
    image_hosts, video_hosts = frozenset(links.image_hosts), frozenset(links.video_hosts)
    image_endings, video_endings = frozenset(links.image_endings), frozenset(links.video_endings)

    def classify(address: str) -> str:
        try:
            parts = urlsplit(address)
            host = (parts.hostname or "").lower()
        except ValueError:
            return "general"
        names = {host, *(host.removeprefix(sub) for sub in _SUBDOMAINS)}
        ending = (
            parts.path.rpartition("/")[2].rpartition(".")[2].lower() if "." in parts.path else ""
        )
        if ending in video_endings or names & video_hosts:
            return "video"
        if ending in image_endings or names & image_hosts:
            return "image"
        for name in names:
            # "/" alone stands for any page but the front page
            if any(
                parts.path.startswith(start) and parts.path != "/"
                for start in links.video_paths.get(name, ())
            ):
                return "video"
        return "general"

    return classify


def origin(post: Post) -> Post:
    """The post that a crosspost shows: its parent where the answer holds it, else itself."""
    parents = post.get("crosspost_parent_list")
    return (
        parents[0]
        if isinstance(parents, list) and parents and isinstance(parents[0], dict)
        else post
    )


def is_crosspost(post: Post) -> bool:
    """Whether the post repeats another one."""
    return bool(post.get("crosspost_parent") or post.get("crosspost_parent_list"))


def post_type(post: Post, classify: Callable[[str], str]) -> tuple[str, str | None, str | None]:
    """(type, link_kind, source_url) of a post of any year.

    Types: gallery, poll, text, image, video, link. `link_kind` (image, video, general) is for
    posts that link, null for text, polls and galleries. A post whose content is gone (`url` is
    its own page, or absent) counts as text.
    """
    true = origin(post)
    url = true.get("url_overridden_by_dest") or true.get("url")
    url = url if isinstance(url, str) and url else None
    if true.get("is_gallery") or true.get("gallery_data"):
        return "gallery", None, url
    if true.get("poll_data"):
        return "poll", None, None
    if true.get("is_self") or url is None or _is_own_page(true, url):
        return "text", None, None
    if "reddit.com/gallery/" in url or url.startswith("/gallery/"):
        return "gallery", None, url
    if true is post and _shows_parents_page(post, url):
        # Of a crosspost whose parent isn't told: the address of a text is its page.
        return "text", None, None
    kind = "video" if true.get("is_video") else classify(url)
    return _KINDS[kind], kind, url


def _shows_parents_page(post: Post, url: str) -> bool:
    parent = post.get("crosspost_parent")
    return (
        isinstance(parent, str)
        and bool(parent)
        and f"/comments/{parent.removeprefix('t3_')}/" in f"{url}/"
    )


def _is_own_page(post: Post, url: str) -> bool:
    permalink = post.get("permalink")
    return isinstance(permalink, str) and len(permalink) > 1 and url.endswith(permalink)


def poll_options(post: Post) -> list[str] | None:
    """Texts of a poll's options, in order; None when the post is no poll."""
    poll = origin(post).get("poll_data")
    if not isinstance(poll, dict):
        return None
    options = poll.get("options")
    return (
        [str(option.get("text", "")) for option in options if isinstance(option, dict)]
        if isinstance(options, list)
        else []
    )
