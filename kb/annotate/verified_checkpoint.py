"""Which checkpoint scores texts, and the proof that it is the right one, before anything reads it.

A checkpoint is a pickle: loading one may run what it says. Detoxify checks nothing, so the file's
sha256 is compared first with every digest that is known: the published ones, which stand in
kb/annotate/published.py, KB_TOXICITY_SHA256, a `.sha256` file beside it. Without any, the file is
refused; the digits in its own name say which model it is, and prove nothing.
"""

import importlib.util
import re
import shlex
import zipfile
from dataclasses import dataclass
from pathlib import Path

from kb.annotate.model_files import check_model_files
from kb.annotate.published_models import KNOWN, PUBLISHED, Published
from kb.core.config.settings import Settings
from kb.core.errors import MissingExtra, MissingModel, SettingError
from kb.core.installation import cache_root, install_extra
from kb.store.tables import checksums
from kb.store.tables.reading import SANDBOX_MODEL

EXTRA = ("torch", "transformers", "detoxify", "onnx", "onnxruntime")
_PREFIX = re.compile(r"-([0-9a-f]{8,64})\.[A-Za-z0-9]+$")
_DIGEST = re.compile(r"\b[0-9a-fA-F]{64}\b")


@dataclass(frozen=True)
class Checkpoint:
    """A verified checkpoint file with its configuration and vocabulary beside it.

    `model` and `revision` (first 16 hex digits of the sha256) key the scores.
    """

    path: Path
    model: str
    sha256: str

    @property
    def revision(self) -> str:
        return self.sha256[:16]

    @property
    def folder(self) -> Path:
        return self.path.parent


def models_folder(name: str) -> Path:
    """The folder of a fetched model."""
    return cache_root() / "models" / name


def need_extra() -> None:
    """Raise MissingExtra unless the packages that load a checkpoint are installed."""
    absent = [name for name in EXTRA if importlib.util.find_spec(name) is None]
    if absent:
        raise MissingExtra(
            f"toxicity scores need {', '.join(absent)}",
            hint=f'{install_extra("toxicity")}; or set toxicity = "off" in the profile',
        )


def find_checkpoint(settings: Settings) -> Checkpoint:
    """The checkpoint of KB_TOXICITY_MODEL, verified. Loads nothing.

    Raises MissingModel (absent, cut off, another file, no digest, no configuration or tokenizer
    beside it that goes with it), SettingError (KB_TOXICITY_SHA256 is no digest).
    """
    chosen = settings.kb_toxicity_model.strip()
    if not chosen:
        raise SettingError(
            "KB_TOXICITY_MODEL is empty",
            hint=f"known: {', '.join(PUBLISHED)}; or give a checkpoint file",
        )
    if chosen in PUBLISHED:
        return _fetched(PUBLISHED[chosen])
    path = Path(chosen).expanduser().absolute()
    if "/" not in chosen and "." not in chosen and not path.exists():
        raise MissingModel(
            f"KB_TOXICITY_MODEL is {chosen!r}",
            hint=f"known: {', '.join(PUBLISHED)}; or give a checkpoint file",
        )
    if path.is_dir():
        raise MissingModel(
            f"KB_TOXICITY_MODEL names a folder: {path}", hint="name the checkpoint file in it"
        )
    if not path.is_file():
        raise MissingModel(
            f"there is no checkpoint {path}", hint="see KB_TOXICITY_MODEL, or run `kb models fetch`"
        )
    expected = _known_digests(path, settings.kb_toxicity_sha256)
    digest = _verify(path, expected, "download the file again")
    if not expected and digest not in KNOWN:
        quoted = shlex.quote(str(path))
        raise MissingModel(
            f"there is no checksum to verify {path.name} with",
            hint=f"if you trust it, run `sha256sum {quoted} > {quoted}.sha256`",
        )
    check_model_files(
        path.parent,
        "put the config.json and the tokenizer's files of its base model beside the checkpoint",
    )
    # Of the name only the part before the digest: the same model under another one is a revision.
    in_name = _PREFIX.search(path.name)
    bare = (
        path.name[: in_name.start()]
        if in_name and digest.startswith(in_name.group(1))
        else path.stem
    )
    name = SANDBOX_MODEL if _made_by_sandbox(path) else bare
    return Checkpoint(path, name or path.stem, digest)


def _made_by_sandbox(path: Path) -> bool:
    """Whether the sandbox made it, whatever it is called; seen without unpickling anything."""
    try:
        with zipfile.ZipFile(path) as file:
            pickles = [name for name in file.namelist() if name.endswith("/data.pkl")]
            return any(b"lorecrawl_sandbox" in file.read(name) for name in pickles)
    except (zipfile.BadZipFile, OSError):
        return False


def _fetched(model: Published) -> Checkpoint:
    command = "kb models fetch" + ("" if model.name == "original" else f" {model.name}")
    folder = models_folder(model.name)
    path = folder / model.checkpoint
    if not path.is_file():
        raise MissingModel(
            f"the toxicity model {model.name!r} is not installed",
            hint=f'run `{command}`, or set toxicity = "off" in the profile',
        )
    digest = _verify(
        path, [("its published digest", model.sha256)], f"delete it and run `{command}` again"
    )
    for name, expected in model.files:
        file = folder / name
        if not file.is_file() or (expected and sha256_of(file) != expected):
            raise MissingModel(
                f"{file} is missing or not the published file", hint=f"run `{command}` again"
            )
    check_model_files(folder, f"run `{command}` again")
    return Checkpoint(path, model.name, digest)


def _known_digests(path: Path, setting: str | None) -> list[tuple[str, str]]:
    """(who says so, lower-case hex digest) for a local checkpoint."""
    known = []
    words = (setting or "").split()
    if words:  # a pasted line of sha256sum begins with the digest
        given = words[0].lower().removeprefix("sha256:")
        if not _DIGEST.fullmatch(given):
            raise SettingError(
                "KB_TOXICITY_SHA256 is not a SHA-256 digest",
                hint=f"give the 64 hex digits that `sha256sum {path.name}` prints",
            )
        known.append(("KB_TOXICITY_SHA256", given))
    for candidate in (path.with_name(path.name + ".sha256"), path.with_suffix(".sha256")):
        if candidate.is_file():
            match = _DIGEST.search(candidate.read_text(encoding="utf-8", errors="replace"))
            if not match:
                raise MissingModel(
                    f"{candidate} contains no SHA-256 digest",
                    hint=f"write it with `sha256sum {path.name} > {candidate.name}`",
                )
            known.append((candidate.name, match.group().lower()))
    return known


def _verify(path: Path, expected: list[tuple[str, str]], what_to_do: str) -> str:
    digest = sha256_of(path)
    for who, wanted in expected:
        if not digest.startswith(wanted):
            raise MissingModel(
                f"checksum mismatch of {path}:"
                f" its SHA-256 starts with {digest[:12]}, but {who} has {wanted[:12]}",
                hint=what_to_do,
            )
    return digest


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, hexadecimal. Raises MissingModel when it can't be read."""
    try:
        return checksums.digest(path)
    except OSError as error:
        raise MissingModel(f"{path} can't be read: {error.strerror}") from None
