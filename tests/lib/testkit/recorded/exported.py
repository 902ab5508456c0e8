"""Exports whole: every file with every byte, what was found, and the figures that were promised."""

import hashlib
from collections.abc import Callable, Mapping
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

from stepdiag.base.findings import Finding
from stepdiag.base.result.result import Result
from stepdiag.exporters.export.export import export
from stepdiag.exporters.export.written import REPORT
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import is_restore
from stepdiag.exporters.files.sets import SUMS
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.verify import Prediction
from stepdiag.exporters.tables.profile import Profile
from testkit import references
from testkit.recorded.plain import in_folder, written
from testkit.recorded.profiles import (
    INCLINED,
    POINTS,
    SET_UP,
    STRAIGHT,
    points_of,
    profile_of,
    punched,
)
from testkit.recorded.results import (
    ANGLES,
    LEANING,
    PLAIN,
    SHAPES,
    TURNING,
    expecting,
    result_of,
    told,
)

TODAY = date(2026, 6, 1)
ACCEPTED = (
    "profile-assumed",
    "slope-steep",
    "change-large",
    "travel-not-covered",
    "value-large",
    "compensation-contradicted",
)
BOTH = 'direction = "both"'
WHOLE = (
    "plain",
    "both",
    "products",
    "sizes",
    "tenths",
    "inclination",
    "straightness",
    "itnc",
    "chain",
    "lists",
    "absolute",
    "inch",
)
"""Cases whose report is recorded to its end."""
LISTS = '[beckhoff]\nway = "lists"\naxis_numbers = { X = 4, Y = 5, Z = 6 }\n'
KINEMATICS = '[heidenhain]\ngeneration = "itnc530"\nchain = "FXYZ"\n'
AT_ZERO = "backlash_um = 0.0"
PUNCH = {"PITCH.TXT": punched()}
WIDE = {"PITCH.TXT": punched(None, *INCLINED, *STRAIGHT, **SET_UP)}
UNSET = {
    "PITCH.TXT": punched(
        None,
        *(f"N0{number}Q1A1P0A2P0A3P0" for number in (*range(5861, 5865), *range(5871, 5875))),
    )
}
OLD_COM = (
    b"BEGIN AXIS_X1.COM MM\r\nNR   AXISPOS      BACKLASH     X1           Y2           Z3\r\n"
    b"0    -200.0000    +0.0000      +0.0021      +0.0000      +0.0013\r\n"
    b"1    +100.0000    +0.0000      -0.0037      +0.0011      +0.0000\r\n"
    b"[END]\r\n"
)


def exported(
    result: Result,
    control: str,
    profile: Profile | None,
    *,
    step_mm: float | None = None,
    accept: Any = ACCEPTED,
    whole: bool = False,
) -> Any:
    """Return what an export wrote and promised; ``whole`` with the tables in its report and the
    part programs that load them."""

    def act(folder: Path) -> dict[str, Any]:
        report = export(
            result,
            control,
            profile,
            step_mm=step_mm,
            accept=accept,
            out_dir=folder / "out",
            today=TODAY,
        )
        found: dict[str, Any] = {"files": written(folder / "out")}
        if not whole:
            found["files"].pop(REPORT)
            found["files"] = {
                name: text
                for name, text in found["files"].items()
                if not name.startswith("LOAD")
            }
        return found | (
            {} if report.prediction is None else {"predicted": figures(report.prediction)}
        )

    return in_folder(act)


def figures(prediction: Prediction) -> list[list[float | None]]:
    """Return the intervals that are promised, in their order: with and without rigid motion, before
    and after, rms and largest."""
    every = (
        found for when in prediction.predicted.parts().values() for found in when.values()
    )
    return [
        [one.value_um, one.low_um, one.high_um]
        for found in every
        for one in (found.rms_um, found.largest_um)
    ]


