"""Labels of figures."""

from collections.abc import Callable

from kb.report.charts import readable
from tests.report.made import OfOne


def test_labels_of_any_script_and_sign(of_one: Callable[[str], OfOne]) -> None:
    """A dollar is no formula, and what the font can't draw is a question mark, not a warning."""
    warned = [*of_one("youtube").warned, *of_one("pairs").warned]
    assert not [text for text in warned if "missing from font" in text]
    assert readable("採掘\n🧱 ok") == "?? ? ok"
    assert len(readable("a" * 80)) == 26
