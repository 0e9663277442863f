"""The published checkpoints, and the files of configuration and vocabulary that go with each.

Checkpoints: https://github.com/unitaryai/detoxify (releases; of some only the first hex digits of
the sha256 are published). What is compared stands here: a file's own name proves nothing.
Configuration and vocabulary: the base model's folder on the model hub, at
one revision, so that they can't change under us.
"""

from dataclasses import dataclass

CHECKPOINTS = "https://github.com"
HUB = "https://huggingface.co"


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
