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

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from kb.core.sources import (
    PUBLISHED,
    SOURCES,
    exported_by,
    made_of,
)
from kb.schema.tables import tables
from kb.store.layout import Layout

MANIFEST = "_manifest.json"
"""The file name of a manifest; the underscore hides it from readers of a folder of Parquet."""

SUMS = "SHA256SUMS"
"""The file name of the checksums of a release folder, and of captured files."""


# Of what is made from sources: what else it reads beside their clean rows, the parts of the
# profile that decide its rows, and the number of its rules.
_OTHER_INPUTS = {
    "tasks": ("raw/youtube/ytdlp_playlists", "labels"),
    "links": ("raw/wiki/pages", "raw/wiki/site"),
}
_SETTINGS = {
    "pairs": ("pairs", "seed", "youtube.language", "keywords"),
    "tasks": ("tasks", "youtube.topic_keywords", "keywords", "pairs.include"),
    "links": ("keywords", "pairs.include", "pairs.exclude", "pairs.near_words"),
}
_RULES = {"pairs": 7, "tasks": 2, "links": 1}
_KEPT_FILES = {"pairs": ("measures.json",)}  # figures of samples that cost requests
_ADDED = {  # tables that another command adds to a folder, which is complete without them
    "pairs/scores": "run `kb pairs score` with the same films, which decodes none of them again"
}


@dataclass(frozen=True)
class Artifact:
    """A folder (or file) that one command makes from its inputs.

    `inputs` are names of other artifacts, "raw/<source>" or "raw/<source>/<kind>". `lock` is the
    lock that its writer holds (kb.store.lock). `reads` are the tables of the inputs that matter,
    all of them when empty; `every_file`: all files of the inputs do, verdicts included. `settings`
    are the parts of the profile that decide its content ("youtube.min_views", "pairs"; "keywords":
    the keyword files; "": all), but for those in `other_settings`. `rules` is raised when the same
    input gives other rows. `public` artifacts are given away as they are, so their manifest is kept
    in state/manifests/.
    """

    name: str
    inputs: tuple[str, ...]
    command: str
    lock: str
    tables: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
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
    def is_kept(self) -> bool:
        """Whether it can't be made again of what the data root has, so that a purge takes rows out
        of it; everything else is derived.
        """
        return not self.inputs

    @property
    def kept_files(self) -> tuple[str, ...]:
        """Files of a derived artifact that are kept when it is made again."""
        return _KEPT_FILES.get(self.name, ())

    @property
    def added(self) -> tuple[str, ...]:
        """Tables that another command adds to the folder; without them the artifact is complete."""
        return tuple(one for one in self.tables if one in _ADDED)

    def hint_of(self, path: Path) -> str:
        """How to make one of its files again when it is damaged or missing."""
        for one in self.added:
            if path.match(f"{one}-*.parquet"):
                return f"remove it, then {_ADDED[one]}" if path.exists() else _ADDED[one]
        return self.hint

    @property
    def hint(self) -> str:
        """How to make it again when one of its files is damaged or missing."""
        if self.command in ("kb pairs", "kb tasks", "kb links", "kb index"):
            return f"run `{self.command} --again`"
        if self.name.startswith("restored"):
            return "remove its folder, then run `kb restore` with the release's folder again"
        if self.name == "labels":
            return "restore it from a copy, or remove it and give `kb label import` every export"
        if self.name.startswith("annotations/"):
            return f"remove it, then run `{self.command}`, which scores its texts again"
        return f"run `{self.command}` again"


