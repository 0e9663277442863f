"""The tiny toxicity model is unpacked without torch, and into its folder alone."""

import io
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
import zstandard

from kb.core.errors import DamagedData
from kb.sandbox import toxicity
from kb.sandbox.toxicity import tiny_checkpoint
from kb.store.checkpoint import sha256_of


def test_it_is_unpacked_without_torch(tmp_path):
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from kb.sandbox.toxicity import tiny_checkpoint\n"
        f"print(tiny_checkpoint(Path({str(tmp_path)!r})))\n"
        "sys.exit(bool({'torch', 'transformers'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    made = Path(done.stdout.strip())
    assert made == tiny_checkpoint(tmp_path)
    assert sha256_of(made) in made.with_name(f"{made.name}.sha256").read_text()


@pytest.mark.smoke
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("../outside", tarfile.REGTYPE),
        ("inside/../../outside", tarfile.REGTYPE),
        ("{place}/outside", tarfile.REGTYPE),
        ("..", tarfile.DIRTYPE),
        ("link", tarfile.SYMTYPE),
        ("link", tarfile.LNKTYPE),
        ("pipe", tarfile.FIFOTYPE),
        ("device", tarfile.CHRTYPE),
    ],
)
def test_nothing_leaves_the_folder(tmp_path, name, kind):
    """Also where `tarfile` has no filters: Python 3.11.0 to 3.11.3."""
    folder = tmp_path / "folder"
    folder.mkdir()
    member = tarfile.TarInfo("config.json")
    member.name = name.format(place=tmp_path)
    member.type, member.linkname = kind, "../outside"
    archive = io.BytesIO()
    with tarfile.open(fileobj=archive, mode="w") as tar:
        tar.addfile(member)
    with pytest.raises(DamagedData, match="is not a plain file"):
        toxicity._unpack(zstandard.compress(archive.getvalue()), folder)
    assert list(tmp_path.rglob("*")) == [folder]
