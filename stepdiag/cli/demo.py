"""``stepdiag demo``: a whole survey on a virtual machine, from recording to verification."""

import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Message, Words, message
from stepdiag.cli.completion import AsJson, Verbose
from stepdiag.terminal.viewer import empty_table, print_words, shown

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stepdiag.demo.demo import Demonstrated, Progress
    from stepdiag.demo.keys import Keyboard


def register(app: typer.Typer) -> None:
    app.command("demo")(demo)


def demo(
    out: Path = Path("demo"),
    seed: int = 1,
    live: Annotated[bool, typer.Option("--live")] = False,
    browser: bool | None = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Record, solve, export and verify a survey on a virtual machine."""
    if live and as_json:
        raise UsageError(
            "--json", expected=message("without-option", option="--live"), found="--live"
        )
    if live:
        _live(out, seed, browser=browser is not False)
        return
    if browser is not None:
        raise UsageError(
            "--browser",
            expected=message("with-option", option="--live"),
            found=message("none"),
        )
    with _progress() as progress:
        # On a busy computer, loading these libraries takes seconds, so the progress starts first.
        from stepdiag.demo.demo import demonstrate
        from stepdiag.demo.processes import ended_in_order

        with ended_in_order():
            found = demonstrate(out, seed, progress)
    if as_json:
        _print_json(found)
    else:
        _print_table(found, verbose=verbose)


@contextmanager
def _progress() -> "Iterator[Progress]":
    """Show the progress of the demo on standard error: a bar on a terminal, otherwise one line per
    setup.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    begun: set[object] = set()

    def line(what: Message, _done: int, _total: int) -> None:
        doing = what.arguments.get("setup", what)
        if doing not in begun:
            begun.add(doing)
            print_words(what, err=True)

    if not sys.stderr.isatty():
        line(message("demo-starting"), 0, 0)
        yield line
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(shown(message("stops-unit"))),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(shown(message("demo-starting")), total=None)
        yield lambda what, done, total: bar.update(
            task, description=shown(what), completed=done, total=total
        )


def _live(out: Path, seed: int, *, browser: bool) -> None:
    from stepdiag.demo.keys import keyboard
    from stepdiag.demo.live import live as watch
    from stepdiag.demo.processes import ended_in_order

    with ended_in_order(), keyboard() as keys:
        watch(out, seed, _Watching(keys, browser=browser))


class _Watching:
    def __init__(self, keys: "Keyboard", *, browser: bool) -> None:
        self._keys = keys
        self._browser = browser

    def opened(self, address: str, token: str) -> None:
        """Print the address of the page and the meaning of the keys, and open the page."""
        from stepdiag.demo.live import KEYS

        print_words(message("demo-page", address=address, token=token))
        typer.echo("")
        print_words("  " + shown(message("demo-enter")))
        for key, each in KEYS.items():
            print_words(f"  {key}      {shown(each.does)}")
        print_words("  q      " + shown(message("key-end")), "")
        if self._browser:
            import webbrowser

            webbrowser.open(address)

    def show(self, line: Words) -> None:
        """Print a line for each event of the demo."""
        print_words(line)

    def pressed(self) -> str:
        """Return the pressed key; the end of the input ends the demo."""
        from stepdiag.demo.live import END

        key = self._keys.pressed()
        return END if self._keys.ended else key


def _print_table(found: "Demonstrated", *, verbose: bool) -> None:
    from rich.console import Console

    from stepdiag.cli.status import concluded_in
    from stepdiag.demo.reach import FORMS

    table = empty_table(message("table-demo"))
    named = {
        "fanuc": message("demo-fanuc"),
        "siemens": message("demo-siemens"),
        **{str(form.name): form.name for form in FORMS},
    }
    forms = {**found.after, **found.reach}
    worst_first = sorted(forms, key=lambda name: -forms[name].rms_um)
    for name, figures in [
        (message("as-it-is"), found.before),
        *((named[name], forms[name]) for name in worst_first),
    ]:
        table.add_row(
            shown(name),
            f"{figures.rms_um:.2f}",
            f"{figures.largest_um:.2f}",
            f"{figures.face_diagonal_um:.2f}",
        )
    Console().print(table)
    for each in found.promises:
        key: Literal["demo-promise-kept", "demo-promise-broken"] = (
            "demo-promise-kept" if each.kept else "demo-promise-broken"
        )
        words = shown(
            message(key, of=each.of, stated=each.stated.words(), true_um=each.true_um)
        )
        print_words(words[0].upper() + words[1:])
    if verbose:
        print_words(*concluded_in(found.round))
        print_words(message("demo-forms"))
    report = str(found.round / "report.html")
    print_words(
        message("demo-done", seconds_s=found.seconds, path=report),
        message("demo-next", folder=str(found.folder)),
    )


def _print_json(found: "Demonstrated") -> None:
    import json
    from dataclasses import asdict

    figures = {
        "as it is": asdict(found.before),
        **{name: asdict(each) for name, each in found.after.items()},
    }
    figures |= {name: asdict(each) for name, each in found.reach.items()}
    factors = {name: found.factor(name) for name in (*found.after, *found.reach)}
    promises = [
        {
            "of": each.of,
            "low_um": each.stated.low_um,
            "high_um": each.stated.high_um,
            "true_um": each.true_um,
            "kept": each.kept,
        }
        for each in found.promises
    ]
    document = {
        "folder": str(found.round),
        "seconds": found.seconds,
        "figures": figures,
        "factors": factors,
        "promises": promises,
    }
    typer.echo(json.dumps(document, indent=2))
