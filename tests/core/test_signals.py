"""Tests of `kb.core.signals`."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from kb.core import signals
from kb.core.errors import Interrupted


@pytest.mark.parametrize("number", signals.BOTH)
def test_a_signal_asks_the_run_to_stop_and_the_block_forgets_it(number: int) -> None:
    before = signal.getsignal(number)
    with signals.stop_on_signals() as stop:
        assert not stop.requested()
        os.kill(os.getpid(), number)
        assert stop.wait(10)
        with pytest.raises(Interrupted, match=signal.Signals(number).name):
            stop.raise_if_asked()
    assert signal.getsignal(number) is before
    assert not signals.stop.requested()


def test_a_second_sigint_ends_the_block() -> None:
    with pytest.raises(KeyboardInterrupt), signals.stop_on_signals() as stop:
        stop.request("SIGINT")
        os.kill(os.getpid(), signal.SIGINT)
        stop.wait(10)
    assert not signals.stop.requested()


def test_another_thread_sets_no_handler() -> None:
    before = [signal.getsignal(number) for number in signals.BOTH]
    inside: list[object] = []

    def run() -> None:
        with signals.stop_on_signals():
            inside.extend(signal.getsignal(number) for number in signals.BOTH)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert inside == before


def test_sigterm_ends_a_program_that_never_looks_at_it() -> None:
    blind = (
        "import signal, time; from kb.core import signals; signals.END_S = 0.1;"
        " signal.signal(signal.SIGTERM, lambda *_: None)\n"
        "with signals.ended_in_time():\n print(flush=True); time.sleep(300)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", blind], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=60)
    assert (process.returncode, said.strip()) == (
        3,
        "kb: stopped by SIGTERM; run the same command to resume",
    )


def test_a_command_that_ended_leaves_nothing_that_hears_of_signals() -> None:
    with signals.ended_in_time():
        pass
    assert signal.set_wakeup_fd(-1) == -1
