"""Tests of the settings of commands in a demo's data root."""

from pathlib import Path

import pytest

from kb.cli.framework.demo_root import in_demo_root
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.errors import MissingExtra
from kb.sandbox import toxicity
from kb.store.state import demo_mark


def test_a_demos_root_keeps_its_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("KB_TOXICITY_MODEL", raising=False)
    profile, plain = load_profile("minecraft"), load_settings(dotenv=False)
    assert in_demo_root(tmp_path, plain, profile) == (plain, profile)
    demo_mark.write(tmp_path, finished=True)
    monkeypatch.setattr(toxicity, "tiny_checkpoint", lambda: Path("tiny.ckpt"))
    settings, same = in_demo_root(tmp_path, plain, profile)
    assert settings.kb_toxicity_model == "tiny.ckpt"
    assert same is profile
    named = load_settings(dotenv=False, kb_toxicity_model="original")
    assert in_demo_root(tmp_path, named, profile) == (named, profile)


def test_a_demo_without_the_model_is_not_scored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing() -> Path:
        raise MissingExtra("torch is not installed")

    monkeypatch.delenv("KB_TOXICITY_MODEL", raising=False)
    monkeypatch.setattr(toxicity, "tiny_checkpoint", missing)
    demo_mark.write(tmp_path, finished=True)
    _, profile = in_demo_root(tmp_path, load_settings(dotenv=False), load_profile("minecraft"))
    assert profile.toxicity.toxicity == "off"
