"""``stepdiag demo``: the whole job on a virtual machine."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from stepdiag.demo.demo import Demonstrated


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("demo")(demo)


def demo(
    out: Annotated[Path, typer.Option(help="An empty or new folder for everything the demo writes.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Another machine for every number.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print for programs.")] = False,
) -> None:
    """Do the whole job on a virtual machine.

    Record, solve, export, load back, verify, over a real Modbus connection and a real serial line.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from stepdiag.demo.demo import demonstrate

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<12}"), BarColumn(), MofNCompleteColumn(), TextColumn("stops"), TimeElapsedColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("starting", total=None)
        found = demonstrate(out, seed, lambda what, done, total: bar.update(task, description=what, completed=done, total=total))
    if as_json:
        _print_json(found)
    else:
        _print_table(found)


def _print_table(found: "Demonstrated") -> None:
    from rich.console import Console
    from rich.table import Table

    from stepdiag.cli.status import concluded_in

    table = Table(title="Errors of the tool where nobody measured: a 9 x 9 x 9 grid and six face diagonals")
    for heading in ("", "rms over the volume, um", "largest, um", "widest face diagonal, um"):
        table.add_column(heading, justify="left" if not heading else "right")
    rows = [("as it is", found.before)]
    named = {"fanuc": "Fanuc: pitch error tables", "siemens": "Siemens: nine tables (EEC and CEC)"}
    forms = {**found.after, **found.reach}
    worst_first = sorted(forms, key=lambda name: -forms[name].rms_um)
    rows += [(named.get(name, name), forms[name]) for name in worst_first]
    for name, figures in rows:
        table.add_row(name, f"{figures.rms_um:.2f}", f"{figures.largest_um:.2f}", f"{figures.face_diagonal_um:.2f}")
    console = Console()
    console.print(table)
    for line in concluded_in(found.round):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    console.print("All from one survey with an autocollimator's angles; the files of each form lie in the folder reach or beside the logs.")
    console.print(
        f"Measured and solved in {found.seconds:.0f} s. Look at {found.round / 'report.html'}; logs, result and files lie beside it."
    )


def _print_json(found: "Demonstrated") -> None:
    import json
    from dataclasses import asdict

    figures = {"as it is": asdict(found.before), **{name: asdict(each) for name, each in found.after.items()}}
    figures |= {name: asdict(each) for name, each in found.reach.items()}
    factors = {name: found.factor(name) for name in (*found.after, *found.reach)}
    typer.echo(json.dumps({"folder": str(found.round), "seconds": found.seconds, "figures": figures, "factors": factors}, indent=2))
