"""What the server of tests/forked.py imports before the first command.

Nothing is called here: a library that is only imported has started no thread that a fork loses.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import os

from tests.forked import import_kb

# What commands import late: they load a model, draw, or drive a browser.
LATE = (
    "detoxify.detoxify",
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
    "onnxruntime",
    "openvino",
    "selenium.webdriver",
    "tokenizers",
    "torch",
    "transformers",
    "wordcloud",
)
# As kb/annotate has it where it imports them; each command gets its own environment.
os.environ |= {"HF_HUB_OFFLINE": "1", "TRANSFORMERS_VERBOSITY": "error"}
import_kb()
for _name in LATE:
    with contextlib.suppress(ImportError):  # of an extra that is not installed
        importlib.import_module(_name)
gc.freeze()  # a collection in a fork would copy every page of these
