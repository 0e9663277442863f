"""`kb pairs score`: pairs and the user's own films → pairs/scores-*.parquet and films/*.parquet.

    annotations/films/<video>/   what was seen of a film (kb.score.film_store)
    state/scores/<video>.json    the scores of a video's pairs, and of what they were made

A film is decoded once, for all that is measured of it; scores are computed of what is stored
(kb.score.pair_scores). So a film that was seen is not opened again unless pairs need vectors of
other places, and a run that was stopped goes on behind the last film.
"""

from __future__ import annotations

import hashlib
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.annotate.backends import choose_device
from kb.artifacts import manifest, measures
from kb.clips.build import SHORT, Chosen, selected, version_of
from kb.clips.film_lookup import (
    FILM_DIFFERS,
    MISSING,
    UNDECODABLE,
    film_digest,
    film_length_s,
)
from kb.clips.frames import UndecodableVideo
from kb.clips.pair_rows import by_video, pairs_of
from kb.core.context import Run
from kb.core.engine import executor_of_tasks, map_in_order
from kb.core.errors import MissingModel
from kb.core.installation import np, require
from kb.core.summary import Summary
from kb.schema.tables import table
from kb.score.calibration import SECTION, section
from kb.score.clip_search import remember_model
from kb.score.figures import write_figures
from kb.score.film_pass import Watched, watch_film
from kb.score.film_store import (
    SeenFilm,
    Vectors,
    chosen_model,
    forget_film,
    keep_film,
    keep_vectors,
    note_model,
    seen_film,
    text_key,
    vectors_of,
)
from kb.score.models import EXTRA, ClipModel, checkpoint_file, model_name
from kb.score.pair_scores import Row, needed_ticks, scores_of
from kb.store.atomic import write_bytes
from kb.store.damage import read_note
from kb.store.layout import Layout
from kb.store.lock import taking
from kb.store.tables import parquet
from kb.store.tables.shard_writer import write_table

_RULES = 2  # raise it when the same film, pairs and model give other scores
_COLUMNS = "pair_id, video_id, text, clip_start_s, clip_end_s, match_start_s, match_end_s"
NAME = "pairs/scores"
NO_TEXT = "no_text"
_PLANNED_BYTES = 2 * 512  # of a vector
_REASONS = (MISSING, SHORT, UNDECODABLE, FILM_DIFFERS, NO_TEXT)


class VideoScores(msgspec.Struct, frozen=True):
    """What became of a video's pairs: the score of each by its id, as columns of a row; or why the
    film could not be read. `made_of`: a digest of pairs, film, model and rules; `pairs`: one of
    each pair by its id, so that pairs that are made again take their scores from here; `absent`:
    pairs of which vectors are lacking while the film is not there.
    """

    made_of: str
    scores: dict[str, tuple[float, float | None, float | None, float | None, int]]
    undecodable: str = ""
    model: str = ""
    pairs: dict[str, str] = {}
    absent: int = 0


class ScoredVideo(NamedTuple):
    """What a worker made of a video, and for how long its model computed and its film was watched
    (s).
    """

    made: VideoScores
    model_s: float = 0.0
    pass_s: float = 0.0


def score(
    run: Run, folders: Sequence[Path], model: Path | None, chosen: Chosen, device: str = "auto"
) -> Summary:
    """Score the chosen pairs; those that were scored by the same model before keep their scores.
    Without `folders` of what is stored.

    pairs = scored + missing + short + undecodable + film_differs + no_text. Raises FatalError
    without pairs, UsageError for a wrong folder, MissingExtra, MissingModel, SettingError (no such
    device), WriterLocked, DiskFull, Interrupted; the same call resumes.
    """
    require("score", *EXTRA, "scenedetect")
    path = checkpoint_file(run.profile) if model is None else model.expanduser().absolute()
    if not path.exists():
        hint = "run `kb models fetch clip`" if model is None else "give a checkpoint or a folder"
        raise MissingModel(f"there is no model {path}", hint=hint)
    name = model_name(path)
    if run.engine == "local":
        device = choose_device(device)  # of a cluster each worker has its own
    counts = Counter[str]()
    scored_rows: list[pa.Table] = []
    waiting = deque[list[Row]]()
    spent = np.zeros(2)  # seconds of models, and of all passes
    with (
        selected(run, folders, chosen, _COLUMNS) as (found, videos, rows),
        taking(run.root, "pairs"),
        run.progress.task("pairs score", total=len(videos), unit="videos") as task,
        executor_of_tasks(run, len(videos), run.root, [*folders, path]) as executor,
    ):

        def todo() -> Iterator[tuple[str, str, str, str, str, list[Row]]]:
            for own in rows:
                with_text = [row for row in own if row["text"] is not None]
                counts[NO_TEXT] += len(own) - len(with_text)
                if with_text:
                    waiting.append(with_text)
                    film = str(found.films.get(own[0]["video_id"], ""))
                    yield str(run.root), str(path), name, device, film, with_text

        for made, *seconds in map_in_order(executor, score_video, todo(), window=executor.window):
            own, spent = waiting.popleft(), spent + np.array(seconds)
            video_id = own[0]["video_id"]
            counts[found.reason(video_id)[0]] += made.absent
            left = len(own) - len(made.scores) - made.absent
            counts[UNDECODABLE if made.undecodable else SHORT] += left
            if made.scores:
                scored_rows.append(_rows(video_id, name, made))
            task.advance(1, pairs=len(made.scores))
        visible = _write(run, name, _with_others(run, name, scored_rows))
        write_figures(run)
        remember_model(run.root, name, path)
    if device != "cpu" and spent[1]:
        run.progress.say(f"the GPU was busy for {spent[0] / spent[1]:.0%} of the time of decoding")
    scored = sum(map(len, scored_rows))
    return Summary(
        command="pairs score",
        pairs=scored + counts.total(),
        scored=scored,
        **{reason: counts[reason] for reason in _REASONS},
        videos=len(scored_rows),
        unknown_length=found.unknown,
        model=name,
        visible=visible,
        path=str(Layout(run.root).pairs),
    )


