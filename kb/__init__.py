"""Lorebase: builds open knowledge bases about a domain from YouTube, a wiki and Reddit."""

__version__ = "0.1.0"
