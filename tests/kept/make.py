"""Makes the data root and the release that later versions have to read, build, verify, purge and
restore: `python -m tests.kept.make`, once a version that promises a format (docs/upgrading.md).

Its content is of the sandbox's invented world, so nobody else's data is in it.
"""

import io
import lzma
import tarfile
import tempfile
from pathlib import Path

import numpy as np

from kb.sandbox.world import World
from kb.score.film_pass import Watched
from kb.score.film_store import Vectors, keep_film, keep_vectors, text_key
from kb.score.shots import CUT, START, Shot
from kb.store.state import tombstones
from kb.version import __version__
from tests.artifacts.rich_root import add_everything
from tests.contract.conftest import Figureless
from tests.faults import Sandbox

FOLDER = Path(__file__).parent
WORLD = {"n_channels": 3, "n_videos": 16, "n_posts": 6, "width": 5, "depth": 3}
NOBODY = "nobody00001"  # an id that was purged by name
MODEL = "planted@0123456789ab"


def archive(version: str = __version__) -> Path:
    """Where the data root of a version is kept, with its release."""
    return FOLDER / f"{version}.tar.xz"


def make(place: Path) -> Path:
    """A data root with every kind of file, and its release, in `place`; the archive of it."""
    with Sandbox(World(**WORLD), services=["youtube", "reddit"]) as sandbox:
        job = Figureless(sandbox, place, toxicity=True)
        for source in ("youtube", "reddit"):
            job.done(source, "crawl")
            job.done(source, "filter")
        add_everything(job, 1, litter=False)
        tombstones.add_tombstones(job.root, "youtube", [(NOBODY, "named")])
        job.done("pairs")
        _see_a_film(job)
        job.done("build")
        job.done("pairs", "align")
        job.done("build")
        job.done("pairs", "draw", "3", "--release")
        job.done("release")
        job.done("verify")
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as tar:
        tar.add(job.root, "data", filter=_plain)
    path = archive()
    path.write_bytes(lzma.compress(packed.getvalue(), preset=9))
    return path


def _see_a_film(job: Figureless) -> None:
    """What a pass over a film keeps, of the first video with pairs."""
    (pair, *_) = job.rows("SELECT video_id, text FROM pairs ORDER BY video_id, pair_id")
    seconds = np.arange(40, dtype=np.float32)
    watched = Watched(
        end_s=40.0,
        shots=[Shot(0.0, 12.5, START), Shot(12.5, 40.0, CUT)],
        motion=seconds,
        light=seconds,
        ticks=np.arange(0),
        vectors=np.zeros((0, 4), np.float16),
        damaged=0,
    )
    keep_film(job.root, pair["video_id"], "planted film", watched)
    vectors = Vectors("planted film")
    vectors.frames = {second: np.eye(4, dtype=np.float16)[second % 4] for second in range(40)}
    vectors.texts = {text_key(pair["text"]): np.ones(4, np.float16)}
    keep_vectors(job.root, pair["video_id"], MODEL, vectors)


def _plain(member: tarfile.TarInfo) -> tarfile.TarInfo | None:
    """Without owners and times; not what only an open database or a running command needs."""
    if member.name.endswith((".lock", "-shm", "-wal")) or member.name.startswith("data/report/"):
        return None
    member.uid = member.gid = member.mtime = 0
    member.uname = member.gname = ""
    return member


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        path = make(Path(place))
    print(f"{path}: {path.stat().st_size:,} bytes")
