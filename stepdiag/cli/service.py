"""``stepdiag service``: a survey as a service of systemd, installed and removed."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from stepdiag.daemon.installation import Step

SurveyFile = Annotated[Path, typer.Argument(help="The survey file, in /etc/stepdiag.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Show what would be done, and do nothing.")]
Root = Annotated[Path, typer.Option("--root", help="Where the root of the file system is, to prepare another one.")]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    service = typer.Typer(no_args_is_help=True, help="A survey as a service of systemd.")
    service.command("install")(install)
    service.command("remove")(remove)
    app.add_typer(service, name="service")


def install(file: SurveyFile, dry_run: DryRun = False, root: Root = Path("/")) -> None:
    """Write unit, rules, token and a drop-in that opens what the survey needs.

    Doing it again changes what has changed, and nothing else.
    """
    from stepdiag.daemon.installation import carry_out, plan_install

    steps = plan_install(file, root)
    _show(steps, texts=dry_run)
    if not dry_run:
        carry_out(steps)
        typer.echo("next: systemctl restart systemd-modules-load && udevadm control --reload && systemctl daemon-reload")
        typer.echo(f"      systemctl enable --now stepdiag@{file.stem}")


def remove(file: SurveyFile, dry_run: DryRun = False, root: Root = Path("/")) -> None:
    """Remove what `install` wrote; survey file, token and what was measured stay."""
    from stepdiag.daemon.installation import carry_out, plan_removal

    steps = plan_removal(file, root)
    _show(steps, texts=False)
    if not dry_run:
        carry_out(steps)
        typer.echo("next: systemctl daemon-reload")


def _show(steps: "list[Step]", *, texts: bool) -> None:
    if not steps:
        typer.echo("nothing to do")
    for step in steps:
        typer.echo(f"{step.does}: {step.path}")
        if texts and step.does == "write":
            typer.echo("".join(f"    {line}\n" for line in step.text.splitlines()), nl=False)
