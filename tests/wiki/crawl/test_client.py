"""Malformed answers are no answers, and lists that loop end."""

import json

import pytest
from werkzeug.wrappers import Response

from kb.core.errors import Challenged, FatalError, Retryable
from kb.wiki.crawl.client import WikiApi


def listed(api: WikiApi, kept: list, going: dict | None = None) -> None:
    """A whole list, as a crawl reads it piece by piece."""
    going = going or {}
    while going is not None:
        kept.append(api.listing(1, 0, going))
        going = kept[-1].response.get("continue")


STRANGE = [
    [],
    "busy",
    {"batchcomplete": True},
    {"message": "busy"},
    {"error": "busy"},
    {"query": []},
    {"query": {}},
    {"query": {"pages": ["Alpha"], "allpages": ["Alpha"]}},
    {"query": {"pages": [{"pageid": "1"}], "allpages": [{"pageid": 1}]}},
]


@pytest.mark.parametrize("answer", STRANGE, ids=str)
def test_an_answer_of_another_shape_is_no_answer(wiki, api, answer) -> None:
    wiki.hook = lambda request: (
        Response(json.dumps(answer)) if request.path == "/w/api.php" else None
    )
    for ask in (
        api.site,
        lambda: api.listing(1, 0, {}),
        lambda: api.details("1", titles=["Alpha"]),
        lambda: api.details("1", ids=["1"]),
        lambda: api.files(["File:A.png"]),
    ):
        with pytest.raises(Retryable, match="the API's answer"):
            ask()


def test_html_instead_of_json_is_shown(wiki, api) -> None:
    wiki.hook = lambda request: Response("<html>\n checking your browser</html>")
    said = r'/w/api.php returns "<html> checking your browser</html>" instead of JSON'
    with pytest.raises(Challenged, match=said):
        api.site()
    wiki.hook = lambda request: Response("busy")
    with pytest.raises(Retryable, match=r'/w/api.php returns "busy" instead of JSON'):
        api.site()
    wiki.hook = lambda request: {"error": {"code": "internal_api_error_Foo", "info": "x"}}
    with pytest.raises(Retryable, match="internal_api_error_Foo"):
        api.site()
    wiki.hook = lambda request: {"error": {"code": "badvalue", "info": "no such thing"}}
    with pytest.raises(FatalError, match="no such thing"):
        api.site()


def test_a_list_that_goes_in_a_circle_ends(wiki, api, web) -> None:
    kept: list = []
    steps = {"": "B", "B": "C", "C": "B"}

    def around(request):
        at = request.args.get("apcontinue", "")
        return {
            "continue": {"apcontinue": steps[at], "continue": "-||"},
            "query": {"allpages": [{"pageid": 1, "ns": 0, "title": f"A{at}"}]},
        }

    wiki.hook = around
    with pytest.raises(Retryable, match="API loops"):
        listed(api, kept)
    assert len(kept) == 3
    # The next run goes on from the last step, and finds the circle again.
    with pytest.raises(Retryable, match="API loops"):
        listed(WikiApi(api.endpoint, web), kept, {"apcontinue": "B", "continue": "-||"})
    assert len(kept) == 5
    wiki.hook = lambda request: {
        "continue": {"pccontinue": "1|2", "continue": "||"},
        "query": {"pages": [{"pageid": 1, "title": "Alpha"}]},
    }
    with pytest.raises(Retryable, match="API loops"):
        api.details("1", titles=["Alpha"])
    # The same list again and again, with ever new steps.
    fresh = iter(range(1000))
    wiki.hook = lambda request: {
        "continue": {"apcontinue": str(next(fresh))},
        "query": {"allpages": [{"pageid": 1, "ns": 0, "title": "A"}]},
    }
    with pytest.raises(Retryable, match="API loops"):
        listed(WikiApi(api.endpoint, web), kept)
