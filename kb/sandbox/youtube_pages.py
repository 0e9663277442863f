"""The watch page of the sandbox's YouTube."""

from __future__ import annotations

import html
import json
from typing import Any

from kb.sandbox.videos import Video
from kb.sandbox.youtube_player import player_answer

PAGE_KEY = "sandbox_page_key"  # every page shows it; the player wants it back


def watch_page(video: Video | None, key: str) -> str:
    """The page of a video: settings with the key, the first player answer, the page's data."""
    config = {
        "CLIENT_CANARY_STATE": "none",
        "DEVICE": "cbr=Sandbox",
        "HL": "en",
        "INNERTUBE_API_KEY": PAGE_KEY,
        "INNERTUBE_API_VERSION": "v1",
        "INNERTUBE_CLIENT_NAME": "WEB",
        "INNERTUBE_CLIENT_VERSION": "2.20261101.00.00",
        "VISITOR_DATA": "Q2dzU2FuZGJveA%3D%3D",
        "INNERTUBE_CONTEXT": {
            "client": {
                "hl": "en",
                "gl": "US",
                "remoteHost": "2001:db8::7",
                "visitorData": "Q2dzU2FuZGJveA%3D%3D",
            }
        },
    }
    player = player_answer(video, key)
    for track in (
        player.get("captions", {})
        .get("playerCaptionsTracklistRenderer", {})
        .get("captionTracks", [])
    ):
        track["name"] = {"simpleText": track["name"]["runs"][0]["text"]}  # as the page writes it
    title = (
        html.escape(video.title if video else "YouTube")
        .replace("\x00", "")
        .encode("utf-8", "replace")
        .decode()
    )
    padding = "\n".join(
        f".ytd-part-{number}{{margin:0 auto;padding:{number % 9}px;color:#0f0f0f}}"
        for number in range(250)
    )
    return (
        f'<!DOCTYPE html><html lang="en"><head><title>{title} -'
        f" YouTube</title><style>{padding}</style>"
        f'<script nonce="sandbox">(function() {{window.ytcfg = {{}};ytcfg.set({_script(config)});'
        f' }})();</script></head><body dir="ltr">'
        f'<script nonce="sandbox">var ytInitialPlayerResponse = {_script(player)};var meta ='
        " document.createElement('meta');</script>"
        '<script nonce="sandbox">var ytInitialData ='
        f" {_script(_page_data(video, key))};</script></body></html>"
    )


def _script(value: Any) -> str:
    return json.dumps(value).replace("<", "\\u003c").replace("&", "\\u0026")


def _page_data(video: Video | None, key: str) -> dict[str, Any]:
    if video is None or not video.in_api or video.player == "gone":
        return {
            "responseContext": {},
            "contents": {"twoColumnWatchNextResults": {"results": {"results": {"contents": []}}}},
            "currentVideoEndpoint": {"watchEndpoint": {"videoId": key}},
        }
    owner = {
        "browseEndpoint": {
            "browseId": video.channel.id,
            "canonicalBaseUrl": f"/channel/{video.channel.id}",
        }
    }
    secondary: dict[str, Any] = {
        "owner": {
            "videoOwnerRenderer": {
                "title": {"runs": [{"text": video.channel.title, "navigationEndpoint": owner}]},
                "navigationEndpoint": owner,
            }
        },
        "attributedDescription": {"content": video.description},
    }
    data: dict[str, Any] = {
        "responseContext": {"mainAppWebResponseContext": {"loggedOut": True}},
        "contents": {
            "twoColumnWatchNextResults": {
                "results": {
                    "results": {
                        "contents": [
                            {
                                "videoPrimaryInfoRenderer": {
                                    "title": {"runs": [{"text": video.title}]}
                                }
                            },
                            {"videoSecondaryInfoRenderer": secondary},
                        ]
                    }
                },
                "secondaryResults": {
                    "secondaryResults": {
                        "results": [
                            {"compactVideoRenderer": _related(other)}
                            for other in video.channel.videos[:8]
                        ]
                    }
                },
            }
        },
        "currentVideoEndpoint": {"watchEndpoint": {"videoId": video.id}},
        "engagementPanels": [],
    }
    if video.label:
        # The label has stood in two places over the years; videos of odd number have the older one.
        browse, name = video.label
        endpoint = {
            "browseEndpoint": {"browseId": browse, "canonicalBaseUrl": f"/channel/{browse}"}
        }
        if video.number % 2:
            secondary["metadataRowContainer"] = {
                "metadataRowContainerRenderer": {
                    "rows": [
                        {
                            "richMetadataRowRenderer": {
                                "contents": [
                                    {
                                        "richMetadataRenderer": {
                                            "style": "RICH_METADATA_RENDERER_STYLE_BOX_ART",
                                            "title": {"simpleText": name},
                                            "subtitle": {"simpleText": "2011"},
                                            "callToAction": {"simpleText": "Browse game"},
                                            "endpoint": endpoint,
                                        }
                                    }
                                ]
                            }
                        }
                    ]
                }
            }
        else:
            data["engagementPanels"].append(
                {
                    "engagementPanelSectionListRenderer": {
                        "content": {
                            "structuredDescriptionContentRenderer": {
                                "items": [
                                    {
                                        "videoDescriptionGamingSectionRenderer": {
                                            "headerText": {"simpleText": "Gaming"},
                                            "mediaLockups": [
                                                {
                                                    "mediaLockupRenderer": {
                                                        "title": {"simpleText": name},
                                                        "subtitle": {"simpleText": "2011"},
                                                        "endpoint": endpoint,
                                                    }
                                                }
                                            ],
                                        }
                                    }
                                ]
                            }
                        }
                    }
                }
            )
    return data


def _related(video: Video) -> dict[str, Any]:
    owner = {"browseEndpoint": {"browseId": video.channel.id}}
    return {
        "videoId": video.id,
        "title": {"simpleText": video.title},
        "lengthText": {"simpleText": f"{video.seconds // 60}:{video.seconds % 60:02d}"},
        "longBylineText": {"runs": [{"text": video.channel.title, "navigationEndpoint": owner}]},
    }
