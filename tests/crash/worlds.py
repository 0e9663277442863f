"""The data roots that the fault injection starts from, made once by the real commands on invented
services, and the commands that it harms.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq

from kb.core.errors import MissingExtra
from kb.sandbox.reddit.service import dumps
from kb.sandbox.world import World
from kb.wiki.browser import chromium
from tests.crash import harm
from tests.faults import Sandbox
from tests.youtube.job import Job

LATER = {"KB_NOW": "2027-01-20T12:00:00Z"}  # what was read in November is too old to be kept
_CHANGES = (
    ('search = ["guide"', 'listings = ["new"]\nsearch = []  # "guide"'),
    ("seconds_between = 1.0", "seconds_between = 0.0"),
)


class Case(NamedTuple):
    """A command that is harmed. `bases`: the roots it starts from, in turn; `then`: commands that
    make visible what it did; `same`: the folders whose bytes have to be those of an unharmed run.
    """

    words: tuple[str, ...]
    bases: tuple[str, ...]
    same: tuple[str, ...]
    then: tuple[tuple[str, ...], ...] = ()
    env: dict[str, str] = {}
    gone: tuple[bytes, ...] = ()  # what no byte of the root may hold afterwards
    slow: bool = False  # takes longest: it comes last
    finished: str = ""  # what it may say instead of doing it all again

    @property
    def name(self) -> str:
        """The command's words, without files and what only says where from and where to."""
        return " ".join(
            word
            for word in self.words
            if "/" not in word and not word.startswith(("--ids=", "--older-than=", "--to="))
        )


