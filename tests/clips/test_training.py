"""docs/train.md word for word: from the sandbox's films to a model that has learned from them."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import clean_environment
from tests.conftest import ROOT, needs

needs("av", "torch", "torchdata")
pytestmark = pytest.mark.slow

TEXT = (ROOT / "docs" / "train.md").read_text(encoding="utf-8")
BATCH = 32  # of the page
# What the page does in small: each step, over fewer films, in as few passes as have its steps.
SMALL = {
    "--videos 60": "--videos 24",
    "draw 1000": "draw 300",
    "epochs = 12": "epochs = 1",
    "epochs = 2\n": "epochs = 4\n",
}


def blocks(language: str, text: str = TEXT) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def made(folder: Path, changes: dict[str, str]) -> Path:
    """The folder, after the commands of the page were run in it."""
    text = TEXT
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    for recipe in blocks("toml", text):
        (folder / recipe.split()[1]).write_text(recipe)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["bash", "-e", "-c", "".join(blocks("bash", text))],
        cwd=folder,
        env=clean_environment() | {"PATH": path, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("train"), SMALL)


def run(place: Path, code: list[str]) -> dict[str, Any]:
    """Run blocks of the page, which have assertions of their own; the names that they define."""
    import torch

    names: dict[str, Any] = {}
    threads = torch.get_num_threads()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        torch.set_num_threads(1)  # tests run side by side; and sums have one order
        for number, block in enumerate(code):
            exec(compile(block, f"docs/train.md, block {number}", "exec"), names)
        torch.set_num_threads(threads)
    return names


@pytest.fixture(scope="module")
def ran(place: Path) -> dict[str, Any]:
    """The names of the page after all of its code was run."""
    return run(place, blocks("python"))


def test_a_model_learns_from_films_what_shapes_stand_for(tmp_path: Path) -> None:
    """On videos that it has not seen, where guessing finds one of 32."""
    *_, trained = run(made(tmp_path, {}), blocks("python")[:3])["accuracies"]
    assert trained > 4 / BATCH


def test_the_page_begins_with_ten_steps_of_a_line_each(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(place, blocks("python")[:1])
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines] == [f"step {n}" for n in range(1, 11)]
    losses = [float(re.findall(r"loss ([\d.]+),", line)[0]) for line in lines]
    assert min(losses[-3:]) < losses[0]


def test_the_training_loop_writes_a_model(ran: dict[str, Any], place: Path) -> None:
    from transformers import CLIPModel

    assert len(ran["accuracies"]) == 2  # before the training and after it
    stored = CLIPModel.from_pretrained(place / "model").state_dict()
    fresh = ran["small_clip"](layers=1).state_dict()
    assert stored.keys() == fresh.keys()
    assert not any(stored[name].equal(weights) for name, weights in fresh.items())


def test_no_video_is_both_trained_on_and_held_out(ran: dict[str, Any]) -> None:
    seen, unseen = ({clip["video_id"] for clip in ran[name]} for name in ("train", "held_out"))
    assert len(unseen) > 3
    assert not seen & unseen


def test_films_and_shards_have_the_same_clips(ran: dict[str, Any], place: Path) -> None:
    """As the page says; JPEG changes pixels a little."""
    from_shards = ran["held_out"]
    keys = "', '".join(clip["pair_id"] for clip in from_shards)
    clips = ran["data"].clips(None, f"pair_id IN ('{keys}')")
    films = clips.torch(videos=place / "films", frames=4, size=(64, 64), fit="crop")
    decoded = {clip["pair_id"]: clip for clip in films}
    assert len(decoded) > BATCH
    for clip in from_shards:
        other = decoded[clip["pair_id"]]
        assert (clip["tokens"] == other["tokens"]).all()
        assert (clip["frame_times_s"] == other["frame_times_s"]).all()
        assert (clip["video"].float() - other["video"].float()).abs().mean() < 8


def test_the_papers_numbers_drive_the_same_loop(ran: dict[str, Any]) -> None:
    """Ten steps of the warm-up, of which the last two layers of each tower alone learn."""
    paper, share = ran["paper"], ran["share_of_peak"]
    rate = paper["peak_rate"] * paper["pretrained_rate"]
    assert [one for one, _ in ran["ten"]] == pytest.approx([rate * n / 500 for n in range(1, 11)])
    assert (share(500, 9_000, paper), share(9_000, 9_000, paper)) == pytest.approx((1, 1 / 15))
    assert share(4_750, 9_000, paper) == pytest.approx((1 + 1 / 15) / 2)
    before = ran["small_clip"](layers=3).state_dict()
    after = ran["model"].state_dict()
    learned = {name for name, weights in after.items() if not (weights == before[name]).all()}
    left = ("embeddings", "layers.0.", "pre_layrnorm", "logit_scale")
    assert learned == {name for name in before if not any(one in name for one in left)}


def test_a_crop_is_the_same_for_all_frames_of_a_clip(ran: dict[str, Any]) -> None:
    import torch

    torch.manual_seed(1)
    pictures = torch.rand(4, 1, 3, 64, 64) * 255
    cut = ran["cropped"](pictures.repeat(1, 5, 1, 1, 1), 0.5)
    assert cut.shape == (4, 5, 3, 64, 64)
    assert (cut == cut[:, :1]).all()
    assert ((cut - pictures).abs().mean((1, 2, 3, 4)) > 10).all()
