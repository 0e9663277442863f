"""Generates the reference pages from the code that they describe.

python -m tests.docs.reference       writes them (make reference)

kb/cli/README.md           commands and settings
data/profiles/README.md    the keys of a profile
schemas/README.md          tables and columns
"""

import types
import typing
from collections.abc import Iterator
from typing import Any

from kb.cli.app import context, leaves
from kb.cli.framework.options import COMMON, DESCRIBED, RUNNING
from kb.core.config.profile import Profile
from kb.core.config.section import model_in, sources_first
from kb.core.config.settings import Settings
from kb.core.summary.vocabulary import WORDS
from kb.schema.tables import tables
from tests.conftest import ROOT

_MADE = "<!-- Made by `make reference`; don't edit. -->\n"


def pages() -> dict[str, str]:
    """Text of every page by its path in the checkout."""
    return {
        "kb/cli/README.md": "\n".join((_MADE + commands(), summaries(), settings())),
        "data/profiles/README.md": _MADE + profile_keys(),
        "schemas/README.md": _MADE + columns(),
    }


def commands() -> str:
    """Every command with its own options and examples; shared options are listed once."""
    shared = {
        p.name: (p, context(path, command))
        for path, command in leaves()
        for p in command.params
        if p.name in (*COMMON, *RUNNING) and p.name not in DESCRIBED
    }
    blocks = [
        "# Commands\n\nAlmost every command has these options; exceptions are noted.\n",
        _option_table([shared[name] for name in COMMON if name in shared]),
        (
            "Some commands also have these options, as noted for each of them."
            " A command refuses any other option with exit code 2.\n"
        ),
        _option_table([shared[name] for name in RUNNING if name in shared]),
    ]
    for path, command in leaves():
        inner = context(path, command)
        options = [p for p in command.params if p.param_type_name == "option" and p.name != "help"]
        usage = " ".join(command.collect_usage_pieces(inner)).replace("[OPTIONS]", "[options]")
        blocks.append(
            f"## `kb {path}`\n\n{_paragraphs(command.help)}\n\nUsage: `kb {path} {usage}`\n"
        )
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        own = [p for p in options if p.name not in shared]
        for table in filter(None, (arguments, own)):
            blocks.append(_option_table([(p, inner) for p in table]))
        names = {p.name for p in options}
        also = [f"`--{name}`" for name in RUNNING if name in names and name in shared]
        lacking = [f"`--{name}`" for name in COMMON if name not in names]
        if also:
            blocks.append(f"Also: {', '.join(also)}.\n")
        if lacking:
            blocks.append(f"Without: {', '.join(lacking)}.\n")
        blocks.append(f"```\n{command.epilog}\n```\n")
    return "\n".join(blocks)


def _option_table(parameters: list[tuple[Any, Any]]) -> str:
    """Options or arguments, each with the context of its command."""
    records = [parameter.get_help_record(context) for parameter, context in parameters]
    rows = [
        f"| `{name.replace('|', chr(92) + '|')}` | {_cell(text)} |"
        for name, text in filter(None, records)
    ]
    return "\n".join(["| option | meaning |", "|---|---|", *rows, ""])


def _paragraphs(text: str) -> str:
    return "\n\n".join(" ".join(part.split()) for part in text.strip().split("\n\n"))


def summaries() -> str:
    """Every name in a summary, as `--json` writes it, and its meaning."""
    lines = [
        "# Summaries\n",
        (
            "A command ends with a summary line; `--json` prints it as an object."
            " `crawled`, `kept`, `rejected`, `failed` and `pending` count the items named by"
            " `counted`. Crawl, filter, export and `kb status` use the same nouns.\n"
        ),
        "| name | meaning |",
        "|---|---|",
    ]
    for name, word in WORDS.items():
        command, _, short = name.rpartition(".")
        where = f" (`kb {command}`)" if command else ""
        lines.append(f"| `{short}`{where} | {_cell(word.doc)} |")
    return "\n".join([*lines, ""])


