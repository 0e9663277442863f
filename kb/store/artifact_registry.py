"""Every folder that a command makes: its name, its inputs, the command, its lock, and its tables.

    raw/<source> → clean/<source> → release/<source>, export/…, index/<source>
                   clean/youtube → pairs → release/pairs, export/…
                   clean/youtube, labels → tasks → release/tasks, export/…
                   clean/<every source> → links → release/links
                   clean/youtube → release/open-text

A name is the artifact's path below the data root. Freshness, completeness, damage, hints, locks,
cleanup and the catalog of tables are derived from these declarations and from the manifest of each
folder (kb.artifacts.manifest). They follow from the sources (kb.core.sources), so a new source
needs no line here.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from kb.core.sources import PUBLISHED, SELECTIONS, SOURCES, made_of, selection_of
from kb.schema.tables import released_tables, tables_of
from kb.store.layout import Layout

MANIFEST = "_manifest.json"
"""The file name of a manifest; the underscore hides it from readers of a folder of Parquet."""

RELEASE = "release"
"""The artifact of what `kb release` writes around the data of all folders below release/."""

SUMS = "SHA256SUMS"
"""The file name of the checksums of a release folder, and of captured files."""


_FORMAT_RULES = {"text": 2}  # numbers of the rules of export formats
CHUNKS = "-chunks.jsonl"  # the end of an export's name with `--chunk-tokens`
_KEPT_FILES = {"pairs": ("measures.json",)}  # figures of samples that cost requests


class Maker(NamedTuple):
    """What makes an artifact: a function of a recipe, by the name of its file in `pipelines/` or of
    the source whose package has it, called with the run and `arguments`.
    """

    recipe: str
    function: str
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True)
class Artifact:
    """A folder (or file) that one command makes from its inputs.

    `inputs` are names of other artifacts, "raw/<source>" or "raw/<source>/<kind>". `maker` makes
    it; what has none is kept, as it can't be made again from its inputs alone. `lock` is the lock
    that its writer holds (kb.store.lock). `reads` are the tables of the inputs that matter, all of
    them when empty; `every_file`: all files of the inputs do, verdicts included. `settings` are the
    parts of the profile that decide its content ("youtube.min_views", "pairs"; "keywords": the
    keyword files; "": all), but for those in `other_settings`. `rules` is raised when the same
    input gives other rows. `public` artifacts are given away as they are, so their manifest is kept
    in state/manifests/.
    """

    name: str
    inputs: tuple[str, ...]
    command: str
    lock: str
    tables: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    maker: Maker | None = None
    public: bool = False
    every_file: bool = False
    settings: tuple[str, ...] = ()
    other_settings: tuple[str, ...] = ()
    rules: int = 1

    def folder(self, root: Path) -> Path:
        """Where it is in a data root."""
        return root / self.name

    def manifest(self, root: Path) -> Path:
        """Where its manifest is in a data root."""
        if self.public:
            return Layout(root).state_folder() / "manifests" / f"{self.name.replace('/', '-')}.json"
        return self.folder(root) / MANIFEST

    @property
    def kept_files(self) -> tuple[str, ...]:
        """Files of a derived artifact that are kept when it is made again."""
        return _KEPT_FILES.get(self.name, ())

    @property
    def command_again(self) -> str:
        """The command that makes it again though nothing seems to have changed."""
        resumes = self.command in ("kb pairs", "kb tasks", "kb links", "kb index")
        return f"{self.command} --again" if resumes else self.command

    @property
    def hint(self) -> str:
        """How to make it again when one of its files is damaged or missing."""
        if self.name.startswith("restored"):
            return "remove its folder, then run `kb restore` with the release's folder again"
        if self.name == "labels":
            return "restore it from a copy, or remove it and give `kb label import` every export"
        if self.name.endswith("films"):
            return f"remove it, then run `{self.command}` with the films again"
        if self.name.startswith("annotations/"):
            return f"remove it, then run `{self.command}`, which scores its texts again"
        command = self.command_again
        return f"run `{command}`" if command != self.command else f"run `{command}` again"


def _declared() -> Iterator[Artifact]:
    """Every artifact after its inputs."""
    yield from _kept()
    for source in SOURCES:
        yield _clean(source)
    for name in PUBLISHED:
        if name in SELECTIONS:
            continue
        if name not in SOURCES and not PUBLISHED[name].part_of:
            yield _made(name)
        yield _released(name)
    for name in SELECTIONS:
        yield _selected(name)
    for source in SOURCES:
        yield Artifact(
            f"index/{source}",
            (f"clean/{source}",),
            "kb index",
            f"index-{source}",
            reads=tuple(f"{source}/{short}" for short in SOURCES[source].indexed),
            maker=Maker("index", "index", (source,)),
            settings=tuple(f"{source}.language" for source in SOURCES),
            rules=9,
        )
    # What a search makes of vectors of films, which no build can do without the model.
    clips = ("pairs/pairs", "pairs/scores")
    yield Artifact("index/clips", ("pairs",), "kb search --clips WORDS", "pairs", reads=clips)
    figured = (f"{name}.{key}" for name, source in SOURCES.items() for key in source.figured)
    yield Artifact(
        "report",
        (*(f"clean/{source}" for source in SOURCES), "pairs", "tasks", "links"),
        "kb report",
        "report",
        maker=Maker("report", "report"),
        every_file=True,
        settings=("title", "seed", "toxicity", "report", *figured),
    )
    for name in PUBLISHED:
        for export in PUBLISHED[name].exports:
            format_ = export.partition("/")[0]
            made = Artifact(
                f"export/{export}",
                _released_inputs(name),
                f"{_command(name, 'export')} --format {format_}",
                f"release-{name}",
                maker=Maker(name, "export", (*_own_name(name), format_)),
                public=True,
                settings=("name",),
                rules=_FORMAT_RULES.get(format_, 1),
            )
            yield made
            if format_ == "text":
                yield replace(
                    made,
                    name=made.name.removesuffix(".jsonl") + CHUNKS,
                    command=f"{made.command} --chunk-tokens N",
                )
    yield Artifact(
        RELEASE,
        tuple(f"release/{name}" for name in PUBLISHED),
        "kb release",
        "",  # those of all release folders
        maker=Maker("release", "release"),
        public=True,
        settings=("",),
    )


def _kept() -> Iterator[Artifact]:
    for source in SOURCES:
        filter_, scores = f"kb {source} filter", ("shared/annotations",)
        yield Artifact(f"annotations/{source}", (), filter_, source, scores)
        yield Artifact(f"restored/{source}", (), "kb restore", "restored")
    yield Artifact("annotations/films", (), "kb pairs score", "pairs")
    yield Artifact("films", (), "kb pairs score", "pairs", ("films/shots", "films/film_figures"))
    yield Artifact("labels", (), "kb label import", "labels", ("labels/labels",))
    yield Artifact("restored", (), "kb restore", "restored")  # its lists of missing ids
    yield Artifact("restored/pairs", (), "kb restore", "restored", ("pairs/pairs",))
    yield Artifact("restored/draw", (), "kb restore", "restored", ("draw/draw",))
    reconstruct = ("raw/reddit",), "kb reddit reconstruct", "reconstructed"
    yield Artifact("export/reconstructed", *reconstruct, public=True)


def _clean(source: str) -> Artifact:
    own = tuple(declared.name for declared in tables_of(source))
    return Artifact(
        f"clean/{source}",
        (f"raw/{source}",),
        f"kb {source} filter",
        source,
        tuple(name for name in own if not name.endswith("/missing")),
        maker=Maker(source, "tables", (source,)),
        settings=(source, "toxicity.toxicity", f"toxicity.thresholds.{source}"),
        other_settings=tuple(f"{source}.{key}" for key in SOURCES[source].crawl_settings),
        rules=SOURCES[source].revision,
    )


def _made(name: str) -> Artifact:
    linked = tuple(f"{source}/{short}" for source in SOURCES for short in SOURCES[source].linked)
    return Artifact(
        name,
        (*(f"clean/{source}" for source in made_of(name)), *PUBLISHED[name].inputs),
        f"kb {name}",
        name,
        tuple(declared.name for declared in tables_of(name)),
        linked if name == "links" else (),
        maker=Maker(name, "tables"),
        settings=PUBLISHED[name].decided_by,
        rules=PUBLISHED[name].revision,
    )


def _released(name: str) -> Artifact:
    own = tuple(declared.name for declared in released_tables(name))
    owner = PUBLISHED[name].part_of
    reads = tuple(f"{owner}/{short}" for short in SOURCES[owner].indexed) if owner else own
    return Artifact(
        f"release/{name}",
        _released_inputs(name),
        _command(name, "export"),
        f"release-{name}",
        own,
        reads,
        maker=Maker(owner, f"export_{name.replace('-', '_')}")
        if owner
        else Maker(name, "export", _own_name(name)),
        public=True,
        settings=("release.shard_mb", *(("release.open_text",) if owner else ())),
    )


def _selected(name: str) -> Artifact:
    """What a command has selected stays as it is until the command selects again."""
    own = tuple(declared.name for declared in tables_of(name))
    return Artifact(
        f"release/{name}",
        (f"release/{PUBLISHED[name].selected_from}",),
        f"kb {PUBLISHED[name].selected_from} {name} N --release",
        f"release-{name}",
        own,
        public=True,
    )


def _own_name(name: str) -> tuple[str, ...]:
    """What a function of a source's recipe, which may be the same for all, is called with."""
    return (name,) if name in SOURCES else ()


