"""What a purge removes, what was purged before, what was never there, and what names no item."""

from dataclasses import replace
from pathlib import Path

import pytest

from kb.artifacts import purge as steps
from kb.core.config.pipeline import load, locate
from kb.core.errors import SettingError
from kb.core.progress import LineProgress
from kb.filters.filter_run import run_clean
from kb.store.layout import Layout
from kb.store.state import tombstones
from tests.artifacts.purged import COUNTS, purged
from tests.filters.made import MONDAY, listing, put, run_at, transcript, video

VIDEO, OTHER, LISTED, ASKED, NEVER = (
    *("PotteryVi01", "PotteryVi02"),
    *("PotteryLi01", "PotteryAs01", "PotteryNe01"),
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Videos that were read, one with a transcript; one that only a channel's list names, and one
    that was asked for in vain.
    """
    root = tmp_path / "data"
    ids = f"{VIDEO},{OTHER},{ASKED}"
    put(root, "videos", (MONDAY, {"id": ids}, listing(video(VIDEO), video(OTHER))))
    put(root, "transcripts", transcript(VIDEO))
    entry = {"snippet": {"resourceId": {"videoId": LISTED}}, "contentDetails": {"videoId": LISTED}}
    put(root, "playlist_items", (MONDAY, {"playlistId": "UU1"}, listing(entry)))
    return root


@pytest.mark.parametrize("filtered", [False, True])
def test_each_id_of_youtube_is_told_apart(root: Path, filtered: bool) -> None:
    run = run_at(root)
    if filtered:
        run_clean(run, "youtube")
    lines = (
        f"https://www.youtube.com/watch?ab_channel=KilnRoad123&v={VIDEO}",
        VIDEO,
        LISTED,
        NEVER,
        "https://www.youtube.com/user/kilnroadpot",
        "KilnRoad",
    )
    # What was asked for in vain goes with every purge.
    assert purged(run, "youtube", *lines) == (3, 0, 1, 2)
    assert tombstones.keys(root, "youtube") == {VIDEO, LISTED, ASKED, NEVER}
    assert purged(run, "youtube", *lines) == (0, 3, 0, 2)
    assert purged(run, "youtube", OTHER, ASKED, NEVER) == (1, 2, 0, 0)


def test_what_only_tables_hold_was_there(root: Path) -> None:
    run = run_at(root)
    run_clean(run, "youtube")
    for segment in root.glob("raw/youtube/*/*.zst"):
        segment.unlink()
    (root / "state" / "youtube.sqlite").unlink(missing_ok=True)
    assert purged(run, "youtube", VIDEO, LISTED, NEVER) == (1, 0, 2, 0)


def test_a_list_that_names_no_item_changes_nothing(root: Path, tmp_path: Path) -> None:
    ids = tmp_path / "ids.txt"
    ids.write_text("\nhttps://vimeo.com/watch?v=PotteryVi01\nKilnRoad\n")
    before = sorted(root.rglob("*"))
    for command in ("purge", "plan"):
        with pytest.raises(SettingError, match=r"https://vimeo\.com/watch\?v=PotteryVi01") as error:
            getattr(load(str(locate("purge"))), command)(run_at(root), "youtube", ids)
        assert error.value.exit_code == 2
    assert sorted(root.rglob("*")) == before


def test_unread_lines_are_listed_and_unknown_ids_are_one_line(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = replace(run_at(root), progress=LineProgress())
    purged(run, "youtube", "KilnRoad", "PL0123", *(f"PotteryN{n:03}" for n in range(9)))
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if "KilnRoad" in line or "PL0123" in line] == [
        "unread, as it names no item: 'KilnRoad'",
        "unread, as it names no item: 'PL0123'",
    ] * 2
    assert len([line for line in said if "PotteryN" in line]) == 2  # of the plan and the purge


def test_an_interrupted_purge_says_in_the_end_what_it_would_have_said(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    purged(run_at(root), "youtube", OTHER)
    ids = tmp_path / "ids.txt"
    ids.write_text(f"{VIDEO}\n{OTHER}\n{NEVER}\n")
    room = load(str(locate("purge")))

    def stop(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(steps, "finish", stop)
        with pytest.raises(KeyboardInterrupt):
            room.purge(run_at(root), "youtube", ids)
    assert Layout(root).purge("youtube").exists()
    for command in ("plan", "purge"):
        summary = getattr(room, command)(run_at(root), "youtube", ids)
        assert [summary[name] for name in COUNTS] == [1, 1, 1, 0]
