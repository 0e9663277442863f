"""One original image file, by the address that the wiki names, else where it was seen."""

from __future__ import annotations

from functools import partial
from typing import Any

from kb.core.errors import ItemFinal, Retryable
from kb.core.profile.wiki import Wiki
from kb.store.frontier import Item
from kb.store.layout import BELOW, Layout
from kb.wiki import urls
from kb.wiki.capture import images
from kb.wiki.connector.hosts import WikiHosts
from kb.wiki.errors import NoPicture


def fetch_original(
    web: WikiHosts, section: Wiki, item: Item, page: dict[str, Any]
) -> dict[str, Any]:
    """The answer to be recorded; `page` is what the wiki says of the file, empty where nothing.

    The file goes into raw/wiki/images, named by what is in it. Raises Blocked.
    """
    info = (page.get("imageinfo") or [{}])[0]
    answer: dict[str, Any] = {
        "key": item.key,
        "title": item.payload.title if info else None,
        "license": urls.file_licence(page),
        "description": info.get("descriptionurl"),
    }
    folder = Layout(web.run.root).images
    inspect = partial(images.inspect, max_pixels=section.max_pixels)
    reason, value, challenge = "", None, ""
    known = filter(None, (info.get("url"), item.key, item.payload.src))
    for url in dict.fromkeys(map(web.today, known)):
        if not web.allowed(url):
            reason, value = "robots", url
            continue
        try:
            sha256, image, size = web.attempt(
                partial(web.download, url, folder, section.max_file_bytes, inspect)
            )
        except NoPicture as error:
            challenge = error.reason
            continue
        except ItemFinal as error:
            reason, value = reason or error.reason, value or error.value
            continue
        except Retryable as error:
            # One image that the server can't give is no reason to stop: the next run asks again.
            return {**answer, "outcome": "failed", "reason": str(error)}
        return {
            **answer,
            "outcome": "stored",
            "sha1": info.get("sha1"),
            "url": url,
            "sha256": sha256,
            "bytes": size,
            "media_type": image.media_type,
            "path": str(BELOW.images / f"{sha256}.{image.extension}"),
            "width": image.width,
            "height": image.height,
            "frames": list(image.frames),
        }
    if challenge:
        return {**answer, "outcome": "failed", "reason": challenge}
    return {**answer, "outcome": "final", "reason": reason, "value": value}