def _command(name: str, of_source: str) -> str:
    """The command of what is published: of a source, or of what is made from sources."""
    owner = PUBLISHED[name].part_of or name
    return f"kb {owner} {of_source}" if owner in SOURCES else f"kb {owner}"


def _released_inputs(name: str) -> tuple[str, ...]:
    of = PUBLISHED[name].part_of or name
    return (f"clean/{of}" if of in SOURCES else name,)


class _Artifacts(dict[str, Artifact]):
    """By name; a selection with a name of its own is declared as the one without."""

    def __missing__(self, name: str) -> Artifact:
        kind, _, rest = name.partition("/")
        if kind != RELEASE or not (selection := selection_of(rest)):
            raise KeyError(name)
        return replace(self[f"{RELEASE}/{selection}"], name=name)

    def __contains__(self, name: object) -> bool:
        named = isinstance(name, str) and name.startswith(f"{RELEASE}/")
        return super().__contains__(name) or (named and bool(selection_of(str(name)[8:])))


ARTIFACTS: dict[str, Artifact] = _Artifacts({one.name: one for one in _declared()})


def selections(root: Path) -> list[str]:
    """The selections that were released here, by the names of their folders."""
    top = Layout(root).release()
    places = (
        place for name in SELECTIONS for place in (top / name, *sorted(top.glob(f"{name}-*")))
    )
    return [place.name for place in places if place.is_dir()]


