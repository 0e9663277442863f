"""Films on a cluster: the scores and clips of one machine, though a worker is killed."""

import shutil
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.conftest import needs

needs("distributed", "av", "cv2", "scenedetect", "torch", "transformers")

from kb.clips import build as clips  # noqa: E402
from kb.clips.build import Chosen  # noqa: E402
from kb.clips.clip_files import CutOptions  # noqa: E402
from kb.core.context import Run  # noqa: E402
from kb.core.errors import SettingError  # noqa: E402
from kb.core.installation import torch  # noqa: E402
from kb.score import build as scores  # noqa: E402
from tests.clips.films import film  # noqa: E402
from tests.release.conftest import a_run  # noqa: E402
from tests.release.made import build as made_root  # noqa: E402

pytestmark = [pytest.mark.dask, pytest.mark.timeout(900)]  # each worker loads torch

VIDEOS = 8


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data root with pairs, a film of each video, and a model with random weights."""
    from tests.score.checkpoints import of_openai, random_clip  # torch takes seconds to load

    place = tmp_path_factory.mktemp("given")
    root = made_root(place / "root", sources=("pairs",), n=VIDEOS, export=False)
    (root / "state").mkdir()
    (place / "films").mkdir()
    for number in range(VIDEOS):
        path = place / "films" / f"vid{number:08d}.mp4"
        fast = {"preset": "ultrafast"}
        film(path, "libx264", range(300 + 50 * number), Fraction(1, 10), (96, 64), fast)
    torch.save(of_openai(random_clip()), place / "small.pt")
    return place


def score(run: Run, given: Path, out: Path) -> None:
    made = scores.score(run, [given / "films"], given / "small.pt", Chosen(), "cpu")
    assert made["scored"] > VIDEOS


def cut(run: Run, given: Path, out: Path) -> None:
    options = CutOptions(frames=4, size=(64, 96))
    assert clips.build(run, [given / "films"], out, options, Chosen())["clips"] > VIDEOS


class Command(NamedTuple):
    """`make`, the folders below its place that it `writes`, and the files that show that it has
    `begun`: the moment when a worker is killed.
    """

    make: Callable[[Run, Path, Path], None]
    writes: tuple[str, ...]
    begun: str


COMMANDS = [
    Command(
        score,
        ("root/pairs", "root/films", "root/annotations/films", "root/state/scores"),
        "root/state/scores/*.json",
    ),
    Command(cut, ("clips",), "clips/*.json"),
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.make.__name__)
def test_a_cluster_makes_the_bytes_of_one_machine(
    command: Command, given: Path, cluster, kill_a_worker, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setattr(clips, "_VIDEOS", 1)

    def made(name: str, **engine: object) -> dict[str, bytes]:
        place = tmp_path / name
        shutil.copytree(given / "root", place / "root")
        run = a_run(place / "root")
        command.make(Run(run.settings, run.profile, run.root, **engine), given, place / "clips")
        files = [path for top in command.writes for path in (place / top).rglob("*")]
        files = [path for path in files if path.is_file()]
        whole = [path for path in files if path.suffix != ".tmp"]  # of the killed worker
        return {str(path.relative_to(place)): path.read_bytes() for path in whole}

    expected = made("here", workers=1)
    killed = kill_a_worker(lambda: any((tmp_path / "dask").glob(command.begun)))
    assert made("dask", workers=2, engine="dask", scheduler=cluster.scheduler_address) == expected
    assert killed, "no worker was killed"


def test_a_worker_without_the_films_is_refused(given: Path, cluster, tmp_path: Path) -> None:
    """Under the path that this process has them at."""
    films = Path("/proc/self/cwd/films")  # of each process its own
    run = a_run(given / "root")
    run = Run(
        run.settings, run.profile, run.root, engine="dask", scheduler=cluster.scheduler_address
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(given)
        with pytest.raises(SettingError, match=f"does not see {films}"):
            clips.build(run, [films], tmp_path / "clips", CutOptions(), Chosen())
    assert not list((tmp_path / "clips").iterdir())
