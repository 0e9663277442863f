"""The toxicity model of the sandbox: tiny, shipped as data, loaded like the published one.

Same architecture and file layout as Detoxify's `original` (BERT for sequence classification, six
classes, a checkpoint that names bert-base-uncased). It tells the insults of its word lists
(data/toxicity/words.toml) from plain text and is good for nothing else: what it scored is marked,
and `kb release publish` refuses it. .ci/tiny_model.py makes the archive.
"""

import hashlib
import io
import tarfile
from pathlib import Path, PurePath

import zstandard

from kb.core.errors import DamagedData
from kb.core.installation import cache_root, making
from kb.store.checkpoint import need_extra, sha256_of
from kb.store.tables.reading import SANDBOX_MODEL

DATA = Path(__file__).with_name("data") / "toxicity"
_ARCHIVE = DATA / "model.tar.zst"


def settings() -> dict[str, str]:
    """The setting that points the software at the tiny model, which is unpacked if need be."""
    return {"KB_TOXICITY_MODEL": str(tiny_checkpoint())}


def tiny_checkpoint(folder: Path | None = None) -> Path:
    """The checkpoint file, with config, vocabulary and `.sha256` beside it.

    Kept in the user's cache; a second call only finds it. Raises MissingExtra.
    """
    packed = _ARCHIVE.read_bytes()
    name = f"{SANDBOX_MODEL}-{hashlib.sha256(packed).hexdigest()[:12]}"
    place = (folder or cache_root() / "models") / name
    checkpoint = place / f"{SANDBOX_MODEL}.ckpt"
    if not checkpoint.is_file():
        need_extra()
        with making(place, checkpoint.is_file) as fresh:
            _unpack(packed, fresh)
    return checkpoint


def _unpack(packed: bytes, folder: Path) -> None:
    content = io.BytesIO(zstandard.ZstdDecompressor().decompress(packed))
    with tarfile.open(fileobj=content) as tar:
        for member in tar:
            data = tar.extractfile(member) if member.isreg() else None
            # By hand, as `extractall` has no filter in Python 3.11.0 to 3.11.3.
            if data is None or PurePath(member.name).name != member.name:
                raise DamagedData(f"{member.name!r} in {_ARCHIVE.name} is not a plain file")
            (folder / member.name).write_bytes(data.read())
    path = folder / f"{SANDBOX_MODEL}.ckpt"
    digest = f"{sha256_of(path)}  {path.name}\n"
    path.with_name(f"{path.name}.sha256").write_text(digest, encoding="utf-8")
