"""Files as people write them, right and wrong, and surveys that are refused: every message in
whole."""

from dataclasses import replace

from _surveys import THREE, angles, planned, runs, survey

from testkit.exact.results import made_result
from testkit.exact.surveys import DIAGONALS

HEADER = "setup,pass,stop,x_mm,y_mm,z_mm,reading_mm"


def readings():
    """Return tables of readings: every column, every refusal."""
    row = "ppp,1,0,0,0,0,0"
    more = [f"ppp,1,{stop},{10 * stop},0,0,{10.001 * stop}" for stop in range(1, 13)]

    def wrong(text, header=HEADER):
        return [header, row, text]

    return {
        "texts": [
            [HEADER, row, *more],
            [
                "\ufeff# a comment",
                "",
                "diagonal, stop, x_mm, y_mm, z_mm, reading_mm, remark",
                "  # more",
                "npp,1,-1e1,+2.50,.5,3e-3,hm",
                "npp,0,0,0,0,-0.0000000001,",
            ],
            [
                (
                    f"{HEADER},u_um,temperature_c,time_s,zero,beam_x_mm,beam_y_mm,beam_z_mm,"
                    "at_20_c,"
                    "turned"
                ),
                row + ",0.25,21.125,1764000000.5,3,1,2,-0.00000001,1,1",
                "ppp,1,1,10,0,0,10,,,,4,,,,0,",
                "linear-z,2,0,0,0,5,0,0.1,,,,,,,,1",
            ],
            [f"{HEADER},zero", row + ",1", "ppp,1,1,10,0,0,10,", "ppp,1,2,20,0,0,20,1"],
            [f"{HEADER},zero", row + ",", "ppp,1,1,10,0,0,10,0"],
            [HEADER, row, *[one for one in more if ",5," not in one[5:8]]],
            [HEADER, row, *more[:4], *more[6:]],
            [HEADER, row, more[0], *more[4:]],
            [HEADER, *more],
            [HEADER, row, more[0], more[0]],
            [HEADER, row, *more[:2], *more[3:5]],
            [HEADER, row, *more[:1], *more[3:]],
            wrong("ppp,0,1,0,0,0,0"),
            wrong("ppp,1.5,1,0,0,0,0"),
            wrong("ppp,1,-1,0,0,0,0"),
            wrong("ppp,1,1234567890,0,0,0,0"),
            wrong("ppp,123456789,0,0,0,0,0"),
            wrong("ppp,²,1,0,0,0,0"),
            wrong("ppx,1,1,0,0,0,0"),
            wrong("unknown-thing,1,1,0,0,0,0"),
            wrong("ppp,1,1,0,0,0,nan"),
            wrong("ppp,1,1,0,0,0,"),
            wrong("ppp,1,1,1e12,0,0,0"),
            wrong("ppp,1,1,1.0001e12,0,0,0"),
            wrong("ppp,1,1,0,0,-inf,0"),
            wrong('ppp,1,1,"1,5",0,0,0'),
            wrong("ppp,1,1,0,5,0,0,0"),
            wrong("ppp,1,1,0,0,0"),
            wrong('ppp,1,1,"0,0,0,0'),
            wrong("ppp,1,1,0,0,0,0,-0.1", f"{HEADER},u_um"),
            [f"{HEADER},u_um", row + ",0", "ppp,1,1,0,0,0,0,-0.0"],
            [f"{HEADER},time_s", row + ",-5.5"],
            [f"{HEADER},beam_x_mm,beam_y_mm,beam_z_mm", row + ",1,2,"],
            [f"{HEADER},beam_x_mm,beam_y_mm,beam_z_mm", row + ",,,2"],
            [f"{HEADER},at_20_c", row + ",2"],
            [f"{HEADER},turned", row + ",yes"],
            [f"{HEADER},zero", row + ",-1"],
            [],
            ["# nothing"],
            [HEADER],
            ["setup;pass;stop", "1;2;3"],
            ["setup\tstop", "1\t2"],
            ["setup,stop", "1,2"],
            [f"{HEADER},reading_mm", row + ",0"],
            [f"{HEADER},,", row + ",,"],
            [f"{HEADER},a,a,b,b", row + ",,,,"],
            [HEADER.replace("setup", "diagonal"), row],
        ]
    }


