"""annotations/films/: what was seen of films, kept as the films may go.

    <video>/film.npz       shots, motion and light of a film, whatever the model
    <video>/<model>.npz    vectors of its frames, and of the texts of its pairs, by one model

state/pair-models.json: the models by which pairs were scored and aligned.

Vectors are kept on this machine: no release, card or upload has them. Files appear complete or not
at all, so a killed run loses at most the film in work. `film` is a digest by which another file of
the same video is recognised.
"""

from __future__ import annotations

import hashlib
import io
import shutil
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from kb.artifacts.measures import read_measures
from kb.core.context import Run
from kb.core.errors import UsageError
from kb.core.installation import np
from kb.core.sources import made_of
from kb.score.film_pass import Watched
from kb.score.shots import CUT, FADE, START, Shot
from kb.store.atomic import write_bytes
from kb.store.damage import read_note, unreadable
from kb.store.layout import Layout
from kb.store.lock import writer
from kb.store.state import tombstones

FILM = "film"
WINDOW_S = 20.0  # vectors are kept from so long before a phrase to so long after it
_KINDS = (START, CUT, FADE)
_FIX = "remove it, then run `kb pairs score` with the film again"


@dataclass(frozen=True)
class SeenFilm:
    """Of a film whatever the model; the arrays are those of `kb.score.film_pass.Watched`."""

    film: str
    end_s: float
    shots: list[Shot]
    motion: np.ndarray
    light: np.ndarray
    damaged: int = 0


@dataclass
class Vectors:
    """Of frames by their place on the model's grid, and of texts by their SHA-256; float16. The
    place of a frame at t s is t / `step_s` − ½.
    """

    film: str = ""
    frames: dict[int, np.ndarray] = field(default_factory=dict)
    texts: dict[str, np.ndarray] = field(default_factory=dict)
    step_s: float = 1.0

    def of_frames(self, ticks: Sequence[int]) -> np.ndarray:
        """The vectors of these places: float32 [frames, width]."""
        return _stacked([self.frames[tick] for tick in ticks])

    def of_texts(self, texts: Sequence[str]) -> np.ndarray:
        """float32 [texts, width]."""
        return _stacked([self.texts[text_key(text)] for text in texts])

    def without(self, texts: Sequence[str]) -> list[str]:
        """Those of the texts that have no vector yet, each once."""
        return [text for text in dict.fromkeys(texts) if text_key(text) not in self.texts]


def span(start_s: float, end_s: float, step: float) -> np.ndarray:
    """The places on the grid of a film, (tick + ½) · step, that lie in a span; one at least."""
    first = round(np.ceil(start_s / step - 0.5))
    return np.arange(first, max(first, round(np.floor(end_s / step - 0.5))) + 1)