def said(item: Finding) -> str:
    """Return a finding as one text."""
    place = [
        f"{name}={value}"
        for name, value in item.as_json().items()
        if name in ("setup", "pass", "stop", "size_um", "among") and value is not None
    ]
    return f"{item.severity} {' '.join(place)}: {references.plain(item.message or item.text)}"


def measured_on(files: Mapping[str, bytes], **more: Any) -> Result:
    """Return the result of a survey with these files active."""
    rows = [
        {
            "name": name,
            "sha256": hashlib.sha256(data).hexdigest(),
            "date": "2026-04-03",
            "source": "archive",
        }
        for name, data in files.items()
    ]
    survey = {"machine": "test machine", "compensation": "on", "active_files": rows}
    return result_of(
        shapes={name: [0.3 * value for value in values] for name, values in SHAPES.items()},
        survey=survey,
        **more,
    )


def exported_files(
    result: Result, control: str, profile: Profile | None, *, step_mm: float | None = None
) -> list[ControlFile]:
    """Return the data files of an export."""

    def act(folder: Path) -> list[ControlFile]:
        report = export(
            result,
            control,
            profile,
            step_mm=step_mm,
            accept=ACCEPTED,
            out_dir=folder / "out",
            today=TODAY,
        )
        names = [
            name
            for name in report.files
            if not is_restore(name) and name not in (REPORT, SUMS)
        ]
        known = controller_named(control)
        made = [
            ControlFile(name=name, data=(folder / "out" / name).read_bytes())
            for name in names
        ]
        return [file for file in made if known.recognises(file)]

    found = in_folder(act)
    assert isinstance(found, list), found
    return found


def own_of(control: str, more: str = "", **how: Any) -> dict[str, bytes]:
    """Return the files for the control of an earlier export, as the control calls them."""
    angles = ANGLES if "products" in more or "chain" in f"{more}{how}" else None
    earlier = result_of(
        angles=angles,
        shapes={
            name: tuple(0.61 * value for value in values) for name, values in SHAPES.items()
        },
    )
    found: dict[str, bytes] = {}

    def act(folder: Path) -> None:
        export(
            earlier,
            control,
            profile_of(control, more, **how),
            accept=ACCEPTED,
            out_dir=folder / "out",
            today=TODAY,
        )
        found.update(
            {
                path.name.replace("_UNTESTED_SIGN", ""): path.read_bytes()
                for path in sorted((folder / "out").iterdir())
                if "_RESTORE" not in path.name
                and path.suffix.upper()
                in (".INI", ".COM", ".CMA", ".COMP", ".HAL", ".CSV", ".TXT", ".LIS")
                and not path.name.startswith(
                    ("EXPORT", "ini_lines", "volcomp", "kinematics", "heidenhain")
                )
            }
        )

    refused = in_folder(act)
    assert refused is None, refused
    return found


def cases() -> dict[str, Callable[[], Any]]:
    """Return every export by its name."""
    found: dict[str, Callable[[], Any]] = {}

    def case(
        name: str,
        result: Callable[[], Result] | Result,
        control: str,
        more: str = "",
        *,
        accept: Any = ACCEPTED,
        **how: Any,
    ) -> None:
        found[f"{control}-{name}"] = lambda: exported(
            result() if callable(result) else result,
            control,
            profile_of(control, more, **how),
            accept=accept,
            whole=name in WHOLE,
        )

    _plain(case)
    _options(case)
    _quick(found)
    _loaded(found)
    return found


def _plain(case: Callable[..., None]) -> None:
    """Every control as it is usually asked, for the mean and for both directions, with angles."""
    for control in (
        "siemens",
        "heidenhain",
        "linuxcnc",
        "beckhoff",
        "mitsubishi",
        "fagor",
        "neutral",
    ):
        case("plain", PLAIN, control)
    case("told", told, "siemens")
    case("told", told, "linuxcnc")
    case("told", told, "neutral", axis={"X": "working_mm = [-160.0, 20.0]"})
    for control in ("siemens", "linuxcnc", "fagor", "neutral"):
        case("both", TURNING, control, machine=BOTH, axes=AT_ZERO)
    case("plain", PLAIN, "fanuc", files=PUNCH)
    case(
        "both",
        TURNING,
        "fanuc",
        "",
        machine=BOTH,
        axes=AT_ZERO,
        files=PUNCH,
        section=fanuc_section("experimental_bidirectional = true"),
    )


