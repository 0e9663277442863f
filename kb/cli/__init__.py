"""The `kb` command: thin files over the rooms, nothing heavy until a command runs."""

from kb.cli.app import main

__all__ = ["main"]
