"""`kb search --clips`: the clips whose pictures are most like words, by stored vectors of films.

    index/clips/<model>.npy      the embedding of each clip, of length 1: float16 [clips, width]
    index/clips/<model>.arrow    id, video, keyword, text and times of each, in the same order

The search is exact: the words are compared with every clip, some thousands at a time. No film is
opened. What is here is made of annotations/films and pairs/, again where these have changed or a
purge has removed it, and never leaves the machine.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from glob import escape
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.artifacts import domain_binding, index, manifest, texts
from kb.artifacts.table_catalog import Catalog
from kb.clips.pair_rows import pairs_of
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.errors import MissingModel, UsageError
from kb.core.installation import np, require, torch
from kb.core.search_hit import SearchHit, cut
from kb.core.sources import SOURCES, made_of
from kb.pairs.clip_tokens import ENDS, LENGTH, Tokens
from kb.score.film_store import Vectors, span, stored_model, vectors_of
from kb.score.models import EXTRA, ClipModel, checkpoint_file, model_name, unit
from kb.store.atomic import write_bytes
from kb.store.layout import Layout
from kb.store.tables import database
from kb.store.tables.reading import reading, scan

NAME = "clips"  # below index/
ARTIFACT = f"index/{NAME}"
(SOURCE,) = made_of("pairs")
_COLUMNS = "pair_id, video_id, keyword, text, clip_start_s, clip_end_s"
_VIDEO = "video_id, title, license, published_at"
_CHUNK = 1_024  # clips that are compared at a time, which a processor's cache holds
_LOOKED_AT = 1_000  # best clips whose videos are looked up at a time
_DIGITS = 4


class ClipHit(SearchHit, kw_only=True):
    """A clip: `similarity` is the cosine of words and clip (`score` is the same), `text` what is
    spoken, at most as long as asked.
    """

    pair_id: str
    video_id: str
    keyword: str
    clip_start_s: float
    clip_end_s: float
    similarity: float


class ClipSearch:
    """The clips of a data root that have vectors by a model, and this model.

    `cut_tokens`: how many tokens of words the model does not read, as they are too many.
    """

    def __init__(self, root: Path, profile: Profile, model: str = "") -> None:
        """`model`: its file, or its name where the file is known; needed where vectors of several
        are stored. Raises UsageError, MissingExtra.
        """
        if Catalog(root.absolute()).is_download:
            raise UsageError(
                f"{root} is a download, and no release has vectors of films",
                hint="search the clips of a data root: `kb pairs score` makes their vectors",
            )
        self._root = root
        self.model = stored_model(root, model)
        require("score", *EXTRA)
        self._file = _file_of(root, profile, self.model, model)

    @property
    def is_current(self) -> bool:
        """Whether the index has all clips as they are now. Raises DamagedData."""
        current = f"{self.model}.npy" in self._usable()
        if current:
            index.verify_index(self._root, NAME)  # once in a process, before the model is loaded
        return current

    def _usable(self) -> list[str]:
        """The files of an index that is current: of this model, and of others."""
        made = index.known(self._root, NAME)
        if made is None or not index.is_current(self._root, NAME):
            return []
        damage = index.damaged(index.folder(self._root, NAME), made, read=False)
        return [] if damage else [*made.files]

    def build(self, run: Run) -> None:
        """Make the index. Raises UsageError without pairs, WriterLocked, DamagedData, DiskFull."""
        catalog, encoder = Catalog(self._root.absolute()), _encoder(self._file)
        home = catalog.path if catalog.is_writable else catalog.cached
        films = Layout(self._root).films.glob(f"*/{escape(self.model)}.npz")
        videos = {path.parent.name for path in films}
        with domain_binding.writing(run, "pairs", workplace=home):
            inputs = texts.inputs(self._root, ARTIFACT)
            others = [index.folder(self._root, NAME) / file for file in self._usable()]
            if not (pairs := catalog.files("pairs/pairs")):
                raise UsageError("there are no pairs whose clips to search", hint="run `kb pairs`")
            with pairs_of(self._root, pairs, videos, _COLUMNS) as reader:
                rows = reader.read_all()
            with (
                run.progress.task("index clips", total=rows.num_rows, unit="clips") as task,
                manifest.replacing(home, ARTIFACT, inputs=inputs) as fresh,
            ):
                for file in others:
                    shutil.copy2(file, fresh.folder)
                places, embedded = [], [np.zeros((0, 0), np.float16)]
                for place, vector in _embedded(self._root, self.model, rows, encoder):
                    places.append(place)
                    embedded.append(vector)
                    task.advance(1)
                stacked = np.array(embedded[1:]) if places else embedded[0]
                np.save(fresh.folder / f"{self.model}.npy", stacked)
                clips = rows.take(pa.array(places, pa.int64())).combine_chunks()
                with pa.ipc.new_file(
                    str(fresh.folder / f"{self.model}.arrow"), clips.schema
                ) as out:
                    out.write_table(clips)
                fresh.figures = {"clips": len(places)}

    def cut_tokens(self, words: str) -> int:
        return max(0, Tokens().count(words) + ENDS - LENGTH)

    def hits(
        self, words: str, limit: int, *, each: int | None = 1, least: float = -1, size: int = 1000
    ) -> list[ClipHit]:
        """The most similar clips, best first; `each` at most of one video, with a similarity of
        `least`. Call it when the index is current. Raises UsageError without words, DamagedData.
        """
        if not words.strip():
            raise UsageError("the query contains no word", hint='kb search --clips "a wolf"')
        index.verify_index(self._root, NAME)
        folder = index.folder(self._root, NAME)
        with pa.memory_map(str(folder / f"{self.model}.arrow")) as file:
            clips = pa.ipc.open_file(file).read_all()
            vectors = np.load(folder / f"{self.model}.npy", mmap_mode="r")
            asked = _encoder(self._file).texts([words])[0]
            similar = _similarities(vectors, asked)
            order = np.argsort(-similar, kind="stable")
            order = order[similar[order] >= least]
            best = list[dict[str, Any]]()
            taken = Counter[str]()
            for start in range(0, len(order), _LOOKED_AT):
                some = order[start : start + _LOOKED_AT]
                ids = clips["video_id"].take(pa.array(some)).to_pylist()
                for place, video in zip(some.tolist(), map(str, ids), strict=True):
                    taken[video] += 1
                    if len(best) < limit and (each is None or taken[video] <= each):
                        row = clips.slice(place, 1).to_pylist()[0]
                        best.append(row | {"similarity": round(float(similar[place]), _DIGITS)})
                if len(best) == limit:
                    break
        return self._with_videos(best, size)

    def _with_videos(self, rows: list[dict[str, Any]], size: int) -> list[ClipHit]:
        files = Catalog(self._root.absolute()).files(f"{SOURCE}/videos")
        about: dict[str, dict[str, Any]] = {}
        if files and rows:
            with reading(files), database.connect(self._root) as con:
                con.register("wanted", pa.table({"video_id": [row["video_id"] for row in rows]}))
                asked = f"SELECT {_VIDEO} FROM {scan(files)} SEMI JOIN wanted USING (video_id)"
                found = con.sql(asked).to_arrow_table().to_pylist()
                about = {row["video_id"]: row for row in found}
        return [_hit(row, about.get(row["video_id"], {}), size) for row in rows]


def has_clips(root: Path) -> bool:
    """Whether vectors of a film are stored. A download has none."""
    return not Catalog(root.absolute()).is_download and any(Layout(root).films.glob("*/*@*.npz"))


def remember_model(root: Path, name: str, path: Path) -> None:
    """Note where the file of a model is on this machine, so that a search finds it."""
    write_bytes(_note(root, name), str(path.absolute()).encode())


def _note(root: Path, name: str) -> Path:
    return Layout(root).state_folder() / f"model-{name}.txt"


def _file_of(root: Path, profile: Profile, name: str, given: str) -> Path:
    note, candidates = _note(root, name), [Path(given).expanduser()] if given else []
    if profile.score.checkpoint.url is not None:
        candidates.append(checkpoint_file(profile))
    if note.is_file():
        candidates.append(Path(note.read_text()))
    for path in candidates:
        if path.exists() and model_name(path) == name:
            return path
    raise MissingModel(
        f"where the file of the model {name} is on this machine is not known",
        hint="name it with --model FILE",
    )


@lru_cache(maxsize=1)
def _encoder(path: Path) -> ClipModel:
    torch.set_num_threads(1)  # for one text; threads would wait for each other
    return ClipModel(path)


def _embedded(
    root: Path, model: str, rows: pa.Table, encoder: ClipModel
) -> Iterator[tuple[int, np.ndarray]]:
    """The place of each row whose clip has frames, and the clip's embedding: float16 [width]."""
    before, vectors = None, Vectors()
    columns = (rows[name].to_pylist() for name in ("video_id", "clip_start_s", "clip_end_s"))
    for place, (video, start_s, end_s) in enumerate(zip(*columns, strict=True)):
        if video != before:
            before, vectors = video, vectors_of(root, video, model)
        asked = span(start_s, end_s, encoder.step_s).tolist()
        ticks = [tick for tick in asked if tick in vectors.frames]
        if ticks:
            yield place, unit(encoder.clip(vectors.of_frames(ticks))).astype(np.float16)


