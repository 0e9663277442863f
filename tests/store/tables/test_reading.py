"""Reading the data root: paths are taken as they are, and a file that can't be read is named with
what to do.
"""

from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from kb.core.errors import DamagedData
from kb.store.state.frontier import Frontier
from kb.store.tables.merge import Merge
from kb.store.tables.reading import reading, scan, state

ODD = "a#b?c%41[d]*'e{f,g}"


def a_file(path: Path, start: int = 0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table({"x": list(range(start, start + 5_000))}), path)
    return path


def test_a_path_is_no_pattern(tmp_path: Path) -> None:
    files = [a_file(tmp_path / name / "it's.parquet") for name in ("a?b", "a*b", ODD)]
    a_file(tmp_path / "axb" / "it's.parquet")
    for file in files:
        assert duckdb.connect().execute(f"SELECT count(*) FROM {scan([file])}").fetchall() == [
            (5_000,)
        ]


def test_the_broken_file_of_many_is_named(tmp_path: Path) -> None:
    good, bad = (
        a_file(tmp_path / "clean" / "wiki" / "pages" / f"part-{n}.parquet") for n in range(2)
    )
    data = bytearray(bad.read_bytes())
    data[60:1_000] = b"\xff" * 940  # pages are broken, the footer is not
    bad.write_bytes(data)
    with (
        pytest.raises(DamagedData, match=r"pages/part-1\.parquet can't be read") as caught,
        reading([good, bad]),
    ):
        duckdb.connect().execute(f"SELECT sum(x) FROM {scan([good, bad])}").fetchall()
    assert caught.value.hint == "run `kb wiki filter` again"
    with pytest.raises(DamagedData, match=r"part-1\.parquet"):
        list(Merge([good, bad], ["x"], ["x"]))
    bad.write_bytes(data[:100])
    with pytest.raises(DamagedData, match=r"part-1\.parquet"):
        list(Merge([good, bad], ["x"], ["x"]))


def test_an_error_of_another_cause_stays_what_it_is(tmp_path: Path) -> None:
    good = a_file(tmp_path / "x.parquet")
    with pytest.raises(duckdb.BinderException), reading([good]):
        duckdb.connect().execute(f"SELECT nothing FROM {scan([good])}")
    with pytest.raises(ZeroDivisionError), reading([good]):
        raise ZeroDivisionError


def test_state_is_read_where_it_is(tmp_path: Path) -> None:
    path = tmp_path / ODD / "state" / "wiki.sqlite"
    frontier = Frontier(path)
    frontier.add_keys("pages", ["1"])
    frontier.close()
    with state(path) as read:
        assert read.counts("pages") == {"todo": 1}
    assert list(tmp_path.iterdir()) == [tmp_path / ODD]  # no file of a name cut off at a # or ?
    path.write_bytes(b"garbage")
    with (
        pytest.raises(DamagedData, match=r"wiki\.sqlite can't be read") as caught,
        state(path) as read,
    ):
        read.kinds()
    assert "the next run rebuilds it" in caught.value.hint


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"key": ["a"], "stage": ["x"]}, "column reason is missing"),
        (
            {"key": [1], "stage": ["x"], "reason": ["y"], "value": ["1"], "threshold": ["2"]},
            "column key is int64, not string",
        ),
    ],
)
def test_a_file_that_is_another_table_is_named(
    tmp_path: Path, wrong: dict[str, list[object]], said: str
) -> None:
    path = tmp_path / "clean" / "youtube" / "rejected" / "part-00000.parquet"
    path.parent.mkdir(parents=True)
    pq.write_table(pa.table(wrong), path)
    with pytest.raises(DamagedData, match=said) as caught, reading([path]):
        pc.starts_with(pq.read_table(path, columns=["key", "reason"])["key"], "a")
        pa.table({}).schema.field("reason")
    assert caught.value.hint == "run `kb youtube filter` again"
