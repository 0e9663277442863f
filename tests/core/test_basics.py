"""What every room builds on: errors, the Run, clock, licences, sources, files that travel along."""

import math
import re
from datetime import UTC, datetime
from pathlib import Path

import pytest
from jinja2 import UndefinedError

from kb import registry
from kb.core import clock, errors
from kb.core.config.profile import load_profile
from kb.core.config.settings import Settings
from kb.core.context import Run
from kb.core.errors import KbError, ProfileError, SettingError
from kb.core.installation import making
from kb.core.licences import KNOWN, licence
from kb.core.sources import BY_DEFAULT, PUBLISHED, SOURCES, made_of
from kb.core.summary import Summary, wilson_interval
from kb.core.summary.plan import PlanPart, PlanPhase, join, to_read
from kb.core.templates import environment
from kb.schema.tables import tables

TREE = [line for line in (errors.__doc__ or "").splitlines() if "─ " in line]


@pytest.mark.parametrize("line", TREE, ids=lambda line: line.split()[-1])
def test_the_tree_of_the_docstring_is_the_classes(line: str) -> None:
    name = re.search(r"─ (\w+)", line)[1]
    kind = getattr(errors, name)
    assert issubclass(kind, KbError)
    if match := re.search(r"  (\d)  ", line):
        assert kind.exit_code == int(match[1])


def test_every_class_is_in_the_tree() -> None:
    named = {re.search(r"─ (\w+)", line)[1] for line in TREE}
    classes = {one.__name__ for one in vars(errors).values() if isinstance(one, type)}
    assert {name for name in classes if issubclass(getattr(errors, name, int), KbError)} == {
        *named,
        "KbError",
    }


def test_what_an_error_carries() -> None:
    moment = datetime(2026, 1, 1, tzinfo=UTC)
    assert errors.QuotaSpent("spent", until=moment).until == moment
    assert str(errors.ItemFinal("not_found", "404")) == "not_found: 404"
    assert errors.Retryable("slow", after=3.0, throttled=True).throttled
    assert errors.FatalError("no", hint="do").hint == "do"


def test_the_worst_of_several_errors_decides_the_exit_code() -> None:
    kinds = [errors.LimitReached, errors.Blocked, errors.Challenged, errors.DamagedData]
    ended = sorted([kind("why") for kind in kinds], key=errors.severity)
    assert [type(error) for error in ended] == kinds[::-1]
    assert [error.exit_code for error in ended] == [1, 4, 3, 3]


@pytest.mark.parametrize(
    ("about", "size", "expected"),
    [
        ({"asked": False}, 1_000, 1),  # a few bytes are read by the time that a process starts
        ({"asked": False}, 1 << 30, 4),
        ({"asked": True}, 1_000, 4),
        ({"asked": False, "engine": "dask"}, 1_000, 4),  # a cluster's processes run already
    ],
)
def test_processes_are_started_where_they_pay(about: dict, size: int, expected: int) -> None:
    run = Run(Settings(), load_profile("minecraft"), Path("data"), workers=4, **about)
    assert run.processes(size) == expected


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


def test_the_first_whole_one_stays(tmp_path):
    folder = tmp_path / "made"
    with making(folder, lambda: True) as first, making(folder, lambda: True) as second:
        assert first != second
        (first / "a").write_text("first")
        (second / "a").write_text("second")
    assert [path.name for path in tmp_path.iterdir()] == ["made"]
    assert (folder / "a").read_text() == "second", "the inner block ended first"


def test_a_damaged_one_is_replaced(tmp_path):
    folder = tmp_path / "made"
    folder.mkdir()
    (folder / "half").touch()
    with making(folder, lambda: False) as fresh:
        (fresh / "a").write_text("whole")
    assert [path.name for path in folder.iterdir()] == ["a"]


def test_nothing_is_left_of_a_failure(tmp_path):
    with pytest.raises(ValueError, match="no"), making(tmp_path / "made", lambda: False) as fresh:
        (fresh / "a").write_text("half")
        raise ValueError("no")
    assert not list(tmp_path.iterdir())


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


