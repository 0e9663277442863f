"""The server: its tools, errors, and its end."""

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from kb.core.errors import UsageError
from kb.mcp.search_tool import run_search
from kb.mcp.server import make_server, run_about, run_query
from kb.mcp.untrusted_text import DEFAULT
from kb.registry import SOURCES as CLASSES
from kb.search.ranking import Only
from kb.store.tables.shard_writer import write_table
from tests.cli.conftest import clean_environment
from tests.filters.made import run_at
from tests.inprocess import Here
from tests.mcp.conftest import SERVER, Ask
from tests.query.test_statements import ESCAPES


def test_the_tools_say_what_they_take(client: Any) -> None:
    opened, call = client
    tools = {tool.name: tool for tool in call(opened.list_tools).tools}
    assert set(tools) == {"search", "read", "query", "about"}
    assert all(tool.annotations.read_only_hint for tool in tools.values())
    assert all("max_chars" in tool.input_schema["properties"] for tool in tools.values())
    takes = set(tools["search"].input_schema["properties"])
    assert {"source", "kind", "entity", "since", "until", "least_score", "each", "limit"} < takes
    assert "not instructions" in opened.instructions


@pytest.mark.parametrize(
    ("tool", "values", "said"),
    [
        (
            "read",
            {"ref": "nowhere"},
            "invalid reference 'nowhere'; give the ref",
        ),
        ("read", {"ref": "wiki:99"}, "unknown page '99'"),
        ("read", {"ref": "wiki:14#Nothing"}, "the page 14 has no section 'Nothing'"),
        ("read", {"ref": "youtube:video000001@soon"}, "invalid second 'soon'"),
        ("read", {"ref": "reddit:p000/zzz"}, "post p000 has no comment 'zzz'"),
        ("search", {"query": "x", "since": "soon"}, "since is 'soon'; write it like 2023-01-31"),
        ("search", {"query": "x", "source": ["tv"]}, "source"),
        ("search", {"query": "x", "max_chars": 10}, "greater than or equal to 1000"),
        ("query", {"sql": "FROM wiki_page"}, "Did you mean wiki_pages?"),
    ],
)
def test_a_mistake_is_told(ask: Ask, tool: str, values: dict[str, Any], said: str) -> None:
    text = ask(tool, **values)
    assert text.error
    assert said in text


def test_a_release_answers_what_it_can(
    tmp_path: Path, make_rows: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for folder in (tmp_path / "lorecrawl-youtube", tmp_path / "data" / "release" / "youtube"):
        write_table(
            folder / "videos-00000-of-00001.parquet",
            make_rows("youtube/videos", 4, released=True),
            "youtube/videos",
            released=True,
        )
    for root in (tmp_path / "lorecrawl-youtube", tmp_path / "data"):
        make_server(run_at(root), CLASSES)
        assert "youtube: 4 videos" in run_about(run_at(root), DEFAULT)
        answer = run_query(root, "SELECT 'n', count(*) FROM youtube_videos", 10, 10, DEFAULT)
        assert "\nn,4\n" in answer
        assert "read` with a ref" in run_search(run_at(root), "title", [], Only(), DEFAULT)
        with pytest.raises(UsageError, match="nothing to search"):
            run_search(run_at(root), "x", ["wiki"], Only(), DEFAULT)


def test_stdout_carries_the_protocol_alone_and_the_server_ends_with_stdin(data: Path) -> None:
    first = {
        "jsonrpc": "2.0",
        "id": 1,
        "method": "initialize",
        "params": {
            "protocolVersion": "2025-06-18",
            "capabilities": {},
            "clientInfo": {"name": "test", "version": "1"},
        },
    }
    lines = [
        first,
        {"jsonrpc": "2.0", "method": "notifications/initialized"},
        {"jsonrpc": "2.0", "id": 2, "method": "tools/list"},
    ]
    server = subprocess.Popen(
        [*SERVER, str(data)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=clean_environment()
    )
    assert server.stdin
    assert server.stdout
    server.stdin.write(
        "".join(json.dumps(line) + "\n" for line in [*lines]).encode() + b"no json\n"
    )
    server.stdin.flush()
    answers = [json.loads(server.stdout.readline()) for _ in range(2)]
    assert {answer.get("id") for answer in answers} <= {1, 2, None}
    server.stdin.close()
    for line in server.stdout.read().splitlines():
        assert json.loads(line)["jsonrpc"] == "2.0"
    assert server.wait(timeout=60) == 0


CLIENT = """
import anyio, sys
from mcp import Client
from mcp.client.stdio import StdioServerParameters, stdio_client

async def main():
    server = StdioServerParameters(command=sys.argv[1], args=sys.argv[2:])
    async with Client(stdio_client(server)) as client:
        await client.call_tool("about", {})
        print("ready", flush=True)
        sql = "SELECT count(*) FROM range(9999999) a, range(9999999) b WHERE a.range % 9 > b.range"
        await client.call_tool("query", {"sql": sql, "timeout_s": 60})

anyio.run(main)
"""


def test_sigkill_of_the_client_ends_the_server_and_its_query(data: Path) -> None:
    client = subprocess.Popen(
        [sys.executable, "-c", CLIENT, *SERVER, str(data)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=clean_environment(),
    )
    assert client.stdout
    assert client.stdout.readline() == b"ready\n"
    (server,) = psutil.Process(client.pid).children()
    while not (queries := server.children()):
        assert client.poll() is None
        time.sleep(0.05)
    client.send_signal(signal.SIGKILL)
    client.wait()
    _, alive = psutil.wait_procs([server, *queries], timeout=60)
    assert not alive


def test_without_the_extra_it_says_what_to_install(
    data: Path, here: Here, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mcp.server", None)
    done = here("mcp", "--data", str(data), "--profile", "minecraft")
    assert (done.code, done.out) == (2, "")
    assert done.said.endswith('or `pip install -e ".[mcp]"` there')
    assert here("mcp", "--data", str(data / "nowhere")).code == 2


def test_query_reads_the_views_and_nothing_else(ask: Ask, data: Path, tmp_path: Path) -> None:
    assert "\n14,Camel\n" in ask("query", sql="SELECT page_id, title FROM clean.wiki_pages")
    tried = re.compile(r"COPY youtube|temp_directory'\)|arrow|blob", re.IGNORECASE)
    chosen = [sql for sql in ESCAPES if tried.search(sql)]
    assert len(chosen) >= 4
    for sql in [*chosen, "SELECT 1; SELECT 2"]:
        text = ask("query", sql=sql.format(tmp=tmp_path, root=data))
        assert text.error, sql
    assert list(tmp_path.iterdir()) == []


def test_query_is_limited(ask: Ask) -> None:
    text = ask("query", sql="FROM range(1000000)", max_rows=7)
    assert "\n6\n" in text
    assert "\n7\n" not in text
    assert "More rows were left out" in text
    text = ask("query", sql="SELECT repeat('word ', 100000) AS words, 7 AS n", max_chars=1000)
    assert "(cut, 500,000 characters in total)" in text
    assert ",7\n" in text
    text = ask("query", sql="SELECT count(*) FROM range(9999999) a, range(9999999) b"
               " WHERE hash(a.range) % (b.range + 1) = 7", timeout_s=0.5)  # fmt: skip
    assert text.error
    assert "longer than 0.5 s" in text
    text = ask("query", sql="SELECT length(repeat('x', 3000000000))")
    assert text.error
    assert "emory" in text