def angle_files():
    """Return files of angles."""
    header = "axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad"
    return {
        "texts": [
            [
                header,
                "X,0,0,1.5,,0.5",
                "x,100,2.25,-1,,",
                "y,0,,,3,0.1",
                "y,50,,,4,0.2",
                "y,25.5,,,-1,0.3",
            ],
            [header, "z,100,1,2,3,0", "z,0,4,5,6,0.7", "z,50,,,9,"],
            [header, "x,0,1,,,"],
            [header, "x,0,1,,,", "x,0,2,,,"],
            [header, "a,0,1,,,"],
            [header, "xy,0,1,,,"],
            [header, ",0,1,,,"],
            [header, "x,,1,,,"],
            [header, "x,0,1,,,-1"],
            [header, "x,0,one,,,", "x,1,2,,,"],
            [header, "x,0,,,,", "x,1,,,,"],
            [header],
            [header.replace(",u_urad", ""), "x,0,1,2,3", "x,9,1,2,4"],
            ["axis,position_mm,EA_urad", "x,0,1"],
            [header, "x,5,1,,,", "x,0,1,,,", "x,5.0,2,,,", "x,0,2,,,"],
        ]
    }


def straightness_files():
    """Return files of straightness."""
    header = "position_mm,approach,EYX_um,u_EYX_um,EZX_um,u_EZX_um"
    rows = [
        "0,1,0.5,0.1,1,0.2",
        "50,1,1.5,0.1,,",
        "100,1,-2,0.3,2,0.2",
        "0,-1,1,0.1,3,0.4",
        "50,-1,2,0.1,4,0.4",
        "100,-1,3,0.1,5,0.5",
        "150,1,,,0,1",
    ]

    def one(text, name="EXY", columns="position_mm,EXY_um,u_EXY_um"):
        return [columns.replace("EXY", name), "0,0,1", "10,1,1", text]

    return {
        "texts": [
            [header, *rows],
            [header, *rows[:2]],
            one("20,2,1"),
            one("30,-2,0.25"),
            one("20,2,0"),
            one("20,2,-1"),
            one("20,2,"),
            one("20,x,1"),
            one("10,2,1"),
            one(",2,1"),
            one("20,,"),
            one("20,2,1", "EXX"),
            one("20,2,1", "EAX"),
            one("20,2,1", "ezy"),
            ["position_mm,EXY_um", "0,1"],
            ["position_mm,EXY_um,u_EZY_um", "0,1,1"],
            ["position_mm", "1"],
            ["position_mm,u_EXY_um", "1,2"],
            ["EXY_um,u_EXY_um", "1,2"],
            [header, "0,2,1,1,1,1"],
            [header, "0,-1.5,1,1,1,1"],
            [header, "0,,1,1,,", "5,0,1,1,,", "9,,2,1,,"],
            [header, "0,1,,,,"],
            [header],
        ]
    }


