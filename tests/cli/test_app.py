"""Help: quick and complete; the root command and its completion."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from kb.cli import main
from kb.cli.app import TREE, leaves

# What may be imported before a command runs: a budget in modules, as a time would depend on the
# machine.
NOT_FOR_HELP = (
    "rich",
    "pydantic",
    "pyarrow",
    "duckdb",
    "numpy",
    "requests",
    "googleapiclient",
    "praw",
    "selenium",
    "torch",
    "dask",
    "distributed",
    "matplotlib",
    "PIL",
    "transformers",
    "detoxify",
    "zstandard",
    "orjson",
    "werkzeug",
)


COMMANDS = dict(leaves())


def imports_of(code: str) -> set[str]:
    answer = subprocess.run(
        [
            sys.executable,
            "-c",
            (
                f"import json, sys\ntry:\n    {code}\nexcept SystemExit:\n    pass\n"
                "print('\\n' + json.dumps(sorted(sys.modules)))"
            ),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(json.loads(answer.stdout.splitlines()[-1]))


def test_help_imports_nothing_heavy() -> None:
    loaded = imports_of("from kb.cli import main; main(['--help'])")
    assert "typer" in loaded
    assert not loaded & set(NOT_FOR_HELP)
    sources = {name for source in SOURCES for name in (f"kb.{source}", f"kb.{source}.source")}
    assert len([name for name in loaded - sources if name.startswith("kb.")]) <= 19
    assert len(loaded) < 400


def test_an_import_of_dumps_loads_no_http_client_and_no_database() -> None:
    loaded = imports_of("import kb.reddit.crawl.importer, kb.artifacts.table_catalog")
    assert not loaded & {"praw", "requests", "aiohttp", "duckdb"}


# Each command's help in one process; it prints what is loaded after it and was not before.
EVERY_HELP = """
import json, sys
from kb.cli import main
known = set()
for name in json.loads(sys.argv[1]):
    try:
        main([*name.split(), "--help"])
    except SystemExit:
        pass
    print("\\n" + json.dumps([name, sorted(set(sys.modules) - known)]))
    known |= set(sys.modules)
"""


def test_a_commands_help_imports_nothing_heavy() -> None:
    answer = subprocess.run(
        [sys.executable, "-c", EVERY_HELP, json.dumps(sorted(COMMANDS))],
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = [json.loads(line) for line in answer.stdout.splitlines() if line.startswith('["')]
    assert len(loaded) == len(COMMANDS)
    # typer checks the types of a command's options with pydantic; that's typer's own need.
    heavy = set(NOT_FOR_HELP) - {"pydantic"}
    assert {name: found for name, new in loaded if (found := heavy & set(new))} == {}


def test_help_lists_every_group(kb: Any) -> None:
    answer = kb("--help")
    assert answer.returncode == 0
    assert answer.stderr == ""
    for name, line in TREE.items():
        assert re.search(rf"^  {name} +{re.escape(line)}$", answer.stdout, re.MULTILINE), name
    titles = re.findall(r"^(\w+):$", answer.stdout, re.MULTILINE)
    assert titles[1:7] == ["Collect", "Build", "Look", "Publish", "Maintain", "More"]


@pytest.mark.parametrize("words", ["", "youtube", "youtube crawl", "pairs", "query"])
def test_every_way_to_ask_for_help_shows_the_same(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def shown(*arguments: str) -> str:
        with pytest.raises(SystemExit) as ended:
            main([*arguments])
        assert ended.value.code == 0
        return capsys.readouterr().out

    text = shown(*words.split(), "--help")
    assert text.startswith(f"Usage: kb {words}".rstrip())
    assert shown(*words.split(), "-h") == text
    assert shown("help", *words.split()) == text


COMPLETED = """
eval "$(kb --show-completion)"
complete_after() {
    COMP_WORDS=(kb "$@"); COMP_CWORD=$#; COMPREPLY=()
    _kb_completion kb
    echo "${COMPREPLY[@]}"
}
complete_after you
complete_after youtube cra
complete_after youtube crawl --only meta
"""


def test_bash_completes_commands_options_and_values(tmp_path: Path) -> None:
    done = subprocess.run(
        ["bash", "-c", COMPLETED],
        env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == ["youtube", "crawl", "metadata"]


SOURCES = ("youtube", "wiki", "reddit")
