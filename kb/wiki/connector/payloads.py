"""Declares what the frontier stores with each kind of item.

kind      key              an item is
site      round            the wiki's description of itself, once a round; removed when answered
          "answered"       done from the first answer on: to do again when raw data have lost it
titles    round:namespace  the list of a namespace's pages
info      round:title      a title whose page is asked for
gone      round            a round that is compared with the pages known; removed when it was
pages     page id          a page, shown when its revision is not the one that was
files     address          an original image file

A round of the whole list is "1", "2" …; one of named titles is "t1", "t2" … .
"""

from __future__ import annotations

import msgspec


class SiteItem(msgspec.Struct):
    """`listed`: the namespaces are to be listed, these or those that the wiki calls content."""

    listed: bool
    namespaces: tuple[int, ...] = ()


class List(msgspec.Struct):
    """`going` is the `continue` of the last answer, empty at the beginning."""

    round: int
    namespace: int
    going: dict[str, str | int] = {}


class Title(msgspec.Struct):
    """A title as it was listed or named."""

    title: str


class PageItem(msgspec.Struct):
    """A page by its newest answer.

    `round` is the newest one that listed it, 0 when none did. `rendered` is the captured (revision,
    title). `former` are its previous titles. `final` is why a page is too large to be captured:
    (revision, title, reason, value). `gone`: the page had once disappeared from the wiki.
    """

    title: str
    url: str
    revision_id: int
    round: int = 0
    rendered: tuple[int, str] | None = None
    former: list[str] = []
    final: tuple[int, str, str, str | None] | None = None
    gone: bool = False


class ImageItem(msgspec.Struct):
    """An image: its address, its title on the wiki where it has one, and where it was seen."""

    key: str
    title: str | None = None
    src: str | None = None


PAYLOADS: dict[str, type[msgspec.Struct]] = {
    "site": SiteItem,
    "titles": List,
    "info": Title,
    "pages": PageItem,
    "files": ImageItem,
}
