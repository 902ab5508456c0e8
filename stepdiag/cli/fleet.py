"""``stepdiag archive``, ``trend``, ``fleet`` and ``resolve``: many machines over years (extra ``stepdiag[fleet]``)."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import DataError, UsageError

if TYPE_CHECKING:
    from stepdiag.fleet.history import LeftOut
    from stepdiag.fleet.resolve import Scheduler
    from stepdiag.fleet.trend import Trend
    from stepdiag.texts.texts import Language

StoreName = Annotated[str, typer.Argument(help="The store: a folder, or an address that fsspec opens (s3://.., sftp://..).")]
Tolerances = Annotated[
    list[str] | None, typer.Option("--tolerance", help="QUANTITY=LARGEST, such as volumetric-rms=15 or C0Y=20; may be given again.")
]
Software = Annotated[str, typer.Option(help="Use what this version of stepdiag solved anew (`stepdiag resolve`), not what was archived.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print for programs.")]

archive = typer.Typer(help="The archive of finished surveys.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.add_typer(archive, name="archive")
    app.command("trend")(trend)
    app.command("fleet")(fleet)
    app.command("resolve")(resolve)


@contextmanager
def extra_needed(name: str) -> Iterator[None]:
    """Say which extra is missing where a library of it is."""
    try:
        yield
    except ModuleNotFoundError as error:
        remedy = f"pip install 'stepdiag[{name}]'"
        raise UsageError(f"stepdiag[{name}]", expected="the libraries of this extra", found=f"no {error.name}", remedy=remedy) from error


@archive.command()
def add(
    folders: Annotated[list[Path], typer.Argument(help="Folders of finished surveys, or folders with such folders in them.")],
    to: Annotated[str, typer.Option("--to", help="The store; made where there is none.")],
    as_json: AsJson = False,
) -> None:
    """Put finished surveys into a store.

    Logs packed, result, files, hashes; read back before a survey is listed. The same survey again changes nothing.
    """
    with extra_needed("fleet"):
        from stepdiag.fleet.archive import add as put
        from stepdiag.fleet.archive import finished_in, refresh_index, undated
        from stepdiag.fleet.store import Store
    from stepdiag.terminal.printable import printable
    from stepdiag.terminal.progress import counted

    found = finished_in(folders)
    store = Store(to, create=True)
    added = []
    try:
        for each in counted(found, "archiving", len(found)):
            added.append(put(each, store))
            if not as_json:
                typer.echo(f"{added[-1].outcome}: {each} as {added[-1].place.folder}")
            if unknown := undated(each):
                typer.echo(printable(f"{each}: {unknown}"), err=True)
    finally:
        refresh_index(store)
    if as_json:
        rows = [
            {"source": str(each.source), "outcome": each.outcome, "folder": each.place.folder, "bytes": each.size_bytes} for each in added
        ]
        typer.echo(json.dumps(rows, indent=2))


@archive.command()
def check(store: StoreName) -> None:
    """Read every byte of a store, and name each file that is not as it was written.

    Lists, tables, results, logs and index, each against its SHA-256 and against what it follows from.
    """
    with extra_needed("fleet"):
        from stepdiag.fleet import custody
        from stepdiag.fleet.store import Store
    from stepdiag.terminal.printable import printable

    place = Store(store)
    broken = list(custody.check(place))
    for name, why in broken:
        typer.echo(printable(f"{name}: {why}"), err=True)
    if broken:
        raise DataError(
            store, expected="files as they were written", found=f"{len(broken)} that are not", remedy="the lines above name each"
        )
    typer.echo(f"{store} holds: {len(place.tables())} surveys")


def trend(
    store: StoreName,
    machine: Annotated[str, typer.Option(help="Only this machine.")] = "",
    tolerance: Tolerances = None,
    software: Software = "",
    csv: Annotated[Path | None, typer.Option("--csv", help="Write every figure into this file.")] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Write the sheet of all machines (HTML) into this file.")] = None,
    language: Annotated[str | None, typer.Option(help="Of the sheet: en or de; en where nothing is stated.")] = None,
    as_json: AsJson = False,
) -> None:
    """Show what changed on the machines of a store.

    Since when and after what; what is unchanged, what is not decidable; when a figure that drifts leaves its tolerance. Surveys that do
    not belong to the others stand apart or are left out, each with the reason; exit code 3 where a table is damaged.
    """
    if language is not None and report is None:
        raise UsageError("--language", expected="--report beside it: the language is that of the sheet", found="none")
    chosen = _language(language or "en")
    found, left_out = _trends(store, machine, tolerance or [], software)
    from rich.console import Console

    from stepdiag.base.files import write_together
    from stepdiag.fleet.report import fleet_html, worst_first
    from stepdiag.fleet.terminal import as_csv, trend_table
    from stepdiag.fleet.terminal import as_json as json_of

    tables = {} if csv is None else {csv: as_csv(found).encode("utf-8")}
    sheets = {} if report is None else {report: fleet_html(found, store, chosen, left_out).encode("utf-8")}
    write_together(tables | sheets, over=True)
    if as_json:
        typer.echo(json.dumps(json_of(found, left_out), indent=2, ensure_ascii=False))
    else:
        Console().print(trend_table([each for _, of_machine in worst_first(found) for each in of_machine], whole=bool(machine)))
    _name_left_out(left_out)


def _name_left_out(left_out: "Sequence[LeftOut]") -> None:
    """Print what no series holds on standard error. Raises DataError where a table is damaged: the other machines are shown before."""
    from stepdiag.terminal.printable import printable

    for each in left_out:
        typer.echo(printable(f"left out: {' '.join(filter(None, (each.machine, each.name)))}: {each.why}"), err=True)
    damaged = [each.name for each in left_out if each.damaged]
    if damaged:
        raise DataError(damaged[0], expected="tables that can be read", found=f"{len(damaged)} damaged", remedy="the lines above name each")


def fleet(
    store: StoreName,
    tolerance: Tolerances = None,
    software: Software = "",
    host: Annotated[str, typer.Option(help="Where the page is served; 127.0.0.1 is this computer alone.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8430,
    language: Annotated[str, typer.Option(help="en or de")] = "en",
) -> None:
    """Show all machines of a store in the browser, worst first.

    The address that is printed carries a token, another one at each start: loopback is open to every account of the computer.
    """
    from secrets import token_urlsafe

    from stepdiag.fleet.page import LOOPBACK, Sheets, create_app, serve
    from stepdiag.fleet.store import Store

    sheets = Sheets(Store(store).state, lambda: _trends(store, "", tolerance or [], software), store)
    chosen = _language(language)
    sheets.sheet(chosen)
    token = token_urlsafe(18)
    typer.echo(f"http://{host}:{port}/?token={token} shows {store}; Ctrl-C ends it")
    serve(create_app(sheets, chosen, token, (*LOOPBACK, host.lower())), host, port)


def resolve(
    store: StoreName,
    workers: Annotated[int | None, typer.Option(min=1, max=256, help="Processes on this computer; 2 where nothing is stated.")] = None,
    scheduler: Annotated[
        str, typer.Option(help="Instead: a Dask scheduler, tls://HOST:PORT; its workers need stepdiag[fleet] and the store.")
    ] = "",
    ca: Annotated[Path | None, typer.Option(help="With --scheduler: the certificate that signs the scheduler's (PEM).")] = None,
    certificate: Annotated[Path | None, typer.Option(help="With --scheduler: the certificate of this client (PEM).")] = None,
    key: Annotated[Path | None, typer.Option(help="With --scheduler: the key of this client's certificate (PEM).")] = None,
    machine: Annotated[str, typer.Option(help="Only this machine.")] = "",
    survey: Annotated[
        Path | None,
        typer.Option("--survey", help="With --machine: a survey file in place of those in its logs, where they are not read any more."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Solve every archived survey anew with this version.

    New results stand beside the old ones; the output lists changes beyond U. Without a change of version the bytes are the same.
    """
    with extra_needed("fleet"):
        from stepdiag.fleet import resolve as resolving
        from stepdiag.fleet.archive import refresh_index
        from stepdiag.fleet.store import Store
    from stepdiag.base.files import read_text

    if survey is not None and not machine:
        raise UsageError("--survey", expected="--machine beside it: a survey file is that of one machine", found="none")
    if workers is not None and scheduler:
        raise UsageError("--workers", expected="no --scheduler beside it: its workers do the work", found=scheduler)
    files = {"--ca": ca, "--certificate": certificate, "--key": key}
    by = _scheduler(scheduler, files) if scheduler or any(files.values()) else workers or 2
    text = read_text(survey) if survey is not None else ""
    place = Store(store)
    surveys = resolving.open_surveys(place, machine)
    found = []
    try:
        for each in resolving.resolve(place, surveys, by, survey=text):
            found.append(each)
            outcome = "; ".join([each.outcome, *each.changed, *filter(None, [each.reason])])
            typer.echo(f"{len(found)} of {len(surveys)}: {each.place.folder}: {outcome}", err=as_json)
    finally:
        refresh_index(place)
    if as_json:
        typer.echo(resolving.as_json(found))
    failed = [each for each in found if each.outcome == "failed"]
    if failed:
        raise DataError(
            store, expected="surveys that this version solves", found=f"{len(failed)} of {len(found)} that it does not",
            remedy="where a survey file in the logs is refused: `--machine M --survey FILE` with one that stands for it",
        )  # fmt: skip


