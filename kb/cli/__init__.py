"""The `kb` command: thin files over the rooms, nothing heavy until a command runs."""

import os
import signal
import sys

from kb.core.signals import BOTH, handling


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the `kb` script: parse, run, and leave with the contract's exit code.

    Until a command takes signals itself, nothing was sent or written: one ends the program at once,
    with exit code 3.
    """
    ours = [
        number
        for number in BOTH
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)
    ]
    with handling(_leave, ours):
        from kb.cli.app import app
        from kb.cli.framework.exit_codes import run_to_exit_code

        sys.exit(run_to_exit_code(app, arguments))


def _leave(number: int, frame: object) -> None:
    """Without raising: an exception in the middle of an import may end up anywhere."""
    name = signal.Signals(number).name
    if "--json" in sys.argv:
        os.write(1, f'{{"stopped": "stopped by {name}", "waits_for": "next run"}}\n'.encode())
    os.write(2, f"kb: stopped by {name}; run the same command to resume\n".encode())
    os._exit(3)


__all__ = ["main"]
