"""Interprets MediaWiki URLs: originals of thumbnails, file titles, licences.

Thumbnails: https://www.mediawiki.org/wiki/Manual:Thumb.php, /thumb/<file>/<width>px-<name>.
"""

import hashlib
import re
from collections.abc import Iterable
from typing import Any
from urllib.parse import parse_qs, quote, unquote, urlencode, urlsplit, urlunsplit

_CC = re.compile(
    r"//(?:www\.)?creativecommons\.org/licenses/(by(?:-nc)?(?:-nd|-sa)?)/(\d\.\d)", re.IGNORECASE
)
_PUBLIC = re.compile(
    r"//(?:www\.)?creativecommons\.org/publicdomain/(zero|mark)/1\.0", re.IGNORECASE
)
_GNU = re.compile(
    r"//(?:www\.)?gnu\.org/(?:copyleft|licenses)/(fdl|gpl|lgpl)(?:-(\d\.\d))?", re.IGNORECASE
)


_THUMBNAIL = re.compile(r"(.*?)/thumb(/.+)/[^/]+$")
_SCALED = re.compile(r"/revision/latest(/.*)?$")
_BY_NAME = re.compile(r"/Special:(?:FilePath|Redirect/file)/(.+)$", re.IGNORECASE)
_SPACER = 4  # pixels of a picture that only keeps a place


def original(src: str) -> str:
    """The address of the original image of a thumbnail, or `src` itself; of `thumb.php` what
    names its file.
    """
    parts = urlsplit(src)
    path, query = parts.path, parts.query
    if _script(path):
        name = parse_qs(query).get("f", [""])[0]
        query = urlencode({"f": name}) if name else query
    elif match := _THUMBNAIL.match(path):
        path, query = match[1] + match[2], ""
    elif _SCALED.search(path):
        path, query = _SCALED.sub("", path), ""
    elif _BY_NAME.search(path):
        query = ""
    return urlunsplit((parts.scheme, parts.netloc, path, query, ""))


def _script(path: str) -> bool:
    return path.endswith(("/thumb.php", "/thumb.php5"))


def sources(key: str, src: str | None) -> list[str]:
    """Where the original of a file may be, the best first: never where only a thumbnail is."""
    given = [key, *([src] if src and original(src) == src.split("#")[0] else [])]
    scaled = src and _SCALED.search(urlsplit(src).path)
    given += [src] if src and scaled and not scaled[1] else []
    return [
        address for address in given if _on_the_web(address) and not _script(urlsplit(address).path)
    ]


def _on_the_web(address: str) -> bool:
    return address.startswith(("http:", "https:"))


def file_key(image: dict[str, Any]) -> str | None:
    """What an image of an extraction is asked for and found by: the address of its original, or for
    a picture that is part of the page its file page, else its digest. None for no picture.
    """
    src = image.get("src") or ""
    if _on_the_web(src):
        return src.split("#")[0] if image.get("poster") else original(src)
    width, height = image.get("natural") or (0, 0)
    if not src.startswith("data:image/") or width * height <= _SPACER:
        return None
    return image.get("file") or "data:" + hashlib.sha256(src.encode()).hexdigest()


def file_title(
    src: str, file_page: str | None = None, names: Iterable[str] = ("File", "Image")
) -> str | None:
    """ "File:Name.png" of an image: by its link to the file page, else by its address. `names` are
    those of the wiki's namespace of files.
    """
    if file_page:
        parts = urlsplit(file_page)
        spaces = "|".join(re.escape(name.replace(" ", "_")) for name in names)
        for where in (*parse_qs(parts.query).get("title", []), unquote(parts.path)):
            named = re.search(rf"(?:^|/)(?:{spaces}):(.+)$", where.replace(" ", "_"), re.IGNORECASE)
            if named:
                return f"File:{named[1].replace('_', ' ')}"
    address = urlsplit(src)
    if address.scheme not in ("http", "https"):
        return None
    named = _BY_NAME.search(address.path)
    name = named[1] if named else urlsplit(original(src)).path.rsplit("/", 1)[-1]
    if _script(address.path):
        name = parse_qs(address.query).get("f", [""])[0]
    name = unquote(name).replace("_", " ").strip()
    if not name or "." not in name or re.search(r"[\[\]{}<>|#]", name):
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
