"""The cloud of the words that people write most, as the paper draws Reddit's."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from kb.core.config.profile import Profile
from kb.look.charts import WIDTH, WORDS, Figure, SavedSheet, canvas, number, saved
from kb.report.data import ReportData

_W, _H = 1080, 640  # the cloud's own pixels
_MORE = """
just like get got can't don't i'm it's that's one would could also any anyone really make made want
need know see im ive dont cant new use using still first even way much many thing things
"""


def words(
    data: ReportData, profile: Profile, name: str, tables: Mapping[str, tuple[str, ...]]
) -> Figure | None:
    """The cloud of the words in some columns of some tables (the paper shows Reddit's)."""
    if not data.clouds:
        return None
    from wordcloud import STOPWORDS

    stop = {word.lower() for word in (*STOPWORDS, *_MORE.split(), *profile.report.stop_words)}
    sums: Counter[str] = Counter()
    for table, columns in tables.items():
        # Enough of each, so that the most frequent ones of all are among them.
        sums.update(dict(data.words(table, columns, stop, 4 * profile.report.cloud_words)))
    ranked = sorted(sums.items(), key=lambda counted: (-counted[1], counted[0]))
    counts = ranked[: profile.report.cloud_words]
    if len(counts) < 5:
        return None
    rows = " and ".join(table.partition("/")[2] for table in tables)
    return Figure(
        name,
        f"What {rows} are about",
        f"The most frequent words; a word's size follows the number of {rows} that say it.",
        "Word cloud; the largest words are "
        + ", ".join(f"{word} ({number(n)})" for word, n in counts[:12])
        + ".",
        _drawn(dict(counts), profile.seed),
        ("word", rows),
        counts[:60],
    )


def _drawn(frequencies: dict[str, int], seed: int) -> SavedSheet:
    from matplotlib import get_data_path
    from matplotlib.font_manager import FontProperties
    from matplotlib.patches import PathPatch
    from matplotlib.textpath import TextPath
    from matplotlib.transforms import Affine2D
    from wordcloud import WordCloud

    font = str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans-Bold.ttf")
    cloud = WordCloud(
        width=_W,
        height=_H,
        font_path=font,
        prefer_horizontal=1.0,
        max_words=len(frequencies),
        min_font_size=22,
        max_font_size=130,
        relative_scaling=0.5,
        margin=10,
        random_state=seed,
    )
    cloud.generate_from_frequencies(frequencies)
    sheet, axes = canvas(WIDTH * _H / _W)
    face = FontProperties(fname=font)
    for index, ((word, _), size, (top, left), _, _) in enumerate(cloud.layout_):
        # A place is where the word's ink begins, not its line.
        shape = TextPath((0, 0), word, size=size, prop=face)
        ink = shape.get_extents()
        place = Affine2D().translate(left - ink.x0, _H - top - ink.y1)
        axes.add_artist(  # add_patch would measure each curve for limits, which are set below
            PathPatch(
                shape,
                transform=place + axes.transData,
                color=WORDS[index % len(WORDS)],
                linewidth=0,
            )
        )
    axes.set_xlim(0, _W)
    axes.set_ylim(0, _H)
    axes.set_aspect("equal")
    axes.axis("off")
    return saved(sheet)
