"""What a reader sees on a wiki page, read by the browser alone: the words of `innerText`, and the
grid of each table; and the same of a Markdown text, to compare.
"""

import re
from collections import Counter
from difflib import SequenceMatcher
from typing import Any

# Boxes of links, contents, tools, marks of footnotes, and what is put where nobody sees it.
READ = r"""
const style = document.createElement("style");
style.textContent = `.navbox, #toc, .toc, .mw-editsection, .mw-jump-link, #siteSub, #contentSub,
  .printfooter, .catlinks, .vector-toc, .mw-empty-elt, sup.reference, noscript
  { display: none !important }
  * { text-transform: none !important }`;
document.head.append(style);
const root = document.querySelector("#mw-content-text .mw-parser-output")
  || document.querySelector("#mw-content-text") || document.querySelector("main") || document.body;
const title = document.querySelector("#firstHeading");
for (const e of root.querySelectorAll("*")) {
  const box = e.getBoundingClientRect(), s = getComputedStyle(e);
  if (box.right < 0 || s.overflow === "hidden" && box.height === 0) e.style.display = "none";
}
const seen = (e) => e.checkVisibility() && !e.closest(".navbox, #toc, .toc");
const tables = [...root.querySelectorAll("table")].filter(seen).map((table) =>
  [...table.rows].map((row) => [...row.cells].map((cell) => {
    const inner = [...cell.querySelectorAll("table")];
    inner.forEach((one) => { one.style.display = "none"; });
    const words = cell.innerText;
    inner.forEach((one) => { one.style.display = ""; });
    return [words, cell.rowSpan, cell.colSpan];
  })));
const head = title && !root.contains(title) ? title.innerText + "\n" : "";
return { text: head + root.innerText, tables };
"""
Grid = list[list[str]]


def laid_out(rows: list[list[tuple[str, int, int]]]) -> tuple[Grid, set[tuple[int, int]]]:
    """The words of a table in every place that a cell covers, and the places where cells begin."""
    places: dict[tuple[int, int], str] = {}
    begun = set()
    for r, row in enumerate(rows):
        c = 0
        for words, down, across in row:
            while (r, c) in places:
                c += 1
            begun.add((r, c))
            for i in range(r, min(r + (down or len(rows)), len(rows))):
                for j in range(c, c + across):
                    places[i, j] = " ".join(words.split())
            c += across
    width = max((c + 1 for r, c in begun), default=0)
    return [[places.get((r, c), "") for c in range(width)] for r in range(len(rows))], begun


def blocks(markdown: str) -> list[str | Grid]:
    """A Markdown text as its tables and what stands between them."""
    found: list[str | Grid] = []
    for line in markdown.split("\n"):
        if not line.startswith("|"):
            if not found or not isinstance(found[-1], str):
                found.append("")
            found[-1] += f"{line}\n"
            continue
        cells = [one.strip().replace("\\|", "|") for one in re.split(r"(?<!\\)\|", line)[1:-1]]
        if not found or isinstance(found[-1], str):
            found.append([])
        found[-1].append([bare(one) for one in cells])
    for one in found:
        if not isinstance(one, str):
            assert {len(row) for row in one} == {len(one[0])}
            assert set(one.pop(1)) == {"---"}
    return found


def bare(markdown: str) -> str:
    """Without the marks of links, lists and headings."""
    text = re.sub(r"\[((?:[^\[\]\\]|\\.)*)\]\((?:<[^<>\n]*>|[^()\s]*)\)", r"\1", markdown)
    text = re.sub(r"^\s*(?:>\s|#{1,6}\s|(?:[-*]|\d+\.)(?:\s|$))+", "", text, flags=re.MULTILINE)
    return re.sub(r"\\(?=[#>|\[\]+*=`~-])", "", text)


def compared(seen: dict[str, Any], markdown: str) -> tuple[int, int, Counter[str], list[Grid]]:
    """The words that a reader sees, those of them that the Markdown has in their order, what it has
    more often, and tables that it has not in their order. A spanned cell's words count once, and
    those of tables that are none on the page (recipes, infoboxes) as they are.
    """
    grids = [laid_out(rows) for rows in seen["tables"]]
    missing = [grid for grid, _ in grids if any(map(any, grid))]
    told: list[str] = []
    for one in blocks(markdown):
        if isinstance(one, str):
            told += words(bare(one))
            continue
        begun = None
        for grid, places in grids:
            if missing and grid == missing[0] == one:
                begun = places
        if begun is not None:
            missing.pop(0)
        for r, row in enumerate(one):
            for c, cell in enumerate(row):
                if begun is None or (r, c) in begun:
                    told += words(cell)
    shown = words(seen["text"])
    same = SequenceMatcher(None, shown, told, autojunk=False).get_matching_blocks()
    return len(shown), sum(one.size for one in same), Counter(told) - Counter(shown), missing


def words(text: str) -> list[str]:
    return re.findall(r"\w+", text)
