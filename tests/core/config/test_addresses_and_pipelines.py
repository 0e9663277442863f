"""Addresses of services, and pipeline files."""

from pathlib import Path

import pytest

from kb.core.config import pipeline
from kb.core.config.addresses import in_the_clear, is_loopback, root_of
from kb.core.errors import SettingError


@pytest.mark.parametrize(
    ("url", "loopback", "clear"),
    [
        ("http://localhost:8000", True, False),
        ("http://127.0.0.2", True, False),
        ("http://[::1]:80", True, False),
        ("http://localhost.example.org", False, True),
        ("http://192.168.0.1", False, True),
        ("https://example.org", False, False),
    ],
)
def test_only_this_machine_may_be_asked_in_the_clear(url: str, loopback: bool, clear: bool) -> None:
    assert (is_loopback(url), in_the_clear(url)) == (loopback, clear)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("127.0.0.1:8000", "like http://localhost"),
        ("http://", "like http://localhost"),
        ("http://a b", "like http://localhost"),
        (f"https://{'a' * 64}.example", "like http://localhost"),
        ("https://me:secret@wiki.example", "user name or password"),
        ("https://wiki.example?a", "without"),
        ("https://wiki.example:99999", "port"),
        ("http://wiki.example", "https://"),
    ],
)
def test_a_root_that_is_none_says_what_it_must_be(value: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        root_of(value, "http://localhost")


@pytest.mark.parametrize(
    "value", ["https://wiki.example/w/", "http://127.0.0.1:8000", "https://é.fr"]
)
def test_a_root_has_no_slash_at_its_end(value: str) -> None:
    assert root_of(value, "") == value.rstrip("/")


def test_a_file_of_the_user_s_own_wins(tmp_path: Path) -> None:
    own = tmp_path / "mine.py"
    own.write_text("ANSWER = 42\n")
    assert pipeline.load(str(pipeline.locate("youtube", str(own)))).ANSWER == 42
    assert pipeline.locate("youtube").parent.name == "pipelines"


@pytest.mark.parametrize("text", ["import no_such_module_of_ours", "def ("])
def test_a_file_that_cannot_be_loaded_is_named(tmp_path: Path, text: str) -> None:
    own = tmp_path / "mine.py"
    own.write_text(text)
    with pytest.raises(SettingError, match="can't be loaded"):
        pipeline.load(str(own))


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match="there is no pipeline file"):
        pipeline.locate("youtube", str(tmp_path / "mine.py"))


def test_a_process_that_stays_up_runs_a_file_as_it_is_now(tmp_path: Path) -> None:
    own = tmp_path / "mine.py"
    for answer in (1, 2):
        own.write_text(f"ANSWER = {answer}\n")
        assert answer == pipeline.load(str(own)).ANSWER
        sent = pipeline.packed("youtube", str(own))
        own.unlink()  # on another machine it is not there
        assert answer == pipeline.unpack(*sent).ANSWER
    assert pipeline.packed("youtube") == ("youtube", "")
    assert pipeline.unpack("youtube", "").clean
