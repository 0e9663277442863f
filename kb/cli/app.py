"""The command tree."""

import typer

app = typer.Typer(name="kb", rich_markup_mode=None, no_args_is_help=True)


@app.callback()
def root() -> None:
    """Build an open knowledge base about a domain from YouTube, a wiki and Reddit."""


def main() -> None:
    """Entry point of the `kb` script."""
    app(prog_name="kb")
