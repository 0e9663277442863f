"""Every path under a data root, once. Nothing here reads or writes.

raw/<source>/<kind>/       answers as they came; the tombstones lie beside the kinds
raw/wiki/                  also pages/ (captures) and images/ (original files)
state/                     <source>.sqlite, locks, and what a data root remembers
annotations/<source>/      scores of texts
annotations/films/         shots of the user's films, and vectors of them and of texts
clean/<source>/<table>/    rows that were kept; rejected, failed and pending beside them
pairs/                     video-text pairs
films/                     shots of the user's films, and what they say of pairs
tasks/                     what videos do by their titles, as prompts
labels/                    what people answered about pairs and tasks
links/                     entities and where each source speaks of them
release/<source>/          what can be published
export/<format>/           other projects' layouts
report/                    figures and their page
restored/<source>/         what `kb restore` brought back from a release's ids; restored/pairs/ too
index/<source>/            what `kb search` reads, and in a note what it was made of
"""

from dataclasses import dataclass
from pathlib import Path

from kb.core.sources import SOURCES

TOP = (
    "raw",
    "state",
    "annotations",
    "clean",
    "pairs",
    "films",
    "tasks",
    "labels",
    "links",
    "release",
    "export",
    "report",
    "restored",
    "index",
)
"""The folders that commands write, in the order of the data's way."""

VERDICTS = ("rejected", "failed", "pending")
"""Folders beside a source's clean tables: what became of the rows that were not kept."""

CAPTURED = next(name for name, source in SOURCES.items() if source.files)
"""The source with captured files beside its raw answers."""

_PAIRS = ("pairs/pairs", "pairs/quality", "pairs/scores")
_FILMS = ("films/shots", "films/film_figures")
_TASKS = ("tasks/tasks", "tasks/titles")
_LINKS = ("links/entities", "links/links")
_SHARING = (*_PAIRS, *_FILMS, *_TASKS, *_LINKS)  # tables with another one in their folder


def parquet_files(folder: Path, pattern: str = "*.parquet") -> list[Path]:
    """The whole files of a table, by name; none where the folder is not there.

    Hidden ones are on their way, or were left by a killed command.
    """
    return sorted(path for path in folder.glob(pattern) if not path.name.startswith("."))


def rows_pattern(name: str) -> str:
    """How the files of a declared table are named in its folder, which may hold two tables."""
    return f"{name.partition('/')[2]}-*.parquet" if name in _SHARING else "*.parquet"


