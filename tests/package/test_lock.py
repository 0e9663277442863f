"""The lock: packages by name, version and hash, and a file of each wherever Lorecrawl runs."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_lock_names_no_place() -> None:
    """Packages by name and version: no index, no file, no torch."""
    lines = (ROOT / ".ci" / "requirements.lock").read_text().splitlines()
    packages = [line.removesuffix(" \\") for line in lines if not line.startswith(("#", " "))]
    assert len(packages) > 100
    assert all(re.match(r"^[A-Za-z0-9._-]+==[^ ]+( ; .+)?$", line) for line in packages)
    assert not [line for line in packages if line.startswith(("torch=", "nvidia", "triton"))]
    assert not [
        line for line in lines if "://" in line or "--index" in line or "--find-links" in line
    ]


def test_every_file_of_the_lock_has_its_hash() -> None:
    text = (ROOT / ".ci" / "requirements.lock").read_text().replace(" \\\n", "")
    packages = [line for line in text.splitlines() if not line.startswith("#")]
    assert len(packages) > 100
    assert all(re.search(r"( +--hash=sha256:[0-9a-f]{64})+$", line) for line in packages)


def proof(folder: Path, *packages: str) -> tuple[int, list[str]]:
    lock = folder / "pylock.toml"
    lock.write_text("".join(f"[[packages]]\n{package}" for package in packages))
    done = subprocess.run(
        [sys.executable, ROOT / ".ci" / "wheels.py", lock], capture_output=True, text=True
    )
    assert done.stderr == ""
    return done.returncode, done.stdout.splitlines()


def package(*wheels: str, marker: str = "") -> str:
    listed = ", ".join(f'{{ url = "https://127.0.0.1/a-1-{wheel}.whl" }}' for wheel in wheels)
    about = f"marker = '{marker}'\n" if marker else ""
    return f"name = 'a'\nversion = '1'\n{about}wheels = [{listed}]\n"


EVERYWHERE = ("manylinux_2_28_x86_64", "manylinux2014_aarch64", "macosx_14_0_arm64")


def test_wheels_for_every_platform_pass(tmp_path: Path) -> None:
    for wheels in (
        ["py3-none-any"],
        ["py2.py3-none-any"],
        [f"cp311-abi3-{place}" for place in EVERYWHERE],
        [f"py3-none-{place}" for place in EVERYWHERE],
        [f"cp3{minor}-cp3{minor}-{place}" for minor in range(11, 15) for place in EVERYWHERE],
    ):
        assert proof(tmp_path, package(*wheels)) == (0, [])


def test_what_is_missing_is_printed_and_ends_with_1(tmp_path: Path) -> None:
    linux = [f"cp3{minor}-cp3{minor}-manylinux_2_17_x86_64" for minor in (11, 12)]
    assert proof(tmp_path, package(*linux)) == (
        1,
        [
            "no wheel and no pure source: a==1 for Python 3.11, 3.12, 3.13, 3.14 on Darwin arm64",
            "no wheel and no pure source: a==1 for Python 3.11, 3.12, 3.13, 3.14 on Linux aarch64",
            "no wheel and no pure source: a==1 for Python 3.13, 3.14 on Linux x86_64",
        ],
    )
    newer = [wheel.replace("14_0", "15_0").replace("2_28", "2_34") for wheel in EVERYWHERE]
    code, lines = proof(tmp_path, package(*(f"cp311-abi3-{place}" for place in newer)))
    assert (code, len(lines)) == (1, 2), "too new for the oldest system that we support"
    free_threaded = [f"cp314-cp314t-{place}" for place in EVERYWHERE]
    assert proof(tmp_path, package("py2-none-any", *free_threaded))[0] == 1


def test_a_package_counts_where_its_marker_holds(tmp_path: Path) -> None:
    old = package("cp311-abi3-manylinux2014_x86_64", marker='sys_platform == "win32"')
    assert proof(tmp_path, old) == (0, [])
    wheels = [f"cp311-cp311-{place}" for place in EVERYWHERE]
    below = package(*wheels, marker='python_full_version < "3.12"')
    assert proof(tmp_path, below) == (0, [])
    both = package(*wheels, marker='python_full_version < "3.13"')
    code, lines = proof(tmp_path, both)
    assert (code, len(lines)) == (1, 3)
    assert all("for Python 3.12 on" in line for line in lines)
