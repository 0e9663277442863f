"""Lorebase: builds open knowledge bases about a domain from YouTube, a wiki and Reddit."""

from kb.core import telemetry

__version__ = "0.1.0"

telemetry.switch_off()