def rtl():
    """Return .rtl files, right and wrong."""
    good = [
        "HEADER::",
        "File type : Linear",
        "Owner : somebody",
        "TARGET DATA::",
        "Filetype : ISO",
        "Target-count : 3",
        "Targets :",
        "0.0 100.5",
        "200",
        "Flags : 0 0 2 0",
        "USER-TEXT::",
        "Axis : X-axis",
        "Machine : mill  1",
        "axis : Y",
        "RUNS::",
        "Run-count : 2",
        "DEVIATIONS::",
        "Run Target Data:",
        "1 1 0.0",
        "1 2 1.5",
        " 1 3 -2.25e0",
        "",
        "2 3 -2",
        "2 2 +1",
        "2 1 .5",
        "EQUIPMENT::",
        "ENVIRONMENT::",
        "EOF::",
    ]

    def changed(**changes):
        """Return lines changed by number; None leaves one out, a list puts several there."""
        return {name.removeprefix("at"): line for name, line in changes.items()}

    nothing = {str(number): None for number in range(len(good))}
    return {
        "base": good,
        "changes": [
            {},
            changed(at0="\ufeffHEADER::", at27=["EOF::", "EOF::"]),
            changed(at9="Flags : 0 1 2 0"),
            changed(at9="Flags : 0 1"),
            changed(at9=None),
            changed(at9="Flags : 0 1 2 0 5"),
            changed(at9="Flags : 0 1 2 3"),
            changed(at7="200.0 100.5", at8="0"),
            changed(at7="0 100", at8="100"),
            changed(at7="0 100", at8="50"),
            changed(at8=None),
            changed(at8="200 300"),
            changed(at6=None),
            changed(at6="targets: 0 100", at7="200", at8=None),
            changed(at8="2e12"),
            changed(at8="1e12"),
            changed(at8="1e2e"),
            changed(at8="1,5"),
            changed(at5="Target-count : 1", at7="1", at8=None),
            changed(at5="Target-count : 0"),
            changed(at5="Target-count : 20001"),
            changed(at5="Target-count : x"),
            changed(at5=None),
            changed(at5="Target-count : ²"),
            changed(at15="Run-count : 0"),
            changed(at15="Run-count : 0000000002"),
            changed(at15="Run-count : 000000002"),
            changed(at15="Run-count : 201"),
            changed(at15="Run-count : 200"),
            changed(at15="Run-count : 1"),
            changed(at15="Run-count : 3"),
            changed(at15=None),
            changed(at15="Run-count : 1", at9=None, at22=None, at23=None, at24=None),
            changed(at18="0 1 0"),
            changed(at18="1 0 0"),
            changed(at18="1 4 0"),
            changed(at18="3 1 0"),
            changed(at19="1 1 2"),
            changed(at24=None),
            changed(at18="1 1"),
            changed(at18="1 1 2 3"),
            changed(at18="1.0 1 2"),
            changed(at18="1 -1 2"),
            changed(at18="123456789 1 2"),
            changed(at18="12345678 1 2"),
            changed(at18="1 123456789 2"),
            changed(at18="1 1 x"),
            changed(at18="1 1 100000"),
            changed(at18="1 1 -100001"),
            changed(at18="1 1 1e400"),
            changed(at27=None),
            changed(at14="TARGET DATA::"),
            changed(at14=None),
            changed(at16=None),
            changed(at3=None),
            nothing,
            changed(at1="File type : Angular"),
            changed(at1="Title : straightness"),
            changed(at4="Filetype : Straightness of Y"),
            changed(at1="Measurement : rotary axis"),
            changed(at1="Measurement type : Flatness"),
            changed(at1="Measurement : linear"),
            changed(at11="Axis : W", at13="Axis : Q"),
            changed(at11="Axis : z axis", at13=None),
            changed(at11=None, at13=None),
            changed(at11="Axis :   Y"),
            changed(at17="-", at18=["1 1 0", "x 1 2"]),
        ],
    }


