"""Scores of pairs: what they cost beside decoding and the bare forward pass, and whether they tell
planted wrong pairs from right ones by the model that docs/train.md trains.

    make bench ARGS="-k score"

The planted films are not those that the model was trained on. In each a keyword is spoken every
40 s, among words that are no keywords, and its shape is shown two seconds before and after.
"""

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import av
import duckdb
import numpy as np
import pytest
import torch
from transformers import CLIPConfig, CLIPModel

from kb.core.installation import folder
from kb.pairs.clip_tokens import token_ids
from kb.sandbox.domain import usual
from kb.sandbox.youtube.films import Picture, timeline, write_film
from kb.score.calibration import area
from kb.score.models import BATCH, ClipModel
from kb.score.pair_scores import Row
from tests.bench.bench_clips import write_moving_film
from tests.cli.conftest import clean_environment
from tests.conftest import ROOT
from tests.score.seen import scored
from tests.youtube.ytdlp import folder as ytdlp

pytestmark = [pytest.mark.bench, pytest.mark.timeout(1800)]

FILMS, MENTIONS, EVERY_S, SHIFT_S = 16, 12, 40, 6
OTHER, SHIFTED, BLACK = "other shape", f"shifted by {SHIFT_S} s", "black film"
# Words of the sandbox's talk that are no keywords.
FILLER = (
    "and you to a is on with about in it at so that than my day of for was up more one because not"
    " but now time once ask times say way from without go out only nobody like can after try if"
    " long be what or then hardly hours told round took old are part thing next have as later first"
)


