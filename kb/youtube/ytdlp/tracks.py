"""Imported subtitles → the transcript of each video, in the form of a crawl's outcomes.

What a track is, in this order: yt-dlp's `-orig` is what speech recognition heard; then the lists of
the video's info.json; then the times of words, which automatic tracks alone have. A track without
them that no info.json lists counts as manual.
"""

import json
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Any, NamedTuple

import pyarrow as pa

from kb.core import languages
from kb.core.installation import pc
from kb.core.languages import is_language, is_same_language
from kb.schema.coerce import in_lists, json_type, read_json, records
from kb.schema.decode import ColumnReader, in_batches, problems
from kb.schema.tables import table
from kb.store.rawlog import rawlog
from kb.store.tables.columns import aligned, column, newest, put
from kb.youtube.ytdlp import subtitles

ORIGINAL = "-orig"
READ_FROM, PAGE, FILE = "read_from", "watch_page", "file"
NOT_IMPORTED = "not_imported"  # outcome of a video that only a file tells of, without a track
_RICHEST = ("json3", "srv3", "json", "vtt", "srt")
FACTS = ("player_width", "player_height", "player_fps", "game_label_id", "game_label")


_ID = re.compile(r"(.+?)-[A-Za-z0-9_-]{11}")  # YouTube's id of a track with a name


def language_of(name: str) -> str:
    """The language of a track by its name: `en` of `en-Qx_9zR4b-1k`, `he` of `iw`."""
    with_id = None if is_language(name) else _ID.fullmatch(name)
    return languages.tag(with_id[1] if with_id else name)


class TrackLanguage(NamedTuple):
    """The profile's language, and whether translations to it are taken."""

    name: str = "en"
    translate: bool = True

    def spoken(self, name: str) -> bool:
        """Whether a track's language is the wanted one, or a variant of it."""
        return is_same_language(name, self.name)


ENGLISH = TrackLanguage()


class TrackKind(NamedTuple):
    """What a track is: manual, asr or translated; its language, and what it was made from."""

    kind: str
    language: str
    original: str


class ListedTracks(NamedTuple):
    """The tracks that an info.json lists, and the language that is spoken, where it names one."""

    manual: frozenset[str] = frozenset()
    automatic: frozenset[str] = frozenset()
    spoken: str | None = None

    @property
    def heard(self) -> frozenset[str]:
        """Languages that speech recognition heard."""
        marked = (name for name in self.automatic if name.endswith(ORIGINAL))
        return frozenset(name.removesuffix(ORIGINAL) for name in marked)

    @property
    def heard_in_original(self) -> frozenset[str]:
        """The same without dubs."""
        return frozenset(name for name in self.heard if self.dubbed_from(name) is None)

    def dubbed_from(self, language: str) -> str | None:
        """The spoken language, if what recognition heard in `language` was a dub; else None.

        Where no spoken language is named and several were heard, nobody knows which one is the
        original: each counts as a dub of another one.
        """
        if self.spoken and is_language(self.spoken):
            return None if is_same_language(self.spoken, language) else self.spoken
        others = (name for name in self.heard if not is_same_language(name, language))
        return min(others, default=None)


def dubbed_from(language: str | None, spoken: str | None) -> str | None:
    """The same for a track and a spoken language of which either may be unknown."""
    return ListedTracks(spoken=spoken).dubbed_from(language) if language and spoken else None


def kind_of(name: str, timed: bool, listed: ListedTracks | None) -> TrackKind:
    """What the track `name` is; `timed`: it has the times of words."""
    known = listed or ListedTracks()
    kind = _kind_by_name(name, timed, known)
    original = known.dubbed_from(kind.language) if kind.kind == "asr" else None
    return TrackKind("translated", original, "asr") if original else kind


def _kind_by_name(name: str, timed: bool, known: ListedTracks) -> TrackKind:
    """The same, where nothing is dubbed."""
    if name.endswith(ORIGINAL):
        return TrackKind("asr", name.removesuffix(ORIGINAL), "asr")
    # Where both lists have it, yt-dlp writes the automatic one if it was asked for no other.
    if name in known.manual and not (timed and name in known.automatic):
        return TrackKind("manual", name, "manual")
    if name in known.automatic and name not in known.heard:
        for manual in sorted(known.manual):
            if name.endswith(f"-{manual}"):
                return TrackKind("translated", manual, "manual")
        if known.heard:
            return TrackKind("translated", min(known.heard_in_original or known.heard), "asr")
    if timed or name in known.automatic:
        return TrackKind("asr", name, "asr")
    # Regions are written in capitals ("en-GB"); "en-de" is yt-dlp's name of a translation.
    translation = re.fullmatch(r"[a-z]{2,3}-([a-z]{2,3}(?:-[A-Za-z0-9]+)?)", name)
    if translation and is_language(translation[1]):
        return TrackKind("translated", translation[1], "manual")
    return TrackKind("manual", name, "manual")


