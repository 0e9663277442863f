"""The sandbox's Data API through the real client, and its answers beside the recorded ones."""

import json
from typing import Any

import pytest
from googleapiclient.errors import HttpError

from tests.faults import Sandbox
from tests.sandbox.conftest import make_client
from tests.sandbox.domains import of_case


def pages(call: Any, **arguments: Any) -> list[dict[str, Any]]:
    found, token = [], None
    while True:
        answer = call(**arguments, pageToken=token).execute()
        found.append(answer)
        if not (token := answer.get("nextPageToken")):
            return found


def test_every_upload_of_a_channel_is_listed_fifty_a_page(services: Sandbox, data_api: Any) -> None:
    channel = services.world.youtube.channels[0]
    answers = pages(
        data_api.playlistItems().list,
        part="contentDetails",
        playlistId=channel.uploads,
        maxResults=50,
    )
    assert [len(answer["items"]) for answer in answers] == [50, 50, 31]
    ids = [item["contentDetails"]["videoId"] for answer in answers for item in answer["items"]]
    assert set(ids) == {video.id for video in channel.videos}
    assert (
        len(ids) == len(set(ids)) + 1
    )  # an upload while paging shifts one entry onto the next page again
    assert services.ledger.units() == 3


def test_search_finds_channels_up_to_five_hundred() -> None:
    from kb.sandbox.world import World

    with Sandbox(World(n_channels=640, n_videos=0), services=["youtube"]) as services:
        answers = pages(
            make_client(services).search().list,
            part="snippet",
            q="Minecraft",
            type="channel",
            maxResults=50,
        )
        assert sum(len(answer["items"]) for answer in answers) == 500
        assert services.ledger.units("search") == len(answers) == 10
        assert services.ledger.units("general") == 0
        assert (
            make_client(services)
            .search()
            .list(part="snippet", q="chess", type="channel")
            .execute()["items"]
            == []
        )


def test_videos_leave_out_what_is_gone_and_hidden(services: Sandbox, data_api: Any) -> None:
    world = services.world.youtube
    gone, hidden, plain = (
        of_case(world, name)[0]
        for name in ("gone between listing and reading", "likes hidden", "manual")
    )
    answer = (
        data_api.videos()
        .list(part="id,statistics", id=f"{plain.id},{gone.id},{hidden.id}")
        .execute()
    )
    assert [item["id"] for item in answer["items"]] == [plain.id, hidden.id]
    assert set(answer["items"][0]) == {"kind", "etag", "id", "statistics"}
    assert "likeCount" not in answer["items"][1]["statistics"]
    assert answer["items"][0]["statistics"]["viewCount"] == plain.view_count


@pytest.mark.parametrize(
    ("name", "frame", "size"),
    [
        ("Short", {"maxHeight": 720}, ("405", "720")),
        ("manual", {"maxWidth": 1280}, ("1280", "720")),
        ("four by three", {"maxWidth": 1280, "maxHeight": 720}, ("960", "720")),
        ("manual", {}, (None, None)),
    ],
)
def test_the_embed_has_the_shape_of_the_video(
    services: Sandbox, data_api: Any, name: str, frame: dict[str, int], size: tuple[str, str]
) -> None:
    video = of_case(services.world.youtube, name)[0]
    player = (
        data_api.videos().list(part="player", id=video.id, **frame).execute()["items"][0]["player"]
    )
    assert (player.get("embedWidth"), player.get("embedHeight")) == size


def test_text_that_json_can_only_escape_travels(services: Sandbox, data_api: Any) -> None:
    for name in (
        "NUL in the title",
        "lone surrogate in the title",
        "right-to-left title",
        "emoji in the title",
    ):
        video = of_case(services.world.youtube, name)[0]
        assert (
            data_api.videos()
            .list(part="snippet", id=video.id)
            .execute()["items"][0]["snippet"]["title"]
            == video.title
        )


def refusal(call: Any) -> tuple[int, str]:
    with pytest.raises(HttpError) as caught:
        call.execute()
    return caught.value.status_code, json.loads(caught.value.content)["error"]["errors"][0][
        "reason"
    ]


def test_refusals_are_googles(services: Sandbox, data_api: Any) -> None:
    world, ids = services.world, list(services.world.youtube.videos)
    assert refusal(
        data_api.playlistItems().list(part="snippet", playlistId=world.youtube.channels[4].uploads)
    ) == (
        404,
        "playlistNotFound",
    )
    assert refusal(
        data_api.playlistItems().list(
            part="snippet", playlistId="UULF" + world.youtube.channels[5].id[2:]
        )
    ) == (404, "playlistNotFound")
    assert refusal(data_api.videos().list(part="snippet", id=",".join(ids[:51]))) == (
        400,
        "invalidFilters",
    )
    assert refusal(data_api.videos().list(part="nothing", id=ids[0])) == (400, "unknownPart")
    assert refusal(
        data_api.search().list(part="snippet", q="x", type="channel", maxResults=51)
    ) == (
        400,
        "invalidParameter",
    )
    assert refusal(make_client(services, "wrong").videos().list(part="snippet", id=ids[0])) == (
        400,
        "keyInvalid",
    )


def test_each_bucket_ends_with_its_own_answer_and_begins_again_the_next_pacific_day(
    services: Sandbox, data_api: Any
) -> None:
    from datetime import UTC, datetime

    world, one = services.world, next(iter(services.world.youtube.videos))
    world.quota |= {"search": 1, "general": 2}
    world.now = datetime(2026, 11, 20, 7, 59, tzinfo=UTC)  # 23:59 in California
    search = data_api.search().list(part="snippet", q="Minecraft", type="channel")
    video = data_api.videos().list(part="snippet", id=one)
    search.execute()
    with pytest.raises(HttpError) as caught:
        search.execute()
    error = json.loads(caught.value.content)["error"]
    assert (caught.value.status_code, error["errors"][0]["reason"]) == (429, "rateLimitExceeded")
    assert "PerDay" in error["details"][0]["metadata"]["quota_limit"]
    video.execute()
    video.execute()
    assert refusal(video) == (403, "quotaExceeded")
    world.now = datetime(2026, 11, 20, 8, 0, tzinfo=UTC)
    search.execute()
    video.execute()
    assert (services.ledger.units(), services.ledger.units("search")) == (3, 2)


@pytest.mark.parametrize(
    ("when", "day"),
    [
        ("2026-03-08T09:59:00+00:00", "2026-03-08"),
        ("2026-07-01T06:59:00+00:00", "2026-06-30"),
        ("2026-07-01T07:00:00+00:00", "2026-07-01"),
        ("2026-11-01T08:30:00+00:00", "2026-11-01"),
        ("2026-11-02T07:30:00+00:00", "2026-11-01"),
    ],
)
def test_the_pacific_day_knows_summer_time(when: str, day: str) -> None:
    from datetime import datetime

    from kb.sandbox.world import World

    world = World()
    world.now = datetime.fromisoformat(when)
    assert world.pacific_day() == day


# What the recordings have and today's answers have not, or what depends on the item.
