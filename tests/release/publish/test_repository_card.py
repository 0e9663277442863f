"""The root's card: every config of every folder, one default, each licence once."""

from kb.release.publish.repository_card import joined

SHARDS = [{"split": "train", "path": "posts-*-of-*.parquet"}]
REDDIT = {
    "license": "cc-by-4.0",
    "tags": ["minecraft", "reddit"],
    "size_categories": ["1M<n<10M"],
    "configs": [{"config_name": "posts", "default": True, "data_files": SHARDS}],
    "dataset_info": {"splits": [{"name": "train", "num_examples": 3}]},
}
TASKS = {
    "license": ["cc-by-4.0", "cc0-1.0"],
    "tags": ["minecraft"],
    "size_categories": ["n<1K"],
    "configs": [
        {
            "config_name": "tasks",
            "default": True,
            "data_files": [{"split": "train", "path": ["a.parquet", "b.parquet"]}],
        }
    ],
    "dataset_info": [{"config_name": "tasks", "splits": []}],
}


def test_configs_name_their_folders_and_one_is_the_default() -> None:
    whole = joined("Minecraft", {"reddit": REDDIT, "tasks": TASKS})
    assert whole["configs"] == [
        {
            "config_name": "posts",
            "default": True,
            "data_files": [{"split": "train", "path": "reddit/posts-*-of-*.parquet"}],
        },
        {
            "config_name": "tasks",
            "data_files": [{"split": "train", "path": ["tasks/a.parquet", "tasks/b.parquet"]}],
        },
    ]
    assert [one["config_name"] for one in whole["dataset_info"]] == ["posts", "tasks"]
    assert whole["license"] == ["cc-by-4.0", "cc0-1.0"]
    assert whole["tags"] == ["minecraft", "reddit"]
    assert whole["size_categories"] == ["1M<n<10M"]