def exports_in(layout: str, name: str, options: Mapping[str, Any]) -> list[str]:
    """The artifacts that an export of what is published under `name` writes in a layout other than
    Parquet: with `chunk_tokens` the chunks alone, else all but these.
    """
    return [
        artifact.name
        for artifact in ARTIFACTS.values()
        if artifact.name.startswith(f"export/{layout}")
        and artifact.maker is not None
        and artifact.maker.recipe == name
        and artifact.name.endswith(CHUNKS) == bool(options.get("chunk_tokens"))
    ]


def artifact_of(path: Path) -> tuple[Path, Artifact] | None:
    """The data root and the artifact that a path belongs to, by the end of the path; None for any
    other file.
    """
    parts = path.parts
    for end in range(len(parts), 0, -1):
        for start in range(end):  # "restored/pairs" before "pairs"
            name = "/".join(parts[start:end])
            if name in ARTIFACTS and name != RELEASE:
                return Path(*parts[:start]), ARTIFACTS[name]
        if parts[end - 1] in ("raw", "state"):
            return None
    return None


def of_table(name: str) -> Artifact:
    """The artifact that has a declared table's rows ("youtube/videos", "pairs/pairs",
    "youtube/rejected").
    """
    source = name.partition("/")[0]
    if source in PUBLISHED and (PUBLISHED[source].part_of or source in SELECTIONS):
        return ARTIFACTS[f"release/{source}"]
    return ARTIFACTS[f"clean/{source}" if source in SOURCES else source]
