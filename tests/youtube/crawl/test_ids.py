"""Which videos a list and an address name."""

from pathlib import Path
from urllib.parse import quote, urlencode

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given
from hypothesis import strategies as some

from kb.core.errors import SettingError
from kb.youtube.crawl.ids import RULES, video_of
from tests.faults import Sandbox
from tests.youtube.crawl.test_fetch import CRAWL, check
from tests.youtube.job import Job


def test_two_parts_copied_together_are_the_whole(job: Job, few: Sandbox, tmp_path: Path) -> None:
    import shutil

    roots = []
    for part in ("1/2", "2/2"):
        one = Job(few, tmp_path / part[0])
        one.done(*CRAWL, "--part", part)
        roots.append(one.root)
    for number, root in enumerate(roots):
        for path in (root / "raw").rglob("*.zst*"):
            target = job.root / "raw" / path.relative_to(root / "raw")
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target.with_name(f"{number}-{path.name}"))
    job.done(*CRAWL)  # what belongs to channels that only the other part found
    check(job)
    watched = [seen.about for seen in few.ledger.requests("/watch")]
    assert len(watched) == len(set(watched))  # no video was read twice


def test_one_part_after_the_other_in_one_root_is_the_whole(job: Job) -> None:
    job.done(*CRAWL, "--part", "1/2")
    listed = len(job.sandbox.ledger.requests("/playlistItems"))
    job.done(*CRAWL, "--part", "2/2")
    assert 0 < listed < len(job.sandbox.ledger.requests("/playlistItems"))
    check(job)


def test_known_ids_alone_leave_no_search_behind(job: Job) -> None:
    file = job.place / "ids.txt"
    file.write_text("\ufeff" + "\n".join(job.sandbox.world.youtube.videos), encoding="utf-8")
    assert job.done(*CRAWL, "--ids", str(file))["bad_lines"] == 0
    assert job.done("status")["left"] == 0
    check(job)
    assert "--again" in job.kb(*CRAWL, "--ids", str(file)).stderr
    assert "--again" not in job.kb(*CRAWL, "--ids", str(file), "--again").stderr


def test_ids_of_a_release_s_folder(tmp_path: Path, make_rows) -> None:
    folder = tmp_path / "release"
    folder.mkdir()
    with pytest.raises(SettingError, match="contains no released videos or pairs"):
        RULES.ids_in(folder)
    for number, key in enumerate(("aaaaaaaaaaa", "bbbbbbbbbbb")):
        rows = make_rows("youtube/videos", 1, released=True, video_id=[key])
        pq.write_table(rows, folder / f"videos-0000{number}-of-00002.parquet")
    pq.write_table(pa.table({"video_id": ["ccccccccccc"]}), folder / "sample-videos.parquet")
    assert RULES.ids_in(folder)[::2] == (["aaaaaaaaaaa", "bbbbbbbbbbb"], 0)


def test_known_ids_skip_discovery(job: Job) -> None:
    ids = [video.id for video in job.sandbox.world.youtube.videos.values()]
    file = job.place / "ids.txt"
    file.write_text("\n".join([*ids[:20], "not an id", *ids[20:], ids[0]]) + "\n")
    summary = job.done(*CRAWL, "--ids", str(file))
    assert (summary["crawled"], summary["bad_lines"]) == (len(ids), 1)
    assert not job.sandbox.ledger.requests("/search|/playlistItems")
    assert job.sandbox.ledger.units() == 1
    check(job)


ID, OTHER = "PotteryId01", "KilnRoad123"

ids = some.text(
    "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_", min_size=11, max_size=11
).filter(lambda text: text not in ("videoseries", "live_stream"))
names = some.sampled_from(
    ["ab_channel", "feature", "list", "t", "si", "pp", "app", "index", "start_radio", "vid", "V"]
)
extra = some.dictionaries(names, some.one_of(ids, some.text(max_size=20)), max_size=5)
schemes = some.sampled_from(["https://", "http://", "HTTPS://", "//", ""])
hosts = some.sampled_from(
    ["www.youtube.com", "youtube.com", "m.youtube.com", "music.youtube.com", "WWW.YouTube.com"]
)
fragments = some.one_of(some.just(""), ids.map("#t={}".format), some.just("#"))


