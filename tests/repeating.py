"""`pytest -p tests.repeating --rounds N PATHS`: the tests there that use a browser, N times."""

import pytest

BROWSER = {"programs", "browser"}  # fixtures that start one


def pytest_addoption(parser: pytest.Parser) -> None:
    """--rounds N."""
    parser.addoption("--rounds", type=int, default=1, metavar="N")


@pytest.fixture
def number(request: pytest.FixtureRequest) -> int:
    """Which of the rounds this is."""
    return int(request.param)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Once a round."""
    if BROWSER.intersection(metafunc.fixturenames):
        metafunc.fixturenames.append("number")
        metafunc.parametrize("number", range(metafunc.config.option.rounds), indirect=True)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Without tests that use none."""
    others = [one for one in items if not BROWSER.intersection(getattr(one, "fixturenames", ()))]
    config.hook.pytest_deselected(items=others)
    items[:] = [one for one in items if one not in others]
