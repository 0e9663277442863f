"""The extras of the package: those of pyproject.toml, and `all`, in the versions of the lock.

So `pip install '.[all]'` installs what `make setup` installs, but for the tools of developers and
for the build of torch.
"""

from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

DEVELOPERS = "# For developers"  # the line of the lock below which are their tools


class Extras(MetadataHookInterface):
    """Read by hatchling, which builds the package."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the extras, which are dynamic."""
        lock = Path(self.root, ".ci", "requirements.lock").read_text(encoding="utf-8")
        lines = lock.partition(DEVELOPERS)[0].splitlines()
        pinned = [line.removesuffix(" \\") for line in lines if not line.startswith(("#", " "))]
        metadata["optional-dependencies"] = {
            **self.config["extras"],
            **self.config["developers"],
            "all": [*pinned, f"torch=={self.config['torch']}"],
        }
