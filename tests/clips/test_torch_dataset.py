"""Clips as a PyTorch dataset: every clip once over ranks and workers, in an order that a seed
gives again, resumed exactly; decoded from films and read from shards.
"""

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kb
from kb.clips import build
from kb.clips.clip_files import CutOptions
from kb.clips.torch_dataset import ClipDataset
from kb.core.errors import UsageError
from kb.core.installation import torch
from kb.pairs.clip_tokens import token_ids
from tests.clips.films import film, number_of
from tests.conftest import needs
from tests.release.conftest import a_run
from tests.release.made import build as made

needs("torch", "torchdata")

FPS = 8  # times are exact in binary
VIDEOS = 9  # two pairs each; the last has no film, the one before it a short one
SMALL: dict[str, Any] = {"frames": 2, "size": (48, 80)}


def stateful_loader(dataset: ClipDataset, **options: Any) -> Any:
    """torchdata's loader. Torch is loaded late: every process collects this file."""
    from torchdata.stateful_dataloader import StatefulDataLoader

    return StatefulDataLoader(dataset, **options)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = made(tmp_path_factory.mktemp("root"), sources=("pairs",), n=VIDEOS, export=False)
    (root / "state").mkdir()
    return root


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Films of 20 s, whose frames carry their numbers."""
    folder = tmp_path_factory.mktemp("films")
    first = folder / "vid00000000.mp4"
    film(first, "libx264", range(20 * FPS), Fraction(1, FPS), (160, 90), {"preset": "veryfast"})
    for number in range(1, VIDEOS - 2):
        (folder / f"vid{number:08d}.mp4").symlink_to(first)
    short = folder / f"vid{VIDEOS - 2:08d}.mp4"
    film(short, "libx264", range(4 * FPS), Fraction(1, FPS), (160, 90), {"preset": "veryfast"})
    return folder


# Shards of either format are read by the same code in the same order.
EITHER = pytest.mark.parametrize("source", ["films", "webdataset"], indirect=True)


@pytest.fixture(scope="module", params=["films", "webdataset", "npz"])
def source(
    request: pytest.FixtureRequest,
    root: Path,
    films: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Path]:
    """The arguments that say where clips come from."""
    if request.param == "films":
        return {"videos": films}
    out = tmp_path_factory.mktemp("shards")
    options = CutOptions(**SMALL, format=request.param)
    build.build(replace(a_run(root), workers=1), [films], out, options, build.Chosen())
    return {"shards": out}


pytestmark = pytest.mark.filterwarnings("ignore:.*the film has no picture for the whole clip")


def _keys(clips: Any) -> list[str]:
    return [clip["pair_id"] for clip in clips]


def _batches(loader: Any) -> Iterator[str]:
    for batch in loader:
        yield from batch["pair_id"]


def test_clips_have_the_shapes_and_values_that_models_take(root: Path, source) -> None:
    dataset = kb.load(root).clips().torch(**source, **SMALL)
    assert isinstance(dataset, torch.utils.data.IterableDataset)
    pairs = {row["pair_id"]: row for row in kb.load(root).clips()}
    clips = list(dataset)
    assert len(clips) == 2 * (VIDEOS - 2)
    for clip in clips:
        pair = pairs[clip["pair_id"]]
        assert (clip["video"].shape, clip["video"].dtype) == ((2, 3, 48, 80), torch.uint8)
        assert (clip["tokens"].shape, clip["tokens"].dtype) == ((77,), torch.int64)
        assert (clip["frame_times_s"].shape, clip["frame_times_s"].dtype) == ((2,), torch.float64)
        assert (clip["tokens"].numpy() == token_ids(pair["text"])).all()
        assert {name: clip[name] for name in ("text", "keyword", "video_id")} == {
            name: pair[name] for name in ("text", "keyword", "video_id")
        }
        shown = [number_of(np.moveaxis(one.numpy(), 0, -1)) for one in clip["video"]]
        assert shown == [int(time * FPS) for time in clip["frame_times_s"].tolist()]


def test_height_and_width_are_not_swapped(root: Path, films: Path) -> None:
    """Bars change from left to right and not from top to bottom."""
    clip = next(iter(kb.load(root).clips().torch(films)))
    assert clip["video"].shape == (16, 3, 160, 256)
    video = clip["video"].float()
    assert video.std(dim=3).mean() > 20 * video.std(dim=2).mean()


def test_every_clip_comes_once_over_ranks_and_workers(root: Path, source) -> None:
    seen: Counter[str] = Counter()
    counts = []
    for rank in range(3):
        part = kb.load(root).clips().torch(**source, **SMALL, rank=rank, world_size=3)
        keys = list(_batches(torch.utils.data.DataLoader(part, batch_size=2, num_workers=2)))
        assert sorted(keys) == sorted(_keys(part)), "workers change nothing but the order"
        counts.append(len(keys))
        seen.update(keys)
    assert len(seen) == 2 * (VIDEOS - 2)
    assert set(seen.values()) == {1}


@EITHER
def test_seed_and_epoch_give_the_order(root: Path, source) -> None:
    def epochs(seed: int) -> list[list[str]]:
        dataset = kb.load(root).clips().torch(**source, **SMALL, seed=seed)
        found = []
        for epoch in range(2):
            dataset.set_epoch(epoch)
            found.append(_keys(dataset))
        dataset.set_epoch(0)
        assert _keys(dataset) == found[0]
        return found

    first, other = epochs(0), epochs(1)
    assert first == epochs(0)
    assert len({tuple(one) for one in first + other}) == 4
    assert len({tuple(sorted(one)) for one in first + other}) == 1


@EITHER
@pytest.mark.parametrize("taken", [0, 5, 14])
def test_a_state_resumes_in_the_middle_of_an_epoch(root: Path, source, taken: int) -> None:
    dataset = kb.load(root).clips().torch(**source, **SMALL)
    dataset.set_epoch(3)
    clips = iter(dataset)
    before = [next(clips)["pair_id"] for _ in range(taken)]
    state = dataset.state_dict()
    rest = _keys(clips)
    again = kb.load(root).clips().torch(**source, **SMALL)
    again.load_state_dict(state)
    again.set_epoch(3)
    assert _keys(again) == rest
    assert sorted(_keys(again)) == sorted(before + rest), "the pass after it is whole"
    again.load_state_dict(state)
    workers = torch.utils.data.DataLoader(again, batch_size=None, num_workers=2)
    assert sorted(_keys(workers)) == sorted(rest), "nothing twice, nothing lost"


@EITHER
@pytest.mark.parametrize("workers", [0, 2])
def test_a_stateful_loader_resumes_with_its_workers(root: Path, source, workers: int) -> None:
    def loader() -> Any:
        dataset = kb.load(root).clips().torch(**source, **SMALL)
        return stateful_loader(dataset, batch_size=3, num_workers=workers)

    whole = list(_batches(loader()))
    first = loader()
    batches = iter(first)
    taken = [key for _ in range(2) for key in next(batches)["pair_id"]]
    state = first.state_dict()
    second = loader()
    second.load_state_dict(state)
    assert taken + list(_batches(second)) == whole


def test_a_stateful_loader_of_a_dataset_that_was_read_before_begins_anew(root: Path, films) -> None:
    """A worker that has given nothing yet is at the beginning, not where a pass before ended."""
    dataset = kb.load(root).clips().torch(films, **SMALL)
    before = iter(dataset)
    assert [next(before)["pair_id"] for _ in range(4)]
    whole = list(_batches(stateful_loader(dataset, batch_size=3, num_workers=2)))
    first = stateful_loader(dataset, batch_size=3, num_workers=2)
    taken = next(iter(first))["pair_id"]
    second = stateful_loader(dataset, batch_size=3, num_workers=2)
    second.load_state_dict(first.state_dict())
    assert taken + list(_batches(second)) == whole


def test_the_state_of_worker_processes_is_never_guessed(root: Path, films: Path) -> None:
    dataset = kb.load(root).clips().torch(films, **SMALL)
    assert list(torch.utils.data.DataLoader(dataset, batch_size=None, num_workers=1))
    with pytest.raises(UsageError, match="how far worker processes"):
        dataset.state_dict()


def test_a_state_of_other_clips_is_refused(root: Path, films: Path) -> None:
    state = kb.load(root).clips().torch(films, **SMALL).state_dict()
    with pytest.raises(UsageError, match="other clips"):
        kb.load(root).clips().torch(films, **SMALL, seed=1).load_state_dict(state)
    with pytest.raises(UsageError, match="other clips"):
        kb.load(root).clips("diamond").torch(films, **SMALL).load_state_dict(state)


def test_pairs_without_a_clip_are_counted_or_warned_of(root: Path, films: Path) -> None:
    dataset = kb.load(root).clips().torch(films, **SMALL)
    assert dataset.left_out == {"missing": 2}
    with pytest.warns(
        UserWarning, match="has no clip: the film has no picture for the whole clip"
    ) as warned:
        list(dataset)
    assert len(warned) == 2


def test_a_clip_in_a_fifo_is_warned_of(root: Path, films: Path, tmp_path: Path) -> None:
    options = CutOptions(**SMALL, format="npz")
    build.build(replace(a_run(root), workers=1), [films], tmp_path, options, build.Chosen())
    path = min(tmp_path.rglob("*.npz"))
    path.unlink()
    os.mkfifo(path)
    dataset = kb.load(root).clips().torch(shards=tmp_path, **SMALL)
    with pytest.warns(UserWarning, match=f"{path.name} can't be read: it is a FIFO, not a file"):
        assert path.stem not in _keys(dataset)


def test_a_film_of_another_length_is_counted_and_warned_of(root: Path, films: Path) -> None:
    rows = kb.load(root).clips().to_table()
    named = {f"vid{VIDEOS - 2:08d}": 4, "vid00000003": 60}
    lengths = [named.get(video_id, 20) for video_id in rows["video_id"].to_pylist()]
    place = rows.schema.get_field_index("duration_s")
    known = kb.reader.Clips(rows.set_column(place, "duration_s", [lengths]))
    with pytest.warns(
        UserWarning, match="vid00000003 has no clips: the film lasts 20.0 s, the vid"
    ):
        dataset = known.torch(films, **SMALL)
    assert dataset.left_out == {"missing": 2, "film_differs": 2}


def test_what_is_wrong_is_one_error(root: Path, films: Path, tmp_path: Path) -> None:
    clips = kb.load(root).clips()
    for match, wrong in (
        ("give one", {}),
        ("no pair has a video file", {"videos": tmp_path}),
        ("not a folder", {"videos": tmp_path / "none"}),
        ("no clips", {"shards": tmp_path}),
        ("rank is 2", {"videos": films, "rank": 2, "world_size": 2}),
        ("above 0", {"videos": films, "frames": 0}),
    ):
        with pytest.raises(UsageError) as caught:
            clips.torch(**wrong)
        assert match in f"{caught.value} {caught.value.hint}"
    build.build(
        replace(a_run(root), workers=1), [films], tmp_path / "s", CutOptions(8), build.Chosen()
    )
    with pytest.raises(UsageError, match="8 frames of 160x256"):
        clips.torch(shards=tmp_path / "s")


def test_pairs_without_texts_say_how_to_get_them(root: Path, films: Path) -> None:
    rows = kb.load(root).clips().to_table()
    without = rows.set_column(
        rows.schema.get_field_index("text"), "text", [[None] * rows.num_rows]
    ).cast(rows.schema)
    with pytest.raises(UsageError, match="no text") as caught:
        kb.reader.Clips(without).torch(films)
    assert "kb restore" in caught.value.hint


def test_a_dataset_goes_to_other_processes(root: Path, films: Path) -> None:
    """With spawn, as on macOS, workers get it pickled."""
    dataset = kb.load(root).clips().torch(films, **SMALL)
    loader = torch.utils.data.DataLoader(
        dataset, batch_size=None, num_workers=1, multiprocessing_context="spawn"
    )
    assert isinstance(dataset, ClipDataset)
    assert _keys(loader) == _keys(dataset)
