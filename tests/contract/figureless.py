"""`kb` with reports that have no figures: those take most of the time of a build, and tests/report
draws them. A forked process imports this file alone.
"""

from kb.report import build
from tests import processes


def run(words: list[str]) -> None:
    build._drawn = lambda *_: []
    processes.run_command(words)
