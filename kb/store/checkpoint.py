"""Which checkpoint scores texts, and the proof that it is the right one, before anything reads it.

A checkpoint is a pickle: loading one may run what it says. Detoxify checks nothing, so the file's
sha256 is compared first with every digest that is known: those of `PUBLISHED`, KB_TOXICITY_SHA256,
and a `.sha256` file beside it. Without any, the file is refused; the digits in its own name say
which model it is, and prove nothing.

The configuration and the tokenizer beside a checkpoint are read before anything is sent or written;
whether they go together and with the weights shows when the model is loaded.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kb.core.config.settings import Settings
from kb.core.errors import MissingExtra, MissingModel, SettingError
from kb.core.installation import cache_root, install_extra
from kb.core.regular_file import NotRegular, check_regular
from kb.store.tables import checksums
from kb.store.tables.reading import SANDBOX_MODEL

EXTRA = ("torch", "transformers", "detoxify", "onnx", "onnxruntime")
_PREFIX = re.compile(r"-([0-9a-f]{8,64})\.[A-Za-z0-9]+$")
_DIGEST = re.compile(r"\b[0-9a-fA-F]{64}\b")

_VOCABULARIES = (
    "vocab.txt",
    "tokenizer.json",
    "vocab.json",
    "spiece.model",
    "sentencepiece.bpe.model",
)
_OPTIONS = ("merges.txt", "tokenizer_config.json", "special_tokens_map.json", "added_tokens.json")

# Checkpoints: https://github.com/unitaryai/detoxify (releases; of some only the first hex digits of
# the sha256 are published). Configuration and vocabulary: the base model's folder on the model hub,
# at one revision, so that they can't change under us.
CHECKPOINTS = "https://github.com"
HUB = "https://huggingface.co"


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
    try:
        check_regular(path)
    except NotRegular as error:
        raise MissingModel(
            f"{path} can't be read: {error.strerror}", hint="name a checkpoint file"
        ) from None
    except OSError:
        raise MissingModel(
            f"there is no checkpoint {path}", hint="see KB_TOXICITY_MODEL, or run `kb models fetch`"
        ) from None
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


def installed(settings: Settings) -> str:
    """The key of the model that would score texts now; "" where none is installed."""
    try:
        need_extra()
        checkpoint = find_checkpoint(settings)
    except (MissingExtra, MissingModel):
        return ""
    return f"{checkpoint.model}@{checkpoint.revision}"


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


def tokenizer_files(folder: Path) -> list[Path]:
    """The files of a tokenizer in a model's folder; none when there is no vocabulary among them."""
    if not any((folder / name).is_file() for name in _VOCABULARIES):
        return []
    return [folder / name for name in (*_VOCABULARIES, *_OPTIONS) if (folder / name).is_file()]


def check_model_files(folder: Path, what_to_do: str) -> None:
    """Raise MissingModel when configuration or tokenizer are missing or can't be read."""
    if not (folder / "config.json").is_file():
        raise MissingModel(f"there is no config.json in {folder}", hint=what_to_do)
    files = tokenizer_files(folder)
    if not files:
        raise MissingModel(f"there is no tokenizer in {folder}", hint=what_to_do)
    problem = next(
        (problem for path in (folder / "config.json", *files) if (problem := problem_of(path))), ""
    )
    if problem:
        raise MissingModel(f"{folder}: {problem}", hint=what_to_do)


def problem_of(path: Path, name: str = "") -> str:
    """What is wrong with a file that is to be `name`, in words; "" when nothing is.

    Binary ones are only looked at.
    """
    name = name or path.name
    try:
        if name.endswith(".json"):
            content = _object(path)
            if name == "tokenizer.json" and not isinstance(content.get("model"), dict):
                return "tokenizer.json is not a tokenizer"
            return (
                f"{name} is empty" if not content and name in ("config.json", "vocab.json") else ""
            )
        if name.endswith(".txt"):
            return _problem_of_words(path, name)
        head = path.read_bytes()[:64].lstrip().lower() if path.is_file() else b""
    except UnicodeDecodeError:
        return f"{name} is not UTF-8 text"
    except (ValueError, RecursionError):
        return f"{name} is not a JSON object"
    except OSError as error:
        return f"{name} can't be read: {error.strerror}"
    return (
        f"{name} is empty or a web page"
        if not head or head.startswith((b"<!doctype", b"<html"))
        else ""
    )


