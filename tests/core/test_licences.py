"""Tests of `kb.core.licences`."""

import pytest

from kb.core.errors import ProfileError
from kb.core.licences import KNOWN, licence
from kb.core.sources import PUBLISHED


@pytest.mark.parametrize("spdx", KNOWN)
def test_every_known_licence_has_its_text_and_address(spdx: str) -> None:
    one = licence(spdx)
    assert len(one.text) > 500
    assert one.url.startswith("https://")
    assert one.zenodo == spdx.lower()


def test_releases_are_under_known_licences() -> None:
    assert {one.licence for one in PUBLISHED.values() if one.licence} <= KNOWN.keys()


def test_an_unknown_licence_names_the_known() -> None:
    with pytest.raises(ProfileError, match="'WTFPL'") as error:
        licence("WTFPL")
    assert "CC-BY-4.0" in error.value.hint
