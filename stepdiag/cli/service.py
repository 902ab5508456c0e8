"""``stepdiag service``: installation and removal of a survey as a systemd service."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.messages import message
from stepdiag.terminal.viewer import print_words

if TYPE_CHECKING:
    from stepdiag.daemon.installation import Step

DryRun = Annotated[bool, typer.Option("--dry-run")]


def register(app: typer.Typer) -> None:
    service = typer.Typer(no_args_is_help=True)
    service.command("install")(install)
    service.command("remove")(remove)
    service.command("publish")(publish)
    app.add_typer(service, name="service")


def install(file: Path, dry_run: DryRun = False, root: Path = Path("/")) -> None:
    """Write the files of a survey's service: the systemd unit, the rules, the token, and a drop-in.
    The drop-in permits the devices and addresses that the survey needs.
    """
    from stepdiag.daemon.installation import carry_out, plan_install

    steps = plan_install(file, root)
    _show(steps, texts=dry_run)
    if not dry_run:
        carry_out(steps)
        shows = any(
            f"stepdiag-page@{file.stem}.socket" in str(step.path)
            for step in steps
            if step.does != "remove"
        )
        reload = (
            "systemd-sysusers && systemctl restart systemd-modules-load && udevadm control "
            "--reload && systemctl daemon-reload"
        )
        enabled = f"stepdiag@{file.stem}" + f" stepdiag-page@{file.stem}.socket" * shows
        print_words(
            message("next-command", command=f"{reload} && systemctl enable --now {enabled}")
        )


def publish(
    file: Path,
    broker: str = "",
    opcua: str = "",
    ca: Annotated[Path | None, typer.Option("--ca")] = None,
    certificate: Path | None = None,
    plain: Annotated[bool, typer.Option("--plain")] = False,
    end: Annotated[bool, typer.Option("--remove")] = False,
    dry_run: DryRun = False,
    root: Path = Path("/"),
) -> None:
    """Write a separate unit for `stepdiag publish`, with few rights."""
    from stepdiag.base.errors import UsageError
    from stepdiag.cli.publish import OPCUA_PORT, PORT, SECURE_PORT
    from stepdiag.daemon.installation import carry_out
    from stepdiag.daemon.publication import (
        Publication,
        credentials,
        plan_end,
        plan_publication,
    )

    if not end and bool(broker) == bool(opcua):
        raise UsageError(
            "service publish",
            expected=message(
                "either-option", one="--broker HOST[:PORT]", other="--opcua ADDRESS[:PORT]"
            ),
            found=message("both" if broker else "neither"),
        )
    port = PORT if plain else SECURE_PORT
    if opcua:
        port = OPCUA_PORT
    publication = Publication(
        broker=broker, opcua=opcua, port=port, ca=ca, certificate=certificate, plain=plain
    )
    steps = plan_end(file, root) if end else plan_publication(file, root, publication)
    _show(steps, texts=dry_run and not end)
    for each, found in (
        {} if end else credentials(file.stem, file.parent, publication)
    ).items():
        print_words(
            message(
                "credential",
                name=each,
                file=f"{file.stem}.{each}",
                state=message("credential-found" if found else "left-out-alone"),
            )
        )
    if not dry_run:
        carry_out(steps)
        print_words(
            message(
                "next-command",
                command="systemctl daemon-reload"
                + f" && systemctl enable --now stepdiag-publish@{file.stem}" * (not end),
            )
        )


def remove(file: Path, dry_run: DryRun = False, root: Path = Path("/")) -> None:
    """Remove the files of `install`; survey file, token and measurements stay."""
    from stepdiag.daemon.installation import carry_out, plan_removal
    from stepdiag.daemon.publication import plan_end

    steps = [*plan_removal(file, root), *plan_end(file, root)]
    _show(steps, texts=False)
    if not dry_run:
        carry_out(steps)
        print_words(message("next-command", command="systemctl daemon-reload"))


def _show(steps: "list[Step]", *, texts: bool) -> None:
    if not steps:
        print_words(message("nothing-to-do"))
    for step in steps:
        typer.echo(f"{step.does}: {step.path}")
        if texts and step.does == "write":
            typer.echo("".join(f"    {line}\n" for line in step.text.splitlines()), nl=False)
