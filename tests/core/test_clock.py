"""Times are UTC; a fixed date holds for the whole process; random numbers depend on their seed."""

import pytest

from kb.core import clock
from kb.core.errors import SettingError


@pytest.mark.parametrize(
    "text", ["2026-11-20T12:00:00Z", "2026-11-20T14:00:00+02:00", "2026-11-20T12:00:00"]
)
def test_times_are_utc(text: str) -> None:
    assert clock.stamp(clock.parse(text)) == "2026-11-20T12:00:00Z"


def test_an_invalid_fixed_date_is_a_setting_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KB_NOW", "tomorrow")
    with pytest.raises(SettingError):
        clock.now()


def test_random_numbers_depend_on_the_parts_alone() -> None:
    assert clock.rng(1, "a").random() == clock.rng(1, "a").random()
    assert clock.rng(1, "a").random() != clock.rng("1a").random()
