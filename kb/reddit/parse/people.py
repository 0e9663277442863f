"""People who asked to be left out: what an answer shows of them.

A name reaches an answer as a keyed hash (anonymize). In place of the hash of such a person stands
PURGED, from the moment an answer is scrubbed, or when a purge takes them out of older ones. What is
theirs is told by it, and where others' records only mention them it stays.
"""

from collections.abc import Iterable
from typing import Any

from kb.reddit.parse import answer_tree
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope

PURGED = "[purged]"


def theirs(answer: Any) -> set[str]:
    """Full names of what such people posted or commented, and of their posts that others' comments
    and crossposts show. PURGED is among them for a record that has no id.
    """
    names = set()
    for kind, data in answer_tree.things(answer):
        if data.get("author") == PURGED:
            key = data.get("id")
            names.add(f"{kind}_{key}" if isinstance(key, str) and key else PURGED)
        link, parents = data.get("link_id"), data.get("crosspost_parent_list")
        if data.get("link_author") == PURGED and isinstance(link, str):
            names.add(link)
        for parent in parents if isinstance(parents, list) else ():
            if isinstance(parent, dict) and parent.get("author") == PURGED:
                names.add(f"{answer_tree.POST}_{parent.get('id')}")
    return names


def without_hashes(envelope: Envelope, people: Iterable[str]) -> Envelope:
    """The envelope with PURGED in place of these hashes; the same object when it has none."""
    line = rawlog.encode(envelope)
    found = [one.encode() for one in people if one.encode() in line]
    for one in found:
        line = line.replace(one, PURGED.encode())
    return rawlog.decode(line) if found else envelope
