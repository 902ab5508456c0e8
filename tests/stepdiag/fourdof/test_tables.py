"""Tables of a multi-axis laser, as its program exports them: exact truth, out and back twice, to
the files of a control."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.fourdof.tables import columns_named, parse_run
from testkit.cli import stepdiag
from testkit.forgeries import flipped

ARCSEC = np.pi / 0.648
"""In urad."""
EDGES = {"x": 500.0, "y": 400.0, "z": 300.0}
TRUE = {
    "EXX": lambda s: 6.0 * np.sin(4.0 * s) + 8.0 * s,
    "EYX": lambda s: 5.0 * np.sin(np.pi * s),
    "EZX": lambda s: -3.0 * np.sin(2.0 * np.pi * s),
    "EAX": lambda s: 12.0 * s**2,
    "EBX": lambda s: -20.0 * s,
    "ECX": lambda s: 9.0 * np.sin(3.0 * s),
}
"""Of X over the share of its travel, in um and urad; of Y and Z the same with the letters turned
on."""
PROFILE = """
[machine]
name = "virtual"
controller = "siemens"
measured_with = "off"
functions = ["EXX", "EYY", "EZZ", "EYX", "EZX", "EZY"]
"""


def truth(axis):
    turned = {"x": "XYZ", "y": "YZX", "z": "ZXY"}[axis]
    letters = dict(zip("XYZ", turned, strict=True)) | dict(
        zip("ABC", (chr(ord(one) - 23) for one in turned), strict=True)
    )
    return {f"E{letters[name[1]]}{axis.upper()}": function for name, function in TRUE.items()}


def table(axis, rng):
    """Return the text of a table with semicolons and decimal commas; the head stands askew, its
    pitch counts the other way."""
    places = np.linspace(0.0, EDGES[axis], 11)
    lines = ["Ziel;Fehler;Gerade H;Gerade V;Rollen;Nicken;Gieren"]
    functions = list(truth(axis).values())
    for _ in range(2):
        for at in (*places, *places[::-1]):
            share = at / EDGES[axis]
            exact = [function(share) for function in functions] + np.array(
                [0.0, 40.0 * share + 3.0, -25.0 * share, 7.0, -4.0, 2.0]
            )
            noisy = exact + rng.normal(scale=[0.1, 0.3, 0.3, 0.5, 0.3, 0.3])
            linear, across, up, roll, pitch, yaw = noisy
            values = [at, linear, across, up, roll / ARCSEC, -pitch / ARCSEC, yaw / ARCSEC]
            lines.append(";".join(f"{value:.4f}".replace(".", ",") for value in values))
    return "\n".join(lines) + "\n"


def mapped(axis):
    linear, across, up, roll, pitch, yaw = truth(axis)
    return [
        f"{linear}=Fehler[um]~0.1",
        f"{across}=Gerade H[um]~0.25",
        f"{up}=Gerade V[um]~0.25",
        f"{roll}=Rollen[arcsec]~0.1",
        f"{pitch}=-Nicken[arcsec]~0.06",
        f"{yaw}=Gieren[arcsec]~0.06",
    ]


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("import")
    rng = np.random.default_rng(60)
    for axis in EDGES:
        (folder / f"{axis}.csv").write_text(table(axis, rng))
    named = [
        argument for axis in EDGES for each in mapped(axis) for argument in ("--map", each)
    ]
    tables = [f"linear-{axis}={folder / axis}.csv" for axis in EDGES]
    code, _, refusal = stepdiag(
        "import", *tables, "--map", "position=Ziel[mm]", *named, "--out", folder
    )
    assert code == 0, refusal
    return folder


@pytest.fixture(scope="module")
def result(imported):
    given_files = (
        "--angles",
        imported / "angles.csv",
        "--straightness",
        imported / "straightness.csv",
    )
    code, _, refusal = stepdiag(
        "solve", imported / "readings.csv", *given_files, "--out", imported / "result.json"
    )
    assert code == 0, refusal
    return json.loads((imported / "result.json").read_text())


@pytest.mark.parametrize("name", ["readings", "angles", "straightness"])
def test_a_flipped_bit_of_what_was_imported_is_named(imported, name):
    """40 bits of each file: none becomes another figure, and none is silent."""
    given = {
        each: imported / f"{each}.csv" for each in ("readings", "angles", "straightness")
    }
    rng = np.random.default_rng(7)
    for _ in range(40):
        with flipped(given[name], rng):
            code, _, refusal = stepdiag(
                "solve",
                given["readings"],
                "--angles",
                given["angles"],
                "--straightness",
                given["straightness"],
            )
        assert (code, f"{name}.csv" in refusal) == (3, True), refusal


def test_tables_give_all_functions_as_they_are(result):
    """Of 11 targets and four passes each function is within 2.5 u of the truth nearly everywhere,
    free of what has no zero."""
    near = []
    for axis, edge in EDGES.items():
        for name, function in truth(axis).items():
            found = result["errors"][name]
            at, value = np.array(found["position_mm"]) / edge, np.array(found["value"])
            exact = function(at)
            if name[1] in "XYZ" and name[1] != name[2]:
                exact = exact - np.interp(at, [0.0, 1.0], [function(0.0), function(1.0)])
            near += list(
                np.abs(value - (exact - exact[0]))[1:-1]
                < 2.5 * np.array(found["u"])[1:-1] + 0.02
            )
    assert len(near) == 3 * 6 * 9
    assert np.mean(near) > 0.93


def test_tables_end_in_the_tables_of_a_control(imported, result):
    """Those of position and of the straightness that no squareness folds into: a laser along one
    axis measures no squareness."""
    assert result["squareness"]["C0Y"]["value"] is None
    axis = (
        '[axes.{name}]\nname = "AX{place}"\nstep_mm = 25\nreference_mm = 0\ntravel_mm = [0.0, '
        "{edge}]\n"
    )
    axes = "".join(
        axis.format(name=name.upper(), place=place, edge=EDGES[name])
        for place, name in enumerate(EDGES, start=1)
    )
    (imported / "machine.toml").write_text(
        PROFILE + axes + "[siemens]\nmeasuring_system = 1\n"
    )
    files = imported / "files"
    code, out, refusal = stepdiag(
        "export",
        imported / "result.json",
        "--controller",
        "siemens",
        "--profile",
        imported / "machine.toml",
        "--out",
        files,
    )
    assert code == 0, refusal or out
    code, out, refusal = stepdiag(
        "verify", imported / "result.json", files, "--profile", imported / "machine.toml"
    )
    assert code == 0, refusal or out


def test_each_function_keeps_its_own_uncertainty(imported):
    rows = [
        line.split(",") for line in (imported / "angles.csv").read_text().splitlines()[1:]
    ]
    u = (
        {float(row[5]) for row in rows if row[0] == "x" and row[2]},
        {float(row[5]) for row in rows if row[0] == "x" and row[3]},
    )
    assert min(u[0]) == pytest.approx(0.1 * ARCSEC, abs=0.05)
    assert min(u[1]) == pytest.approx(0.06 * ARCSEC, abs=0.05)


@given(
    st.lists(st.sampled_from(["single", "double", "again"]), min_size=1, max_size=5),
    st.integers(3, 9),
    st.booleans(),
)
def test_passes_are_parted_where_the_axis_turns(turns, count, falls):
    """Whether the turning stop is read once, twice, or the axis goes back to begin again: each pass
    has all targets, odd ones in +."""
    rises = list(range(count))[:: -1 if falls else 1]
    rows, expected, way = list(rises), [list(rises)], 1
    for turn in turns:
        way = way if turn == "again" else -way
        targets = rises[::way]
        rows += targets[1:] if turn == "single" else targets
        expected.append(targets)
    text = "p,e\n" + "\n".join(f"{row},0.5" for row in rows)
    found = parse_run(
        text, "linear-x", columns_named(["position=p[mm]", "EXX=e[um]"]), "t.csv"
    )
    numbers = list(dict.fromkeys(found.number.tolist()))
    assert [
        found.position_mm[found.number == number].tolist() for number in numbers
    ] == expected
    assert all(
        (targets[0] < targets[-1]) == (number % 2 == 1)
        for targets, number in zip(expected, numbers, strict=True)
    )


@pytest.mark.parametrize(
    "option", ["EXX=e[arcsec]", "EAX=e[um]", "EQX=e[um]", "EXX=e", "position=p[um"]
)
def test_a_column_that_is_named_wrongly_is_refused(option):
    with pytest.raises(UsageError):
        columns_named(["position=p[mm]", option])
