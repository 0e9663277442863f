"""How the server starts and ends."""

import signal
from pathlib import Path

import pytest

from tests.explore.conftest import Explored, explored


def test_a_folder_without_tables_and_a_port_that_is_taken_are_refused(
    demo_pages: Explored, demo: Path, tmp_path: Path
) -> None:
    with explored(tmp_path / "nothing") as nothing:
        assert nothing.address == ""
    with explored(demo / "data" / "demo", "--port", str(demo_pages.port)) as second:
        assert second.address == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_as_done(demo: Path, number: signal.Signals) -> None:
    with explored(demo / "data" / "demo") as pages:
        assert pages.ask("/").status == 200
        pages.process.send_signal(number)
        assert pages.process.wait(30) == 0
