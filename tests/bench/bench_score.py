"""Scores of pairs by the model that docs/train.md trains, on films with planted wrong pairs: how
well they tell wrong pairs from right ones, and find a shift.

    make bench ARGS="-k score"

The films are not those that the model was trained on. In each a keyword is spoken every 40 s, among
words that are no keywords, and its shape is shown two seconds before and after.
"""

import json
import os
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import duckdb
import numpy as np
import pytest

from kb.core.installation import folder
from kb.sandbox.domain import usual
from kb.sandbox.youtube.films import Mention, _spoken_of, _timeline, _write
from kb.score.calibration import area
from tests.cli.conftest import clean_environment
from tests.conftest import ROOT
from tests.youtube.ytdlp import folder as ytdlp

pytestmark = pytest.mark.bench

FILMS, MENTIONS, EVERY_S, SHIFT_S = 16, 12, 40, 6
# Words of the sandbox's talk that are no keywords.
FILLER = (
    "and you to a is on with about in it at so that than my day of for was up more one because not"
    " but now time once ask times say way from without go out only nobody like can after try if"
    " long be what or then hardly hours told round took old are part thing next have as later first"
)
RATE = 2  # pictures of a film a second


class Place:
    """A folder with the model of docs/train.md, a data root of sparse talk, and its films."""

    def __init__(self, path: Path) -> None:
        self.path, self.model = path, path / "train" / "model"
        self.said: dict[str, list[Mention]] = {}
        self.seconds = EVERY_S * (MENTIONS + 1)
        words = FILLER.split()
        names = sorted({one.name for one in _spoken_of(usual()) if one.name[0].isalpha()})
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
                said.append(Mention(keyword, at + 0.24))
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
        env = clean_environment() | {
            "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
            "PYTHONPATH": str(ROOT),
        }
        done = subprocess.run(
            ["bash", "-e", "-c", command],
            cwd=at,
            env=env,
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
        )
        assert done.returncode == 0, done.stderr

    def films(self, kind: str) -> Path:
        """Films of the talk in which what `kind` says is wrong."""
        out = self.path / kind
        out.mkdir()
        names = sorted({one.keyword for said in self.said.values() for one in said})
        other = dict(zip(names, names[len(names) // 2 :] + names[: len(names) // 2], strict=True))
        for key, said in self.said.items():
            shown = {
                "right": said,
                "other shape": [Mention(other[k], s) for k, s in said],
                f"shifted by {SHIFT_S} s": [Mention(k, s + SHIFT_S) for k, s in said],
                "black": [],
            }[kind]
            _write(out / f"{key}.mp4", _timeline(shown, self.seconds), self.seconds)
        return out

    def scores(self, kind: str, workers: int = 2) -> dict[str, dict[str, float]]:
        """By pair: its row of pairs/scores, from a root of its own."""
        root = self.path / f"root of {kind}"
        shutil.copytree(self.path / "data", root)
        self.run(
            f'kb pairs score --data "{root}" --videos "{self.films(kind)}" --model "{self.model}"'
            f" --workers {workers}",
            self.path,
        )
        rows = duckdb.sql(f"FROM '{root}/pairs/scores-*.parquet'").to_arrow_table().to_pylist()
        return {row["pair_id"]: row for row in rows}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    made = Place(tmp_path_factory.mktemp("score"))
    profile = made.path / "profile"
    shutil.copytree(folder("profiles") / "minecraft", profile)
    text = (profile / "profile.toml").read_text()
    text = re.sub(r"^max_clip_s = .*", "max_clip_s = 8", text, flags=re.MULTILINE)
    text = re.sub(r"^\[toxicity[^[]*", "", text, flags=re.MULTILINE)
    (profile / "profile.toml").write_text('toxicity = "off"\n' + text)
    how = "--data data --profile profile/profile.toml"
    made.run(
        f"kb youtube import given {how} && kb youtube filter {how} && kb pairs {how}", made.path
    )
    train = made.path / "train"
    train.mkdir()
    page = (ROOT / "docs" / "train.md").read_text(encoding="utf-8")
    bash, python = (
        "\n".join(re.findall(rf"^```{one}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[:2])
        for one in ("bash", "python")
    )
    made.run(bash.replace("--videos 60", "--videos 120").replace("draw 1000", "draw 2000"), train)
    (train / "train.py").write_text(python)
    made.run("python train.py", train)
    return made


def test_wrong_pairs_are_told_from_right_ones(place: Place, capsys: pytest.CaptureFixture) -> None:
    found = {
        kind: place.scores(kind)
        for kind in ("right", "other shape", f"shifted by {SHIFT_S} s", "black")
    }
    right = found["right"]
    lines, areas = [f"{len(right)} pairs of {FILMS} films"], []
    for kind, scores in found.items():
        if kind == "right":
            continue
        assert scores.keys() == right.keys()
        both = (np.array([one[key]["similarity"] for key in right]) for one in (right, scores))
        areas.append(area(*both))
        lines.append(f"{kind}: AUC {areas[-1]}")
    offsets = [one["best_offset_s"] for one in found[f"shifted by {SHIFT_S} s"].values()]
    shift = float(np.mean(np.array(offsets) == SHIFT_S))
    lines.append(f"shift of {SHIFT_S} s found in {shift:.1%}")
    with capsys.disabled():
        print("", *lines, sep="\n")
    assert all(one["auc"] >= 0.95 for one in areas)
    assert shift >= 0.9