class Place:
    """A folder with the model of docs/train.md, a data root of sparse talk, and its films."""

    def __init__(self, path: Path) -> None:
        self.path, self.model = path, path / "train" / "model"
        self.said: dict[str, list[tuple[str, float]]] = {}
        self.seconds = EVERY_S * (MENTIONS + 1)
        words = FILLER.split()
        names = sorted(noun.title for noun in usual().speech.nouns)
        rng = random.Random(0)
        given = path / "given"
        given.mkdir(parents=True)
        for number in range(FILMS):
            key = f"planted{number:04d}"
            said, lines = [], []
            at = 1.0
            for place in range(MENTIONS):
                keyword = rng.choice(names)
                while at < EVERY_S * (place + 1) - 5:
                    line = [rng.choice(words) for _ in range(6)]
                    lines.append(self._line(at, line))
                    at += 4
                at = float(EVERY_S * (place + 1))
                lines.append(self._line(at, ["so", *keyword.lower().split(), "is", "not", "old"]))
                said.append((keyword, at + 0.24))
                at += 4
            self.said[key] = said
            about = ytdlp.info(key, duration=self.seconds, title=f"minecraft {number}")
            (given / f"{key}.info.json").write_text(json.dumps(about))
            (given / f"{key}.en-orig.json3").write_text(ytdlp.json3(lines, automatic=True))

    @staticmethod
    def _line(at: float, words: list[str]) -> ytdlp.Line:
        spaced = [word if not place else f" {word}" for place, word in enumerate(words)]
        timed = [(240 * place, word) for place, word in enumerate(spaced)]
        return ytdlp.Line(round(at * 1000), 240 * len(words), timed)

    def run(self, command: str, at: Path) -> None:
        with self.started(command, at) as process:
            _, said = process.communicate()
        assert process.returncode == 0, said

    def started(self, command: str, at: Path) -> subprocess.Popen[str]:
        env = clean_environment() | {
            "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
            "PYTHONPATH": str(ROOT),
            "OMP_NUM_THREADS": "1",  # of so small a model threads wait for each other
        }
        return subprocess.Popen(
            ["bash", "-e", "-c", command],
            cwd=at,
            env=env,
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    def films(self, kind: str, shown: Callable[[str], Iterator[tuple[int, Picture]]]) -> Path:
        """A film for each video, with the pictures that `shown` gives for its id."""
        out = self.path / f"films {kind}"
        if not out.exists():
            out.mkdir()
            for key in self.said:
                write_film(out / f"{key}.mp4", shown(key))
        return out

    def planted(self, kind: str) -> Path:
        """Films of the talk in which what `kind` says is wrong."""
        names = sorted({name for said in self.said.values() for name, _ in said})
        other = dict(zip(names, names[len(names) // 2 :] + names[: len(names) // 2], strict=True))

        def shown(key: str) -> Iterator[tuple[int, Picture]]:
            said = {
                "right": self.said[key],
                OTHER: [(other[name], at) for name, at in self.said[key]],
                SHIFTED: [(name, at + SHIFT_S) for name, at in self.said[key]],
                BLACK: [],
            }
            return timeline(said[kind], self.seconds)

        return self.films(kind, shown)

    def command(self, root: Path, films: Path, workers: int = 2) -> str:
        return (
            f'exec kb pairs score --data "{root}" --videos "{films}" --model "{self.model}"'
            f" --workers {workers}"
        )

    def unscored(self, name: str) -> Path:
        """A data root of its own with the pairs, and without scores."""
        return shutil.copytree(self.path / "data", self.path / f"root {name}")

    def scores(self, films: Path) -> dict[str, dict[str, float]]:
        """By pair: its row of pairs/scores, from a data root of its own."""
        root = self.unscored(films.name)
        self.run(self.command(root, films), self.path)
        rows = duckdb.sql(f"FROM '{root}/pairs/scores-*.parquet'").to_arrow_table().to_pylist()
        return {row["pair_id"]: row for row in rows}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    made = Place(tmp_path_factory.mktemp("score"))
    profile = made.path / "profile"
    shutil.copytree(folder("profiles") / "minecraft", profile)
    text = (profile / "profile.toml").read_text()
    for name, value in (("max_clip_s", 8), ("max_tokens", 20)):
        text = re.sub(rf"^{name} = .*", f"{name} = {value}", text, flags=re.MULTILINE)
    text = re.sub(r"^\[toxicity[^[]*", "", text, flags=re.MULTILINE)
    (profile / "profile.toml").write_text('toxicity = "off"\n' + text)
    how = "--data data --profile profile/profile.toml"
    made.run(
        f"kb youtube import given {how} && kb youtube filter {how} && kb pairs {how}", made.path
    )
    train = made.path / "train"
    train.mkdir()
    page = (ROOT / "docs" / "train.md").read_text(encoding="utf-8")
    bash, recipe, python = (
        re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
        for language in ("bash", "toml", "python")
    )
    more = bash[0].replace("--videos 60", "--videos 160").replace("draw 1000", "draw 3200")
    made.run(more, train)
    longer = recipe[0].replace("epochs = 12", "epochs = 16")
    longer = longer.replace("final_rate = 1e-3", "final_rate = 1e-4")
    (train / "small.toml").write_text(longer)
    (train / "train.py").write_text("\n".join(python[:2]))
    made.run("python train.py", train)
    return made


def test_wrong_pairs_are_told_from_right_ones(place: Place, capsys: pytest.CaptureFixture) -> None:
    right, *wrong = (place.scores(place.planted(k)) for k in ("right", OTHER, SHIFTED, BLACK))
    similarity = np.array([one["similarity"] for one in right.values()])
    lines, areas = [f"{len(right)} pairs of {FILMS} films", "", "| planted | measured | |"], []
    lines.append("|---|---|---|")
    for kind, scores in zip((OTHER, SHIFTED, BLACK), wrong, strict=True):
        assert scores.keys() == right.keys()
        found = area(similarity, np.array([scores[key]["similarity"] for key in right]))
        assert found is not None
        areas.append(found["auc"])
        bounds = f"{found['auc']:.3f} ({found['low']:.3f} to {found['high']:.3f})"
        lines.append(f"| {kind} | area under the curve | {bounds} |")
    offsets = np.array([one["best_offset_s"] for one in wrong[1].values()])
    shift = float((offsets == SHIFT_S).mean())
    lines.append(f"| {SHIFTED} | `best_offset_s` is {SHIFT_S} | {shift:.1%} of pairs |")
    apart = _static_apart(place)
    lines.append(f"| pictures that stay | `static_share`, largest error | {apart.max():.4f} |")
    differences = _differences(place)
    lines.append(f"| two workers; SIGKILL, then again | bytes that differ | {differences} |")
    with capsys.disabled():
        print("", *lines, sep="\n")
    assert min(areas) >= 0.95
    assert shift >= 0.9
    assert apart.max() <= 0.02
    assert differences == 0


def _static_apart(place: Place) -> np.ndarray:
    """Of each pair how far its static share is from that of its film, in which a shape is there or
    not, anew in some of the seconds.
    """
    rng = np.random.default_rng(0)
    there = {
        key: (np.cumsum(rng.random(place.seconds) < often) % 2).tolist()
        for key, often in zip(place.said, np.linspace(0, 1, FILMS), strict=True)
    }

    def shown(key: str) -> Iterator[tuple[int, Picture]]:
        shape = ((), (place.said[key][0][0],))
        yield from ((2 * second, shape[one]) for second, one in enumerate(there[key]))
        yield 2 * place.seconds - 1, shape[there[key][-1]]

    found = place.scores(place.films("that stay", shown))
    columns = "pair_id, video_id, clip_start_s, clip_end_s"
    pairs = duckdb.sql(f"SELECT {columns} FROM '{place.path}/data/pairs/pairs-*.parquet'")
    apart = []
    for pair, video, start_s, end_s in pairs.fetchall():
        middles = [s for s in range(place.seconds) if start_s <= s + 0.5 <= end_s]
        still = [there[video][s] == there[video][s + 1] for s in middles[:-1]]
        apart.append(found[pair]["static_share"] - np.mean(still))
    return np.abs(apart)


def _differences(place: Place) -> int:
    """Bytes of the table that differ between one worker and two, and after SIGKILL."""
    films, tables = place.planted("right"), []
    for name, workers, kill in (("of one", 1, False), ("of two", 2, False), ("killed", 2, True)):
        root = place.unscored(name)
        command = place.command(root, films, workers)
        if kill:
            with place.started(command, place.path) as process:
                while not any((root / "state" / "scores").glob("*.json")):
                    assert process.poll() is None
                    time.sleep(0.01)
                process.send_signal(signal.SIGKILL)
            assert not any((root / "pairs").glob("scores-*"))
        place.run(command, place.path)
        (table,) = (root / "pairs").glob("scores-*.parquet")
        tables.append(table.read_bytes())
    first, *others = tables
    return sum(
        abs(len(first) - len(one)) + sum(a != b for a, b in zip(first, one, strict=False))
        for one in others
    )


# -- what it costs ---------------------------------------------------------------------------------

SECONDS = 40


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """720p at 30 pictures a second, which move."""
    path = tmp_path_factory.mktemp("film") / "a.mp4"
    write_moving_film(path, 720, SECONDS)
    return path


def _clip(patch: int, width: int, layers: int, side: int) -> CLIPModel:
    """A CLIP with random weights: of 32, 768, 12 and 224 it has the size of ViT-B/32."""
    torch.manual_seed(0)
    part = {
        "hidden_size": width,
        "intermediate_size": 4 * width,
        "num_hidden_layers": layers,
        "num_attention_heads": width // 64,
    }
    text = {**part, "eos_token_id": 49_407}
    vision = {**part, "image_size": side, "patch_size": patch}
    return CLIPModel(CLIPConfig(text_config=text, vision_config=vision, projection_dim=64))


def _rows() -> list[Row]:
    """Pairs every eight seconds, as a talk that names something in every sentence has them."""
    return [
        {
            "pair_id": str(at),
            "text": f"{at} " + " ".join(random.Random(at).choices(FILLER.split(), k=24)),
            "clip_start_s": at - 6,
            "clip_end_s": at + 6,
            "match_start_s": at,
            "match_end_s": at + 0.5,
        }
        for at in range(8, SECONDS, 8)
    ]


def _bare(path: Path, model: CLIPModel, side: int, texts: list[str]) -> None:
    """Decode the film, and run the model over as many frames and texts in the same batches."""
    with av.open(str(path)) as film:
        film.streams.video[0].codec_context.thread_count = 1
        for _ in film.decode(video=0):
            pass
    ids = torch.from_numpy(np.stack([token_ids(text) for text in texts]))
    with torch.inference_mode():
        for at in range(0, SECONDS, BATCH):
            model.get_image_features(torch.rand(min(BATCH, SECONDS - at), 3, side, side))
        for at in range(0, len(texts), BATCH):
            some = ids[at : at + BATCH]
            model.get_text_features(some[:, : (some != 0).sum(1).max()])


def _cost(work: Callable[[], object]) -> np.ndarray:
    """Seconds and CPU seconds."""
    begin = time.perf_counter(), time.process_time()
    work()
    return np.array((time.perf_counter(), time.process_time())) - begin


@pytest.mark.parametrize(
    ("name", "shape"), [("ViT-B/32", (32, 768, 12, 224)), ("the page's", (16, 64, 1, 64))]
)
def test_a_film_costs_little_more_than_decoding_and_the_model(
    film: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    name: str,
    shape: tuple[int, int, int, int],
) -> None:
    """The least of some rounds of each, by turns."""
    clip, rows = _clip(*shape).eval(), _rows()
    clip.save_pretrained(tmp_path / "model")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # as a worker does
    model = ClipModel(tmp_path / "model")
    texts = [row["text"] for row in rows]
    ours, bare = np.full((2, 2), np.inf)
    for _ in range(2):
        ours = np.minimum(ours, _cost(lambda: scored(film, rows, model)))
        work = lambda: _bare(film, clip, shape[-1], texts)  # noqa: E731
        bare = np.minimum(bare, _cost(work))
    torch.set_num_threads(threads)
    ratio = ours / bare
    with capsys.disabled():
        print(
            f"\n{name}: {len(rows)} pairs of a film of {SECONDS} s in {ours[0]:.2f} s,"
            f" {ratio[0]:.2f} x decoding and the bare model ({ratio[1]:.2f} x in CPU time)"
        )
    assert ratio.max() <= 1.3


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_clips_a_second_of_a_gpu(film: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """ViT-B/16 with random weights; the GPU's own figure of how long it was busy."""
    _clip(16, 768, 12, 224).save_pretrained(tmp_path / "model")
    model, rows = ClipModel(tmp_path / "model", "cuda"), _rows()
    scored(film, rows, model)  # to warm up
    asked = "nvidia-smi --query-gpu=utilization.gpu --format=csv,noheader,nounits -lms 100"
    with subprocess.Popen(asked.split(), stdout=subprocess.PIPE, text=True) as watcher:
        wall, _ = _cost(lambda: [scored(film, rows, model) for _ in "123"])
        watcher.terminate()
        busy = [int(line) for line in watcher.communicate()[0].split() if line.isdigit()]
    with capsys.disabled():
        print(
            f"\n{torch.cuda.get_device_name()}: {3 * len(rows) / wall:.1f} clips a second of one"
            f" worker, GPU busy {np.mean(busy):.0f} % of the time"
        )
    assert busy
