"""The tiny toxicity model is unpacked without torch."""

import subprocess
import sys
from pathlib import Path

from kb.annotate.verified_checkpoint import sha256_of
from kb.sandbox.toxicity import tiny_checkpoint


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
