"""A checkpoint is verified before anything unpickles it; a wrong,
missing or cut one is exit 2 with what to do.
"""

import os
import pickle
import shutil
import socket
import subprocess

import pytest

from kb.annotate.backends import open_runner
from kb.annotate.detoxify_model import load_detoxify
from kb.core.config.settings import load_settings
from kb.core.errors import MissingExtra, MissingModel, SettingError
from kb.store import checkpoint
from kb.store.checkpoint import PUBLISHED, find_checkpoint, sha256_of
from kb.store.tables.reading import SANDBOX_MODEL
from tests.annotate.made import WORDS, checkpoint_of, make_checkpoint
from tests.conftest import needs

needs("torch", "detoxify")

BESIDE = {
    "cut configuration": ("config.json", '{"a":', "config.json is not a JSON object"),
    "list as configuration": ("config.json", "[]", "config.json is not a JSON object"),
    "cut options of the tokenizer": (
        "tokenizer_config.json",
        '{"a":',
        "tokenizer_config.json is not a JSON object",
    ),
    "empty vocabulary": ("vocab.txt", "", "[UNK]"),
    "vocabulary in another code": ("vocab.txt", "[UNK]\nfünf", "UTF-8"),
    "a tokenizer that is none": ("tokenizer.json", "{}", "tokenizer.json is not a tokenizer"),
    "a web page": ("spiece.model", "<!DOCTYPE html><p>log in", "web page"),
}


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


def test_a_digest_may_come_from_a_file_or_the_setting(copied):
    digest = sha256_of(copied)
    assert find(copied, kb_toxicity_sha256=digest).sha256 == digest
    named = copied.rename(copied.with_name(f"my_model-{digest[:8]}.ckpt"))
    assert find(named, kb_toxicity_sha256=digest).model == SANDBOX_MODEL, "known under any name"
    plain = named.rename(named.with_name("plain.ckpt"))
    (plain.parent / "plain.ckpt.sha256").write_text(f"{digest}  plain.ckpt\n")
    assert find(plain).revision == digest[:16]
    (plain.parent / "plain.ckpt.sha256").rename(plain.parent / "plain.sha256")
    assert find(plain).sha256 == digest


def test_a_files_own_name_proves_nothing(copied, tmp_path, monkeypatch):
    """Anybody can call a file by the start of its digest; the line to type is in the message."""
    digest = sha256_of(copied)
    for name in (f"toxic_original-{digest[:8]}.ckpt", f"my model-{digest}.ckpt"):
        named = copied.with_name(name)
        shutil.copyfile(copied, named)
        error = refused(named)
        assert name in str(error)
        subprocess.run(error.hint.split("`")[1], shell=True, check=True, cwd=tmp_path)
        assert find(named).sha256 == digest, "the line that was told doesn't help"
    # A published file is known by what it is, wherever it lies.
    monkeypatch.setitem(checkpoint.KNOWN, digest, "original")
    assert find(copied).sha256 == digest