@given(ids, extra, some.randoms(use_true_random=False), schemes, hosts, fragments)
@example(ID, {"feature": "emb_rel_end"}, None, "https://", "www.youtube.com", "")
def test_a_watch_page_is_named_by_v_whatever_stands_around(
    key: str, extra: dict[str, str], chance, scheme: str, host: str, fragment: str
) -> None:
    parameters = [*extra.items(), ("v", key)]
    if chance is not None:
        chance.shuffle(parameters)
    for path in ("/watch", "/watch/", "/"):
        assert video_of(f"{scheme}{host}{path}?{urlencode(parameters)}{fragment}") == key


@given(
    ids, extra, schemes, some.sampled_from(["shorts", "embed", "live", "v", "e", "watch"]), hosts
)
@example("watch_popup", {}, "https://", "shorts", "www.youtube.com")  # a page's name elsewhere
def test_a_path_names_its_video_whatever_the_parameters_hold(
    key: str, extra: dict[str, str], scheme: str, kind: str, host: str
) -> None:
    asked = urlencode({**extra, "v": OTHER} if kind != "watch" else extra)
    for end in ("", "/", f"?{asked}", f"/?{asked}#{OTHER}"):
        assert video_of(f"{scheme}{host}/{kind}/{key}{end}") == key
        assert video_of(f"{scheme}www.youtube-nocookie.com/{kind}/{key}{end}") == key
        assert video_of(f"{scheme}youtu.be/{key}{end}") == key


@given(ids, extra, schemes)
def test_an_address_inside_an_address_counts_where_the_path_asks_for_it(
    key: str, extra: dict[str, str], scheme: str
) -> None:
    inner = f"/watch?{urlencode({**extra, 'v': key})}"
    for before in ("a=KilnRoad123&", "v=KilnRoad123&", ""):
        around = f"{scheme}www.youtube.com/attribution_link?{before}u={quote(inner, safe='')}"
        assert video_of(around) == key
        whole = quote(f"https://www.youtube.com{inner}", safe="")
        assert video_of(f"{scheme}www.youtube.com/oembed?{before}url={whole}&format=json") == key


@given(ids, schemes)
def test_no_other_host_and_no_other_page_names_a_video(key: str, scheme: str) -> None:
    for host in ("vimeo.com", "notyoutube.com", "youtube.com.example.org", "youtube.com@a.example"):
        assert video_of(f"{scheme}{host}/watch?v={key}") is None
        assert video_of(f"{scheme}{host}/embed/{key}") is None
    for path in (
        f"user/{key}", f"c/{key}", f"@{key}", f"channel/{key}?v={key}", f"hashtag/{key}", key,
        f"playlist?list={key}&v={key}", f"results?search_query={key}", f"redirect?q={key}&v={key}",
        f"embed/videoseries?list={key}", f"embed/live_stream?channel={key}", f"watch?list={key}",
    ):  # fmt: skip
        assert video_of(f"{scheme}www.youtube.com/{path}") is None
    assert video_of(f"{scheme}www.youtube.com/watch?v={key}x") is None


@pytest.mark.parametrize(
    "text",
    [
        ID,
        f"  {ID}\t",
        f"youtube {ID}",
        f"- {ID}",
        f"12. https://youtu.be/{ID}",
        f"{ID}  # asked on 3 May",
        f"<https://youtu.be/{ID}>",
        f"The kiln, description: https://youtu.be/{ID}.",
        f"https://www.youtube.com/watch?feature=x&amp;v={ID}",
        f"https://www.youtube.com/watch?v={ID}?t=3",
        f"https://m.youtube.com/#/watch?v={ID}&x=1",
        f"http://www.youtube.com/watch#!v={ID}&feature=related",
        f"https://consent.youtube.com/m?continue=https%3A%2F%2Fyoutu.be%2F{ID}&gl=DE",
        f"https://studio.youtube.com/video/{ID}/edit",
        f"https://www.youtube.com:443/watch?v={ID}",
    ],
)
def test_what_people_write(text: str) -> None:
    assert video_of(text) == ID


@pytest.mark.parametrize(
    "text",
    [
        "",
        f"{ID}2",
        ID[:-1],
        f"folder/{ID}",
        f"?v={ID}",
        "two words",
        f"https://youtu.be/{ID} https://youtu.be/{OTHER}",
        f"https://www.youtube.com/watch?v={ID}&v={OTHER}",
        f"https://[youtube.com/watch?v={ID}",
        "https://youtu.be/",
    ],
)
def test_what_names_no_video(text: str) -> None:
    assert video_of(text) is None
