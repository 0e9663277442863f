"""The shipped declarations are as a package's must be."""

import pytest

from kb.core.config.settings import DECLARED
from kb.core.sources import SOURCES
from kb.schema.declared import problems


@pytest.mark.parametrize("name", SOURCES)
def test_a_shipped_source_is_declared_without_contradiction(name: str) -> None:
    assert not list(problems(SOURCES[name], DECLARED.model_fields))
