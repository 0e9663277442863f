"""What YouTube's site shows to a client that it turns away: the marks of the recorded pages."""

from typing import Any

from kb.sandbox.youtube.web import SITE, player_answer


def consent_page() -> str:
    """The cookie wall that comes in place of a watch page."""
    return (
        '<!DOCTYPE html><html lang="en"><head><title>Before you continue to'
        ' YouTube</title></head><body><form action="https://consent.youtube.com/s"'
        ' method="POST"><input type="hidden" name="gl"'
        ' value="DE"><input type="hidden" name="continue"'
        f' value="{SITE}/watch?v="><input'
        ' type="hidden" name="v" value="cb.20261101-00-p0.en+FX+000">'
        "<button>I agree</button></form></body></html>"
    )


def captcha_page() -> str:
    """The page that a blocked client sees."""
    return (
        "<!DOCTYPE html><html><head><title>YouTube</title><script"
        ' src="https://www.google.com/recaptcha/api.js" async defer></script></head><body>'
        '<div id="captcha-page"><form action="/das_captcha" method="POST">'
        '<div class="g-recaptcha" data-sitekey="sandbox"></div></form></div></body></html>'
    )


def bot_answer() -> dict[str, Any]:
    """The player's answer to a blocked client."""
    status = {"status": "LOGIN_REQUIRED", "reason": "Sign in to confirm you’re not a bot"}
    return {**player_answer(None), "playabilityStatus": status}
