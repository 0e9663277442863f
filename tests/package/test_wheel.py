"""The wheel is whole: what a user installs works outside of the checkout."""

import email
import json
import os
import subprocess
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.installed import outside

pytestmark = pytest.mark.wheel

ROOT = Path(__file__).resolve().parents[2]


def run(folder: Path, *command: str | Path, **env: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        cwd=folder,
        env={**outside(), **env},
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )


def test_it_holds_every_file_that_the_code_reads(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
    for folder, inside in (
        ("schemas", "kb/schemas"),
        ("pipelines", "kb/pipelines"),
        ("data/profiles", "kb/profiles"),
        ("kb", "kb"),
    ):
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                name = f"{inside}/{path.relative_to(ROOT / folder)}"
                assert name in held, f"{name} is not in the wheel"


def test_it_holds_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        tops = {name.split("/")[0] for name in archive.namelist()}
        assert not [
            name for name in archive.namelist() if "tests/" in name or name.endswith(".pyc")
        ]
    assert len(tops) == 2
    assert "kb" in tops


def test_the_extra_all_has_the_versions_of_the_lock(wheel: Path) -> None:
    """What `pip install '.[all]'` takes is what set-up installs, torch's build apart."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith("/METADATA")]
        about = email.message_from_bytes(archive.read(name))
    required = [Requirement(line) for line in about.get_all("Requires-Dist", [])]
    pinned = {
        one.name: one.specifier
        for one in required
        if one.marker and one.marker.evaluate({"extra": "all"}) and not one.marker.evaluate()
    }
    lock = (ROOT / ".ci" / "requirements.lock").read_text(encoding="utf-8")
    locked = [
        Requirement(line.removesuffix(" \\"))
        for line in lock.splitlines()
        if not line.startswith(("#", " "))
    ]
    here = {one.name: one.specifier for one in locked if not one.marker or one.marker.evaluate()}
    assert here | {"torch": pinned["torch"]} | pinned == here | {"torch": pinned["torch"]}
    for one in required:
        extras = about.get_all("Provides-Extra", [])
        users = [extra for extra in extras if extra not in ("all", "test", "bench")]
        wanted = not one.marker or any(one.marker.evaluate({"extra": extra}) for extra in users)
        if wanted and one.name != "lorecrawl":
            (version,) = pinned[one.name]
            assert one.specifier.contains(version.version), one
    assert not {"pytest", "mypy"} & set(pinned), "tools of developers"


def test_it_runs_outside_the_checkout(installed: Path, tmp_path: Path) -> None:
    where = run(tmp_path, installed / "python", "-c", "import kb; print(kb.__file__)")
    assert Path(where.stdout.strip()).is_relative_to(installed.parent)
    answer = run(tmp_path, installed / "kb", "--help")
    assert (answer.returncode, answer.stderr) == (0, "")
    answer = run(tmp_path, installed / "kb", "status", "--json")
    assert answer.returncode == 0, answer.stderr
    assert json.loads(answer.stdout)["profile"] == "minecraft"


def test_profile_schemas_and_pipelines_are_found_in_it(installed: Path, tmp_path: Path) -> None:
    code = (
        "from kb.core.installation import folder\n"
        "from kb.core.config.profile import load_profile\n"
        "from kb.schema.tables import tables\n"
        "print(len(list(folder('pipelines').glob('*.py'))), len(tables()),"
        " load_profile('minecraft').path)\n"
    )
    answer = run(tmp_path, installed / "python", "-c", code)
    assert answer.returncode == 0, answer.stderr
    pipelines, tables, profile = answer.stdout.split()
    assert int(pipelines) == len(list((ROOT / "pipelines").glob("*.py")))
    assert int(tables) >= 10
    assert Path(profile).is_relative_to(installed.parent)


OPTIONAL = (
    "torch",
    "transformers",
    "detoxify",
    "onnxruntime",
    "psutil",
    "selenium",
    "PIL",
    "dask",
    "distributed",
    "matplotlib",
    "wordcloud",
    "tokenizers",
    "mlcroissant",
    "cffconvert",
)


@pytest.fixture
def base_only(tmp_path: Path) -> dict[str, str]:
    """Settings under which optional packages can't be imported,
    as after an installation without extras.
    """
    folder = tmp_path / "blocked"
    folder.mkdir()
    for name in OPTIONAL:
        (folder / f"{name}.py").write_text(
            f"raise ModuleNotFoundError(\"No module named '{name}'\", name='{name}')\n"
        )
    return {"PYTHONPATH": str(folder)}


def test_the_base_install_imports_every_module(
    installed: Path, tmp_path: Path, base_only: dict[str, str]
) -> None:
    """Optional packages are needed by the stage that uses them, not by the import of its module."""
    code = (
        "import importlib, pkgutil, kb\n"
        "for module in pkgutil.walk_packages(kb.__path__, 'kb.'):\n"
        "    if not module.name.startswith(('kb.pipelines', 'kb.schemas',"
        " 'kb.profiles')) and not module.name.endswith('__main__'):\n"
        "        importlib.import_module(module.name)\n"
        "        print(module.name)\n"
    )
    answer = run(tmp_path, installed / "python", "-c", code, **base_only)
    assert answer.returncode == 0, answer.stderr
    assert len(answer.stdout.split()) > 30


def test_the_base_install_queries(
    installed: Path, tmp_path: Path, base_only: dict[str, str]
) -> None:
    answer = run(
        tmp_path, installed / "kb", "query", "SELECT 6 * 7 AS n", "--format", "csv", **base_only
    )
    assert (answer.returncode, answer.stdout, answer.stderr) == (0, "n\n42\n", "")


def test_running_as_a_module_is_the_same(installed: Path, tmp_path: Path) -> None:
    one = run(tmp_path, installed / "kb", "--help")
    other = run(tmp_path, installed / "python", "-m", "kb", "--help")
    assert one.stdout == other.stdout
    assert os.access(installed / "kb", os.X_OK)