@pytest.mark.parametrize("name", SOURCES)
def test_tables_of_a_source_are_declared(name: str) -> None:
    source = SOURCES[name]
    shorts = [*source.tables, *source.indexed, *source.linked]
    assert {f"{name}/{short}" for short in shorts} <= set(tables())
    assert {*source.shown, *source.sampled} <= set(tables())
    assert source.main in source.tables


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_is_exported_has_a_writer(name: str) -> None:
    assert {*PUBLISHED[name].formats} == {*registry.PUBLISHED[name].writers()} - {"parquet"}


@pytest.mark.parametrize("name", SOURCES)
def test_the_rules_of_a_purge_are_those_of_the_source(name: str) -> None:
    assert registry.SOURCES[name].purge_rules().source == name


def test_what_is_made_from_sources() -> None:
    assert made_of("pairs") == ("youtube",)
    assert made_of("links") == tuple(SOURCES)
    assert made_of("tasks") == made_of("pairs")
    assert made_of("wiki") == ("wiki",)
    assert (*SOURCES, "pairs", "tasks", "links") == BY_DEFAULT
    assert (*BY_DEFAULT, "open-text", "draw") == tuple(PUBLISHED)


def test_what_is_left_in_the_order_of_work() -> None:
    """Kinds that are never fetched are left out, and new ones come last."""
    left = {"videos": {"todo": 2, "in_progress": 1, "done": 9}, "searches": {"todo": 0}}
    kinds = {**left, "channels": {"todo": 5}, "strange_kind": {}}
    assert SOURCES["youtube"].in_order(kinds) == ["searches", "videos", "strange_kind"]
    assert SOURCES["youtube"].left_by(kinds) == {"videos": 3}
    assert SOURCES["youtube"].noun("strange_kind") == "strange kind"


def test_a_plan_sums_its_phases_and_shows_them_in_columns() -> None:
    videos = PlanPart([PlanPhase("videos", 1_200, requests=24, units=24)], ["50 ids a request"])
    posts = PlanPart([PlanPhase("posts", 10, requests=1, hours=0.5, gb=0.25)])
    made = join("restore", [videos, posts])
    assert (made["requests"], made["units"], made["hours"], made["gb"]) == (25, 24, 0.5, 0.25)
    lines = Summary(made).line().splitlines()
    assert lines[0] == "restore --plan: nothing is sent"
    assert lines[1].split() == ["phase", "items", "requests", "units", "hours", "gb"]
    assert lines[2].split() == ["videos", "1,200", "24", "24", "0.0", "0"]
    assert lines[4].split() == ["all", "25", "24", "0.5", "0.25"]
    assert len({len(line) for line in lines[1:5]}) == 1
    assert lines[5] == "  assumed: 50 ids a request"


def test_items_that_failed_are_read_again() -> None:
    kinds = {"videos": {"todo": 2, "in_progress": 1, "error": 3, "done": 5, "skipped": 7}}
    assert (to_read(kinds, "videos"), to_read(kinds, "pages")) == (6, 0)


@pytest.mark.parametrize(
    ("hits", "n", "expected"),
    [  # Newcombe, Statistics in Medicine 17 (1998), table I, method 3
        (81, 263, (0.2553, 0.3662)),
        (15, 148, (0.0624, 0.1605)),
        (0, 20, (0.0, 0.1611)),
        (1, 29, (0.0061, 0.1718)),
        (0, 0, (0.0, 1.0)),
    ],
)
def test_published_intervals(hits: int, n: int, expected: tuple[float, float]) -> None:
    assert wilson_interval(hits, n) == pytest.approx(expected, abs=5e-5)


def test_the_ends_are_the_shares_that_a_score_test_does_not_reject() -> None:
    for end in wilson_interval(7, 40):
        assert abs(7 / 40 - end) / math.sqrt(end * (1 - end) / 40) == pytest.approx(1.96, abs=1e-4)
