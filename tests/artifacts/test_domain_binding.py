"""Tests of `kb.artifacts.domain_binding`."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from kb.artifacts import domain_binding
from kb.artifacts.domain_binding import bind_service
from kb.core.config.profile import load_profile
from kb.core.errors import OtherService, ProfileError
from kb.sandbox.world import World
from kb.store import atomic, lock
from kb.store.layout import Layout
from tests.faults import Sandbox
from tests.store.state.test_service_binding import answered
from tests.youtube.job import Job

STARDEW = (
    'name = "stardew"\ntitle = "Stardew"\n[youtube]\nkeywords = ["{word}"]\ncategory_ids = [20]\n'
)


def stardew(folder: Path, word: str = "farm", name: str = "stardew") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "stardew.toml"
    path.write_text(STARDEW.format(word=word).replace('"stardew"', f'"{name}"'))
    return path


def test_another_profile_is_refused_once_something_is_stored(tmp_path: Path) -> None:
    root, mine = tmp_path / "root", load_profile(stardew(tmp_path))
    domain_binding.note(root, load_profile("minecraft"))  # mistyped: nothing came from it
    domain_binding.note(root, mine)
    assert domain_binding.remembered(root) is None
    answered(root)
    assert domain_binding.remembered(root) == domain_binding.Remembered(
        "stardew", str(tmp_path / "stardew.toml"), "../stardew.toml"
    )
    domain_binding.note(
        root, load_profile(stardew(tmp_path, "other"))
    )  # numbers and words may change
    with pytest.raises(OtherService, match="of the profile 'stardew', not 'minecraft'") as refused:
        domain_binding.note(root, load_profile("minecraft"))
    assert str(tmp_path / "stardew.toml") in refused.value.hint
    assert refused.value.exit_code == 2


BEGINS = """
import sys
from pathlib import Path
from kb.core.config.profile import load_profile
from kb.store import lock
from kb.artifacts import domain_binding
root = Path(sys.argv[1])
with lock.writer(root, "youtube"):
    domain_binding.note(root, load_profile("minecraft"))
    print("noted", flush=True)
    sys.stdin.read()
