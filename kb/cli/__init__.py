"""The `kb` command: thin files over the rooms, nothing heavy until a command runs."""

import signal
import sys

from kb.core.signals import BOTH, end_in_time, handling, leave


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
    if signal.SIGTERM in ours:
        end_in_time()
    with handling(leave, ours):
        from kb.cli.app import app
        from kb.cli.framework.exit_codes import run_to_exit_code

        sys.exit(run_to_exit_code(app, arguments))


__all__ = ["main"]
