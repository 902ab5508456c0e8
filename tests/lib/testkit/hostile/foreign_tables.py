"""Files of controls: tables, punch files and profiles, each as its controller reads it and as
`verify`, `export` and `program` use it."""

import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from stepdiag.base.errors import StepdiagError
from stepdiag.base.readings.readings import parse_readings
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.file import parse_profile
from stepdiag.exporters.profiles.registry import CONTROLLERS
from stepdiag.exporters.programs import CONTROLS, Sequence, default_signals, nc_programs
from stepdiag.exporters.programs.settings import program_section
from stepdiag.exporters.safety.sign_run import from_readings, read_sign_run
from stepdiag.exporters.safety.sign_test import bump, verdict
from stepdiag.exporters.safety.verify import verify_files
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import Profile
from testkit.exact.machines import MACHINES, profile_of, profile_text
from testkit.exact.results import VOLUME, made_result
from testkit.hostile.foreign_base import Target, refusing, text_of

RESULT = made_result(
    {
        "EXX": [0.0, 11.0, 7.0, 3.0, 5.0],
        "EYX": [0.0, 2.0, -1.0, 2.0, 0.0],
        "EZZ": [0.0, 1.0, 2.0, 3.0, 4.0],
    },
    squareness={"C0Y": 12.0},
)
OLDER = {
    "heidenhain": ('generation = "tnc640"', 'generation = "itnc530"'),
    "beckhoff": ('way = "volumetric"', 'way = "lists"\ncross_sense = "as-error"'),
    "mitsubishi": ('data = "incremental"', 'data = "absolute"'),
}
"""The other way in which some controls take their tables."""


class Everything:
    """Accepts every warning by its name, so that an export goes on to its end."""

    def __contains__(self, code: object) -> bool:
        return True


def table_targets() -> dict[str, Target]:
    """Return a target for every file that a control reads, and for the profile, the texts and the
    runs that belong to it."""
    found: dict[str, Target] = {}
    for name, controller in CONTROLLERS.items():
        text = _profile_text(name)
        found[f"profile {name}"] = Target(
            text.encode(), refusing(_profile_reader(controller)), weight=0.3
        )
        for label, profile in _profiles(name, text):
            files = _files(controller, profile)
            for file in _kinds(files):
                beside = [other for other in files if other is not file]
                found[f"table {label} {file.name}"] = Target(
                    file.data, _table_reader(controller, profile, file, beside), weight=0.5
                )
    lattice_file = lattice.render(lattice.lattice_of(RESULT, 200.0))
    found["table lattice"] = Target(
        lattice_file.data,
        refusing(lambda data: verify_files(RESULT, [replace(lattice_file, data=data)])),
    )
    found["sign run"] = Target(
        b"position_mm,off_um,on_um\n-200,0,0\n-100,0,-5\n0,1,-9\n100,1,1\n200,0,0\n",
        refusing(_sign_run),
    )
    return found


def _profile_text(name: str) -> str:
    return profile_text(
        name,
        steps_mm=(100.0, 100.0, 50.0),
        references_mm=(-200.0, 0.0, -100.0),
        direction=MACHINES[name].directions[-1],
    )


def _profiles(name: str, text: str) -> list[tuple[str, Profile]]:
    texts = {name: text}
    if name in OLDER:
        texts[f"{name} older"] = text.replace(*OLDER[name]).replace(
            ", 'EZX', 'EXY', 'EZY', 'EXZ', 'EYZ'", ""
        )
    return [(label, _parsed(each, CONTROLLERS[name])) for label, each in texts.items()]


def _parsed(text: str, controller: Controller) -> Profile:
    return parse_profile(
        text, "foreign.toml", controller, VOLUME, MACHINES[controller.name].files
    )


def _files(controller: Controller, profile: Profile) -> list[ControlFile]:
    plan = controller.plan(curves_of(RESULT, profile.machine.functions), profile)
    settled = replace(profile, options=plan.options or profile.options)
    return [file for file in controller.render(plan.tables, settled) if file.role != "note"]


def _kinds(files: list[ControlFile]) -> list[ControlFile]:
    """Return the files, one of those that are alike: the tables of the axes look the same."""
    return list(
        {
            file.name.translate(str.maketrans("xyz23", "xxx11")): file for file in files
        }.values()
    )


def _table_reader(
    controller: Controller, profile: Profile, good: ControlFile, beside: list[ControlFile]
) -> Callable[[bytes], object]:
    def read(data: bytes) -> None:
        file = replace(good, data=data)
        for known in CONTROLLERS.values():
            known.recognises(file)
        lattice.recognises(file)
        with suppress(StepdiagError):
            verify_files(RESULT, [file], nodes=3)
        for files in ((file,), (file, *beside)):
            with suppress(StepdiagError):
                _used(controller, files, profile)

    return read


def _used(controller: Controller, files: tuple[ControlFile, ...], profile: Profile) -> None:
    for table in controller.parse(files, profile):
        assert np.isfinite(table.position_mm).all()
        assert np.isfinite(table.absolute_um).all()
        assert (np.diff(table.position_mm) > 0).all()
    machine = msgspec.structs.replace(
        profile.machine, measured_with="on", existing=[file.name for file in files]
    )
    _exported(controller, replace(profile, machine=machine, existing=files))


def _profile_reader(controller: Controller) -> Callable[[bytes], object]:
    def read(data: bytes) -> object:
        text = text_of(data)
        with suppress(StepdiagError):
            _programs(text, controller.name)
        profile = _parsed(text, controller)
        with suppress(StepdiagError):
            bump(controller, profile, "EXX")
        return _exported(controller, profile)

    return read


def _programs(text: str, control: str) -> object:
    section = program_section(text, "foreign", control)
    if control not in CONTROLS:
        return None
    sequence = Sequence(name="foreign", volume=VOLUME, setups=("ppp",), handshake=True)
    return nc_programs(
        sequence,
        control,
        signals=section.signals(default_signals(control)),
        decimals=section.decimals,
    )


def _exported(controller: Controller, profile: Profile) -> object:
    with tempfile.TemporaryDirectory() as folder:
        try:
            return export(
                RESULT,
                controller.name,
                profile,
                accept=Everything(),
                out_dir=Path(folder) / "out",
            )
        finally:
            stray = [each.name for each in Path(folder).iterdir() if each.name != "out"]
            assert not stray, f"written beside the folder that was asked for: {stray}"


_BUMP = bump(CONTROLLERS["neutral"], profile_of("neutral", VOLUME, sections=8), "EXX")


def _sign_run(data: bytes) -> object:
    with suppress(StepdiagError):
        off, _, on = text_of(data).partition("\n#on\n")
        verdict(_BUMP, *from_readings(parse_readings(off), parse_readings(on), "X")[:3])
    return verdict(_BUMP, *read_sign_run(ControlFile(name="run.csv", data=data))[:3])