def settings() -> str:
    """Every environment variable."""
    lines = [
        "# Settings\n",
        (
            "Settings come from the environment, or from `.env` in the working folder (copy"
            " `.env.example`). The environment wins.\n"
        ),
        "| name | meaning | default |",
        "|---|---|---|",
    ]
    for name, field in Settings.model_fields.items():
        default = "" if field.default is None else f"`{field.default}`"
        lines.append(f"| `{name.upper()}` | {_cell(field.description or '')} | {default} |")
    return "\n".join([*lines, ""])


def profile_keys() -> str:
    """Every key of a profile, by section."""
    lines = [
        "# Profiles\n",
        (
            "A profile holds everything that Lorecrawl knows about a domain, in one TOML file."
            " `minecraft` and `cooking` are included; pass your own with `--profile FILE.toml`."
            " Leave out the sections of sources that you don't collect."
            " An optional `world.toml` in the same folder lists the keywords used in the invented"
            " world of `kb sandbox` and `kb demo`; by default they are chosen at random.\n"
        ),
    ]
    return "\n".join([*lines, *_section("", Profile), ""])


def _section(title: str, model: Any) -> Iterator[str]:
    if title:
        yield f"\n## `[{title}]`\n"
        doc = (model.__doc__ or "").strip()
        if doc:
            yield _paragraphs(doc) + "\n"
    yield "| key | type | default | meaning |"
    yield "|---|---|---|---|"
    deeper = []
    for name in sources_first(model.model_fields):
        field = model.model_fields[name]
        if name == "path":
            continue
        inner = model_in(field.annotation)
        if inner is not None:
            full = f"{title}.{name}" if title else name
            many = typing.get_origin(field.annotation) in (tuple, list, dict)
            deeper.append((f"[{full}]" if many else full, inner))
            continue
        default = (
            "required"
            if field.is_required()
            else f"`{_short(field.get_default(call_default_factory=True))}`"
        )
        yield (
            f"| `{name}` | {_type(field.annotation)} | {default} |"
            f" {_cell(field.description or '')} |"
        )
    for full, inner in deeper:
        yield from _section(full, inner)


def _type(annotation: Any) -> str:
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Literal:
        return " \\| ".join(f"`{value}`" for value in inner)
    if origin in (tuple, list, set, frozenset):
        return f"list of {_type(inner[0])}"
    if origin is dict:
        return f"table of {_type(inner[1])}"
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_type(part) for part in inner if part is not type(None))
    if origin is typing.Annotated:
        return _type(inner[0])
    return {"str": "text", "int": "integer", "float": "number", "bool": "true or false"}.get(
        getattr(annotation, "__name__", ""), getattr(annotation, "__name__", str(annotation))
    )


def _short(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        text = "[" + ", ".join(repr(part) for part in value) + "]"
    elif isinstance(value, bool):
        text = str(value).lower()
    else:
        text = repr(value) if isinstance(value, str) else str(value)
    return (text if len(text) <= 60 else text[:59] + "…").replace("|", "\\|")


def columns() -> str:
    """Every table and column, from schemas/."""
    lines = [
        "# Tables\n",
        (
            "Times are UTC. A column without a reason for null is never null."
            " *Released* columns are those of `release/`.\n"
        ),
    ]
    for table in tables().values():
        lines += [
            f"## `{table.name}`\n",
            f"{table.doc}\n",
            f"Key: {', '.join(f'`{name}`' for name in table.key)}.\n",
            "| column | type | unit | null when | released | meaning | from |",
            "|---|---|---|---|---|---|---|",
        ]
        lines += [
            f"| `{column.name}` | {_cell(column.type)} | {column.unit} | {_cell(column.why_null)} |"
            f" {'yes' if column.released else ''} | {_cell(column.doc)} |"
            f" {_cell('; '.join(map(str, (column.source, *column.also))))} |"
            for column in table.columns
        ]
        lines.append("")
    return "\n".join(lines)


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())


if __name__ == "__main__":
    for name, text in pages().items():
        (ROOT / name).write_text(text, encoding="utf-8")
