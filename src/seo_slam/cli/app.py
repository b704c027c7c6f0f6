"""The application: one command a module, errors as one line on standard error."""

import sys

import typer

from seo_slam.cli import ask, check, demo, doctor, edits, evaluate, export, navigate, query, run, simulate
from seo_slam.errors import SeoSlamError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Object-level semantic SLAM: RGB-D frames in, a map of things out.",
)

app.command("demo")(demo.demo)
app.command("run")(run.run)
app.add_typer(evaluate.app, name="eval")
app.command("doctor")(doctor.doctor)
app.command("check")(check.check)
app.command("query")(query.query)
app.command("ask")(ask.ask)
app.command("navigate")(navigate.navigate)
app.command("export")(export.export)
app.command("edits")(edits.edits)
app.command("simulate")(simulate.simulate)


def main() -> None:
    """Run the command line; a mistake of the caller ends with one clear line and exit status 2."""
    try:
        app()
    except SeoSlamError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(2)
