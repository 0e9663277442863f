"""Tests of `kb.core.templates`."""

from pathlib import Path

import pytest
from jinja2 import UndefinedError

from kb.core.templates import environment


@pytest.mark.parametrize(("escapes", "shown"), [(True, "A &lt;B&gt;\n"), (False, "A <B>\n")])
def test_values_are_escaped_where_asked_and_filters_are_known(
    tmp_path: Path, escapes: bool, shown: str
) -> None:
    (tmp_path / "a.jinja").write_text("{{ one | upper_case }}\n")
    made = environment(tmp_path, {"upper_case": str.upper}, autoescape=escapes)
    assert made.get_template("a.jinja").render(one="a <b>") == shown


def test_a_missing_value_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "a.jinja").write_text("{{ one }}")
    with pytest.raises(UndefinedError):
        environment(tmp_path, {}, autoescape=False).get_template("a.jinja").render()