def _declared() -> Iterator[Artifact]:
    for source in SOURCES:
        filter_ = f"kb {source} filter"
        own = tuple(one.name for one in tables().values() if one.source == source)
        kept = tuple(name for name in own if not name.endswith("/missing"))
        texts = tuple(f"{source}/{short}" for short in SOURCES[source].indexed)
        clean = f"clean/{source}"
        yield Artifact(f"annotations/{source}", (), filter_, source, ("shared/annotations",))
        yield Artifact(
            clean,
            (f"raw/{source}",),
            filter_,
            source,
            kept,
            settings=(source, "toxicity.toxicity", f"toxicity.thresholds.{source}"),
            other_settings=tuple(f"{source}.{key}" for key in SOURCES[source].crawl_settings),
            rules=2,
        )
        yield Artifact(
            f"index/{source}",
            (clean,),
            "kb index",
            f"index-{source}",
            reads=texts,
            settings=("youtube.language",),
            rules=7,
        )
        yield Artifact(f"restored/{source}", (), "kb restore", "restored")
    for name in ("pairs", "tasks", "links"):
        own = tuple(one.name for one in tables().values() if one.source == name)
        inputs = tuple(f"clean/{one}" for one in made_of(name))
        linked = tuple(f"{one}/{short}" for one in SOURCES for short in SOURCES[one].linked)
        yield Artifact(
            name,
            (*inputs, *_OTHER_INPUTS.get(name, ())),
            f"kb {name}",
            name,
            own,
            linked if name == "links" else (),
            settings=_SETTINGS[name],
            rules=_RULES[name],
        )
    yield Artifact("labels", (), "kb label import", "labels", ("labels/labels",))
    yield Artifact("restored", (), "kb restore", "restored")  # its lists of missing ids
    yield Artifact("restored/pairs", (), "kb restore", "restored", ("pairs/pairs",))
    for name in PUBLISHED:
        own = tuple(one.name for one in tables().values() if one.source == name and one.released)
        owner = PUBLISHED[name].part_of
        inputs = (f"clean/{owner or name}" if (owner or name) in SOURCES else name,)
        reads = tuple(f"{owner}/{short}" for short in SOURCES[owner].indexed) if owner else own
        command, lock = exported_by(name), f"release-{name}"
        asked = ("release.open_text",) if owner else ()
        yield Artifact(
            f"release/{name}",
            inputs,
            command,
            lock,
            own,
            reads,
            public=True,
            settings=("release.shard_mb", *asked),
        )
        for export in PUBLISHED[name].exports:
            format_ = f"{command} --format {export.partition('/')[0]}"
            yield Artifact(
                f"export/{export}", inputs, format_, lock, public=True, settings=("name",)
            )
    reconstruct = "kb reddit reconstruct", "reconstructed"
    yield Artifact("export/reconstructed", (), *reconstruct, public=True)
    clean_all = tuple(f"clean/{source}" for source in SOURCES)
    yield Artifact(
        "report",
        (*clean_all, "pairs", "tasks", "links"),
        "kb report",
        "report",
        every_file=True,
        settings=("title", "seed", "toxicity", "report", "youtube.min_duration_s"),
    )


ARTIFACTS: dict[str, Artifact] = {one.name: one for one in _declared()}


def derived_from(name: str) -> list[str]:
    """The artifacts that are made of an input ("raw/youtube"), directly or through others, in the
    order of `ARTIFACTS`.
    """
    made = {name}
    for _ in ARTIFACTS:  # as often as the longest way through them, at most
        for artifact in ARTIFACTS.values():
            if any(one in made or one.startswith(f"{name}/") for one in artifact.inputs):
                made.add(artifact.name)
    return [one for one in ARTIFACTS if one in made]


def artifact_of(path: Path) -> tuple[Path, Artifact] | None:
    """The data root and the artifact that a path belongs to, by the end of the path; None for any
    other file.
    """
    parts = path.parts
    for end in range(len(parts), 0, -1):
        for start in range(end):  # "restored/pairs" before "pairs"
            if (name := "/".join(parts[start:end])) in ARTIFACTS:
                return Path(*parts[:start]), ARTIFACTS[name]
        if parts[end - 1] in ("raw", "state"):
            return None
    return None


def of_table(name: str) -> Artifact:
    """The artifact that has a declared table's rows ("youtube/videos", "pairs/pairs",
    "youtube/rejected").
    """
    source = name.partition("/")[0]
    if source in PUBLISHED and PUBLISHED[source].part_of:
        return ARTIFACTS[f"release/{source}"]
    return ARTIFACTS[f"clean/{source}" if source in SOURCES else source]
