"""A page's images leave the raw answers with it, however their names are written in addresses."""

from pathlib import Path
from typing import Any

import pytest
import zstandard

from kb.artifacts import purge as steps
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.crawl.purge import remove_keys
from kb.registry import SOURCES as CLASSES
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request, Segment
from kb.store.state.frontier import Frontier
from kb.wiki.purge import RULES

HOST = "https://minecraft.wiki"
WHEN = "2026-01-01T00:00:00Z"


def record(root: Path, kind: str, params: dict[str, Any], response: Any) -> None:
    segment = Segment(rawlog.folder(root, "wiki", kind))
    envelope = Envelope(WHEN, Request(f"{HOST}/api.php", params), 200, response)
    segment.append(rawlog.encode(envelope))
    segment.close()


def shown(root: Path, page: int, *names: tuple[str, str]) -> None:
    """A captured page with its image files: (address, title)."""
    files = [{"key": key, "title": title, "src": key} for key, title in names]
    fields = {"page_id": page, "title": f"Page {page}", "url": f"{HOST}/w/{page}"}
    captured = {"outcome": "captured", "revision_id": page, "folder": f"raw/wiki/pages/{page}/1"}
    record(root, "renders", {"page_id": str(page)}, fields | captured | {"files": files})


def test_names_in_other_letters_and_forms_go_and_shared_ones_stay(tmp_path: Path) -> None:
    own = f"{HOST}/images/Caf%C3%A9_chair.png", "File:Café chair.png"
    small = f"{HOST}/images/Net.png", "File:net.png"
    both = f"{HOST}/images/Sand.png", "File:Sand.png"
    shown(tmp_path, 1, own, small, both)
    shown(tmp_path, 2, both)
    titles = [own[1], small[1], both[1]]
    pages = [{"ns": 6, "title": title} for title in (own[1], "File:Net.png", both[1])]
    change = {"fromencoded": False, "from": small[1], "to": "File:Net.png"}
    query = {"normalized": [change], "pages": pages}
    record(tmp_path, "imageinfo", {"titles": titles}, {"query": query})
    ids = tmp_path / "ids.txt"
    ids.write_text("1\n")
    settings = load_settings(dotenv=False, kb_data=tmp_path, kb_contact="me@example.org")
    run = Run(settings, load_profile("minecraft"), tmp_path)
    assert remove_keys(run, CLASSES["wiki"].connector(run), RULES, RULES.read_ids(ids, None))[
        0
    ].keys == {"1": "named"}
    (left,) = rawlog.envelopes(tmp_path, "wiki", "imageinfo")
    assert left.request.params == {"titles": [both[1]]}
    assert left.response == {"query": {"normalized": [], "pages": [pages[2]]}}
    assert [one.response["page_id"] for one in rawlog.envelopes(tmp_path, "wiki", "renders")] == [2]


class Killed(Exception):
    """Stands for SIGKILL: nothing after it is done."""


@pytest.mark.parametrize(
    ("place", "name", "call"),
    [
        (steps, "answers", 1),
        (Frontier, "set_offset", 2),
        (Frontier, "remove", 2),
        (Frontier, "remove", 3),
        (Frontier, "forget", 1),
    ],
)
def test_a_purge_that_was_killed_leaves_no_title_in_the_state(
    place: Any, name: str, call: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The harness of kills stops before file operations; this one between changes of the state."""
    file = f"{HOST}/images/Quartz_jetty.png", "File:Quartz jetty.png"
    listed = {"query": {"allpages": [{"pageid": 1, "ns": 0, "title": "Page 1"}]}}
    record(tmp_path, "titles", {"round": 1, "apnamespace": "0"}, listed)
    page = {"pageid": 1, "ns": 0, "title": "Page 1", "fullurl": f"{HOST}/w/Page_1"}
    page["revisions"] = [{"revid": 1, "timestamp": WHEN}]
    record(tmp_path, "pages", {"round": 1, "titles": "Page 1"}, {"query": {"pages": [page]}})
    shown(tmp_path, 1, file)
    shown(tmp_path, 2)
    ids = tmp_path / "ids.txt"
    ids.write_text("1\n")
    settings = load_settings(dotenv=False, kb_data=tmp_path, kb_contact="me@example.org")
    run = Run(settings, load_profile("minecraft"), tmp_path)
    real, calls = getattr(place, name), []

    def killed(*args: Any, **options: Any) -> Any:
        calls.append(name)
        if len(calls) == call:
            raise Killed
        return real(*args, **options)

    def whole() -> None:
        listed = RULES.read_ids(ids, None)
        purge, _ = remove_keys(run, CLASSES["wiki"].connector(run), RULES, listed)
        steps.finish(purge)

    with monkeypatch.context() as patch:
        patch.setattr(place, name, killed)
        with pytest.raises(Killed):
            whole()
    whole()
    kept = Layout(tmp_path).kept_profile  # the user's own keywords, nothing that was collected
    left = [
        path
        for path in tmp_path.rglob("*")
        if path.is_file()
        and path != ids
        and kept not in path.parents
        and (b"Quartz" in (data := texts(path)) or b"Page 1" in data)
    ]
    assert left == []


def texts(path: Path) -> bytes:
    """What is in a file, decompressed."""
    data = path.read_bytes()
    if data[:4] != b"\x28\xb5\x2f\xfd":
        return data
    return zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True).read()