def flip(path: Path) -> None:
    """Change a bit in the middle of a file."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)


class Worlds:
    """`base(name)` is a root to copy; `cases` are all commands that can run on this machine."""

    def __init__(self, place: Path, sandbox: Sandbox, wiki: bool) -> None:
        self.place, self.wiki, self.sandbox = place, wiki, sandbox
        # What chaos.Trial has found of unharmed runs, by command and base.
        self.wholes: dict[tuple[tuple[str, ...], str], Any] = {}
        self._job = Job(sandbox, place, toxicity=True)
        self._job.profile(*_CHANGES)
        plain = place / "plain" / "profile.toml"
        shutil.copytree(place / "profile", plain.parent)
        plain.write_text(plain.read_text().replace('toxicity = "on"', 'toxicity = "off"'))
        self.env = {key: value for key, value in self._job.env.items() if key != "KB_DATA"}
        # A crawl that is filtered afterwards needs no scores for that.
        self.plain = {"KB_PROFILE": str(plain)}
        self.sources = ("youtube", "reddit", "wiki") if wiki else ("youtube", "reddit")
        self.dumps = [str(path) for path in dumps(sandbox.world.reddit, place / "dumps")]
        self._make()
        self.cases = list(self._cases())

    def base(self, name: str) -> Path:
        """A root to copy; "empty" has nothing."""
        return self.place / "bases" / name

    def _make(self) -> None:
        def each(*words: str) -> None:
            for source in self.sources:
                self._done(source, *words)

        self.base("empty").mkdir(parents=True)
        each("crawl")
        self._kept("crawled")
        # Names are hashed with a secret that is drawn: the same one, for the same bytes.
        (self.base("keyed") / "state").mkdir(parents=True)
        for path in (self._job.root / "state").glob("reddit.key*"):
            shutil.copy(path, self.base("keyed") / "state")
        for source in self.sources:
            self._done("annotate", source)
        self._kept("scored")
        each("filter")
        self._done("index")
        self._kept("clean")
        each("export")
        self._done("pairs")
        self._done("links")
        self._kept("made")
        self._done("release")
        shutil.copytree(self._job.root / "release", self.place / "released")
        self._kept("released")
        self._restored()
        # Drawing takes long: of one source alone.
        one = self.base("figures") / "clean"
        shutil.copytree(self.base("clean") / "clean" / self.sources[-1], one / self.sources[-1])
        (self.base("figures") / "state").mkdir()
        self._purged()
        self._damage(shutil.copytree(self.base("released"), self.base("damaged")))

    def _restored(self) -> None:
        """The same with everything that was brought back and written in other layouts."""
        root = f"--data={shutil.copytree(self.base('released'), self.base('restored'))}"
        self._done("restore", str(self.place / "released"), root)
        self._done("reddit", "reconstruct", root)
        self._done("youtube", "export", "--format=minedojo", root)
        self._done("reddit", "export", "--format=text", root)
        self._done("pairs", "--format=video2dataset", root)

    def _purged(self) -> None:
        """A root with everything, tombstones too."""
        root = shutil.copytree(self.base("released"), self.base("purged"))
        for source in self.sources:
            self._done(*self._purge(source).words, f"--data={root}")
        self._done("build", "pairs", "links", "release", "index", f"--data={root}")

    def _done(self, *words: str) -> None:
        ended = harm.run([*words, "--quiet"], self._job.env, self.place)
        assert ended.code == 0, (words, ended.err[-2000:])

    def _kept(self, name: str) -> None:
        shutil.copytree(self._job.root, self.base(name))

    @staticmethod
    def _damage(root: Path) -> None:
        """What `kb verify --repair` has to do: make clean rows, pairs and a release again, and
        replay a state.
        """
        for pattern in ("clean/youtube/videos/*", "release/reddit/posts-*"):
            flip(max(root.glob(pattern), key=lambda path: path.stat().st_size))
        (root / "state/reddit.sqlite").write_bytes(b"no database" * 1000)
        next(root.glob("pairs/pairs-*")).unlink()

    def _cases(self) -> Iterator[Case]:
        plain, made = self.plain, ("clean", "pairs", "release")
        for source in self.sources:
            clean = (f"clean/{source}",)
            filtered, slow = ((source, "filter"),), source == "wiki"
            yield Case((source, "crawl"), ("keyed",), clean, filtered, plain, slow=slow)
            yield Case(("annotate", source), ("crawled",), clean, filtered)
            yield Case((source, "filter"), ("scored", "made"), clean)
            yield Case((source, "export"), ("clean", "made"), (f"release/{source}",))
            yield self._purge(source)
        yield Case(
            ("reddit", "import", *self.dumps),
            ("keyed", "crawled"),
            ("clean/reddit",),
            (("reddit", "filter"),),
            plain,
        )
        for source in ("youtube", "reddit"):
            yield Case(
                ("refresh", source, "--older-than=0"),
                ("crawled",),
                (f"clean/{source}",),
                ((source, "filter"),),
                plain | LATER,
            )
        yield from self._with_workers()
        yield Case(("reddit", "reconstruct"), ("made",), ("export/reconstructed",))
        for words in (
            ("youtube", "export", "--format=minedojo"),
            ("reddit", "export", "--format=text"),
            ("pairs", "--format=video2dataset"),
        ):
            yield Case(words, ("made",), ("export",))
        built = ("clean", "pairs", "tasks", "links", "release")
        parts = (*self.sources[:2], "pairs", "tasks", "links", "release")
        yield Case(("build", *parts), ("scored",), built)
        yield Case(("build",), ("scored",), (*built, "report"), slow=True)
        yield Case(("index", "--again"), ("clean",), ())
        yield Case(("pairs",), ("clean",), ("pairs", "release/pairs"))
        yield Case(("pairs", "--again"), ("made",), ("pairs", "release/pairs"))
        yield Case(("links",), ("clean",), ("links", "release/links"))
        yield Case(("links", "--again"), ("made",), ("links", "release/links"))
        yield Case(("release",), ("made", "released"), ("release",))
        to = "--to=zenodo-sandbox"
        yield Case(("release", "publish", to, "--publish"), ("released",), ("release",))
        yield Case(("report",), ("figures",), ("report",), slow=True)
        released = str(self.place / "released")
        yield Case(("restore", released), ("keyed",), ("restored",), slow=True)
        yield Case(("verify", "--repair"), ("damaged",), made)
        yield Case(
            ("profile", "new", "ferns", "--out=data/ferns"),
            ("empty",),
            ("ferns",),
            finished="already exists",
        )

    def _with_workers(self) -> Iterator[Case]:
        """The same with processes of their own, which end with the one that is killed."""
        two, filtered = "--workers=2", (("reddit", "filter"),)
        yield Case(("youtube", "filter", two), ("scored", "made"), ("clean/youtube",))
        yield Case(
            ("reddit", "import", *self.dumps, two),
            ("keyed", "crawled"),
            ("clean/reddit",),
            filtered,
            self.plain,
        )
        yield Case(("annotate", "reddit", two), ("crawled",), ("clean/reddit",), filtered)
        yield Case(("pairs", "--again", two), ("made",), ("pairs", "release/pairs"))

    def _purge(self, source: str) -> Case:
        """A kept row with a title of its own is named."""
        table, key, prefix = {
            "youtube": ("videos", "video_id", ""),
            "reddit": ("posts", "post_id", "t3_"),
            "wiki": ("pages", "page_id", ""),
        }[source]
        rows = pq.read_table(
            next((self.base("made") / "clean" / source / table).glob("*.parquet")),
            columns=[key, "title"],
        ).to_pylist()
        titles = [row["title"] for row in rows]
        row = max(
            (row for row in rows if sum(row["title"] in title for title in titles) == 1),
            key=lambda row: len(row["title"]),
        )
        ids = self.place / f"{source}.txt"
        ids.write_text(f"{prefix}{row[key]}\n")
        gone = [row["title"].encode()]
        if source == "youtube":
            gone.append(row[key].encode())
        return Case(
            ("purge", source, f"--ids={ids}"),
            ("restored", "made"),
            ("clean", "pairs", "links", "release", "export", "restored"),
            gone=tuple(gone),
        )


def world() -> World:
    """A small one, whose services answer however often they are asked."""
    made = World(n_channels=4, n_videos=40, n_posts=24, width=40, depth=6, n_pages=5)
    made.reddit.room = 10**9
    made.quota = dict.fromkeys(made.quota, 10**9)
    return made


def services(wiki: bool = True) -> tuple[Sandbox, bool]:
    """The services to be asked, not yet listening; whether there is a browser for the wiki's."""
    if wiki:
        try:
            chromium.find_programs()
        except MissingExtra:
            wiki = False
    names = ["youtube", "reddit", "zenodo", *(["wiki"] if wiki else [])]
    return Sandbox(world(), services=names), wiki
