"""The `kb` command: thin files over the rooms, nothing heavy until a command runs."""

import contextlib
import os
import signal
import sys

from kb.core.errors import KbError
from kb.core.signals import BOTH, ended_in_time, handling, leave
from kb.core.startup import collect_seldom


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the `kb` script: parse, run, and leave with the contract's exit code.

    Until a command takes signals itself, nothing was sent or written: one ends the program at once,
    with exit code 3.
    """
    collect_seldom()
    # Plug-ins of pydantic are not asked for: they are looked for in every installed package.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    ours = [
        number
        for number in BOTH
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)
    ]
    in_time = ended_in_time() if signal.SIGTERM in ours else contextlib.nullcontext()
    with in_time, handling(leave, ours):
        try:
            from kb.cli.app import app
        except KbError as error:  # the declaration of a source is not as it should be
            print(f"kb: {error}" + (f"; {error.hint}" if error.hint else ""), file=sys.stderr)
            sys.exit(error.exit_code)
        from kb.cli.framework.exit_codes import run_to_exit_code

        sys.exit(run_to_exit_code(app, arguments))


__all__ = ["main"]
