"""Files of controls, damaged in every way that a line or a number can be: what each reader makes of
them, or its whole refusal."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from stepdiag.base.result.result import Result
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.neutral import curves_csv
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.levers import left_out
from stepdiag.exporters.safety.sign_run import read_sign_run
from stepdiag.exporters.safety.verify import controller_of
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table
from testkit import references
from testkit.recorded import plain
from testkit.recorded.exported import BOTH, LISTS, WIDE, fanuc_section
from testkit.recorded.profiles import profile_of
from testkit.recorded.results import LEANING, PLAIN, TURNING, result_of

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?")
_KIND = re.compile(r"[-+]?\d+(?:\.\d*)?")
_MOST_NUMBERS = 7
Reader = Callable[[Sequence[ControlFile]], Any]


def planned(
    control: str, result: Result, profile: Profile
) -> tuple[tuple[ControlFile, ...], Profile]:
    """Return the files for a control, as it is planned without a look at what it held, and the
    profile to read them with."""
    controller = controller_named(control)
    fit = fitted(result, profile.machine.functions, profile.machine.squareness_into)
    plan = (
        controller.plan_products(fit.curves, fit.products, profile)
        if hasattr(controller, "plan_products")
        else controller.plan(fit.curves, profile)
    )
    settled = replace(profile, options=plan.options or profile.options)
    return tuple(
        file for file in controller.render(plan.tables, settled) if file.role != "note"
    ), settled


def damages(text: str) -> Iterator[tuple[str, str]]:
    """Yield what is done to a text, and the damaged text: to the first and the last line of every
    kind, and to the whole."""
    lines = text.split("\n")
    for number in _of_each_kind(lines):
        line, at = lines[number], str(number + 1)

        def with_line(*new: str, number: int = number) -> str:
            return "\n".join([*lines[:number], *new, *lines[number + 1 :]])

        yield f"{at} left out", with_line()
        yield f"{at} twice", with_line(line, line)
        yield (
            f"{at} with a word more",
            with_line(f"{line.rstrip()} 7x{line[len(line.rstrip()) :]}"),
        )
        yield f"{at} cut", with_line(line.rstrip()[:-2] + line[len(line.rstrip()) :])
        for n, match in enumerate(list(_NUMBER.finditer(line))[:_MOST_NUMBERS]):
            for new in (_other(match.group()), "-" + match.group().lstrip("+-"), "0", "q")[
                : 4 if n < 4 else 1
            ]:
                if new != match.group():
                    yield (
                        f"{at}: {match.group()} ({match.start()}) {new}",
                        with_line(line[: match.start()] + new + line[match.end() :]),
                    )
    yield "empty", ""
    yield "first half", "\n".join(lines[: len(lines) // 2]) + "\n"
    yield "without its last two letters", text.rstrip()[:-2]
    yield "without an end of the last line", text.rstrip("\r\n")
    yield "with empty lines", text.replace("\n", "\n\n")
    yield "with blanks at the ends of lines", text.replace("\n", " \n")
    yield "in small letters", text.lower()
    yield "with semicolons for commas", text.replace(",", ";")
    yield "not in ASCII", text + "\xb5"


def _other(number: str) -> str:
    """Return a number that is one more in its last digit but one, or the last."""
    place = next((n for n in range(len(number) - 1, -1, -1) if number[n].isdigit()), 0)
    return number[:place] + str((int(number[place]) + 1) % 10) + number[place + 1 :]


def _of_each_kind(lines: Sequence[str]) -> list[int]:
    first, last = {}, {}
    for number, line in enumerate(lines):
        if line.strip():
            kind = _KIND.sub("0", line)
            first.setdefault(kind, number)
            last[kind] = number
    return sorted({*first.values(), *last.values()})


def told(tables: Sequence[Table], whole: Sequence[Table]) -> Any:
    """Return what damaged tables are beside the whole ones: what of each is otherwise."""
    known = {str(one.label): plain.table(one) for one in whole}
    found = {str(one.label): plain.table(one) for one in tables}
    changed: dict[str, Any] = {f"no {label}": True for label in known if label not in found}
    for label, one in found.items():
        if label not in known:
            changed[f"new {label}"] = {
                key: value for key, value in one.items() if key != "label"
            }
        elif one != known[label]:
            changed[label] = {
                key: _changes(value, known[label].get(key))
                for key, value in one.items()
                if value != known[label].get(key)
            }
    return changed or "the same"


def _changes(value: Any, was: Any) -> Any:
    if isinstance(value, list) and isinstance(was, list) and len(value) == len(was):
        return {
            str(n): each
            for n, (each, old) in enumerate(zip(value, was, strict=True))
            if each != old
        }
    return value


def _case(
    control: str, result: Result, *, only: str = "", broken: str = "", **how: Any
) -> Callable[[], Any]:
    """Return a case: every data file of a control (or the ``broken`` one) damaged in turn, read
    with the others beside it."""

    def act() -> Any:
        made, settled = planned(control, result, profile_of(control, **how))
        controller = controller_named(control)
        read = [file for file in made if file.role == "data" or only]
        read = [file for file in read if not only or file.name.startswith(only)]
        whole = controller.parse(read, settled)
        found: dict[str, Any] = {}
        for index, file in enumerate(read):
            if not file.name.startswith(broken):
                continue
            for what, text in damages(file.data.decode("latin-1")):
                damaged = [
                    *read[:index],
                    replace(file, data=text.encode("latin-1")),
                    *read[index + 1 :],
                ]
                found[f"{file.name} {what}"] = plain.attempted(
                    lambda damaged=damaged: told(controller.parse(damaged, settled), whole)
                )
        return {"whole": [plain.table(one) for one in whole], "damaged": plain.grouped(found)}

    return act


def cases() -> dict[str, Callable[[], Any]]:
    """Return the damages by reader."""
    small = 'functions = ["EXX", "EYX"]'
    lean = 'functions = ["EXX", "EYX", "EZX"]'
    return {
        "siemens": _case("siemens", PLAIN, machine=small),
        "siemens-both": _case(
            "siemens",
            TURNING,
            machine=f"{small}\n{BOTH}",
            axes="backlash_um = 0.0",
            only="NC_CEC",
        ),
        "siemens-products": _case(
            "siemens",
            LEANING,
            more="products = true\ncec_tables_held = 4",
            machine=lean,
            only="NC_CEC",
        ),
        "siemens-program": _case("siemens", PLAIN, machine=small, only="LOAD"),
        "fanuc": _case(
            "fanuc",
            PLAIN,
            files=WIDE,
            machine='functions = ["EXX", "EYX"]',
            section=fanuc_section("straightness_option = true", "inclination = true"),
        ),
        "fanuc-both": _case(
            "fanuc",
            TURNING,
            files={"PITCH.TXT": WIDE["PITCH.TXT"]},
            machine=f'functions = ["EXX"]\n{BOTH}',
            axes="backlash_um = 0.0",
            section=fanuc_section("experimental_bidirectional = true"),
        ),
        "heidenhain": _case("heidenhain", PLAIN, machine=small),
        "heidenhain-chain": _case(
            "heidenhain",
            LEANING,
            broken="AXIS-X",
            section='[heidenhain]\ngeneration = "itnc530"\nchain = "FXYZ"',
        ),
        "linuxcnc": _case(
            "linuxcnc",
            TURNING,
            machine=f'functions = ["EXX", "EXY"]\n{BOTH}',
            axis={"X": "backlash_um = 3.0"},
        ),
        "linuxcnc-inch": _case(
            "linuxcnc", PLAIN, machine='functions = ["EXX"]\nunits = "inch"'
        ),
        "beckhoff": _case("beckhoff", LEANING, more='chain = "FXYZ"'),
        "beckhoff-lists": _case(
            "beckhoff",
            TURNING,
            section=LISTS + 'cross_sense = "as-error"',
            machine=f"{small}\n{BOTH}",
            axes="backlash_um = 0.0",
        ),
        "mitsubishi": _case("mitsubishi", PLAIN, machine=small),
        "mitsubishi-absolute": _case(
            "mitsubishi",
            PLAIN,
            section='[mitsubishi]\noutput_unit_um = 0.5\ndata = "absolute"',
            machine=small,
        ),
        "fagor": _case(
            "fagor", TURNING, machine=f'functions = ["EXX"]\n{BOTH}', axes="backlash_um = 0.0"
        ),
        "neutral": _case(
            "neutral", TURNING, machine=f"{small}\n{BOTH}", axes="backlash_um = 0.0"
        ),
        "lattice": _lattice,
        "sign-run": _sign_run,
        "recognised": _recognised,
    }


def _lattice() -> Any:
    """A lattice of eight vertices."""
    volume = replace(PLAIN.volume, increments=1)
    held = lattice.lattice_of(result_of(shapes={"EXX": (0.0, 3.7)}, volume=volume), 60.0)
    thin = replace(
        held,
        axes_mm=tuple(axis[[0, -1]] for axis in held.axes_mm),
        vectors_um=held.vectors_um[::5, ::4, ::3],
    )
    file = lattice.render(thin)

    def read(data: bytes) -> Any:
        found = lattice.parse(replace(file, data=data))
        return {
            "axes": [axis.tolist() for axis in found.axes_mm],
            "um": found.vectors_um.reshape(-1).tolist(),
        }

    text = file.data.decode("ascii")
    broken = {
        what: plain.attempted(lambda damaged=damaged: read(damaged.encode("latin-1")))
        for what, damaged in damages(text)
    }
    return {"whole": read(file.data), "damaged": plain.grouped(broken)}


def _sign_run() -> Any:
    """The small CSV of a sign test."""
    text = "position_mm,off_um,on_um\n100.0,1.25,2.5\n-100.0,0.5,0.75\n0.0,0.25,5.5\n"

    def read(data: bytes) -> Any:
        run = read_sign_run(ControlFile(name="run.csv", data=data))
        return [column.tolist() for column in run[:3]]

    broken = {
        what: plain.attempted(lambda damaged=damaged: read(damaged.encode("latin-1")))
        for what, damaged in damages(text)
    }
    return {"whole": read(text.encode("ascii")), "damaged": plain.grouped(broken)}


def _recognised() -> Any:
    """Which controls recognise which file, and which compensate levers."""
    files: list[ControlFile] = []
    for control in sorted(CONTROLLERS):
        more, how = {
            "siemens": ("products = true", {}),
            "beckhoff": ('chain = "FXYZ"', {}),
            "fanuc": ("", {"files": WIDE}),
        }.get(control, ("", {}))
        files += planned(control, LEANING, profile_of(control, more, **how))[0]
    files += planned(
        "beckhoff",
        PLAIN,
        profile_of(
            "beckhoff",
            section=LISTS + 'cross_sense = "as-error"',
            machine='functions = ["EXX", "EXY"]',
        ),
    )[0]
    files += planned(
        "heidenhain",
        LEANING,
        profile_of(
            "heidenhain", section='[heidenhain]\ngeneration = "itnc530"\nchain = "FXYZ"'
        ),
    )[0]
    files += [
        lattice.render(lattice.lattice_of(PLAIN, 60.0)),
        ControlFile(name="note.txt", data=b"a note\n"),
    ]
    files += [
        ControlFile(name="AX_EEC_RESTORE_UNTESTED_SIGN.INI", data=b""),
        ControlFile(name="screw_x.comp", data=b"1 2 x\n"),
    ]
    found: dict[str, Any] = {}
    for file in files:
        left = left_out({file.name: file.data})
        found[file.name] = {
            "by": [name for name, control in CONTROLLERS.items() if control.recognises(file)],
            "lattice": lattice.recognises(file),
            "curves": file.data.startswith(curves_csv.NAME.encode()),
            "alone": plain.attempted(lambda file=file: controller_of([file]).name),
            "with a note": plain.attempted(
                lambda file=file: controller_of([file, files[0]]).name
            ),
            "levers": None if left is None else references.plain(left.message),
        }
    return found
