"""Playlists: from a search to the tables, at the price of their pages."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kb.sandbox.youtube.cases import Playlist
from kb.sandbox.youtube.playlists import GONE
from tests.faults import LoggedRequest, Sandbox
from tests.youtube.crawl.test_fetch import CRAWL
from tests.youtube.job import Job, searched_playlists

LISTS = "SELECT * EXCLUDE (fetched_at) FROM clean.youtube_playlists ORDER BY playlist_id"
ENTRIES = "SELECT * FROM clean.youtube_playlist_videos ORDER BY playlist_id, position"
PHRASES = ("Minecraft Tutorial", "Minecraft Guide")


def public(sandbox: Sandbox) -> list[Playlist]:
    """The playlists that the phrases find and anybody may read."""
    return [one for one in searched_playlists(sandbox) if one.privacy == "public"]


def playlist_pages(sandbox: Sandbox, since: int) -> list[LoggedRequest]:
    """Requests for pages of playlists that are no channel's uploads."""
    asked = sandbox.ledger.requests("/v3/playlistItems", since=since)
    return [request for request in asked if not request.args["playlistId"].startswith("UU")]


def kept_places(job: Job, playlist: Playlist) -> dict[str, int]:
    """Where the playlist lists kept videos first."""
    kept = {row["video_id"] for row in job.rows("SELECT video_id FROM clean.youtube_videos")}
    places: dict[str, int] = {}
    for place, video in enumerate(playlist.entries):
        if video.id in kept:
            places.setdefault(video.id, place)
    return places


def check_tables(job: Job, listed: list[Playlist]) -> None:
    """The tables are what the world's playlists say of kept videos."""
    wanted = {one.id: places for one in listed if (places := kept_places(job, one))}
    rows = {row["playlist_id"]: row for row in job.rows(LISTS)}
    assert rows.keys() == wanted.keys()
    for one in listed:
        if row := rows.get(one.id):
            shown = (row["title"], row["channel_id"], row["item_count"])
            assert shown == (one.title, one.channel.id, len(one.entries))
    got: dict[str, dict[str, int]] = {key: {} for key in wanted}
    for row in job.rows(ENTRIES):
        got[row["playlist_id"]][row["video_id"]] = row["position"]
    assert got == wanted