def _problem_of_words(path: Path, name: str) -> str:
    lines = path.read_text(encoding="utf-8").rstrip("\n").split("\n")
    if lines[0].lstrip().lower().startswith(("<!doctype", "<html")):
        return f"{name} is a web page"
    if name == "vocab.txt" and "[UNK]" not in (line.strip() for line in lines):
        return "vocab.txt has no token [UNK]"
    if name == "merges.txt" and not any(
        len(line.split()) == 2 for line in lines if not line.startswith("#version")
    ):
        return "merges.txt has no pair of tokens"
    return ""


def _object(path: Path) -> dict[str, Any]:
    content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise ValueError(path.name)  # noqa: TRY004  as for what is no JSON
    return content


@dataclass(frozen=True)
class Published:
    """A Detoxify model and where its files are.

    `sha256` is the whole digest where it is known, else as much of it as is published.
    """

    name: str
    release: str
    checkpoint: str
    sha256: str
    base: str
    revision: str
    files: tuple[tuple[str, str], ...]  # (name, sha256 or "" where only the revision pins it)

    def sources(self, root: str | None = None) -> list[tuple[str, str, str]]:
        """(file name, address, expected sha256 or its prefix) of every file; the big one last.

        `root` stands for both hosts (KB_MODELS_ENDPOINT).
        """
        hub, releases = root or HUB, root or CHECKPOINTS
        files = [
            (name, f"{hub}/{self.base}/resolve/{self.revision}/{name}", digest)
            for name, digest in self.files
        ]
        address = (
            f"{releases}/unitaryai/detoxify/releases/download/{self.release}/{self.checkpoint}"
        )
        return [*files, (self.checkpoint, address, self.sha256)]


_ROBERTA = (
    ("config.json", ""),
    ("tokenizer_config.json", ""),
    ("vocab.json", ""),
    ("merges.txt", ""),
    ("tokenizer.json", ""),
)

_ALBERT = (("config.json", ""), ("spiece.model", ""), ("tokenizer.json", ""))

_XLM = (
    ("config.json", ""),
    ("tokenizer_config.json", ""),
    ("sentencepiece.bpe.model", ""),
    ("tokenizer.json", ""),
)

PUBLISHED = {
    model.name: model
    for model in (
        Published(
            "original",
            "v0.1-alpha",
            "toxic_original-c1212f89.ckpt",
            "c1212f89ac23307ab33932ce29dc446a6e030fb3f384a500890bbe662b7b544a",
            "google-bert/bert-base-uncased",
            "86b5e0934494bd15c9632b12f734a8a67f723594",
            (
                ("config.json", "7160e1553ad2ca51d8c1cb066be533db31826e12d173824c1bb0cb1a4f187d20"),
                (
                    "tokenizer_config.json",
                    "a025160ef0431f1a392f6f050c1310f4c5d9fb6f275932dbccba73c4d214bf10",
                ),
                ("vocab.txt", "07eced375cec144d27c900241f3e339478dec958f92fddbc551f295c992038a3"),
            ),
        ),
        Published(
            "unbiased",
            "v0.3-alpha",
            "toxic_debiased-c7548aa0.ckpt",
            "c7548aa09468726af4cfdd0959912467784de4a076786913ada9f0f21b68f60d",
            "FacebookAI/roberta-base",
            "e2da8e2f811d1448a5b465c236feacd80ffbac7b",
            _ROBERTA,
        ),
        Published(
            "multilingual",
            "v0.4-alpha",
            "multilingual_debiased-0b549669.ckpt",
            "0b549669",
            "FacebookAI/xlm-roberta-base",
            "e73636d4f797dec63c3081bb6ed5c7b0bb3f2089",
            _XLM,
        ),
        Published(
            "original-small",
            "v0.1.2",
            "original-albert-0e1d6498.ckpt",
            "0e1d6498",
            "albert/albert-base-v2",
            "8e2f239c5f8a2c0f253781ca60135db913e5c80c",
            _ALBERT,
        ),
        Published(
            "unbiased-small",
            "v0.1.2",
            "unbiased-albert-c8519128.ckpt",
            "c8519128",
            "albert/albert-base-v2",
            "8e2f239c5f8a2c0f253781ca60135db913e5c80c",
            _ALBERT,
        ),
    )
}

# Files that are known by their whole digest, wherever they lie and whatever they are called.
KNOWN = {model.sha256: model.name for model in PUBLISHED.values() if len(model.sha256) == 64}