"""


def test_two_first_crawls_with_different_profiles_are_not_both_begun(tmp_path: Path) -> None:
    """Nothing is stored yet, so that neither would bind the other."""
    root, mine = tmp_path / "root", load_profile(stardew(tmp_path))
    other = subprocess.Popen(
        [sys.executable, "-c", BEGINS, str(root)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert other.stdout and other.stdout.readline() == "noted\n"  # noqa: PT018
        with lock.writer(root, "wiki"):
            domain_binding.note(root, load_profile("minecraft"))  # the same one is fine
            said = rf"another process \(pid {other.pid}\) is starting .* 'minecraft', not 'stardew'"
            with pytest.raises(OtherService, match=said):
                domain_binding.note(root, mine)
    finally:
        other.communicate("")
    kept = Layout(root).kept_profile / "profile.toml"
    assert load_profile(kept).name == "minecraft"  # the copy is not one of what was refused
    domain_binding.note(root, mine)  # it stored nothing
    assert '"stardew"' in (root / "state" / "profile.json").read_text()


def test_a_file_that_moved_is_found_beside_the_root_or_its_copy_is_used(tmp_path: Path) -> None:
    place = tmp_path / "here"
    domain_binding.note(place / "root", load_profile(stardew(place)))
    answered(place / "root")
    moved = place.rename(tmp_path / "there")
    bound = domain_binding.remembered(moved / "root")
    assert bound is not None
    assert domain_binding.load(moved / "root", bound)[0].path == moved / "stardew.toml"
    stardew(moved, name="valley")  # the same file is another profile now
    with pytest.raises(OtherService, match="'stardew', not 'valley'"):
        domain_binding.load(moved / "root", bound)
    (moved / "stardew.toml").unlink()
    profile, said = domain_binding.load(moved / "root", bound)
    assert (profile.name, profile.youtube.keywords) == ("stardew", ("farm",))
    assert "stardew.toml is gone; its copy in the data root is used" in said
    shutil.rmtree(Layout(moved / "root").kept_profile)  # a root of an older version has none
    with pytest.raises(ProfileError, match="is gone") as gone:
        domain_binding.load(moved / "root", bound)
    assert "--profile FILE" in gone.value.hint


def test_without_a_copy_the_shipped_profile_of_that_name_is_used(tmp_path: Path) -> None:
    domain_binding.note(tmp_path, load_profile(stardew(tmp_path, name="minecraft")))
    answered(tmp_path)
    (tmp_path / "stardew.toml").unlink()
    shutil.rmtree(Layout(tmp_path).kept_profile)
    bound = domain_binding.remembered(tmp_path)
    assert bound is not None
    profile, said = domain_binding.load(tmp_path, bound)
    assert profile.is_shipped
    assert "stardew.toml is gone; the shipped profile 'minecraft' is used" in said


def test_an_older_root_is_bound_where_its_subreddit_agrees(tmp_path: Path) -> None:
    bind_service(tmp_path, "reddit", subreddit="terraria")
    domain_binding.note_if_stored(tmp_path, load_profile("minecraft"))
    assert not (tmp_path / "state" / "profile.json").exists()  # nothing is stored
    answered(tmp_path)
    with pytest.raises(OtherService, match="subreddit terraria"):
        domain_binding.note_if_stored(tmp_path, load_profile("minecraft"))
    domain_binding.note_if_stored(tmp_path, load_profile(stardew(tmp_path)))  # it has no [reddit]
    assert domain_binding.remembered(tmp_path).name == "stardew"


def test_the_commands_of_a_root_use_its_profile_and_refuse_another(tmp_path: Path) -> None:
    """`KB_PROFILE=minecraft kb youtube filter` on a `stardew` root used to mix the two."""
    with Sandbox(World(n_channels=9, n_videos=30), services=["youtube"]) as services:
        job = Job(services, tmp_path)
        path = job.profile(('name = "minecraft"', 'name = "stardew"'))
        wrong = {"KB_PROFILE": "minecraft"}
        job.done("youtube", "crawl", "--only", "channels")
        for words in (
            ("youtube", "crawl"),
            ("youtube", "filter"),
            ("youtube", "export"),
            ("pairs",),
            ("release",),
            ("report",),
            ("status",),
            ("query", "--tables"),
            ("reddit", "filter"),
            ("wiki", "export"),
        ):
            line = job.stopped(*words, code=2, **wrong)
            assert "of the profile 'stardew', not 'minecraft'" in line, words
        del job.env["KB_PROFILE"]
        assert job.done("youtube", "crawl")["crawled"] > 0  # by the file that it remembers
        assert job.done("status")["profile"] == "stardew"
        path.rename(path.with_name("gone.toml"))
        for words in (("youtube", "filter"), ("status",), ("query", "SELECT 1 AS one")):
            answer = job.kb(*words)
            assert answer.returncode == 0, answer.stderr
            assert "warning: " in answer.stderr
            assert "is gone; its copy in the data root is used" in answer.stderr
        moved = path.with_name("gone.toml")
        job.done("youtube", "filter", "--profile", str(moved))
        assert job.kb("status").stderr == ""  # where it is now is remembered


def test_noting_the_profile_clears_what_a_killed_command_left_of_it(tmp_path: Path) -> None:
    """Not every command that notes it takes a lock of the root: `kb reddit reconstruct --out`."""
    state = tmp_path / "state"
    state.mkdir()
    killed = subprocess.run(
        [sys.executable, "-c", "from kb.store import atomic; print(atomic.mark())"],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    left = state / f".profile.json.{killed.stdout.strip()}-0.tmp"
    running = state / f".profile.json.{atomic.mark()}-0.tmp"
    for path in (left, running):
        path.write_bytes(b"{")
    domain_binding.note(tmp_path, load_profile("minecraft"))
    assert (left.exists(), running.exists()) == (False, True)
    assert (state / "profile.json").is_file()