def test_from_a_search_to_the_tables(job: Job) -> None:
    sandbox = job.sandbox
    sandbox.world.youtube.playlists[1].title = "Minecraft Tutorial &amp; Guide <b>"
    crawled = job.done(*CRAWL, "--only", "playlists")
    pages = sum(max(1, -(-len(one.entries) // 50)) for one in public(sandbox))
    trouble = [one for one in sandbox.world.youtube.playlists if one.privacy in ("private", GONE)]
    asked = sandbox.ledger.requests("/youtube/v3/")
    assert len(asked) == len(PHRASES) + pages + len(trouble)
    assert crawled["playlists"] == len(public(sandbox))
    again = len(sandbox.ledger)
    job.done(*CRAWL, "--only", "playlists")
    assert len(sandbox.ledger) == again
    job.done(*CRAWL)
    assert playlist_pages(sandbox, again) == []
    filtered = job.done("youtube", "filter")
    check_tables(job, public(sandbox))
    by_phrase = {row["playlist_id"]: row["keyword"] for row in job.rows(LISTS)}
    assert by_phrase.get(sandbox.world.youtube.playlists[1].id, PHRASES[0]) == PHRASES[0]
    gone = [one.id for one in trouble if one.privacy == GONE]
    empty = sorted(one.id for one in public(sandbox) if not one.entries)
    private = [one.id for one in trouble if one.privacy == "private"]
    assert filtered["playlists_left_out"] == {
        "not_found": gone,
        "not_public": private,
        **({"empty": empty} if empty else {}),
    }
    job.done("youtube", "export")
    released = job.rows("SELECT * FROM release.youtube_playlist_videos ORDER BY ALL")
    assert released == job.rows("SELECT * FROM clean.youtube_playlist_videos ORDER BY ALL")


def test_a_playlist_that_changes_between_two_pages(job: Job) -> None:
    world = job.sandbox.world.youtube
    long = next(one for one in world.playlists if one.teaches)
    long.entries[:] = [*world.videos.values()] * 5
    first, *others = long.entries
    turned: list[int] = []

    def turn(request: LoggedRequest) -> None:
        if request.args.get("playlistId") == long.id and "pageToken" in request.args:
            turned.append(1)
            long.entries[:] = [*others, first]  # a page begins with what the last one ended with

    job.sandbox.faults.add("/v3/playlistItems", times=None, then=turn)
    job.done(*CRAWL)
    job.done("youtube", "filter")
    listed = [row for row in job.rows(ENTRIES) if row["playlist_id"] == long.id]
    kept = job.rows("SELECT video_id FROM clean.youtube_videos")
    assert turned
    assert len(listed) == len(kept)
    assert len({row["video_id"] for row in listed}) == len(listed)


def test_playlists_by_their_addresses_and_their_end(job: Job) -> None:
    world = job.sandbox.world.youtube
    found, hidden = (
        next(one for one in world.playlists if one.privacy == privacy and one.entries)
        for privacy in ("public", "unlisted")
    )
    hidden.entries = list(found.entries)
    alone = world.videos[next(iter(world.videos))].id
    (job.place / "lists.txt").write_text(
        f"https://www.youtube.com/playlist?list={found.id}&si=x\n"
        f"youtube.com/playlist?list={hidden.id}\nhttps://www.youtube.com/watch?v={alone}&list={found.id}\n"
    )
    job.done(*CRAWL, "--ids", "lists.txt")
    asked = job.sandbox.ledger.requests("/youtube/v3/")
    assert {seen.path.rsplit("/", 1)[-1] for seen in asked} == {
        *("playlists", "playlistItems", "videos")
    }
    wanted = {*(video.id for video in found.entries), alone}
    assert {key for seen in asked for key in seen.args.get("id", "").split(",")} >= wanted
    filtered = job.done("youtube", "filter")
    assert filtered["crawled"] == len(wanted)
    check_tables(job, [found])
    assert {row["keyword"] for row in job.rows(LISTS)} == {None}

    # Later on it has another title and fewer entries; then its owner removes it.
    found.title = "Another title"
    found.entries[:] = found.entries[::2]
    job.done("refresh", "youtube", KB_NOW="2027-03-01T00:00:00Z")
    job.done("youtube", "filter")
    check_tables(job, [found])
    found.privacy = GONE
    del world.by_playlist
    job.done("refresh", "youtube", KB_NOW="2027-06-01T00:00:00Z")
    purged = job.done("purge", "youtube")
    assert purged["also"] >= 1
    assert job.rows(LISTS) == [] == job.rows(ENTRIES)
    for kind in ("playlists", "playlist_items"):
        assert found.id not in json.dumps(job.raw(kind))


def test_a_playlist_of_5000_entries_costs_its_pages(job: Job) -> None:
    world = job.sandbox.world.youtube
    long = next(playlist for playlist in world.playlists if playlist.teaches)
    videos = list(world.videos.values())
    long.entries[:] = [videos[number % len(videos)] for number in range(5000)]
    (job.place / "lists.txt").write_text(f"https://www.youtube.com/playlist?list={long.id}\n")
    summary = job.done(*CRAWL, "--ids", "lists.txt", "--only", "playlists", "--limit", "3", code=3)
    assert summary["waits_for"]
    job.done(*CRAWL, "--ids", "lists.txt")
    pages = job.sandbox.ledger.requests("/v3/playlistItems")
    assert len(pages) == 100
    job.done("youtube", "filter")
    check_tables(job, [long])
    (row,) = job.rows(LISTS)
    assert row["item_count"] == 5000


def test_a_refresh_of_playlists_goes_on_where_a_quota_stopped_it(job: Job) -> None:
    job.done(*CRAWL)
    lists = len(public(job.sandbox))
    quota, words = job.sandbox.world.quota, ("refresh", "youtube", "--older-than", "0")
    before = len(job.sandbox.ledger)
    enough = quota["general"]
    quota["general"] = job.sandbox.ledger.units() + 4
    job.done(*words, code=3)
    assert 0 < len(playlist_pages(job.sandbox, before)) < lists
    quota["general"] = enough
    job.done(*words, KB_NOW="2026-11-21T12:00:00Z")
    ledger = job.sandbox.ledger
    pages = playlist_pages(job.sandbox, before)
    assert len([page for page in pages if page.status == 200]) == lists
    asked = ledger.requests("/v3/playlists", since=before)
    titles = [key for request in asked for key in request.args["id"].split(",")]
    assert len(titles) == len(set(titles))


@pytest.mark.parametrize(("days", "reads_again"), [(6, False), (8, True)])
def test_a_round_passes_over_playlists_that_were_just_refreshed(
    job: Job, days: int, reads_again: bool
) -> None:
    job.done(*CRAWL)
    job.done("refresh", "youtube", "--older-than", "0")
    before = len(job.sandbox.ledger)
    job.done(*CRAWL, "--again", KB_NOW=f"2026-11-{20 + days}T12:00:00Z")
    read = {request.args["playlistId"] for request in playlist_pages(job.sandbox, before)}
    assert bool(read & {playlist.id for playlist in public(job.sandbox)}) == reads_again


def test_a_purged_playlist_and_one_of_a_channel_that_left(job: Job) -> None:
    job.done(*CRAWL)
    job.done("youtube", "filter")
    shown = job.rows(LISTS)
    named, owner = shown[0]["playlist_id"], shown[-1]["channel_id"]
    (job.place / "gone.txt").write_text(f"https://www.youtube.com/playlist?list={named}\n")
    (job.place / "channels.txt").write_text(f"{owner}\n")
    assert job.done("purge", "youtube", "--ids", "gone.txt")["purged"] == 1
    job.done("purge", "youtube", "--channels", "channels.txt")
    for kind in ("search", "playlist_items"):
        assert named not in json.dumps(job.raw(kind))
    job.done(*CRAWL, "--again")
    job.done("youtube", "filter")
    left = job.rows(LISTS)
    assert named not in {row["playlist_id"] for row in left}
    assert owner not in {row["channel_id"] for row in left}
    assert len(left) > 0


def imported(job: Job, folder: Path, key: str, **about: Any) -> None:
    """A file of yt-dlp about a playlist."""
    folder.mkdir(exist_ok=True)
    record = {"_type": "playlist", "id": key, "title": key, "extractor_key": "YoutubeTab", **about}
    (folder / f"{key}.info.json").write_text(json.dumps(record))


@pytest.mark.parametrize("place", [lambda n: {}, lambda n: {"playlist_index": n + 5}])
def test_imported_playlists_are_in_the_same_tables(
    job: Job, place: Callable[[int], dict[str, int]]
) -> None:
    world, folder = job.sandbox.world.youtube, job.place / "lists"
    keys = list(world.videos)[:12]
    listed = [{"id": key, **place(n)} for n, key in enumerate(keys)]
    imported(job, folder, "PLmade", entries=listed, playlist_count=40, channel_id="UC" + "a" * 22)
    imported(job, folder, "PLhidden", entries=listed, availability="unlisted")
    imported(job, folder, "UU" + "a" * 22, entries=listed)
    job.done("youtube", "import", str(folder))
    job.done(*CRAWL, "--only", "metadata")
    job.done(*CRAWL, "--only", "transcripts")
    job.done("youtube", "filter")
    (row,) = job.rows(LISTS)
    assert (row["playlist_id"], row["title"], row["item_count"]) == ("PLmade", "PLmade", 40)
    first = place(0).get("playlist_index", 1) - 1
    for row in job.rows(ENTRIES):
        assert row["position"] == first + keys.index(row["video_id"])
    assert job.rows(ENTRIES)
