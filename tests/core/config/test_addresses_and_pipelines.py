"""Addresses of services and of data, and pipeline files."""

import pickle
from pathlib import Path

import pytest

from kb.core.config.addresses import address_of, in_the_clear, is_loopback, root_of
from kb.core.config.pipeline import digests, recipe_of
from kb.core.config.profile import Profile, load_profile
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


@pytest.fixture
def profile(tmp_path: Path) -> Profile:
    """One that names mine.py beside it."""
    path = tmp_path / "profile.toml"
    path.write_text('name = "mine"\ntitle = "Mine"\n[tasks]\npipeline = "mine.py"\n')
    return load_profile(path, named=True)


def test_a_file_of_the_user_s_own_wins(profile: Profile) -> None:
    profile.resolve_file("mine.py").write_text("tables = 42\n")
    recipe = recipe_of(profile, "tasks")
    assert recipe.defined("tables") == 42
    assert callable(recipe.defined("export"))  # what it does not define is the shipped one's
    assert recipe_of(profile, "pairs") == ("pairs", "", "")
    with pytest.raises(SettingError, match="does not define `nothing`"):
        recipe.defined("nothing")


@pytest.mark.parametrize(
    "text", ["import no_such_module_of_ours", "def (", "{}['x']", "raise SystemExit(3)"]
)
def test_a_file_that_cannot_be_loaded_is_named(profile: Profile, text: str) -> None:
    profile.resolve_file("mine.py").write_text(text)
    with pytest.raises(SettingError, match=r"mine\.py can't be loaded"):
        recipe_of(profile, "tasks").defined("tables")


def test_a_file_that_is_missing_is_named(profile: Profile) -> None:
    with pytest.raises(SettingError, match=r"mine\.py can't be read: No such file"):
        recipe_of(profile, "tasks")
    assert list(digests(profile, "tasks")) == ["pipelines/tasks.py"]


def test_a_process_that_stays_up_runs_a_file_as_it_is_now(profile: Profile) -> None:
    for answer in (1, 2):
        profile.resolve_file("mine.py").write_text(f"ANSWER = {answer}\n")
        sent = pickle.dumps(recipe_of(profile, "tasks"))
        profile.resolve_file("mine.py").unlink()  # on another machine it is not there
        assert answer == pickle.loads(sent).defined("ANSWER")


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ('def f(x):\n    """Other words."""\n\n    return (x + 1)  # a remark\n', True),
        ("def f(x):\n    return x + 2\n", False),
        ("def f(x):\n    return x + 1.0\n", False),
        ("def f(x=None):\n    return x + 1\n", False),
        ("def f(x", False),
    ],
)
def test_a_digest_is_of_what_a_recipe_does(profile: Profile, text: str, same: bool) -> None:
    noted = []
    for one in ('def f(x):\n    """Words."""\n    return x + 1\n', text):
        profile.resolve_file("mine.py").write_text(one)
        noted.append(digests(profile, "tasks")["mine.py"])
    assert (noted[0] == noted[1]) is same


@pytest.mark.parametrize(
    "address",
    [
        "s3://bucket/v1",
        "hf://datasets/ORG/NAME@v1.0.0",
        "file:///srv/release",
        "blockcache::hf://datasets/ORG/NAME",
        "zip://youtube::https://example.org/files/v1.zip",
        "simplecache::tar://release::file:///srv/v1.tar",
    ],
)
def test_an_address_stays_one_as_a_path(address: str) -> None:
    assert address_of(address) == address
    assert address_of(Path(address)) == address


@pytest.mark.parametrize("folder", ["data", "/srv/a:b", "./s3:x", "C:/data"])
def test_a_folder_is_no_address(folder: str) -> None:
    assert address_of(Path(folder)) == ""
