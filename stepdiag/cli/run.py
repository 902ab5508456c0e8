"""``stepdiag run``: the daemon, and the commands that it starts as processes for a complete
survey."""

from pathlib import Path
from typing import Annotated

import typer

from stepdiag.base.messages import joined, message


def register(app: typer.Typer) -> None:
    app.command("run")(run)
    app.command("complete", hidden=True)(complete)
    app.command("pack", hidden=True)(pack)
    app.command("page", hidden=True)(page)


def run(file: Path, verbose: Annotated[bool, typer.Option("--verbose")] = False) -> None:
    """Record surveys beside the machine (the daemon)."""
    from stepdiag.daemon.service import record

    record(file, verbose=verbose)


def page(file: Path) -> None:
    """Show a survey that a daemon records (systemd starts this for the page's first visitor)."""
    from stepdiag.page.process import serve_activated

    serve_activated(file)


def complete(
    folder: Path,
    readings: Annotated[bool, typer.Option("--readings")] = False,
    certificate: Annotated[bool, typer.Option("--certificate")] = False,
) -> None:
    """Solve a recorded survey, write result, controller files and report beside its logs (`run`
    starts this).
    """
    from stepdiag.daq.service.priority import lower_priority

    lower_priority()
    from stepdiag.completion.completion import complete as finish
    from stepdiag.completion.completion import leave_readings

    if readings:
        leave_readings([folder], folder)
        return
    from stepdiag.base.messages import kept
    from stepdiag.report.completed import write_completed_report
    from stepdiag.terminal.exits import refusals_shown

    # the daemon reads the last line of this output as a message
    with refusals_shown(kept):
        if certificate:
            from stepdiag.cli.certificate import certify_folder

            typer.echo(
                kept(message("certificate-written", name=certify_folder(folder).name)),
                err=True,
            )
            return
        done = finish([folder], folder)
        write_completed_report(done)
    refused = kept(
        joined(
            [
                message("export-refused", control=name, why=why)
                for name, why in done.refusals.items()
            ]
        )
    )
    typer.echo(refused or done.folder, err=bool(refused))


def pack(folder: Path, max_gb: float) -> None:
    """Pack the oldest finished surveys of a folder until the folder is smaller than ``max_gb``
    (`run` starts this command).
    """
    from stepdiag.daq.service.priority import lower_priority

    lower_priority()
    import structlog

    from stepdiag.daemon.journal import configure
    from stepdiag.daq.recording.archive import keep_budget, size_bytes
    from stepdiag.daq.service.metrics import GB

    configure()
    log = structlog.get_logger("archive")
    for packed in keep_budget(folder, max_gb * GB):
        log.info(
            "archived", folder=str(packed.folder), saved_mb=round(packed.saved_bytes / 1e6, 3)
        )
    used_gb = size_bytes(folder) / GB
    if used_gb > max_gb:
        log.warning("over-budget", used_gb=round(used_gb, 2), max_gb=max_gb)