def _scheduler(address: str, files: "Mapping[str, Path | None]") -> "Scheduler":
    """Return the scheduler that is named. Raises UsageError for one without TLS: it would run the code of whoever reaches it."""
    from stepdiag.fleet.resolve import Scheduler

    if not address.startswith("tls://"):
        raise UsageError("--scheduler", expected="tls://HOST:PORT: Dask runs whatever code a client sends", found=address or "none")
    given = {option: file for option, file in files.items() if file is not None and file.is_file()}
    for option, file in files.items():
        if option not in given:
            raise UsageError(option, expected="a file (PEM) beside --scheduler", found="none" if file is None else f"no file {file}")
    return Scheduler(address=address, ca=given["--ca"], certificate=given["--certificate"], key=given["--key"])


def _trends(address: str, machine: str, tolerances: list[str], software: str) -> "tuple[list[Trend], tuple[LeftOut, ...]]":
    """Return the trends of a store, and what is left out."""
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
        require_known(stated, history_in(store, now).series if software else history.series, FILE)
    return trends_of(history.series, stated.together_with(given).of), history.left_out


def _tolerance(text: str) -> tuple[str, float]:
    quantity, _, value = text.partition("=")
    try:
        largest = float(value)
    except ValueError:
        largest = 0.0
    if not 0.0 < largest < float("inf"):
        raise UsageError("--tolerance", expected="QUANTITY=NUMBER above 0, such as volumetric-rms=15", found=repr(text))
    return quantity, largest


def _language(language: str) -> "Language":
    from stepdiag.texts.texts import LANGUAGES

    chosen = next((known for known in LANGUAGES if known == language), None)
    if chosen is None:
        raise UsageError("--language", expected=" or ".join(LANGUAGES), found=language)
    return chosen