def plan(run: Run, folders: Sequence[Path], model: Path | None, chosen: Chosen) -> Summary:
    """What a run would decode and store: films that were not seen or of which vectors are lacking,
    their hours, and the size of the vectors of a model with 512 dimensions. Writes nothing.
    """
    path = checkpoint_file(run.profile) if model is None else model.expanduser()
    name = model_name(path) if path.exists() else ""
    pairs = films = places = 0
    seconds = 0.0
    with selected(run, folders, chosen, _COLUMNS) as (found, videos, rows):
        for own in rows:
            video_id = own[0]["video_id"]
            pairs += len(own)
            seen, vectors = seen_film(run.root, video_id), vectors_of(run.root, video_id, name)
            lacking = {tick for row in own for tick in _lacking(row, seen, vectors, 1.0)}
            if video_id in found.films and lacking:
                films, places = films + 1, places + len(lacking)
                seconds += film_length_s(found.films[video_id])
    return Summary(
        command="pairs score",
        pairs=pairs,
        videos=len(videos),
        films=films,
        hours=round(seconds / 3600, 2),
        gigabytes=round(places * _PLANNED_BYTES / 1e9, 3),
    )


def score_video(
    root: str, model: str, name: str, device: str, film: str, rows: list[Row]
) -> ScoredVideo:
    """The scores of a video's pairs, unless they are there. Runs in a worker. `film`: its path, ""
    where only what is stored counts. A film that changes while it is read is read again.
    """
    at, video_id = Path(root), rows[0]["video_id"]
    place = Layout(at).scoring / f"{video_id}.json"
    while True:
        version = version_of(film) if film else None
        seen = seen_film(at, video_id)
        digest = film_digest(Path(film)) if film else seen.film if seen is not None else ""
        if not digest:
            return ScoredVideo(VideoScores("", {}, absent=len(rows)))
        encoded = msgspec.json.encode((_RULES, name, digest, rows), order="sorted")
        made_of = hashlib.sha256(encoded).hexdigest()
        done = _read_scores(place)
        if done is not None and done.made_of == made_of and (done.undecodable or seen is not None):
            return ScoredVideo(done)
        loaded = _model(model, device)
        absent, watched = 0, None
        try:
            vectors = vectors_of(at, video_id, name)
            if vectors.film != digest:
                vectors = Vectors(digest, {}, vectors.texts)
            current = seen if seen is not None and seen.film == digest else None
            path = Path(film) if film else None
            seen, watched = _completed(at, current, vectors, loaded, name, path, rows)
            known = [row for row in rows if not _lacking(row, seen, vectors, loaded.step_s)]
            absent = len(rows) - len(known)
            scores = {row[0]: row[1:] for row in scores_of(known, seen, vectors, loaded)}
            made = VideoScores(made_of, scores, model=name, pairs=_digests(known), absent=absent)
        except (UndecodableVideo, FileNotFoundError) as error:
            made = VideoScores(made_of, {}, str(error) or "the file is gone")
        if not film or version_of(film) == version:
            if not absent:  # else a film that comes later brings the others
                write_bytes(place, msgspec.json.encode(made))
            times = (watched.model_s, watched.pass_s) if watched is not None else ()
            return ScoredVideo(made, *times)
        forget_film(at, video_id)