def results():
    """Return a result, and changes of it: a path with what stands there instead, or None where it
    is left out."""
    made = made_result(
        {"EXX": [0, 1, 2, 1, 0], "EYX": None},
        squareness={"C0Y": 3.0, "B0Z": None},
        angles={"EAX": [0, 1, 2, 3, 4.5]},
        reversal={"EZZ": [1, 2, 3, 2, 1]},
    )
    text = made.to_json().splitlines()
    paths = [
        ["format", "other"],
        ["format", 1],
        ["format"],
        ["version", 0],
        ["version", 9],
        ["version", True],
        ["version", "1"],
        ["version"],
        ["chain", "XYZ"],
        ["chain", 5],
        ["chain"],
        ["method", 3],
        ["method"],
        ["volume"],
        ["volume", []],
        ["volume.origin_mm", [0, 0]],
        ["volume.origin_mm", [0, 0, "a"]],
        ["volume.origin_mm", 1],
        ["volume.size_mm", [1, 2, 0]],
        ["volume.size_mm", [1, 2]],
        ["volume.size_mm", [1, 2, 3, 4]],
        ["volume.size_mm", [1, 2, 1e13]],
        ["volume.increments", 0],
        ["volume.increments", 1],
        ["volume.increments", 500],
        ["volume.increments", 501],
        ["volume.increments", 4.0],
        ["volume.increments", True],
        ["errors.EXX"],
        ["errors.EXQ", {}],
        ["errors.EXX", 5],
        ["errors.EXX.unit", "urad"],
        ["errors.EXX.unit"],
        ["errors.EAX.unit", "um"],
        ["errors.EXX.position_mm", [0]],
        ["errors.EXX.position_mm", [0, 1, 1, 2, 3]],
        ["errors.EXX.position_mm", [3, 2, 1]],
        ["errors.EXX.value", [1, 2]],
        ["errors.EXX.value", None],
        ["errors.EXX.value"],
        ["errors.EXX.value", [0, 1, 2, None, 0]],
        ["errors.EXX.value", [0, 1, 2, True, 0]],
        ["errors.EXX.u"],
        ["errors.EXX.u_readings"],
        ["errors.EXX.u_readings", [1]],
        ["errors.EXX.slope_identified", 1],
        ["errors.EXX.slope_identified"],
        ["errors", []],
        ["errors"],
        ["reversal.EZZ.value", [1]],
        ["reversal.EQQ", {}],
        ["reversal"],
        ["expected.EXX", {}],
        ["expected", 1],
        ["expected"],
        ["squareness.C0Y"],
        ["squareness.C0Y.unit", "um"],
        ["squareness.C0Y.value", "3"],
        ["squareness.C0Y.value", None],
        ["squareness.C0Y.u", 1e13],
        ["squareness.C0Y.u_readings"],
        ["squareness.C0Y.u_readings", 0.5],
        ["squareness"],
        ["scale.X"],
        ["scale.X.identified", True],
        ["scale.X.identified", 0],
        ["scale.X.value", 3.0],
        ["scale.X.unit", "ppm"],
        ["setups", 1],
        ["setups", {"ppp": 1}],
        ["setups", {"ppp": {"more": [1, {"a": 2}]}}],
        ["setups", {"ppp": {"a": 1e13}}],
        ["findings", {}],
        ["findings", [1]],
        ["findings", [{"code": "a", "severity": "bad", "text": "t"}]],
        ["findings", [{"severity": "info", "text": "t"}]],
        ["findings", [{"code": 3, "severity": "info", "text": "t"}]],
        [
            "findings",
            [
                {
                    "code": "a",
                    "severity": "info",
                    "text": "t",
                    "setup": "ppp",
                    "pass": 2,
                    "stop": 0,
                    "size_um": -1.5,
                    "among": ["ppp/1", "npp/2"],
                }
            ],
        ],
        ["findings", [{"code": "a", "severity": "error", "text": "t", "pass": 1.5}]],
        ["findings", [{"code": "a", "severity": "warning", "text": "t", "among": ["x", 1]}]],
        ["findings", [{"code": "a", "severity": "warning", "text": "t", "stop": "1"}]],
        ["software"],
        ["software", {"name": 1}],
        ["software", {"name": "x"}],
        ["software", {"name": "x", "version": "2", "more": 1}],
        ["new_entry", {"a": [1, "b", None, True]}],
        ["new_entry", [1e13]],
        ["x" * 80, {"long": "y" * 200}],
        ["errors.EXX.unit", "z" * 100],
    ]
    position = {"X": [0, 1], "Y": [0, 1], "Z": [0, 2]}
    good = {
        "position_mm": position,
        "offset": {"EXX": [0, 1]},
        "modes": {"EXX": [[1, 2], [3, 4]], "C0Y": [[1], [2]]},
        "rest": {"EZZ": [1, 0.5]},
        "between_um": {"EXX": [1, 2, 3], "EYY": 0.5},
        "sized": {"scale": [[1], [2]], "shift": [[0], [1]]},
    }
    posterior = [
        good,
        {name: value for name, value in good.items() if name != "sized"},
        good | {"position_mm": {"X": [0, 1]}},
        good | {"position_mm": position | {"Y": [1, 1]}},
        good | {"position_mm": position | {"Z": [1]}},
        good | {"offset": {"EXX": [1]}},
        good | {"offset": {"C0Y": [1, 2]}},
        good | {"offset": {"A0Z": [2]}},
        good | {"offset": []},
        good | {"modes": {"EXX": [[1, 2]], "C0Y": [[1], [2]]}},
        good | {"modes": {"EXX": [[1]]}},
        good | {"modes": {"EXX": 1}},
        good | {"modes": {}},
        good | {"rest": {"EZZ": [1, 2, 3]}},
        good | {"between_um": {"EXX": []}},
        good | {"between_um": {"EXX": "a"}},
        good | {"sized": {"scale": [], "shift": []}},
        good | {"sized": {"scale": [[1], [2]], "shift": [[0]]}},
        good | {"sized": {"scale": [[1], [2, 3]], "shift": [[0], [1]]}},
        good | {"sized": {"scale": [[1, 2, 3]], "shift": [[0, 0, 0]]}},
        good | {"sized": {"scale": [[1, 2]], "shift": [[0, 0]]}},
        good | {"sized": {"scale": [[]], "shift": [[]]}},
        good | {"sized": {"scale": [[1]]}},
        {},
    ]
    return {"result": text, "changes": paths + [["posterior", one] for one in posterior]}


