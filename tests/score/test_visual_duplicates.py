"""Clips of different videos that show the same, by planted vectors; films: tests/bench."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from kb.score import visual_duplicates as duplicates
from kb.score.visual_duplicates import visual_duplicates
from tests.score.planted_vectors import MODEL, World, clips_of, plant

FILMS, COPIED = 20, 10
CLIPS = pa.schema(
    [
        *((name, pa.string()) for name in ("pair_id", "video_id")),
        *((name, pa.float64()) for name in ("clip_start_s", "clip_end_s")),
    ]
)


def rows_of(*videos: str) -> list[dict[str, object]]:
    return [row for video in sorted(videos) for row in clips_of(video)]


def found_in(root: Path, rows: list[dict[str, object]]) -> dict[str, str]:
    """The first pair of the cluster of each that is not first itself, as "video second"."""
    ordered = sorted(rows, key=lambda row: (row["video_id"], row["pair_id"]))
    place = {row["pair_id"]: f"{row['video_id']} {row['clip_start_s']:.0f}" for row in rows}
    found = visual_duplicates(root, MODEL, pa.Table.from_pylist(ordered, schema=CLIPS))
    return {place[pair]: place[first] for pair, first in found.items()}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, object]]]:
    """Films a00 to a19, and copies b00 to b09 of the first ten."""
    root, made = tmp_path_factory.mktemp("visual"), World()
    for number in range(FILMS):
        film = made.film()
        plant(root, f"a{number:02}", film)
        if number < COPIED:
            plant(root, f"b{number:02}", made.copy(film))
    names = [path.name for path in (root / "annotations" / "films").iterdir()]
    return root, rows_of(*names)


@pytest.mark.parametrize("leaf", [duplicates.LEAF, 32])
def test_copies_are_found_and_other_scenes_of_the_world_are_not(
    world: tuple[Path, list[dict[str, object]]], leaf: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compared as a whole, and where hyperplanes part the clips."""
    monkeypatch.setattr(duplicates, "LEAF", leaf)
    found = found_in(*world)
    right = {clip: first for clip, first in found.items() if clip == first.replace("a", "b")}
    assert len(right) >= 0.95 * COPIED * 8
    assert len(found) - len(right) <= 0.01 * len(world[1])
    assert found_in(world[0], world[1][::-1]) == found


def test_what_does_not_move_has_no_duplicates(tmp_path: Path) -> None:
    """A black picture, or a menu, is in many films; and a clip of few frames has no course."""
    made = World()
    still = np.repeat(made.film(1), 64, axis=0)
    for name in ("a", "b", "c"):
        plant(tmp_path, name, np.concatenate([still[:32], made.film(32)]))
    plant(tmp_path, "d", still[:3])
    assert found_in(tmp_path, rows_of("a", "b", "c", "d")) == {}
    assert found_in(tmp_path, []) == {}
    assert found_in(tmp_path, rows_of("without-vectors")) == {}


def test_a_copy_may_begin_later_and_have_another_grid(tmp_path: Path) -> None:
    """A film with an opening before it, and vectors every half second."""
    made = World()
    others = {f"x{number}": made.film() for number in range(6)}
    films = {"a": made.film(), **others}
    for name, film in films.items():
        plant(tmp_path, name, np.repeat(film, 2, axis=0), step_s=0.5)
    opening = made.copy(np.concatenate([made.film(5), films["a"]]))
    plant(tmp_path, "b", np.repeat(opening, 2, axis=0), step_s=0.5)
    moved = [{**row, "clip_start_s": row["clip_start_s"] + 5} for row in clips_of("b")]
    moved = [{**row, "clip_end_s": row["clip_start_s"] + 8} for row in moved]
    found = found_in(tmp_path, rows_of(*films) + moved)
    assert found == {f"b {at + 5}": f"a {at}" for at in range(0, 64, 8)}
