"""Files beside a checkpoint are checked before anything is loaded."""

import shutil

import pytest

from kb.annotate.checkpoint import find_checkpoint
from kb.core.config.settings import load_settings
from kb.core.errors import MissingModel

BESIDE = {
    "cut configuration": ("config.json", '{"a":', "config.json is no JSON object"),
    "list as configuration": ("config.json", "[]", "config.json is no JSON object"),
    "cut options of the tokenizer": (
        "tokenizer_config.json",
        '{"a":',
        "tokenizer_config.json is no JSON object",
    ),
    "empty vocabulary": ("vocab.txt", "", "[UNK]"),
    "vocabulary in another code": ("vocab.txt", "[UNK]\nfünf", "UTF-8"),
    "a tokenizer that is none": ("tokenizer.json", "{}", "tokenizer.json is no tokenizer"),
    "a web page": ("spiece.model", "<!DOCTYPE html><p>log in", "web page"),
}


@pytest.mark.parametrize("case", BESIDE)
def test_broken_files_beside_a_checkpoint_are_named_before_anything_is_loaded(tiny, tmp_path, case):
    name, content, words = BESIDE[case]
    shutil.copytree(tiny.parent, tmp_path / "model")
    copied = tmp_path / "model" / tiny.name
    (copied.parent / name).write_bytes(content.encode("latin-1"))
    settings = load_settings(dotenv=False, kb_toxicity_model=str(copied))
    with pytest.raises(MissingModel) as error:
        find_checkpoint(settings)
    assert words in str(error.value)