def surveys():
    """Return a survey, and changes of it by which it is none: rows changed (None leaves one out) or
    told otherwise."""
    box = replace(
        THREE,
        increments=2,
        size_mm=(300.0, 200.0, 100.0),
        origin_mm=(0.0, 0.0, 0.0),
        angle_urad=0.0,
    )
    given = survey(box.survey((*DIAGONALS, "linear-x")))
    bodies = survey(planned(box, runs("body-ppp", "body-npp", "linear-y", return_pass=False)))
    lines = given["readings"]
    header, names = lines[0].split(","), {}
    for number, line in enumerate(lines):
        setup, _, stop = line.split(",")[:3]
        names[f"{setup} {stop}"] = number

    def put(place, **values):
        cells = lines[names[place]].split(",")
        for name, value in values.items():
            cells[header.index(name)] = str(value)
        return {str(names[place]): ",".join(cells)}

    def every(setup, of):
        """Return the rows of a setup with readings changed by a function."""
        rows = {}
        for place, number in names.items():
            if place.startswith(setup + " "):
                cells = lines[number].split(",")
                cells[6] = repr(round(of(float(cells[6])), 6))
                rows[str(number)] = ",".join(cells)
        return rows

    gone = {
        str(number): None
        for place, number in names.items()
        if not place.startswith(("ppp", "setup"))
    }
    only_x = {
        str(number): None
        for place, number in names.items()
        if not place.startswith(("linear-x", "setup"))
    }
    last = {str(names[f"ppp {stop}"]): None for stop in (4, 5, 6)}
    head = {
        "name": "EYX",
        "position_mm": [0.0, 150.0, 300.0],
        "value_um": [0.0, 1.0, 0.0],
        "u_um": [0.5, 0.5, 0.5],
        "approach": 1,
    }
    reach = ["axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad"]
    return {
        "base": given,
        "bodies": bodies,
        "changes": [
            {"solve": True},
            {"chain": "XYZ"},
            {"method": "estimat"},
            {"method": "other"},
            {"method": "wang2000", "angles": angles(box)},
            {"method": "wang2000"},
            {"method": "least-squares", "monte_carlo": 5},
            {"method": "least-squares", "straightness": [head]},
            {"angles": [*reach, "x,0,1,,,", "x,250,2,,,"]},
            {"angles": [*reach, "y,0.02,1,,,", "y,200,2,,,"]},
            {"angles": [*reach, "y,0.009,1,,,", "y,199.991,2,,,"]},
            {"angles": [*reach, "x,-50,1,,,1", "x,350,9000000,,,1"]},
            {"straightness": [head | {"position_mm": [0.0, 150.0, 300.5]}]},
            {"straightness": [head | {"position_mm": [-0.5, 150.0, 300.0]}]},
            {"straightness": [head | {"position_mm": [0.005, 150.0, 299.995]}]},
            {"rows": put("ppp 2", y_mm=60)},
            {"rows": put("ppp 2", y_mm=100.1)},
            {
                "rows": put("ppp 3", z_mm=50.19)
                | put("ppp 4", z_mm=50.19)
                | put("ppp 5", z_mm=50.19)
            },
            {
                "rows": put("ppp 3", z_mm=50.21)
                | put("ppp 4", z_mm=50.21)
                | put("ppp 5", z_mm=50.21)
            },
            {"rows": put("ppp 1", y_mm=3)},
            {"rows": put("ppp 1", y_mm=0.04)},
            {"rows": put("ppp 1", x_mm=-150)},
            {"rows": put("ppp 6", z_mm=100.3)},
            {"rows": put("npp 0", x_mm=299.98)},
            {"rows": put("npp 0", x_mm=299.992), "solve": True},
            {"rows": put("linear-x 1", y_mm=5)},
            {"rows": put("linear-x 2", x_mm=149)},
            {"rows": gone, "solve": True},
            {"rows": only_x},
            {"rows": last},
            {"rows": {str(names["ppp 6"]): None}},
            {"rows": {str(names["pnp 3"]): None}},
            {"rows": {str(names["pnp 2"]): None, str(names["pnp 3"]): None}},
            {"rows": {str(names[f"linear-x {stop}"]): None for stop in (1, 2)}},
            {"rows": {str(names["linear-x 1"]): None}},
            {"rows": every("ppp", lambda mm: -mm)},
            {"rows": every("ppp", lambda mm: mm / 1000.0)},
            {"rows": every("npp", lambda mm: 1.099 * mm), "solve": True},
            {"rows": every("npp", lambda mm: 1.101 * mm)},
            {"rows": every("npp", lambda mm: -1.05 * mm)},
            {"rows": every("linear-x", lambda mm: -mm)},
            {"rows": every("ppn", lambda mm: 1.05 * mm)},
            {"rows": put("ppp 2", reading_mm=500), "solve": True},
            {"rows": {str(number): None for number in range(1, len(lines))}},
            {"of": "bodies"},
            {"of": "bodies", "rows": {"3": None}},
            {"of": "bodies", "rows": {"2": None}},
            {"of": "bodies", "method": "wang2000"},
            {"method": "least-squares"},
            {"method": "least-squares", "rows": {str(names["ppn 0"]): None}},
            {
                "method": "least-squares",
                "rows": {
                    str(number): None
                    for place, number in names.items()
                    if place.startswith("pnp")
                },
            },
            {"method": "wang2000", "rows": {str(names["npp 3"]): None}},
            {"method": "least-squares", "zero": [9, 10, 11, 12, 13]},
            {"assumed": {"reduced_to_20_c": True}},
            {"at_20_c": [3]},
            {"at_20_c": [0, 1, 2, 3, 4, 5, 6]},
        ],
    }


FILES = {
    "readings": ("tables of readings", "readings", readings),
    "angle-files": ("files of angles", "angles", angle_files),
    "straightness-files": ("files of straightness", "straightness", straightness_files),
    "rtl": (".rtl files", "rtl", rtl),
    "results": (
        "results read and written again, and changes that are refused",
        "results",
        results,
    ),
    "refused": (
        "surveys that are refused, and some that are not",
        "refused-surveys",
        surveys,
    ),
}
