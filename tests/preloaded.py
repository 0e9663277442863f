"""What the server of tests/forked.py imports before the first command.

No library that starts threads is called here: a fork would lose them.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import importlib
import itertools
from pathlib import Path

from kb.cli.app import leaves
from kb.cli.commands.profile.check import examine
from kb.core.profile import load_profile
from kb.core.sources import PUBLISHED
from kb.pairs import clip_tokens, keyword_list, keywords, matching
from kb.release import render, texts
from kb.release.about import about
from tests.forked import import_kb, sync_nothing

# What commands import late: they load a model, draw, or drive a browser. None needs torch where the
# model is compiled; it would double what each fork copies.
LATE = (
    "PIL.PngImagePlugin",
    "distributed",
    "googleapiclient.discovery",
    "instant_clip_tokenizer",
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
    "onnxruntime",
    "selenium.webdriver",
    "structlog",
    "tokenizers",
    "wordcloud",
)
_COLLAPSE = 25  # MADV_COLLAPSE of Linux 6.1
_HUGE = 2 << 20


def _in_huge_pages() -> None:
    """Have this process's memory lie in huge pages where the kernel can do that: a fork copies an
    entry for each page and gives it back at its end, which took longer than many a command.
    """
    advise = ctypes.CDLL(None).madvise
    for line in Path("/proc/self/maps").read_text().splitlines():
        area, rights, _, _, inode, *_ = line.split()
        start, end = (int(at, 16) for at in area.split("-"))
        start, end = -(-start // _HUGE) * _HUGE, end // _HUGE * _HUGE
        if rights == "rw-p" and inode == "0" and start < end:
            advise(ctypes.c_void_p(start), ctypes.c_size_t(end - start), _COLLAPSE)


import_kb()
sync_nothing()
for _name in LATE:
    with contextlib.suppress(ImportError):  # of an extra that is not installed
        importlib.import_module(_name)
# Every command looks at its profile's lists, and those of the shipped one have thousands of words:
# what each becomes is reckoned here, once, and not in a thousand forks. So are the templates of a
# release, which take longer to compile than to fill.
keyword_list.phrase = functools.cache(keyword_list.phrase)
keyword_list.is_everyday = functools.cache(keyword_list.is_everyday)
_profile = load_profile("minecraft")
examine(_profile.path)
matching.Matcher(keywords.load(_profile).phrases)
clip_tokens.Tokens()
for _name in render.ENVIRONMENT.list_templates(extensions=["jinja"]):
    render.ENVIRONMENT.get_template(_name)
for _source, _show in itertools.product(PUBLISHED, (texts.line, texts.md)):
    about(_profile, _source, _show)
for _ in leaves():  # and the tree of commands
    pass
gc.freeze()  # a collection in a fork would copy every page of these
with contextlib.suppress(OSError):  # of a system without /proc
    _in_huge_pages()
