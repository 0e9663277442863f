"""Tests of `kb.store.lock`."""

import os

import pytest

from kb.core.errors import WriterLocked
from kb.store import lock


def test_a_second_writer_names_the_first(tmp_path):
    with lock.writer(tmp_path, "youtube"):
        with pytest.raises(WriterLocked, match=str(os.getpid())), lock.writer(tmp_path, "youtube"):
            pass
        with lock.writer(tmp_path, "reddit"):
            pass
    with lock.writer(tmp_path, "youtube"):
        pass
