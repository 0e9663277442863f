"""Tests of the commands of a source that declares none of its own."""

from typer.testing import CliRunner

from kb.cli.commands.sources.default_commands import app_of


def test_it_has_crawl_filter_and_export_with_the_nouns_of_its_spec() -> None:
    app = app_of("reddit")
    listed = CliRunner().invoke(app, ["--help"])
    assert listed.exit_code == 0
    for name in ("crawl", "filter", "export"):
        assert name in listed.stdout
    crawl = CliRunner().invoke(app, ["crawl", "--help"]).stdout
    assert "--limit" in crawl
    assert "posts" in crawl
