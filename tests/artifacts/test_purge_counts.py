"""What a purge says that it removed is what is gone, for every source and spelling of a key."""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.core.config.profile.products import Toxicity
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.reddit.crawl.importer import import_dumps
from kb.store.rawlog import rawlog
from tests.artifacts.purged import COUNTS, purged
from tests.filters.made import MONDAY, listing, put, video
from tests.wiki.test_purge import HOST, record, shown

VIDEO = "PotteryVi0{}"


@dataclass(frozen=True)
class Kept:
    """A source's raw data: `items` with what leaves with each, and how lists may spell an item."""

    source: str
    fill: Callable[[Run], None]
    items: Mapping[str, frozenset[str]]
    never: tuple[str, ...]
    spellings: Callable[[str], list[str]]
    held: Callable[[Path], set[str]]


def fill_youtube(run: Run) -> None:
    ids = [VIDEO.format(number) for number in range(4)]
    put(run.root, "videos", (MONDAY, {"id": ",".join(ids)}, listing(*map(video, ids))))


def spell_video(key: str) -> list[str]:
    return [
        key,
        f"https://www.youtube.com/watch?ab_channel=KilnRoad123&v={key}",
        f"youtu.be/{key}?t=3",
        f"https://m.youtube.com/shorts/{key}",
    ]


def fill_reddit(run: Run) -> None:
    common = {"author": "a", "created_utc": 1_600_000_000, "subreddit": "Minecraft", "score": 9}
    posts = [
        {"id": key, "title": "T", "selftext": "words", **common} for key in ("w1pots", "w2pots")
    ]
    comments = [
        {"id": key, "link_id": f"t3_{post}", "parent_id": f"t3_{post}", "body": "b", **common}
        for key, post in (("w3bowl", "w1pots"), ("w4bowl", "w1pots"), ("w1pots", "w2pots"))
    ]
    dump = run.root.with_name("dump.ndjson")
    dump.write_text("".join(f"{json.dumps(one)}\n" for one in (*posts, *comments)))
    import_dumps(run, [dump])


def spell_thing(key: str) -> list[str]:
    kind, _, bare = key.partition("_")
    addresses = {
        "t3": [f"https://www.reddit.com/r/x/comments/{bare}/a_title/?utm_name=zz"],
        "t1": [f"https://old.reddit.com/r/x/comments/zz/a_title/{bare}/"],
    }
    return [key, f"{kind.upper()}_{bare.upper()}", *addresses[kind]]


def fill_wiki(run: Run) -> None:
    for page in range(1, 4):
        listed = {"pageid": page, "ns": 0, "title": f"Page {page}"}
        asked = {"round": 1, "apnamespace": "0", "apfrom": str(page)}
        record(run.root, "titles", asked, {"query": {"allpages": [listed]}})
        about = {**listed, "fullurl": f"{HOST}/w/Page_{page}"}
        about["revisions"] = [{"revid": page, "timestamp": "2026-01-01T00:00:00Z"}]
        answer = {"query": {"pages": [about]}}
        record(run.root, "pages", {"round": 1, "titles": f"Page {page}"}, answer)
        shown(run.root, page)


def held_in(root: Path, source: str, kind: str, place: Callable[[dict], set[str]]) -> set[str]:
    answers = (one.response for one in rawlog.envelopes(root, source, kind))
    return {key for answer in answers for key in place(answer)}


KEPT = (
    Kept(
        "youtube",
        fill_youtube,
        {VIDEO.format(number): frozenset() for number in range(4)},
        ("PotteryNe01", "PotteryNe02"),
        spell_video,
        lambda root: held_in(root, "youtube", "videos", lambda a: {v["id"] for v in a["items"]}),
    ),
    Kept(
        "reddit",
        fill_reddit,
        {
            "t3_w1pots": frozenset({"t1_w3bowl", "t1_w4bowl"}),
            "t3_w2pots": frozenset({"t1_w1pots"}),  # the bare id of a post
            **{key: frozenset() for key in ("t1_w3bowl", "t1_w4bowl", "t1_w1pots")},
        },
        ("t1_w2pots", "t3_w3bowl", "t3_w9zzzz"),
        spell_thing,
        lambda root: held_in(
            root,
            "reddit",
            "dumps",
            lambda a: {f"{c['kind']}_{c['data']['id']}" for c in a["data"]["children"]},
        ),
    ),
    Kept(
        "wiki",
        fill_wiki,
        {str(page): frozenset() for page in range(1, 4)},
        ("77", "88"),
        lambda key: (
            [key, f"page {key}", f"Page_{key}", f"{HOST}/w/Page_{key}"] if int(key) < 4 else [key]
        ),
        lambda root: held_in(root, "wiki", "renders", lambda a: {str(a["page_id"])}),
    ),
)


@pytest.fixture(scope="module", params=KEPT, ids=lambda kept: kept.source)
def filled(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Kept, Run]:
    root = tmp_path_factory.mktemp(request.param.source) / "data"
    run = run_of(root)
    request.param.fill(run)
    return request.param, run


def run_of(root: Path) -> Run:
    about = load_settings(dotenv=False, kb_data=root, kb_contact="me@example.org")
    profile = load_profile("minecraft").model_copy(update={"toxicity": Toxicity(toxicity="off")})
    return Run(about, profile, root, workers=1)


@settings(max_examples=12, deadline=None)
@given(data=st.data())
def test_the_summary_says_what_is_gone(filled: tuple[Kept, Run], data: st.DataObject) -> None:
    kept, run = filled
    keys = data.draw(st.lists(st.sampled_from([*kept.items, *kept.never]), min_size=1))
    lines = [data.draw(st.sampled_from(kept.spellings(key))) for key in keys]
    root = run.root.with_name("copy")
    shutil.rmtree(root, ignore_errors=True)
    shutil.copytree(run.root, root)
    before = kept.held(root)
    assert before == kept.items.keys()
    said = dict(zip(COUNTS, purged(run_of(root), kept.source, *lines), strict=True))
    named = set(keys) & before
    gone = before - kept.held(root)
    assert gone == named.union(*(kept.items[key] for key in named))
    assert (said["purged"], said["also"]) == (len(named), len(gone - named))
    assert (said["known"], said["unknown"]) == (0, len(set(keys) - before))