def rows(lines: Iterable[bytes], most: int = 512) -> Iterator[pa.Table]:
    """Envelopes of ytdlp_subtitles and own_transcripts → `video_id`, `track` (the language as the
    file names it, null where it does not), `format`, `timed`, `cues` (JSON text) and `fetched_at`
    of each file.
    """
    for files in in_batches(_files(lines), most):
        kinds = (pa.string(), pa.string(), pa.string(), pa.bool_(), pa.string(), pa.string())
        columns = [pa.array([row[at] for row in files], kind) for at, kind in enumerate(kinds)]
        columns[-1] = pc.cast(columns[-1], pa.timestamp("us", "UTC"))
        names = ("video_id", "track", "format", "timed", "cues", "fetched_at")
        yield pa.table(columns, names=[*names])


def _files(lines: Iterable[bytes]) -> Iterator[tuple[str, str | None, str, bool, str, str | None]]:
    for line in lines:
        envelope = rawlog.decode(line)
        answer = envelope.response
        try:
            track = subtitles.read(answer["format"], answer["text"])
        except ValueError:  # text that a purge or an older version left; the import counted others
            continue
        cues = json.dumps(subtitles.as_columns(track.cues), ensure_ascii=False)
        about = (answer["video_id"], answer["language"], answer["format"])
        yield *about, track.timed, cues, envelope.fetched_at


def with_imported(
    crawled: pa.Table | None,
    imported: pa.Table | None,
    files: pa.Table | None,
    wanted: TrackLanguage,
) -> pa.Table | None:
    """Outcomes of a crawl (newest of each video), and of files where these are newer or the crawl
    has had no final one.

    A file replaces the track alone: size, frame rate and label of the watch page stay, and an age
    restriction that the page named does. A video whose info.json (`files`) lists no track in the
    language has none, unless an answer says other.
    """
    if crawled is not None:
        crawled = put(crawled, READ_FROM, pa.array([PAGE] * crawled.num_rows, pa.string()))
    listed = _listed(files)
    outcomes: list[_Found] = []
    for video, tracks in listed.items():  # without any track: older than all else that is known
        names = tracks.manual | (tracks.automatic if wanted.translate else tracks.heard_in_original)
        if not any(map(wanted.spoken, names)):
            outcomes.append((video, "none", None, None, None))
    if imported is not None:
        outcomes += _chosen(
            imported, wanted, lambda video, name, timed: kind_of(name, timed, listed.get(video))
        )
    if not outcomes:
        return crawled
    made = _outcomes(outcomes)
    if crawled is None:
        return newest(made, ("video_id",), ("final", "fetched_at"))
    restricted = crawled.filter(pc.equal(crawled["outcome"], "age_restricted"))["video_id"]
    made = made.filter(pc.invert(pc.is_in(made["video_id"], value_set=restricted.combine_chunks())))
    every = pa.concat_tables([crawled, made.select(crawled.column_names)])
    best = newest(every.combine_chunks(), ("video_id",), ("final", "fetched_at"))
    page = aligned(crawled, "video_id", best["video_id"].combine_chunks())
    for name in FACTS:
        best = put(best, name, pc.coalesce(best[name], page[name]))
    return best


def without_dubs(outcomes: pa.Table, videos: pa.Table, wanted: TrackLanguage) -> pa.Table:
    """The outcomes, in which a track that recognition heard in another language than the video's
    is `translated`, from `asr` of the spoken language: it heard a dub that a machine made. Without
    translations such a video has no transcript.
    """
    side = aligned(
        videos.select(["video_id", "default_audio_language"]),
        "video_id",
        column(outcomes, "video_id"),
    )
    spoken = column(side, "default_audio_language").to_pylist()
    kinds, languages = (column(outcomes, name).to_pylist() for name in ("kind", "language"))
    originals = [
        dubbed_from(language, own) if kind == "asr" else None
        for kind, language, own in zip(kinds, languages, spoken, strict=True)
    ]
    dubbed = pa.array([original is not None for original in originals])
    if not pc.any(dubbed).as_py():
        return outcomes
    if not wanted.translate:
        none = pc.if_else(dubbed, "none", column(outcomes, "outcome"))
        return put(outcomes, "outcome", none)
    for name, values in (
        ("kind", "translated"),
        ("original_kind", "asr"),
        ("language", pa.array(originals, pa.string())),
    ):
        given = column(outcomes, name).cast(pa.string())
        outcomes = put(outcomes, name, pc.if_else(dubbed, values, given))
    return outcomes