def text_key(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def seen_film(root: Path, video_id: str) -> SeenFilm | None:
    """What is known of a video's film. Raises DamagedData."""
    arrays = _arrays(_place(root, video_id, FILM))
    if arrays is None:
        return None
    kinds = (_KINDS[kind] for kind in arrays["kind"].tolist())
    shots = zip(arrays["start_s"].tolist(), arrays["end_s"].tolist(), kinds, strict=True)
    return SeenFilm(
        str(arrays["film"]),
        float(arrays["length_s"]),
        [Shot(*shot) for shot in shots],
        arrays["motion"],
        arrays["light"],
        int(arrays["damaged"]),
    )


def keep_film(root: Path, video_id: str, film: str, watched: Watched) -> SeenFilm:
    """Store what a pass saw. Raises DiskFull."""
    shots = watched.shots
    _save(
        _place(root, video_id, FILM),
        {
            "film": np.array(film),
            "length_s": np.array(watched.end_s),
            "start_s": np.array([shot.start_s for shot in shots], np.float64),
            "end_s": np.array([shot.end_s for shot in shots], np.float64),
            "kind": np.array([_KINDS.index(shot.kind) for shot in shots], np.uint8),
            "motion": watched.motion,
            "light": watched.light,
            "damaged": np.array(watched.damaged),
        },
    )
    return SeenFilm(film, watched.end_s, shots, watched.motion, watched.light, watched.damaged)


def vectors_of(root: Path, video_id: str, model: str) -> Vectors:
    """The stored vectors of a video by a model. Raises DamagedData."""
    arrays = _arrays(_place(root, video_id, model))
    if arrays is None:
        return Vectors()
    return Vectors(
        str(arrays["film"]),
        dict(zip(arrays["ticks"].tolist(), arrays["frames"], strict=True)),
        dict(zip(arrays["keys"].tolist(), arrays["texts"], strict=True)),
        float(arrays.get("step_s", 1.0)),
    )


def keep_vectors(root: Path, video_id: str, model: str, vectors: Vectors) -> None:
    """Store vectors. Raises DiskFull."""
    ticks, keys = sorted(vectors.frames), sorted(vectors.texts)
    _save(
        _place(root, video_id, model),
        {
            "film": np.array(vectors.film),
            "ticks": np.array(ticks, np.int64),
            "frames": _stacked([vectors.frames[tick] for tick in ticks]).astype(np.float16),
            "keys": np.array(keys, "U64"),
            "texts": _stacked([vectors.texts[key] for key in keys]).astype(np.float16),
            "step_s": np.array(vectors.step_s),
        },
    )


def seen_videos(root: Path) -> list[str]:
    """The videos of which a film was seen, by id."""
    return sorted(path.parent.name for path in Layout(root).films.glob(f"*/{FILM}.npz"))


def stored_model(root: Path, asked: str = "") -> str:
    """The model by which vectors are stored. `asked`: its name, the part of it before the digest,
    or the file that it was read from. Raises UsageError for none, and for more than one.
    """
    names = sorted({path.stem for path in Layout(root).films.glob("*/*.npz")} - {FILM})
    if not names:
        raise UsageError(
            "no film was seen by a model yet", hint="run `kb pairs score --videos DIR` first"
        )
    wanted = {asked, Path(asked).name, Path(asked).stem}
    chosen = [name for name in names if not asked or wanted & {name, name.rpartition("@")[0]}]
    if len(chosen) != 1:
        what = (
            f"no vectors by {asked} are stored" if asked else "vectors by several models are stored"
        )
        raise UsageError(what, hint=f"give --model one of {', '.join(chosen or names)}")
    return chosen[0]


def chosen_model(root: Path, section: str) -> str:
    """The model that a section of pairs/measures.json is of; "" for none. Raises DamagedData."""
    fix = "remove it, then run `kb pairs score` and `kb pairs align` again"
    noted = read_note(_chosen(root), dict[str, str], fix=fix) or {}
    measured = read_measures(Layout(root).pairs).get(section, {})  # before there were notes
    return noted.get(section) or measured.get("model") or next(iter(measured.get("models", [])), "")


def note_model(root: Path, section: str, model: str) -> None:
    """Note the model by which pairs are scored or aligned from now on. Raises DiskFull."""
    noted = read_note(_chosen(root), dict[str, str], fix="remove it") or {}
    write_bytes(_chosen(root), msgspec.json.encode(noted | {section: model}))


def _chosen(root: Path) -> Path:
    return Layout(root).state_folder() / "pair-models.json"


def forget_film(root: Path, video_id: str) -> None:
    """Remove all that was seen of a video's film."""
    shutil.rmtree(Layout(root).films / video_id, ignore_errors=True)


def unite(run: Run, roots: Sequence[Path]) -> int:
    """Bring over what other roots have seen of films; how many files were new or grew. Of two films
    of one video the one here stays; purged videos stay away. Raises DamagedData, DiskFull,
    WriterLocked.
    """
    brought = 0
    purged = {key for source in made_of("pairs") for key in tombstones.keys(run.root, source)}
    with writer(run.root, "pairs"):
        for root in roots:
            for path in sorted(Layout(root).films.glob("*/*.npz")):
                if path.parent.name not in purged:
                    brought += _bring(run.root, root, path.parent.name, path.stem)
            for path in sorted(Layout(root).scoring.glob("*.json")):
                place = Layout(run.root).scoring / path.name
                if path.stem not in purged and not place.exists():
                    write_bytes(place, path.read_bytes())
            if _chosen(root).is_file() and not _chosen(run.root).exists():
                write_bytes(_chosen(run.root), _chosen(root).read_bytes())
    return brought


def _bring(home: Path, root: Path, video_id: str, name: str) -> bool:
    place, path = (_place(top, video_id, name) for top in (home, root))
    if not place.exists():
        write_bytes(place, path.read_bytes())
        return True
    if name == FILM or place.read_bytes() == path.read_bytes():
        return False
    ours, theirs = vectors_of(home, video_id, name), vectors_of(root, video_id, name)
    if ours.film != theirs.film:
        return False
    frames, texts = theirs.frames | ours.frames, theirs.texts | ours.texts
    united = Vectors(ours.film, frames, texts, ours.step_s)
    if (len(united.frames), len(united.texts)) == (len(ours.frames), len(ours.texts)):
        return False
    keep_vectors(home, video_id, name, united)
    return True


def _place(root: Path, video_id: str, name: str) -> Path:
    return Layout(root).films / video_id / f"{name}.npz"


def _stacked(vectors: Sequence[np.ndarray]) -> np.ndarray:
    return np.array(vectors, np.float32) if vectors else np.zeros((0, 0), np.float32)


def _arrays(path: Path) -> Mapping[str, Any] | None:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise unreadable(path, error, _FIX) from None


def _save(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    write_bytes(path, file.getvalue())
