"""Error after each form of compensation of the same survey, judged at unmeasured points by the law
of each control."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from stepdiag.base.messages import Message, message
from stepdiag.base.result.result import Result
from stepdiag.demo.files import (
    beckhoff_profile,
    fanuc_profile,
    heidenhain_profile,
    linuxcnc_profile,
    siemens_profile,
)
from stepdiag.exporters.export.export import export
from stepdiag.exporters.profiles.file import load_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.virtual.control.compensation import Control

ACCEPTED = (
    "value-large",
    "slope-steep",
    "travel-not-covered",
    "change-large",
    "profile-assumed",
)
"""Warnings that are accepted in a first export on a machine as inaccurate as the demo's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    name: Message
    control: Control
    profile: str


WHOLE_FIELD = message("form-field")
FORMS = (
    Form(
        name=message("form-pitch"),
        control="siemens",
        profile=siemens_profile(functions='["EXX", "EYY", "EZZ"]'),
    ),
    Form(
        name=message("form-fanuc"), control="fanuc", profile=fanuc_profile(straightness=True)
    ),
    Form(
        name=message("form-828d"),
        control="siemens",
        profile=siemens_profile(products=True, held=8),
    ),
    Form(
        name=message("form-840d"), control="siemens", profile=siemens_profile(products=True)
    ),
    Form(name=message("form-beckhoff"), control="beckhoff", profile=beckhoff_profile("FXYZ")),
    Form(
        name=message("form-heidenhain"),
        control="heidenhain",
        profile=heidenhain_profile("FXYZ"),
    ),
    Form(name=WHOLE_FIELD, control="linuxcnc", profile=linuxcnc_profile()),
)


def exported(folder: Path, result: Result) -> Iterator[tuple[Form, Sequence[Path]]]:
    """Write the files of every form of compensation into ``folder``; yield the active files of each
    form. The files named in the profiles are beside ``folder``."""
    for number, form in enumerate(FORMS, start=1):
        path = folder.parent / f"reach-{number}-{form.control}.toml"
        path.write_text(form.profile, encoding="utf-8")
        profile = load_profile(path, controller_named(form.control), result.volume)
        out = folder / f"{number}-{form.control}"
        report = export(result, form.control, profile, accept=ACCEPTED, out_dir=out)
        yield form, [out / name for name in report.files if _acts(name)]


def _acts(name: str) -> bool:
    return "_RESTORE" not in name and (
        name.endswith((".INI", ".TXT", ".csv", ".COM"))
        or name.startswith("kinematics_comp_lines")
    )