_Found = tuple[str, str, "TrackKind | None", str | None, Any]
"""Video, outcome, what the track is, its cues as JSON text, and when it was read."""


def _chosen(
    files: pa.Table, wanted: TrackLanguage, kind_of: Callable[[str, str, bool], TrackKind]
) -> Iterator[_Found]:
    """The best track of each video: manual, automatic, translated; the plain language before its
    variants; the richest file. One that names no language is in the wanted one.
    """
    best: dict[str, tuple[Any, TrackKind, int]] = {}
    columns = (files[name].to_pylist() for name in ("video_id", "track", "format", "timed"))
    for row, (video, given, form, timed) in enumerate(zip(*columns, strict=True)):
        name = given or wanted.name
        kind = kind_of(video, name, timed)
        if not wanted.spoken(name) or (kind.kind == "translated" and not wanted.translate):
            continue
        is_variant = language_of(name) != language_of(wanted.name)
        order = (kind.kind == "translated", kind.original == "asr", is_variant)
        rank = (*order, name, _RICHEST.index(form))
        if video not in best or rank < best[video][0]:
            best[video] = (rank, kind, row)
    for video, (_, kind, row) in sorted(best.items()):
        yield video, "ok", kind, files["cues"][row].as_py(), files["fetched_at"][row].as_py()


def own(files: pa.Table | None, wanted: TrackLanguage) -> pa.Table | None:
    """The collector's own transcripts in the language as outcomes, the best one of each video."""
    if files is None:
        return None
    return _outcomes(
        [*_chosen(files, wanted, lambda video, name, timed: TrackKind("asr", name, "asr"))]
    )


def _listed(files: pa.Table | None) -> dict[str, ListedTracks]:
    if files is None:
        return {}
    files = files.filter(pc.fill_null(files["lists_tracks"], False))
    columns = (
        files[name].to_pylist()
        for name in ("video_id", "manual_tracks", "automatic_tracks", "default_audio_language")
    )
    return {
        video: ListedTracks(frozenset(manual), frozenset(automatic), spoken)
        for video, manual, automatic, spoken in zip(*columns, strict=True)
    }


def _outcomes(outcomes: list[_Found]) -> pa.Table:
    """Rows with the columns of kb.youtube.parse.answers.transcripts."""
    kinds = [one[2] for one in outcomes]
    own: dict[str, list[Any]] = {
        "video_id": [one[0] for one in outcomes],
        "outcome": [one[1] for one in outcomes],
        "kind": [kind and kind.kind for kind in kinds],
        "language": [kind and language_of(kind.language) for kind in kinds],
        "original_kind": [kind and kind.original for kind in kinds],
        "fetched_at": [one[4] for one in outcomes],
        "final": [True] * len(outcomes),
    }
    columns: dict[str, pa.Array[Any]] = {}
    for name, arrow in _types().items():
        if name == "problems":
            columns[name] = problems({}, len(outcomes))
        elif name == "cues":
            columns[name] = _cues([one[3] for one in outcomes])
        else:
            columns[name] = pa.array(own.get(name, [None] * len(outcomes)), arrow)
    columns[READ_FROM] = pa.array([FILE] * len(outcomes), pa.string())
    return pa.table(columns)


def _cues(texts: list[str | None]) -> Any:
    """Cues of JSON text, as crawled answers have them."""
    kind = table("youtube/transcripts").column("cues").parsed
    lines = [b'{"cues":%b}' % (text or "null").encode() for text in texts]
    shape = json_type(kind, {})
    read = None if shape is None else read_json(lines, pa.schema([("cues", shape)]))
    cues: Any = None if read is None else read["cues"].combine_chunks()
    made = None if cues is None else in_lists(cues, kind)
    return records([json.loads(line)["cues"] for line in lines] if made is None else made, kind)[0]


@cache
def _types() -> dict[str, Any]:
    """Column → type of the rows that parsing makes of a crawl's outcomes."""
    reader = ColumnReader(table("youtube/transcripts"), "transcripts", note_absent=False)
    empty = reader.table([])
    types: dict[str, Any] = {field.name: field.type for field in empty.schema}
    del types["format"]
    return {**types, "final": pa.bool_()}