def _similarities(vectors: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """The cosine of each vector (float16) with the one asked for: float32 [clips].

    A float16 becomes a float32 by its bits, which takes a third of NumPy's time: the sign stays in
    front, the rest moves to where a float32 has it, and the exponent is then 112 too low. One
    thread computes, as those of a BLAS wait for each other longer than so small products take.
    """
    asked, products = (asked * 2.0**112).astype(np.float32), [np.zeros(0, np.float32)]
    for at in range(0, len(vectors), _CHUNK):
        bits = vectors[at : at + _CHUNK].view(np.int16).astype(np.int32)
        bits <<= 13
        bits &= ~0x70000000
        products.append(np.einsum("ij,j->i", bits.view(np.float32), asked))
    return np.concatenate(products)


def _hit(row: dict[str, Any], about: dict[str, Any], size: int) -> ClipHit:
    video, start_s, end_s = row["video_id"], row["clip_start_s"], row["clip_end_s"]
    shown, published = cut(row["text"] or row["keyword"], size), about.get("published_at")
    return ClipHit(
        text=shown,
        snippet=" ".join(shown.split()),
        source=SOURCE,
        kind="clip",
        key=video,
        title=about.get("title") or video,
        path=f"{start_s:.1f} to {end_s:.1f} s",
        score=row["similarity"],
        url=f"{SOURCES[SOURCE].url_of(video)}&t={int(start_s)}s",
        licence=about.get("license"),
        date=None if published is None else published.date().isoformat(),
        start_s=start_s,
        pair_id=row["pair_id"],
        video_id=video,
        keyword=row["keyword"],
        clip_start_s=start_s,
        clip_end_s=end_s,
        similarity=row["similarity"],
    )