@dataclass(frozen=True, slots=True)
class Layout:
    """The paths of a data root. Without an argument a method gives the folder above."""

    root: Path

    def raw(self, source: str = "", kind: str = "") -> Path:
        """A source's answers, or the segments of one kind."""
        return self.root / "raw" / source / kind

    @property
    def captures(self) -> Path:
        """The wiki's pages as a browser showed them: <page id>/<revision>/."""
        return self.raw(CAPTURED, "pages")

    @property
    def images(self) -> Path:
        """The wiki's image files, named by what is in them."""
        return self.raw(CAPTURED, "images")

    def tombstones(self, source: str) -> Path:
        """A source's purged keys."""
        return self.raw(source) / "tombstones.parquet"

    def tombstone_count(self, source: str) -> Path:
        """How many purged keys there are at least."""
        return self.state_folder(source) / "tombstones.json"

    def state_folder(self, source: str = "") -> Path:
        """state/, or what a source keeps there in a folder of its own."""
        return self.root / "state" / source

    def state(self, source: str) -> Path:
        """What is to do and what was done, in SQLite."""
        return self.state_folder() / f"{source}.sqlite"

    def lock(self, name: str) -> Path:
        """The file of a lock of kb.store.lock."""
        return self.state_folder() / f"{name}.lock"

    def identity(self, source: str) -> Path:
        """The services that a source's data came from."""
        return self.state_folder() / f"{source}.identity.json"

    def key(self, source: str) -> Path:
        """The secret that names are hashed with."""
        return self.state_folder() / f"{source}.key"

    def key_mark(self, source: str, digest: str) -> Path:
        """What says beside raw data with which key their names were hashed, and travels with them.

        "*" for the digest gives the pattern of all.
        """
        return self.raw(source) / f"key-{digest}.sha256"

    def key_marks(self, source: str) -> list[Path]:
        """The marks of all keys that raw data of this source were hashed with."""
        return sorted(self.raw(source).glob(self.key_mark(source, "*").name))

    def purge(self, source: str) -> Path:
        """The keys of a purge that is not finished."""
        return self.state_folder() / f"{source}.purge.json"

    @property
    def damaged_files(self) -> Path:
        """What commands found damaged (kb.store.damage)."""
        return self.state_folder() / "damaged-files.txt"

    def importing(self, source: str) -> Path:
        """Which files were imported, and how far."""
        return self.state_folder() / f"{source}-import"

    def known(self, source: str) -> Path:
        """What is known of each thing, while a refresh or a purge looks through it."""
        return self.state_folder() / f".{source}.known"

    @property
    def profile(self) -> Path:
        """The profile that the data root is bound to."""
        return self.state_folder() / "profile.json"

    @property
    def kept_profile(self) -> Path:
        """A copy of the profile and its keyword files, as the newest command used them."""
        return self.state_folder("profile")

    @property
    def runs(self) -> Path:
        """A record of each run that wrote."""
        return self.state_folder() / "runs"

    @property
    def deposits(self) -> Path:
        """What was uploaded."""
        return self.state_folder() / "deposits.json"

    def released(self, source: str) -> Path:
        """Which keys each version of a source's release had."""
        return self.state_folder("releases") / source

    def annotations(self, source: str) -> Path:
        """The scores of a source's texts."""
        return self.root / "annotations" / source

    def clean(self, source: str = "", table: str = "") -> Path:
        """A source's rows, or those of one table or verdict ("videos", "rejected")."""
        return self.root / "clean" / source / table

    def filtering(self, source: str) -> Path:
        """Rows on their way through a filter."""
        return self.clean(f".{source}.work")

    def summary(self, source: str) -> Path:
        """What the last filter said."""
        return self.clean(source) / "summary.json"

    @property
    def pairs(self) -> Path:
        return self.root / "pairs"

    @property
    def films(self) -> Path:
        """What was seen of the user's films, a folder for each video."""
        return self.annotations("films")

    @property
    def scoring(self) -> Path:
        """Scores of pairs, a file for each video."""
        return self.state_folder("scores")

    @property
    def tasks(self) -> Path:
        return self.root / "tasks"

    @property
    def labels(self) -> Path:
        return self.root / "labels"

    @property
    def links(self) -> Path:
        return self.root / "links"

    def table(self, name: str) -> Path:
        """The folder of a declared table's rows: "youtube/videos", "pairs/pairs"."""
        source = name.partition("/")[0]
        own = name in _SHARING or name == "labels/labels"
        return self.root / source if own else self.clean(*name.split("/"))

    def rows(self, name: str) -> list[Path]:
        """The files of a declared table's rows, in order."""
        return parquet_files(self.table(name), rows_pattern(name))

    def release(self, source: str = "") -> Path:
        """A source's folder to publish; `pairs` has one too."""
        return self.root / "release" / source

    def export(self, format: str = "", name: str = "") -> Path:
        """Another project's layout, or a file of it."""
        return self.root / "export" / format / name

    @property
    def reconstructed(self) -> Path:
        """Where `kb reddit reconstruct` writes by default."""
        return self.export("reconstructed")

    def restored(self, source: str = "", table: str = "") -> Path:
        """What was brought back of a source, or one of its tables; what could not be had lies in
        `missing.parquet` there and above.
        """
        return self.root / "restored" / source / table

    @property
    def report(self) -> Path:
        return self.root / "report"

    @property
    def page(self) -> Path:
        """The report's page."""
        return self.report / "index.html"

    @property
    def indexes(self) -> Path:
        """What `kb search` reads."""
        return self.root / "index"

    def index(self, source: str) -> Path:
        """A source's passages and their words."""
        return self.indexes / source


BELOW = Layout(Path())
"""The same paths relative to the data root, as rows, plans and messages name them."""