def test_published_digests_stand_in_the_code_and_not_in_a_name(copied, tmp_path, monkeypatch):
    """A file that was put in the place of a fetched one is refused, whatever its name says."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    model = checkpoint.PUBLISHED["original"]
    assert len(model.sha256) == 64
    place = checkpoint.models_folder("original")
    shutil.copytree(copied.parent, place)
    shutil.copyfile(copied, place / model.checkpoint)
    assert "its published digest" in str(refused("original"))


def test_what_a_verified_file_would_run_is_not_run(tmp_path):
    """The digest says which file it is,
    not that it is harmless: only tensors and values are read.
    """
    mark = tmp_path / "ran"

    class Bomb:
        def __reduce__(self):
            return os.mkdir, (str(mark),)

    made = make_checkpoint(
        tmp_path / "model", change=lambda held: held["config"].update(extra=Bomb())
    )
    with pytest.raises(MissingModel, match="not a Detoxify checkpoint"):
        load_detoxify(checkpoint_of(made))
    assert not mark.exists()


def test_a_file_that_is_replaced_after_it_was_verified_is_not_loaded(copied, tmp_path):
    verified = find(copied, kb_toxicity_sha256=sha256_of(copied))
    copied.write_bytes(make_checkpoint(tmp_path / "other").read_bytes())
    with pytest.raises(MissingModel, match="changed after it was verified"):
        load_detoxify(verified)


@pytest.mark.parametrize("damage", ["cut", "changed", "empty"])
def test_a_damaged_file_is_refused(copied, damage):
    digest, data = sha256_of(copied), copied.read_bytes()
    copied.write_bytes(
        {"cut": data[: len(data) // 2], "changed": data[:-1] + b"?", "empty": b""}[damage]
    )
    for settings in ({"kb_toxicity_sha256": digest},):
        assert "checksum mismatch" in str(refused(copied, **settings))


def test_every_digest_must_agree(copied):
    digest = sha256_of(copied)
    copied.with_name(copied.name + ".sha256").write_text("0" * 64)
    refused(copied, kb_toxicity_sha256=digest)


@pytest.mark.parametrize("given", ["   ", "a", "no digest at all", "0" * 63, "g" * 64])
def test_a_blank_or_short_setting_is_no_proof(copied, given):
    """A prefix of one digit fits one file in sixteen: nothing may be unpickled for it."""
    with pytest.raises((MissingModel, SettingError)) as error:
        find(copied, kb_toxicity_sha256=given if given != "a" else sha256_of(copied)[:1])
    assert error.value.exit_code == 2
    assert "sha256sum" in error.value.hint


def test_a_pasted_line_of_sha256sum_is_taken(copied):
    digest = sha256_of(copied)
    for given in (f" {digest}  {copied.name}\n", digest.upper(), f"sha256:{digest}"):
        assert find(copied, kb_toxicity_sha256=given).sha256 == digest


def test_a_date_in_the_name_is_no_digest_when_another_one_is_given(copied):
    digest = sha256_of(copied)
    dated = copied.rename(copied.with_name("mine-20240115.ckpt"))
    assert find(dated, kb_toxicity_sha256=digest).sha256 == digest
    dated.with_name(dated.name + ".sha256").write_text(digest)
    assert find(dated).sha256 == digest
    dated.with_name(dated.name + ".sha256").unlink()
    refused(dated)


def test_a_folder_is_named_as_one(copied):
    assert "names a folder" in str(refused(copied.parent))


def _without_outputs(held):
    del held["config"]["arch"]["args"]["num_classes"]


def _with_more(held):
    held["config"]["arch"]["args"]["extra"] = 1


def _not_a_number(held):
    held["state_dict"]["classifier.bias"][:] = float("nan")


def _too_few_classes(held):
    held["config"]["dataset"]["args"]["classes"] = []


def _another_shape(held):
    held["state_dict"]["classifier.weight"] = held["state_dict"]["classifier.weight"][
        :, :-1
    ].clone()


@pytest.mark.parametrize(
    "change", [_without_outputs, _with_more, _not_a_number, _too_few_classes, _another_shape]
)
def test_a_checkpoint_that_can_not_be_loaded_is_exit_2(tmp_path, change):
    with pytest.raises(MissingModel) as error:
        load_detoxify(checkpoint_of(make_checkpoint(tmp_path / "model", change=change)))
    assert error.value.hint
    assert "\n" not in str(error.value)


def test_weights_in_halves_are_widened(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def halve(held):
        held["state_dict"] = {name: value.half() for name, value in held["state_dict"].items()}

    exact = open_runner(checkpoint_of(make_checkpoint(tmp_path / "exact")))
    halved = open_runner(checkpoint_of(make_checkpoint(tmp_path / "halved", change=halve)))
    for row, wanted in zip(halved.score(WORDS), exact.score(WORDS), strict=True):
        assert row == pytest.approx(wanted, abs=0.01)


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
    with pytest.raises(MissingModel, match="not a Detoxify checkpoint"):
        load_detoxify(find(copied, kb_toxicity_sha256=sha256_of(copied)))


def test_a_configuration_of_another_model_is_exit_2(copied):
    config = copied.parent / "config.json"
    config.write_text(
        config.read_text()
        .replace('"hidden_size": 192', '"hidden_size": 96')
        .replace('"num_hidden_layers": 2', '"num_hidden_layers": 3')
    )
    with pytest.raises(MissingModel, match="does not match"):
        load_detoxify(find(copied, kb_toxicity_sha256=sha256_of(copied)))


def test_it_loads_without_asking_any_host(tiny, monkeypatch):
    """The checkpoint says bert-base-uncased: plain Detoxify would ask the model hub for it."""

    def refuse(*arguments, **options):
        pytest.fail("a host was asked")

    for name in [name for name in os.environ if name.startswith("HF_")]:
        monkeypatch.delenv(name)
    monkeypatch.setattr(socket.socket, "connect", refuse)
    for name in ("getaddrinfo", "create_connection"):
        monkeypatch.setattr(socket, name, refuse)
    model = load_detoxify(find(tiny))
    assert max(model.predict("you are a stupid idiot").values()) > 0.5
    assert "identity_attack" in model.class_names


def test_without_the_extra_it_is_exit_2(monkeypatch, make_run):
    from kb.annotate.toxicity import ToxicityScorer

    monkeypatch.setattr(checkpoint, "EXTRA", ("torch", "no_such_package"))
    run = make_run()
    with pytest.raises(MissingExtra) as error:
        ToxicityScorer.open(run, "youtube")
    assert "[toxicity]" in error.value.hint
    assert not run.root.exists()


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


def test_published_addresses_are_pinned():
    for model in PUBLISHED.values():
        *files, (checkpoint, address, expected) = model.sources()
        assert all(f"/resolve/{model.revision}/" in url for _, url, _ in files)
        assert len(model.revision) == 40
        assert checkpoint.endswith(f"-{expected[:8]}.ckpt")
        assert address.startswith("https://github.com/unitaryai/detoxify/releases/download/")
        assert "config.json" in [name for name, _, _ in files]
