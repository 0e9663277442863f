"""Interprets MediaWiki URLs: originals of thumbnails, file titles, licences.

Thumbnails: https://www.mediawiki.org/wiki/Manual:Thumb.php, /thumb/<file>/<width>px-<name>.
"""

import re
from typing import Any
from urllib.parse import quote, unquote, urlsplit, urlunsplit

_CC = re.compile(
    r"//(?:www\.)?creativecommons\.org/licenses/(by(?:-nc)?(?:-nd|-sa)?)/(\d\.\d)", re.IGNORECASE
)
_PUBLIC = re.compile(
    r"//(?:www\.)?creativecommons\.org/publicdomain/(zero|mark)/1\.0", re.IGNORECASE
)
_GNU = re.compile(
    r"//(?:www\.)?gnu\.org/(?:copyleft|licenses)/(fdl|gpl|lgpl)(?:-(\d\.\d))?", re.IGNORECASE
)


def original(src: str) -> str:
    """The address of the original image of a thumbnail, or `src` itself."""
    parts = urlsplit(src)
    path = parts.path
    if match := re.match(r"(.*?)/thumb(/.+)/[^/]+$", path):
        path = match[1] + match[2]
    path = re.sub(r"/revision/latest(/.*)?$", "", path)
    return urlunsplit(
        (parts.scheme, parts.netloc, path, parts.query if path == parts.path else "", "")
    )


def file_title(src: str, file_page: str | None = None) -> str | None:
    """ "File:Name.png" of an image: by its link to the file page, else by its address."""
    if file_page:
        parts = urlsplit(file_page)
        match = re.search(r"(?:/|title=)((?:File|Image):[^?&#]+)", f"{parts.path}?{parts.query}")
        if match:
            return unquote(match[1]).replace("_", " ").replace("Image:", "File:", 1)
    name = unquote(urlsplit(original(src)).path.rsplit("/", 1)[-1]).replace("_", " ").strip()
    if (
        not name
        or "." not in name
        or re.search(r"[\[\]{}<>|#]", name)
        or urlsplit(src).scheme not in ("http", "https")
    ):
        return None
    return f"File:{name}"


def spdx(url: str) -> str | None:
    """The SPDX id of a licence's address; None where it has none."""
    if match := _CC.search(url):
        return f"CC-{match[1].upper()}-{match[2]}"
    if match := _PUBLIC.search(url):
        return "CC0-1.0" if match[1].lower() == "zero" else None
    if match := _GNU.search(url):
        names = {"fdl": ("GFDL", "1.3"), "gpl": ("GPL", "3.0"), "lgpl": ("LGPL", "3.0")}
        name, newest = names[match[1].lower()]
        return f"{name}-{match[2] or newest}-or-later"
    return None


def by_name(name: str) -> str | None:
    """The SPDX id of a licence's short name as file pages write it ("CC BY-SA 3.0", "GFDL")."""
    plain = re.sub(r"[\s_-]+", "-", name.strip().upper()).strip("-")
    if match := re.fullmatch(r"CC-BY(-NC)?(-ND|-SA)?-(\d\.\d)", plain):
        return f"CC-BY{match[1] or ''}{match[2] or ''}-{match[3]}"
    return {
        "CC0": "CC0-1.0",
        "CC0-1.0": "CC0-1.0",
        "CC-ZERO": "CC0-1.0",
        "GFDL": "GFDL-1.3-or-later",
        "MIT": "MIT",
    }.get(plain)


def licence(url: str | None, text: str | None = None) -> str | None:
    """`pages.license`: the SPDX id where the address or the name maps to one, else the address."""
    return (spdx(url) if url else None) or (by_name(text) if text else None) or url or None


def file_licence(page: dict[str, Any]) -> str | None:
    """The licence that a file's page gives: its metadata, else the first one that it links to."""
    info = (page.get("imageinfo") or [{}])[0]
    metadata = info.get("extmetadata") or {}
    for key in ("LicenseUrl", "LicenseShortName", "License"):
        value = metadata.get(key, {}).get("value")
        if isinstance(value, str) and value.strip():
            return spdx(value) or by_name(value) or value.strip()
    links = (link.get("url") or link.get("*") or "" for link in page.get("extlinks") or [])
    return next((name for link in links if (name := spdx(link))), None)


def history(script: str, title: str) -> str:
    """The address of a page's history, which names its contributors."""
    return f"{script}?title={quote(title.replace(' ', '_'), safe='')}&action=history"
