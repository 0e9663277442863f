"""Every folder that a command makes: its name, its inputs, the command, and the tables in it.

    raw/<source> → clean/<source> → release/<source>, export/…, index/<source>
                   clean/youtube → pairs → release/pairs, export/…
                   clean/<every source> → links → release/links

A name is the artifact's path below the data root. Freshness, completeness, damage, hints, locks and
the catalog of tables are derived from these declarations and from the manifest of each folder
(kb.artifacts.manifest). A new source or folder needs its line here and nothing elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from kb.core.sources import PUBLISHED, SOURCES, SPECS, exported_by, made_of
from kb.schema.tables import tables

VERDICTS = ("rejected", "failed", "pending")


@dataclass(frozen=True)
class Artifact:
    """A folder (or file) that one command makes from its inputs.

    `inputs` are names of other artifacts or "raw/<source>". `reads` are the tables of the inputs
    that matter, all of them when empty. `public` artifacts are given away as they are, so their
    manifest is kept in state/manifests/.
    """

    name: str
    inputs: tuple[str, ...]
    command: str
    tables: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    public: bool = False

    def folder(self, root: Path) -> Path:
        """Where it is in a data root."""
        return root / self.name

    @property
    def hint(self) -> str:
        """What to do to have it again when a file of it is damaged or missing."""
        if self.name in ("pairs", "links"):
            return f"run `{self.command} --again`"
        if self.name.startswith("index/"):
            return "run `kb index --again`"
        if self.name.startswith("restored/"):
            return "remove its folder, then run `kb restore` with the release's folder again"
        return f"run `{self.command}` again"


def _declared() -> Iterator[Artifact]:
    for source in SOURCES:
        kept = tuple(one.name for one in tables().values() if one.source == source)
        filtered = tuple(name for name in kept if not name.endswith("/missing"))
        yield Artifact(
            f"annotations/{source}", (), f"kb {source} filter", tables=("shared/annotations",)
        )
        yield Artifact(
            f"clean/{source}", (f"raw/{source}",), f"kb {source} filter", tables=filtered
        )
        texts = tuple(f"{source}/{short}" for short in SPECS[source].indexed)
        yield Artifact(f"index/{source}", (f"clean/{source}",), "kb index", reads=texts)
        yield Artifact(f"restored/{source}", (), "kb restore")
    for name in ("pairs", "links"):
        own = tuple(one.name for one in tables().values() if one.source == name)
        inputs = tuple(f"clean/{one}" for one in made_of(name))
        linked = tuple(f"{one}/{text.table}" for one in SOURCES for text in SPECS[one].texts)
        reads = linked if name == "links" else ()
        yield Artifact(name, inputs, f"kb {name}", own, reads)
    yield Artifact("restored/pairs", (), "kb restore", tables=("pairs/pairs",))
    for name in PUBLISHED:
        own = tuple(one.name for one in tables().values() if one.source == name and one.released)
        made_from = f"clean/{name}" if name in SPECS else name
        yield Artifact(
            f"release/{name}", (made_from,), exported_by(name), tables=own, reads=own, public=True
        )
    for name, made_from, command in (
        ("minedojo/youtube_full.json", "clean/youtube", "kb youtube export --format minedojo"),
        ("minedojo/youtube_tutorial.json", "clean/youtube", "kb youtube export --format minedojo"),
        ("minedojo/wiki_full", "clean/wiki", "kb wiki export --format minedojo"),
        ("minedojo/reddit.json", "clean/reddit", "kb reddit export --format minedojo"),
        ("minedojo/pairs.json", "pairs", "kb pairs --format minedojo"),
        ("convokit", "clean/reddit", "kb reddit export --format convokit"),
        ("clip4mc", "pairs", "kb pairs --format clip4mc"),
        ("video2dataset", "pairs", "kb pairs --format video2dataset"),
        ("reconstructed", "raw/reddit", "kb reddit reconstruct"),
    ):
        yield Artifact(f"export/{name}", (made_from,), command, public=True)
    yield Artifact("report", tuple(f"clean/{source}" for source in SOURCES), "kb report")


ARTIFACTS: dict[str, Artifact] = {one.name: one for one in _declared()}


def artifact_of(path: Path) -> tuple[Path, Artifact] | None:
    """The data root and the artifact that a path belongs to, by the end of the path; None for any
    other file.
    """
    parts = path.parts
    for end in range(len(parts), 0, -1):
        for start in range(end):  # "restored/pairs" before "pairs"
            if (name := "/".join(parts[start:end])) in ARTIFACTS:
                return Path(*parts[:start]), ARTIFACTS[name]
    return None


def of_table(name: str) -> Artifact:
    """The artifact that has a declared table's rows ("youtube/videos", "pairs/pairs",
    "youtube/rejected").
    """
    source = name.partition("/")[0]
    return ARTIFACTS[f"clean/{source}" if source in SPECS else source]
