"""Addresses of published models are pinned."""

from kb.annotate.checkpoint import PUBLISHED


def test_published_addresses_are_pinned():
    for model in PUBLISHED.values():
        *files, (checkpoint, address, expected) = model.sources()
        assert all(f"/resolve/{model.revision}/" in url for _, url, _ in files)
        assert len(model.revision) == 40
        assert checkpoint.endswith(f"-{expected[:8]}.ckpt")
        assert address.startswith("https://github.com/unitaryai/detoxify/releases/download/")
        assert "config.json" in [name for name, _, _ in files]
