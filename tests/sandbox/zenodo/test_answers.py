"""Tests of the answers of the deposit service."""

import json
from typing import Any

import pytest

from kb.sandbox.zenodo import ZenodoError, checked_metadata
from tests.sandbox.answers import GOOD


@pytest.mark.parametrize(
    ("change", "fields"),
    [
        ({"title": ""}, ["metadata.title"]),
        ({"upload_type": "recipe"}, ["metadata.upload_type"]),
        ({"license": "mine", "publication_date": "today"}, ["license", "publication_date"]),
    ],
)
def test_every_wrong_field_is_named(change: dict[str, Any], fields: list[str]) -> None:
    with pytest.raises(ZenodoError) as caught:
        checked_metadata({**GOOD, **change}, complete=True)
    assert caught.value.response is not None
    errors = json.loads(caught.value.response.get_data())["errors"]
    assert [one["field"].removeprefix("metadata.") for one in errors] == [
        name.removeprefix("metadata.") for name in fields
    ]


def test_an_open_deposit_without_a_licence_becomes_cc0() -> None:
    assert checked_metadata(GOOD, complete=True)["license"] == "cc-zero"
    kept = checked_metadata({**GOOD, "license": "cc-by-4.0"}, complete=True)
    assert kept["license"] == "cc-by-4.0"
    assert "license" not in checked_metadata({"access_right": "closed"}, complete=False)
