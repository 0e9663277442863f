"""The card at the root of a repository, made of the cards of its folders.

`datasets.load_dataset("ORG/NAME", config)` reads the root's card only: so that every table of every
folder is a config there, the folders' metadata are joined, with their names before the files'.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from kb.release.metadata.card import SIZES

CARD = "README.md"


def metadata_of(card: str) -> dict[str, Any]:
    """The YAML of a folder's card as plain values."""
    from huggingface_hub import DatasetCard

    data: Any = DatasetCard(card, ignore_metadata_errors=True).data
    return dict(data.to_dict())


def joined(title: str, cards: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The metadata of a repository, of its folders' in their order: lists without repeats, every
    config with its folder, and one default.
    """
    configs, infos = [], []
    for folder, card in cards.items():
        mine = [_in_folder(folder, config) for config in card.get("configs", [])]
        infos += _infos(card.get("dataset_info"), mine)
        configs += mine
    for config in configs:
        config.pop("default", None)
    if configs:
        configs[0]["default"] = True
    lists = {
        name: list(dict.fromkeys(one for card in cards.values() for one in _list(card.get(name))))
        for name in ("license", "language", "size_categories", "task_categories", "tags")
    }
    sizes = [one for one in SIZES if one in lists["size_categories"]]
    lists["size_categories"] = sizes[-1:] or lists["size_categories"]
    whole = {
        "license": lists.pop("license"),
        "pretty_name": title,
        **lists,
        "configs": configs,
        "dataset_info": infos,
    }
    return {name: what for name, what in whole.items() if what}


def repository_card(
    repo: str, title: str, about: str, version: str, cards: Mapping[str, Mapping[str, Any]]
) -> str:
    """The text of README.md."""
    from huggingface_hub import DatasetCardData

    whole = joined(title, cards)
    names = [config["config_name"] for config in whole.get("configs", [])]
    rows = "\n".join(
        f"| [{folder}]({folder}/README.md) | {card.get('pretty_name', folder)}"
        f" | {', '.join(config['config_name'] for config in card.get('configs', []))}"
        f" | {', '.join(_list(card.get('license')))} |"
        for folder, card in cards.items()
    )
    first = names[0] if names else ""
    return f"""---
{DatasetCardData(**whole).to_yaml().rstrip()}
---

# {title}

{about} Version {version}.

Each folder is a release of its own, with its own licence, card, datasheet, metadata and checksums.

| folder | what it holds | tables | licence |
| --- | --- | --- | --- |
{rows}

```python
from datasets import load_dataset

rows = load_dataset("{repo}", "{first}", split="train")  # any table above; streaming=True works too
```

```sh
hf download {repo} --repo-type dataset --local-dir release
kb verify release     # whether every file is as it was published
kb restore release    # the content, with your own keys or dumps
```

Rows that were removed since an earlier version are listed in each folder's `tombstones.ndjson`;
remove them from your copies, too.
"""


def _in_folder(folder: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """A config whose files lie in a folder."""
    files = [
        {**one, "path": [f"{folder}/{path}" for path in _list(one["path"])]}
        if isinstance(one.get("path"), list)
        else {**one, "path": f"{folder}/{one['path']}"}
        for one in config.get("data_files", [])
    ]
    return {**config, "data_files": files}


def _infos(infos: Any, configs: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What a card says of its tables, each with the config's name: a card with one may leave it
    out.
    """
    names = [str(config["config_name"]) for config in configs]
    listed = [infos] if isinstance(infos, Mapping) else infos or []
    return [{"config_name": names[0], **one} if len(names) == 1 else dict(one) for one in listed]


def _list(value: Any) -> list[Any]:
    if value is None:
        return []
    return list(value) if isinstance(value, list | tuple) else [value]
