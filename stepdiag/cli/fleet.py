"""``stepdiag archive``, ``trend``, ``fleet`` and ``resolve``: a store of surveys of many machines
(extra ``stepdiag[fleet]``)."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.cli.completion import AsJson
from stepdiag.terminal.viewer import language_named, print_words, shown

if TYPE_CHECKING:
    from stepdiag.fleet.resolve import Scheduler
    from stepdiag.fleet.series import LeftOut
    from stepdiag.fleet.trend import Trend


archive = typer.Typer(no_args_is_help=True)
OUTCOMES = {
    "archived": message("outcome-archived"),
    "already there": message("outcome-there"),
    "the same bytes": message("outcome-same"),
    "solved anew": message("outcome-anew"),
    "failed": message("outcome-failed"),
}


def register(app: typer.Typer) -> None:
    app.add_typer(archive, name="archive")
    app.command("trend")(trend)
    app.command("fleet")(fleet)
    app.command("resolve")(resolve)


@contextmanager
def extra_needed(name: str) -> Iterator[None]:
    """Convert the error of a missing library into a message with the name of its extra."""
    try:
        yield
    except ModuleNotFoundError as error:
        remedy = message("pip-install", name=name)
        raise UsageError(
            f"stepdiag[{name}]",
            expected=message("libraries-of-extra"),
            found=message("no-name", name=error.name or ""),
            remedy=remedy,
        ) from error


@archive.command()
def add(
    folders: list[Path],
    to: Annotated[str, typer.Option("--to")],
    as_json: AsJson = False,
) -> None:
    """Put finished surveys into a store."""
    with extra_needed("fleet"):
        from stepdiag.fleet.archive import add as put
        from stepdiag.fleet.archive import finished_in, refresh_index, undated
        from stepdiag.fleet.store import Store
    from stepdiag.terminal.progress import counted

    found = finished_in(folders)
    store = Store(to, create=True)
    added = []
    try:
        for each in counted(found, message("archiving"), len(found)):
            added.append(put(each, store))
            if not as_json:
                print_words(
                    message(
                        "archived-each",
                        outcome=OUTCOMES[added[-1].outcome],
                        source=str(each),
                        folder=added[-1].place.folder,
                    )
                )
            if unknown := undated(each):
                print_words(f"{each}: {unknown}", err=True)
    finally:
        refresh_index(store)
    if as_json:
        rows = [
            {
                "source": str(each.source),
                "outcome": each.outcome,
                "folder": each.place.folder,
                "bytes": each.size_bytes,
            }
            for each in added
        ]
        typer.echo(json.dumps(rows, indent=2))


@archive.command()
def check(store: str) -> None:
    """Read every byte of a store, and name each changed file."""
    with extra_needed("fleet"):
        from stepdiag.fleet import custody
        from stepdiag.fleet.store import Store

    place = Store(store)
    broken = list(custody.check(place))
    for name, why in broken:
        print_words(f"{name}: {shown(why)}", err=True)
    if broken:
        raise DataError(
            store,
            expected=message("files-unchanged"),
            found=message("number-damaged", count=len(broken)),
            remedy=message("lines-above"),
        )
    print_words(message("store-holds", store=store, count=len(place.tables())))


def trend(
    store: str,
    machine: str = "",
    tolerance: list[str] | None = None,
    software: str = "",
    csv: Annotated[Path | None, typer.Option("--csv")] = None,
    report: Annotated[Path | None, typer.Option("--report")] = None,
    language: str | None = None,
    as_json: AsJson = False,
) -> None:
    """Show what changed on the machines of a store."""
    if language is not None and report is None:
        raise UsageError(
            "--language",
            expected=message("with-option", option="--report"),
            found=message("none"),
        )
    chosen = language_named(language or "en")
    found, left_out = _trends(store, machine, tolerance or [], software)
    from rich.console import Console

    from stepdiag.base.files import write_together
    from stepdiag.fleet.report import fleet_html, worst_first
    from stepdiag.fleet.terminal import as_csv, trend_table
    from stepdiag.fleet.terminal import as_json as json_of

    tables = {} if csv is None else {csv: as_csv(found).encode("utf-8")}
    sheets = (
        {}
        if report is None
        else {report: fleet_html(found, store, chosen, left_out).encode("utf-8")}
    )
    write_together(tables | sheets, over=True)
    if as_json:
        typer.echo(json.dumps(json_of(found, left_out), indent=2, ensure_ascii=False))
    else:
        Console().print(
            trend_table(
                [each for _, of_machine in worst_first(found) for each in of_machine],
                whole=bool(machine),
            )
        )
    _name_left_out(left_out)


def _name_left_out(left_out: "Sequence[LeftOut]") -> None:
    for each in left_out:
        print_words(
            message(
                "left-out",
                name=" ".join(filter(None, (each.machine, each.name))),
                why=each.why,
            ),
            err=True,
        )
    damaged = [each.name for each in left_out if each.damaged]
    if damaged:
        raise DataError(
            damaged[0],
            expected=message("readable-tables"),
            found=message("number-damaged", count=len(damaged)),
            remedy=message("lines-above"),
        )


def fleet(
    store: str,
    tolerance: list[str] | None = None,
    software: str = "",
    host: str = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8430,
    language: str = "en",
) -> None:
    """Show all machines of a store in the browser, worst first."""
    from secrets import token_urlsafe

    from stepdiag.fleet.page import LOOPBACK, Sheets, create_app, serve
    from stepdiag.fleet.store import Store

    sheets = Sheets(
        Store(store).state, lambda: _trends(store, "", tolerance or [], software), store
    )
    chosen = language_named(language)
    sheets.sheet(chosen)
    token = token_urlsafe(18)
    print_words(
        message("fleet-page", address=f"http://{host}:{port}/?token={token}", store=store)
    )
    serve(create_app(sheets, chosen, token, (*LOOPBACK, host.lower())), host, port)


def resolve(
    store: str,
    workers: Annotated[int | None, typer.Option(min=1, max=256)] = None,
    scheduler: str = "",
    ca: Path | None = None,
    certificate: Path | None = None,
    key: Path | None = None,
    machine: str = "",
    survey: Annotated[Path | None, typer.Option("--survey")] = None,
    as_json: AsJson = False,
) -> None:
    """Solve every archived survey again with this version."""
    with extra_needed("fleet"):
        from stepdiag.fleet import resolve as resolving
        from stepdiag.fleet.archive import refresh_index
        from stepdiag.fleet.store import Store
    from stepdiag.base.files import read_text

    if survey is not None and not machine:
        raise UsageError(
            "--survey",
            expected=message("with-option", option="--machine"),
            found=message("none"),
        )
    if workers is not None and scheduler:
        raise UsageError(
            "--workers",
            expected=message("without-option", option="--scheduler"),
            found=scheduler,
        )
    files = {"--ca": ca, "--certificate": certificate, "--key": key}
    by = _scheduler(scheduler, files) if scheduler or any(files.values()) else workers or 2
    text = read_text(survey) if survey is not None else ""
    place = Store(store)
    surveys = resolving.open_surveys(place, machine)
    found = []
    try:
        for each in resolving.resolve(place, surveys, by, survey=text):
            found.append(each)
            outcomes = [
                OUTCOMES[each.outcome],
                *each.changed,
                *([each.reason] if each.reason != "" else []),
            ]
            done = message(
                "resolved-each",
                number=len(found),
                count=len(surveys),
                folder=each.place.folder,
                outcomes=outcomes,
            )
            print_words(done, err=as_json)
    finally:
        refresh_index(place)
    if as_json:
        typer.echo(resolving.as_json(found))
    failed = [each for each in found if each.outcome == "failed"]
    if failed:
        raise DataError(
            store,
            expected=message("solved-by-version"),
            found=message("some-unsolved", count=len(failed), of=len(found)),
            remedy=message("survey-instead"),
        )


def _scheduler(address: str, files: "Mapping[str, Path | None]") -> "Scheduler":
    """Return the scheduler of an address. Raises UsageError for a scheduler without TLS, because
    any client could run code on it."""
    from stepdiag.fleet.resolve import Scheduler

    if not address.startswith("tls://"):
        raise UsageError(
            "--scheduler", expected=message("tls-scheduler"), found=address or message("none")
        )
    given = {
        option: file for option, file in files.items() if file is not None and file.is_file()
    }
    for option, file in files.items():
        if option not in given:
            raise UsageError(
                option,
                expected=message("pem-beside-scheduler"),
                found=str(file) if file else message("none"),
            )
    return Scheduler(
        address=address,
        ca=given["--ca"],
        certificate=given["--certificate"],
        key=given["--key"],
    )


def _trends(
    address: str, machine: str, tolerances: list[str], software: str
) -> "tuple[list[Trend], tuple[LeftOut, ...]]":
    from datetime import UTC, datetime

    with extra_needed("fleet"):
        from stepdiag.fleet.history import history_in
        from stepdiag.fleet.store import Store
        from stepdiag.fleet.tolerances import FILE, Tolerances, require_known, tolerances_in
        from stepdiag.fleet.trend import trends_of

    given, store, now = dict(map(_tolerance, tolerances)), Store(address), datetime.now(UTC)
    history = history_in(store, now, machine, software)
    require_known(Tolerances(all=given), history.series, "--tolerance")
    stated = tolerances_in(store)
    if not machine:
        require_known(
            stated, history_in(store, now).series if software else history.series, FILE
        )
    return trends_of(history.series, stated.together_with(given).of), history.left_out


def _tolerance(text: str) -> tuple[str, float]:
    quantity, _, value = text.partition("=")
    try:
        largest = float(value)
    except ValueError:
        largest = 0.0
    if not 0.0 < largest < float("inf"):
        raise UsageError(
            "--tolerance",
            expected=message(
                "such-as", what=message("quantity-above-0"), example="volumetric-rms=15"
            ),
            found=repr(text),
        )
    return quantity, largest
