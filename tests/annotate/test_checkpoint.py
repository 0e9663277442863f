"""A checkpoint is verified before anything unpickles it; a wrong, missing or cut one is exit 2 with what to do."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys

import pytest

from kb.annotate.checkpoint import SANDBOX, find_checkpoint, sha256_of
from kb.annotate.detoxify_model import load_detoxify
from kb.core.errors import MissingExtra, MissingModel
from kb.core.settings import load_settings


def find(path, **settings):
    return find_checkpoint(load_settings(dotenv=False, kb_toxicity_model=str(path), **settings))


@pytest.fixture
def copied(tiny, tmp_path):
    """The tiny model without any word about its digest."""
    folder = tmp_path / "model"
    shutil.copytree(tiny.parent, folder)
    (folder / f"{tiny.name}.sha256").unlink()
    return folder / tiny.name


def refused(path, **settings):
    with pytest.raises(MissingModel) as error:
        find(path, **settings)
    assert error.value.exit_code == 2
    assert error.value.hint
    return error.value


def test_without_any_digest_it_is_refused(copied):
    assert "sha256sum" in refused(copied).hint


def test_a_digest_may_come_from_the_name_a_file_or_the_setting(copied):
    digest = sha256_of(copied)
    assert find(copied, kb_toxicity_sha256=digest).sha256 == digest
    named = copied.rename(copied.with_name(f"my_model-{digest[:8]}.ckpt"))
    assert find(named).model == SANDBOX, "the sandbox's model is known under any name"
    plain = named.rename(named.with_name("plain.ckpt"))
    (plain.parent / "plain.ckpt.sha256").write_text(f"{digest}  plain.ckpt\n")
    assert find(plain).revision == digest[:16]
    (plain.parent / "plain.ckpt.sha256").rename(plain.parent / "plain.sha256")
    assert find(plain).sha256 == digest


@pytest.mark.parametrize("damage", ["cut", "changed", "empty"])
def test_a_damaged_file_is_refused(copied, damage):
    digest, data = sha256_of(copied), copied.read_bytes()
    copied.write_bytes({"cut": data[: len(data) // 2], "changed": data[:-1] + b"?", "empty": b""}[damage])
    for settings in ({"kb_toxicity_sha256": digest},):
        assert "cut off" in str(refused(copied, **settings))
    named = copied.rename(copied.with_name(f"tiny-{digest[:8]}.ckpt"))
    refused(named)


def test_every_digest_must_agree(copied):
    digest = sha256_of(copied)
    copied.with_name(copied.name + ".sha256").write_text("0" * 64)
    refused(copied, kb_toxicity_sha256=digest)


def test_missing_files_are_named(copied, tmp_path):
    digest = sha256_of(copied)
    assert "kb models fetch" in refused(tmp_path / "none.ckpt").hint
    assert "original" in refused("originall").hint
    (copied.parent / "vocab.txt").unlink()
    assert "tokenizer" in str(refused(copied, kb_toxicity_sha256=digest))
    (copied.parent / "config.json").unlink()
    assert "config.json" in str(refused(copied, kb_toxicity_sha256=digest))


def test_the_published_model_that_was_never_fetched_names_the_command(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert refused("original").hint.startswith("run `kb models fetch`")


def test_nothing_is_unpickled_before_the_digest_is_right(copied, tmp_path):
    digest = sha256_of(copied)
    mark = tmp_path / "ran"

    class Bomb:
        def __reduce__(self):
            return os.mkdir, (str(mark),)

    copied.write_bytes(pickle.dumps(Bomb()))
    refused(copied, kb_toxicity_sha256=digest)
    assert not mark.exists()


def test_a_file_that_is_no_checkpoint_is_exit_2(copied):
    import torch

    torch.save({"weights": 1}, copied)
    with pytest.raises(MissingModel, match="no Detoxify checkpoint"):
        load_detoxify(find(copied, kb_toxicity_sha256=sha256_of(copied)))


def test_a_configuration_of_another_model_is_exit_2(copied):
    config = copied.parent / "config.json"
    config.write_text(
        config.read_text().replace('"hidden_size": 64', '"hidden_size": 32').replace('"num_hidden_layers": 2', '"num_hidden_layers": 3')
    )
    with pytest.raises(MissingModel, match="doesn't fit"):
        load_detoxify(find(copied, kb_toxicity_sha256=sha256_of(copied)))


def test_it_loads_without_asking_any_host(tiny):
    """The checkpoint says bert-base-uncased: plain Detoxify would ask the model hub for it."""
    code = (
        "import socket, sys\n"
        "def refuse(*a, **k): sys.exit('a host was asked')\n"
        "socket.socket.connect = socket.getaddrinfo = socket.create_connection = refuse\n"
        "from kb.annotate.checkpoint import find_checkpoint\n"
        "from kb.annotate.detoxify_model import load_detoxify\n"
        "from kb.core.settings import load_settings\n"
        f"model = load_detoxify(find_checkpoint(load_settings(dotenv=False, kb_toxicity_model={str(tiny)!r})))\n"
        "assert max(model.predict('you are a stupid idiot').values()) > 0.5\n"
        "print(model.class_names)\n"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("HF_")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert "identity_attack" in done.stdout


def test_without_the_extra_it_is_exit_2(monkeypatch, make_run):
    from kb.annotate import checkpoint
    from kb.annotate.toxicity import Scorer

    monkeypatch.setattr(checkpoint, "EXTRA", ("torch", "no_such_package"))
    run = make_run()
    with pytest.raises(MissingExtra) as error:
        Scorer.open(run, "youtube")
    assert "lorebase[toxicity]" in error.value.hint
    assert not run.root.exists()


def test_the_tiny_model_is_the_same_bytes_when_trained_again(tiny, tmp_path):
    from kb.sandbox.toxicity import tiny_checkpoint

    assert sha256_of(tiny_checkpoint(tmp_path)) == sha256_of(tiny)
