"""Pictures as wikis load them: each has the address of its original, whatever stands in its place
before it is seen.
"""

import io

from PIL import Image

from kb.wiki import media_urls
from kb.wiki.crawl.fetch import wanted_files

SPACER = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7"
LAZY = {
    "a placeholder in srcset": f'<img src="{SPACER}" srcset="{SPACER} 1x" data-src="/real.png">',
    "its own srcset too": f'<img src="{SPACER}" data-src="/real.png" data-srcset="/real.png 2x">',
    "a span": """<span class="lazy-image-placeholder" style="width: 40px;height: 30px"
      data-src="/real.png" data-alt="Ore"></span>""",
    "a span before its noscript": """<noscript><img src="/real.png"></noscript><span
      class="lazy-image-placeholder" data-src="/real.png"></span>""",
    "a noscript beside it": f'<img src="{SPACER}"><noscript><img src="/real.png"></noscript>',
    "a noscript alone": '<p><noscript><img src="/real.png"></noscript></p>',
    "a source of a picture": f"""<picture><source srcset="{SPACER}"><img src="{SPACER}"
      data-src="/real.png"></picture>""",
    "what loads when it comes into view": f"""<div style="height:4000px"></div>
      <img src="{SPACER}" id=late>
      <script>new IntersectionObserver((seen) => {{ if (seen.some((one) => one.isIntersecting))
      late.src = "/real.png"; }}).observe(late);</script>""",
}


def png() -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (40, 30), (9, 90, 200)).save(buffer, "PNG")
    return buffer.getvalue()


def test_a_picture_that_waits_is_loaded(pages, look):
    addresses, body = [], ""
    for number, part in enumerate(LAZY.values()):
        addresses.append(pages.put(f"/real{number}.png", png(), "image/png"))
        body += f"<div>{part.replace('/real.png', f'/real{number}.png')}</div>"
    html = f"<!DOCTYPE html><body><div id=content>{body}</div>"
    extraction = look(pages.put("/shown/lazy", html)).extraction
    found = [e for e in extraction["elements"] if e["kind"] == "image"]
    assert [(e["src"], e["loaded"]) for e in found] == [(one, True) for one in addresses]
    assert [file["key"] for file in wanted_files(extraction)] == addresses


def test_a_picture_without_an_address_is_no_picture(pages, look):
    addresses = ("src=''", "src=' '", "src='#'", "src='?'", "", "srcset=''", "src='' alt=Kiln")
    body = "".join(f"<p>Kiln <img {address}></p>" for address in addresses)
    body += "<img src='/none.png' alt=Ore>"
    url = pages.put("/shown/nowhere", f"<!DOCTYPE html><body><div id=content>{body}</div>")
    extraction = look(url).extraction
    assert [e["src"] for e in extraction["elements"] if e["kind"] == "image"] == [
        f"{pages.url}/none.png"
    ]
    assert [file["key"] for file in wanted_files(extraction)] == [f"{pages.url}/none.png"]


def test_videos_and_their_posters(pages, look):
    pages.put("/real.png", png(), "image/png")
    body = """<div id=content><figure><video poster="/real.png" width=80 height=60>
      <source src="/kiln.webm"></video><figcaption>At dawn</figcaption></figure>
      <audio src="/fire.ogg" controls></audio></div>"""
    extraction = look(pages.put("/shown/video", f"<!DOCTYPE html><body>{body}")).extraction
    found = {e["kind"]: e for e in extraction["elements"]}
    assert found["video"]["address"] == f"{pages.url}/kiln.webm"
    assert found["audio"]["address"] == f"{pages.url}/fire.ogg"
    assert (found["image"]["parent"], found["image"]["caption"]) == (
        found["video"]["id"],
        "At dawn",
    )
    (file,) = wanted_files(extraction)
    assert (file["key"], file["title"]) == (f"{pages.url}/real.png", None)


def test_a_picture_in_the_pages_own_text_is_found_by_its_file_or_is_itself():
    part = {"src": "data:image/png;base64,AAAA", "natural": [40, 30], "file": None}
    named = {**part, "file": "https://wiki.example/wiki/File:Ore.png"}
    spacer = {**part, "natural": [1, 1]}
    page = {"url": "https://wiki.example/wiki/Ore"}
    files = wanted_files({"page": page, "elements": [part, named, spacer]})
    assert [(file["title"], file["src"]) for file in files] == [
        (None, part["src"]),
        ("File:Ore.png", part["src"]),
    ]
    assert media_urls.file_key(named) == named["file"]