def fanuc_section(more: str, axis: str = "", x: str = "") -> str:
    """Return the section of FANUC with words of its own for every axis."""
    axes = [
        f"{points_of(letter, *numbers)}\n{axis}{x if letter == 'X' else ''}"
        for letter, numbers in POINTS.items()
    ]
    return "\n".join(
        [f"[fanuc]\ndetection_unit_um = 1.0\nincrement_limit = 127\n{more}", *axes]
    )


def _options(case: Callable[..., None]) -> None:
    """Every option of every control."""
    sizes = "eec_points = { X = 9, Y = 8 }\ncec_points = 7\n"
    sizes += "cec_tables_held = 16\ncec_max_velo = 0.3\n"
    case(
        "sizes",
        PLAIN,
        "siemens",
        sizes + "measuring_system = 2\nfirst_cec_table = 3\ndecimals = 5",
        section="[siemens]",
    )
    case(
        "sense",
        PLAIN,
        "siemens",
        'cec_sense = "as-compensation"\nmetric_line = true\ncec_tables = { EYX = [7], EZY = [2] }',
    )
    case("products", LEANING, "siemens", "products = true")
    case(
        "few-products",
        LEANING,
        "siemens",
        "products = true\ncec_tables_held = 9\nfirst_cec_table = 1",
    )
    case("possible-products", LEANING, "siemens")
    case(
        "both-numbered",
        TURNING,
        "siemens",
        "cec_tables = { EXX = [5, 6], EYX = [0, 1] }",
        machine=BOTH,
        axes=AT_ZERO,
    )
    about = (
        'machine = "test machine"\ncontrol = "siemens"\nmeasuring_system = "1"\nbump_sha256 = '
        '["b"]\nruns_sha256 = ["a"]\n'
    )
    tests = "".join(
        f'[[sign_test]]\nkind = "{kind}"\ndate = 2025-06-01\nverdict = "as-error"\n{about}'
        for kind in ("eec", "cec")
    )
    case("tested", PLAIN, "siemens", tests=tests)
    case(
        "one-tested",
        PLAIN,
        "siemens",
        tests=tests.replace('"cec"\ndate = 2025-06-01', '"cec"\ndate = 2025-05-31'),
    )
    case(
        "fold",
        PLAIN,
        "siemens",
        machine='functions = ["EYX", "EZX", "EZY", "EXX"]\nsquareness_into = { C0Y = "EYX", B0Z '
        '= "EZX", A0Z = "EZY" }',
    )
    case(
        "few", expecting, "siemens", machine='functions = ["EYY", "EXZ"]', limits="points = 4"
    )
    case(
        "finer",
        PLAIN,
        "siemens",
        steps={"X": 37.5, "Y": 48.0, "Z": 90.0},
        axis={"X": "travel_mm = [-230.0, 130.0]"},
    )
    case(
        "wider",
        PLAIN,
        "siemens",
        axis={"X": "start_mm = -300.0\nend_mm = 200.0\nreference_mm = 0.0"},
        limits="value_um = 12.0\nwarn_value_um = 9.0",
    )
    case(
        "warned",
        PLAIN,
        "siemens",
        axis={"X": "travel_mm = [-230.0, 130.0]"},
        limits="warn_value_um = 9.0",
        accept=("value-large",),
    )
    case(
        "refused",
        PLAIN,
        "siemens",
        machine='units = "inch"',
        axis={"Y": "travel_mm = [0.0, 300.0]"},
        limits="value_um = 9.0",
        accept=(),
    )
    case("one-direction", TURNING, "siemens", axes="backlash_um = 1.5")
    case(
        "inclination",
        PLAIN,
        "fanuc",
        files=WIDE,
        section=fanuc_section("", "inclination = true"),
    )
    case(
        "inclination-unset",
        PLAIN,
        "fanuc",
        files=UNSET,
        section=fanuc_section("", "inclination = true"),
    )
    case(
        "straightness",
        PLAIN,
        "fanuc",
        files=WIDE,
        section=fanuc_section("straightness_option = true\npoints_per_axis = 64"),
    )
    numbers = (
        "moving = 5712\ncompensated = 5722\npoints = [5741, 5742, 5743, 5744]\nvalues = [5771, "
        "5772, 5773, 5774]"
    )
    case(
        "straightness-numbered",
        PLAIN,
        "fanuc",
        files=WIDE,
        section=fanuc_section("") + f"\n[fanuc.straightness.EXY]\n{numbers}",
    )
    case(
        "tenths",
        PLAIN,
        "fanuc",
        files={"A.TXT": punched(), "B.TXT": punched(None, *STRAIGHT, points=0)},
        section=fanuc_section("", "magnification = 2").replace(
            "unit_um = 1.0", "unit_um = 0.1\nleast_input_um = 0.1"
        ),
    )
    case(
        "limit",
        PLAIN,
        "fanuc",
        files=PUNCH,
        section=fanuc_section("").replace("increment_limit = 127", "increment_limit = 2"),
    )
    case("no-file", PLAIN, "fanuc")
    case("no-parameters", PLAIN, "fanuc", files={"PITCH.TXT": punched(parameters=False)})
    case("report-only", PLAIN, "fanuc", files=PUNCH, machine='functions = ["EXX", "EYX"]')
    case(
        "unset-points",
        PLAIN,
        "fanuc",
        files=WIDE,
        section=fanuc_section("straightness_option = true"),
        machine='functions = ["EYX"]',
    )
    case(
        "itnc",
        LEANING,
        "heidenhain",
        section='[heidenhain]\ngeneration = "itnc530"\nchain = "FXYZ"\ndecimals = 5\nassignment '
        '= "OWN.CMA"',
    )
    case("itnc-plain", PLAIN, "heidenhain", section='[heidenhain]\ngeneration = "itnc530"')
    case(
        "tnc4xx",
        PLAIN,
        "heidenhain",
        section='[heidenhain]\ngeneration = "tnc4xx"',
        steps={"X": 52.4288, "Y": 52.4288, "Z": 26.2144},
        axis={
            letter: f"start_mm = {low}\nend_mm = {low + 6 * step}\nreference_mm = {low}"
            for letter, low, step in (
                ("X", -200.0, 52.4288),
                ("Y", 40.0, 52.4288),
                ("Z", -150.0, 26.2144),
            )
        },
    )
    case("tnc4xx-spacing", PLAIN, "heidenhain", section='[heidenhain]\ngeneration = "tnc4xx"')
    case("own-widths", PLAIN, "heidenhain", files={"AXIS_X1.COM": OLD_COM}, accept=())
    case("chain-elsewhere", PLAIN, "heidenhain", 'chain = "FXYZ"')
    case("inch", PLAIN, "linuxcnc", "decimals = 8", machine='units = "inch"')
    case(
        "backlash",
        PLAIN,
        "linuxcnc",
        "decimals = 4",
        axis={"X": "backlash_um = 3.1", "Y": "backlash_um = -1.7"},
    )
    case("both-backlash", TURNING, "linuxcnc", machine=BOTH, axis={"X": "backlash_um = 3.1"})
    case("kinematics", LEANING, "linuxcnc", 'way = "kinematics"')
    case(
        "kinematics-told",
        told,
        "linuxcnc",
        'way = "kinematics"',
        steps={"X": 150.0},
        axis={"X": "working_mm = [-150.0, 50.0]"},
    )
    case("kinematics-inch", PLAIN, "linuxcnc", 'way = "kinematics"', machine='units = "inch"')
    case(
        "kinematics-beside",
        PLAIN,
        "linuxcnc",
        'way = "kinematics"',
        axis={"X": "start_mm = 0.0\nend_mm = 300.0\nreference_mm = 0.0"},
    )
    case("chain", LEANING, "beckhoff", 'chain = "FXYZ"\ndecimals = 6\nmax_records = 30')
    case(
        "chain-turned",
        lambda: result_of(angles=ANGLES, chain="XYFZ"),
        "beckhoff",
        'chain = "XYFZ"\nturned = false\nnegate = "XYZ"',
    )
    case("negate", PLAIN, "beckhoff", 'negate = "XZ"')
    some = 'functions = ["EXX", "EYY", "EZZ", "EYX", "EXZ"]'
    case(
        "lists",
        PLAIN,
        "beckhoff",
        machine=some,
        section=LISTS + 'cross_sense = "as-compensation"\nmaster_word = "master_ax_nr"',
    )
    case(
        "lists-both",
        TURNING,
        "beckhoff",
        machine=f"{some}\n{BOTH}",
        axes=AT_ZERO,
        section=LISTS + 'cross_sense = "as-error"',
        accept=("direction-averaged",),
    )
    case(
        "lists-averaged",
        TURNING,
        "beckhoff",
        machine=f"{some}\n{BOTH}",
        axes=AT_ZERO,
        section=LISTS + 'cross_sense = "as-error"',
    )
    case("lists-unasked", PLAIN, "beckhoff", machine=some, section=LISTS)
    case("lists-crossed", PLAIN, "beckhoff", section=LISTS + 'cross_sense = "as-error"')
    case(
        "lists-sizes",
        PLAIN,
        "beckhoff",
        machine=some,
        section=LISTS + 'cross_sense = "as-error"\nssfk_points = 4\ncross_points = 3',
    )
    case(
        "absolute",
        PLAIN,
        "mitsubishi",
        section='[mitsubishi]\noutput_unit_um = 0.05\ndata = "absolute"\nfirst_data = 4501',
    )
    case(
        "scaled",
        PLAIN,
        "mitsubishi",
        section='[mitsubishi]\noutput_unit_um = 0.01\ndata = "incremental"',
    )
    case(
        "beyond-scale",
        PLAIN,
        "mitsubishi",
        section='[mitsubishi]\noutput_unit_um = 0.001\ndata = "incremental"',
    )
    case("off-grid", PLAIN, "mitsubishi", axis={"X": "reference_mm = -150.0"})
    case(
        "reversed",
        lambda: result_of(reversal={"EXX": (2.2, 2.2, 2.2, 2.2)}),
        "fagor",
        machine=BOTH,
        axes=AT_ZERO,
    )
    case("straightness-alone", PLAIN, "fagor", machine='functions = ["EYX"]')
    case(
        "extended",
        TURNING,
        "neutral",
        machine=BOTH,
        axes=AT_ZERO,
        axis={"X": "start_mm = -300.0\nend_mm = 200.0"},
    )


