"""A data root whose films show what is named before, with, after or never with its words."""

import json
import random
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from kb.score.film_pass import Watched
from kb.score.film_store import Vectors, keep_film, keep_vectors, text_key
from kb.score.pair_scores import needed_ticks
from kb.score.shots import Shot
from tests.cli.conftest import clean_environment
from tests.inprocess import Done, run
from tests.youtube.ytdlp import folder as ytdlp

MOST_S = 15  # by how much a picture comes before or after its words
SHOWN_S = 2.0  # for so long before and after its middle
KINDS = ("before", "with", "after", "never")
# Words of the sandbox's talk that are no keywords.
FILLER = (
    "and you to about it so that than day up more because not now time once ask was for with on but"
    " my of if long be what or then told old are part next have as later first"
)
PROFILE = """\
name = "shapes"
title = "Minecraft"
toxicity = "off"
[youtube]
keywords = ["Minecraft"]
category_ids = [20]
[pairs]
include = {names}
max_tokens = 20
"""


class Mention(NamedTuple):
    """A keyword that is spoken at `at_s`; its picture's middle, None where it is never shown."""

    keyword: str
    at_s: float
    kind: str
    shown_s: float | None


class AlignmentWorld:
    """Videos in which a keyword is named every `every_s` seconds, a quarter of each kind."""

    def __init__(
        self, path: Path, names: list[str], films: int, mentions: int, every_s: int
    ) -> None:
        self.path, self.root, self.seconds = path, path / "data", every_s * (mentions + 1)
        self.mentions: dict[str, list[Mention]] = {}
        rng = random.Random(0)
        given = path / "given"
        given.mkdir(parents=True)
        (path / "profile.toml").write_text(PROFILE.format(names=json.dumps(names)))
        for number in range(films):
            key, own, lines, at = f"aligned{number:04d}", [], [], 1.0
            for place in range(mentions):
                keyword, kind = rng.choice(names), KINDS[(number + place) % 4]
                while at < every_s * (place + 1) - 5:
                    lines.append(self._line(at, rng.choices(FILLER.split(), k=6)))
                    at += 4
                at = float(every_s * (place + 1))
                lines.append(self._line(at, ["so", *keyword.lower().split(), "is", "not", "old"]))
                by_s = rng.uniform(4, MOST_S) * {"before": -1, "after": 1}.get(kind, 0)
                shown_s = None if kind == "never" else at + 0.24 + by_s
                own.append(Mention(keyword, at + 0.24, kind, shown_s))
                at += 4
            self.mentions[key] = own
            about = ytdlp.info(key, duration=self.seconds, title=f"minecraft {number}")
            (given / f"{key}.info.json").write_text(json.dumps(about))
            (given / f"{key}.en-orig.json3").write_text(ytdlp.json3(lines, automatic=True))
        for words in (("youtube", "import", given), ("youtube", "filter"), ("pairs",)):
            done = self.kb(*words)
            assert done.code == 0, done.err

    @staticmethod
    def _line(at: float, words: list[str]) -> ytdlp.Line:
        spaced = [word if not place else f" {word}" for place, word in enumerate(words)]
        timed = [(240 * place, word) for place, word in enumerate(spaced)]
        return ytdlp.Line(round(at * 1000), 240 * len(words), timed)

    def kb(self, *words: object) -> Done:
        at = ("--data", self.root, "--profile", self.path / "profile.toml")
        return run((*words, *at), env=clean_environment(), cwd=self.path)

    def shown(self, video: str) -> list[tuple[str, float]]:
        """Which pictures a film shows, and when."""
        every = self.mentions[video]
        return [(one.keyword, one.shown_s) for one in every if one.shown_s is not None]

    def rows(self, name: str) -> list[dict[str, object]]:
        paths = sorted(self.root.glob(f"{name}-*.parquet"))
        return pa.concat_tables([pq.read_table(path) for path in paths]).to_pylist()

    def mention_of(self, pair: dict[str, object]) -> Mention:
        own = self.mentions[pair["video_id"]]
        return min(own, key=lambda one: abs(one.at_s - pair["match_start_s"]))

    def plant_vectors(self, model: str, step_s: float = 1.0, seed: int = 0) -> None:
        """What a model would have stored of these films: of a picture and of a text that names it
        noisy vectors of one direction.
        """
        rng = np.random.default_rng(seed)
        names = sorted({one.keyword for every in self.mentions.values() for one in every})
        world = rng.normal(size=(len(names) + 1, 64)) / 8
        direction = dict(zip(names, world[1:], strict=True))
        pairs = self.rows("pairs/pairs")
        for video in self.mentions:
            own = [pair for pair in pairs if pair["video_id"] == video]
            ticks = sorted({tick for pair in own for tick in needed_ticks(pair, step_s).tolist()})
            vectors = Vectors("film", step_s=step_s)
            for tick in ticks:
                at_s = (tick + 0.5) * step_s
                if at_s < self.seconds:
                    near = [k for k, mid in self.shown(video) if abs(at_s - mid) <= SHOWN_S]
                    frame = world[0] + sum((direction[name] for name in near), np.zeros(64))
                    frame = frame + rng.normal(size=64) / 16
                    vectors.frames[tick] = frame.astype(np.float16)
            for pair in own:
                text = direction[pair["keyword"]] + world[0] / 2 + rng.normal(size=64) / 16
                text /= np.linalg.norm(text)
                vectors.texts[text_key(pair["text"])] = text.astype(np.float16)
            keep_vectors(self.root, video, model, vectors)
            nothing = np.zeros(self.seconds, np.float32)
            shots = [Shot(0.0, float(self.seconds), "start")]
            watched = Watched(float(self.seconds), shots, nothing, nothing, None, None, 0)
            keep_film(self.root, video, "film", watched)


class Aligned(NamedTuple):
    """How aligned times do: the error of each pair that is shown (s), how alignable each pair is
    and whether it is shown, and the share of clips that show their word at aligned and at spoken
    times, of as many.
    """

    errors: np.ndarray
    alignable: np.ndarray
    shown: np.ndarray
    share_aligned: float
    share_spoken: float


def measured(world: AlignmentWorld) -> Aligned:
    figures = {row["pair_id"]: row for row in world.rows("films/film_figures")}
    errors, alignable, truth, clips = [], [], [], []
    for pair in world.rows("pairs/pairs"):
        own, mention = figures[pair["pair_id"]], world.mention_of(pair)
        start_s, end_s = own["aligned_start_s"], own["aligned_end_s"]
        shown = mention.shown_s is not None
        alignable.append(own["alignable"])
        truth.append(shown)
        if shown and own["alignable"] >= 0.5:
            errors.append(abs((start_s + end_s) / 2 - mention.shown_s))

        def shows(start: float, end: float, middle: float | None = mention.shown_s) -> bool:
            return middle is not None and start - SHOWN_S < middle < end + SHOWN_S

        spoken = shows(pair["clip_start_s"], pair["clip_end_s"])
        clips.append((shows(start_s, end_s) if own["alignable"] >= 0.5 else None, spoken))
    taken = [aligned for aligned, _ in clips if aligned is not None]
    return Aligned(
        np.array(errors),
        np.array(alignable),
        np.array(truth),
        float(np.mean(taken)),
        float(np.mean([spoken for _, spoken in clips])),
    )
