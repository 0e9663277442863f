"""The `kb` command: thin files over the rooms, nothing heavy until a command runs."""

import os
import signal
import sys


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the `kb` script: parse, run, and leave with the contract's exit code.

    Until a command takes signals itself, nothing was sent or written: one ends the program at once,
    with exit code 3.
    """
    ours = [
        number
        for number in (signal.SIGINT, signal.SIGTERM)
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)
    ]
    before = {number: signal.signal(number, _leave) for number in ours}
    try:
        from kb.cli.app import app
        from kb.cli.framework.exit_codes import run_to_exit_code

        words = {"args": arguments, "prog_name": "kb", "standalone_mode": False}
        sys.exit(run_to_exit_code(lambda: app(**words)))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave(number: int, frame: object) -> None:
    """Without raising: an exception in the middle of an import may end up anywhere."""
    name = signal.Signals(number).name
    if "--json" in sys.argv:
        os.write(1, f'{{"stopped": "stopped by {name}"}}\n'.encode())
    os.write(2, f"kb: stopped by {name}; run the same command to resume\n".encode())
    os._exit(3)


__all__ = ["main"]