def _quick(found: dict[str, Callable[[], Any]]) -> None:
    """Exports without a profile."""
    for control in ("siemens", "heidenhain", "linuxcnc", "fanuc"):
        found[f"{control}-quick"] = lambda control=control: exported(
            told(), control, None, step_mm=60.0
        )
    found["siemens-quick-shape"] = lambda: exported(
        result_of(shape_only=("EXX", "EYY")), "siemens", None, step_mm=20.0
    )
    found["lattice"] = lambda: exported(LEANING, "lattice", None, step_mm=60.0)
    found["lattice-told"] = lambda: exported(told(), "lattice", None, step_mm=30.0 * 2)
    found["lattice-coarse"] = lambda: exported(
        told(), "lattice", profile_of("neutral", steps={"X": 150.0, "Y": 60.0, "Z": 60.0})
    )
    found["etalon"] = lambda: exported(LEANING, "etalon", None)
    found["etalon-told"] = lambda: exported(told(), "etalon", None)
    found["siemens-step"] = lambda: exported(
        PLAIN, "siemens", profile_of("siemens"), step_mm=60.0
    )


def _loaded(found: dict[str, Callable[[], Any]]) -> None:
    """Exports over tables that the control holds: active while measuring, or switched off then."""
    for control in (
        "siemens",
        "fanuc",
        "heidenhain",
        "linuxcnc",
        "beckhoff",
        "mitsubishi",
        "fagor",
        "neutral",
    ):
        for state in ("on", "off"):
            for few in (False, True):
                found[f"{control}-loaded-{state}{'-few' if few else ''}"] = partial(
                    _over, control, state, few=few
                )
    for state in ("on", "off"):
        for few in (False, True):
            found[f"siemens-loaded-{state}{'-few' if few else ''}-products"] = partial(
                _over, "siemens", state, few=few, more="products = true"
            )
    for state in ("on", "off"):
        found[f"beckhoff-loaded-{state}-chain"] = partial(
            _over, "beckhoff", state, more='chain = "FXYZ"'
        )
        found[f"heidenhain-loaded-{state}-chain"] = partial(
            _over, "heidenhain", state, section=KINEMATICS
        )
    on = 'measured_with = "on"'

    def over(
        result: Callable[[], Result], more: str = "", machine: str = "", only: str = ""
    ) -> Any:
        own = {
            name: data for name, data in own_of("siemens").items() if name.startswith(only)
        }
        return exported(
            result(), "siemens", profile_of("siemens", more, machine=machine, files=own)
        )

    found["siemens-loaded-part"] = lambda: over(lambda: PLAIN, only="AX_EEC")
    found["siemens-loaded-elsewhere"] = lambda: over(
        lambda: PLAIN, "first_cec_table = 4", 'functions = ["EXX", "EYX"]'
    )
    found["siemens-loaded-others"] = lambda: over(
        lambda: measured_on({"NC_CEC.INI": b"x"}), machine=on
    )
    found["siemens-loaded-unsaid"] = lambda: over(lambda: PLAIN, machine=on)
    held = {"lattice.csv": _lattice()}
    way = 'way = "kinematics"'
    found["linuxcnc-loaded-lattice"] = lambda: exported(
        measured_on(held), "linuxcnc", profile_of("linuxcnc", way, machine=on, files=held)
    )
    found["linuxcnc-lattice-off"] = lambda: exported(
        PLAIN, "linuxcnc", profile_of("linuxcnc", way, files=held)
    )
    found["linuxcnc-lattice-beside"] = lambda: exported(
        PLAIN, "linuxcnc", profile_of("linuxcnc", files=held)
    )
    found["linuxcnc-kinematics-over-screws"] = lambda: exported(
        PLAIN, "linuxcnc", profile_of("linuxcnc", way, files=own_of("linuxcnc"))
    )


def _over(control: str, state: str, *, few: bool = False, more: str = "", **how: Any) -> Any:
    """Return an export over the files of an earlier one; ``few``: of some functions alone."""
    own = own_of(control, more, **{"files": PUNCH} if control == "fanuc" else {}, **how)
    some = ["EXX"] if control in ("fanuc", "fagor") else ["EXX", "EYX", "EZZ"]
    machine = f'measured_with = "{state}"' + (f"\nfunctions = {some}" if few else "")
    result = measured_on(own) if state == "on" else LEANING if more or how else PLAIN
    return exported(
        result,
        control,
        profile_of(control, more, machine=machine, files=own, **how),
        whole=state == "on" and few and not more,
    )


def _lattice() -> bytes:
    """Return a small lattice."""
    rows = ["x_mm,y_mm,z_mm,cx_um,cy_um,cz_um"]
    for x in (-200, 100):
        for y in (40, 280):
            rows += [
                f"{x},{y},{z},{(x - y) / 100:.3f},{(y + z) / 100:.3f},{(z - x) / 100:.3f}"
                for z in (-150, 30)
            ]
    return ("\n".join(rows) + "\n").encode("ascii")