def _completed(
    root: Path,
    seen: SeenFilm | None,
    vectors: Vectors,
    model: ClipModel,
    name: str,
    film: Path | None,
    rows: Sequence[Row],
) -> tuple[SeenFilm, Watched | None]:
    """What was seen of a film, and the pass over it, where one was needed. Sees it and adds vectors
    where these pairs need what is not stored: of the film's frames, where it is there, and of the
    texts.
    """
    video_id, watched = rows[0]["video_id"], None
    lacking = {tick for row in rows for tick in _lacking(row, seen, vectors, model.step_s)}
    if film is not None and (seen is None or lacking):
        watched = watch_film(film, sorted(lacking), model, ahead=model.device != "cpu")
        vectors.frames |= dict(zip(watched.ticks.tolist(), watched.vectors, strict=True))
        if seen is None:
            seen = keep_film(root, video_id, vectors.film, watched)
    if texts := vectors.without([row["text"] for row in rows]):
        embedded = model.texts(texts).astype(np.float16)
        vectors.texts |= dict(zip(map(text_key, texts), embedded, strict=True))
    if lacking or texts:
        vectors.step_s = model.step_s
        keep_vectors(root, video_id, name, vectors)
    if seen is None:
        raise FileNotFoundError
    return seen, watched


def _lacking(row: Row, seen: SeenFilm | None, vectors: Vectors, step: float) -> list[int]:
    """The places of the film that a pair needs and no vector is stored of."""
    end_s = seen.end_s if seen is not None else np.inf
    ticks = needed_ticks(row, step).tolist()
    return [tick for tick in ticks if tick not in vectors.frames and (tick + 0.5) * step < end_s]


def _digests(rows: Sequence[Row]) -> dict[str, str]:
    """A digest of each pair, by its id."""
    encoded = ((row["pair_id"], msgspec.json.encode(row, order="sorted")) for row in rows)
    return {pair_id: hashlib.sha256(text).hexdigest()[:16] for pair_id, text in encoded}


def put_back(run: Run) -> None:
    """Scores of pairs that were made again, where all scored pairs of a video are what they were.

    Opens no film. Raises WriterLocked, DamagedData, DiskFull.
    """
    at, name = Layout(run.root), chosen_model(run.root, SECTION)
    with taking(run.root, "pairs"):
        write_figures(run)
    if not name:
        return
    before = measures.read_measures(at.pairs).get(SECTION, {"pairs": 0})["pairs"]
    scored = ((path.stem, _read_scores(path)) for path in at.scoring.glob("*.json"))
    known = {video: done for video, done in scored if done is not None and done.model == name}
    scored_rows: list[pa.Table] = []
    with pairs_of(run.root, at.rows("pairs/pairs"), known, _COLUMNS) as reader:
        for own in by_video(reader):
            video = own[0]["video_id"]
            if known[video].pairs.items() <= _digests(own).items():
                scored_rows.append(_rows(video, name, known[video]))
    with taking(run.root, "pairs"):
        _write(run, name, scored_rows)
    if lost := before - sum(map(len, scored_rows)):
        run.progress.say(
            f"{lost:,} pairs have no scores any more; run `kb pairs score` again, which decodes no"
            " film whose pairs are the same as before"
        )


def _read_scores(path: Path) -> VideoScores | None:
    return read_note(path, VideoScores, fix="remove it, then score the pairs again")


@lru_cache(maxsize=1)
def _model(path: str, device: str) -> ClipModel:
    """Loaded once in each worker, which computes on one core: so scores do not depend on how many
    workers there are.
    """
    import torch

    torch.set_num_threads(1)
    return ClipModel(Path(path), choose_device(device))


def _rows(video_id: str, model: str, made: VideoScores) -> pa.Table:
    values = ((pair_id, video_id, model, *score) for pair_id, score in made.scores.items())
    names = table(NAME).names()
    rows = [dict(zip(names, row, strict=True)) for row in values]
    return pa.Table.from_pylist(rows, schema=table(NAME).arrow())


def _with_others(run: Run, model: str, scored_rows: list[pa.Table]) -> list[pa.Table]:
    """New scores, and those of other pairs by the same model."""
    fresh = pa.concat_tables([table(NAME).arrow().empty_table(), *scored_rows])
    kept = [parquet.read_table(path) for path in Layout(run.root).rows(NAME)]
    kept = [
        shard.filter(
            pc.and_(
                pc.equal(shard["model"].cast(pa.string()), model),
                pc.invert(pc.is_in(shard["pair_id"], fresh["pair_id"].combine_chunks())),
            )
        )
        for shard in kept
    ]
    return [fresh, *(shard.cast(fresh.schema) for shard in kept)]


def _write(run: Run, model: str, scored_rows: list[pa.Table]) -> dict[str, Any]:
    """Write the scores, and what they say of all pairs into pairs/measures.json; what people's
    judgements say of them.
    """
    folder = Layout(run.root).pairs
    every = pa.concat_tables([table(NAME).arrow().empty_table(), *scored_rows])
    note_model(run.root, SECTION, model)
    measured = section(run.root, run.profile, every)
    sections = measures.read_measures(folder) | {SECTION: measured}
    with manifest.editing(run.root, "pairs"):
        write_table(folder / "scores-00000-of-00001.parquet", every, NAME)
        measures.write_measures(folder, sections)
    visible: dict[str, Any] = measured["visible"]
    return visible
