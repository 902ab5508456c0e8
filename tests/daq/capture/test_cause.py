"""One cause over a whole pass (rates: `python -m benchmarks.shops`): a few shops of each kind, from
the bytes to the correction."""

from dataclasses import replace
from itertools import product

import pytest

from testkit.cli import stepdiag
from testkit.exact.driven import Fault
from testkit.exact.shops import CAUSES, Shop, corrected, draw, survey_of, surveyed
from testkit.examples import exploring, spread

KINDS = list(CAUSES)
NAMED = (
    "sign",
    "permutation",
    "codes shifted",
    "axis order",
    "laser sign",
    "laser late",
    "plc late",
    "wavelength",
    "diameter",
)
"""What a pass shows."""
SOLVED = (
    "air never",
    "expansion twice",
    "other diagonal",
    *(["air twice"] if exploring() else []),
)
"""What the whole survey shows. Air twice is the line of air never with the other sign."""


def shop_of(cause, again=0, machine="all"):
    """Return a shop of a cause."""
    shops = (draw(KINDS.index(cause) + len(KINDS) * number) for number in range(50))
    return [shop for shop in shops if shop.machine == machine][again]


def corrected_in_place(shop, found, tmp_path):
    """Correct the survey file beside the logs, which stay as they are; return what the command
    prints and the folder of the logs."""
    place = tmp_path / "bench"
    place.mkdir()
    (tmp_path / "recorded" / "logs").rename(place / "0001")
    logs = {path.name: path.read_bytes() for path in (place / "0001").glob("*.mcap")}
    file = tmp_path / "survey.toml"
    file.write_text(corrected(shop, survey_of(shop)), encoding="utf-8")
    told = stepdiag("correct", file, "--name", "somebody", "--yes")
    assert told.code == 0, told.refusal
    assert {path.name: path.read_bytes() for path in (place / "0001").glob("*.mcap")} == logs
    assert stepdiag("correct", file, "--yes").out.startswith("nothing to correct")
    assert (
        f"corrected: {found.wanted} complete passes" in told.out or shop.expands
    )  # which concerns the solver alone
    return place / "0001"


@pytest.mark.parametrize("cause", NAMED)
def test_one_wrong_line_is_named_once_and_corrected_without_driving_again(cause, tmp_path):
    """The line is named by the fifth stop, after two standstills at which the file fails; nothing
    else is raised as an error; and the corrected file finds every pass in the same logs.
    """
    shop = shop_of(cause)
    found = surveyed(shop, tmp_path / "recorded", files=False)
    errors = [
        (after, each)
        for after, each in zip(found.after, found.findings, strict=True)
        if each.severity == "error"
    ]
    assert [
        str(each.message.arguments["line"]).startswith(shop.line) for _, each in errors
    ] == [True]
    assert errors[0][0] <= 5
    corrected_in_place(shop, found, tmp_path)


@pytest.mark.parametrize("cause", SOLVED)
def test_what_the_survey_shows_is_named_before_a_file_is_written_and_corrected(
    cause, tmp_path
):
    """No table of the wrong file reaches a control; the tables of the corrected one leave a tenth
    of the machine's error."""
    shop = shop_of(cause, machine="stopped" if cause == "other diagonal" else "all")
    found = surveyed(shop, tmp_path / "recorded")
    assert found.passes == found.wanted
    assert found.files.after_um is None
    assert [line.startswith(shop.line) for line in found.files.lines] == [True]
    logs = corrected_in_place(shop, found, tmp_path)
    solved = stepdiag("solve", logs, "--out", tmp_path / "again.json")
    assert solved.code == 0, solved.refusal
    assert "step-mismatch" not in (tmp_path / "again.json").read_text(encoding="utf-8")


ORDERS = (
    {"npp": "pnp", "pnp": "npp"},
    {"npp": "pnp", "pnp": "ppn", "ppn": "npp"},
    {"ppp": "ppn", "npp": "ppp", "pnp": "npp", "ppn": "pnp"},
    {"ppp": "npp", "npp": "ppp", "pnp": "ppn", "ppn": "pnp"},
)
TWICE = ({"pnp": "ppn"}, {"ppp": "npp"})
"""Setups whose programs drive other diagonals, and one whose program drives another's."""


def shop_driving(machine, driven, seed):
    """Return a shop of two increments whose programs drive other diagonals than planned."""
    drawn, line = draw(seed), "plc.signals.setup" if machine == "all" else "plan.setups"
    return Shop(
        seed,
        machine,
        "other diagonal",
        size=drawn.size,
        back=drawn.back,
        swapped=tuple(driven.items()),
        line=line,
    )


@pytest.mark.parametrize(
    ("seed", "machine", "driven"),
    spread(
        [
            (seed, *case)
            for seed, case in enumerate(
                product(("stopped", "no positions", "none"), (*ORDERS, *TWICE)), 7010
            )
        ],
        4,
    ),
    ids=str,
)
def test_no_file_of_other_diagonals_is_written(seed, machine, driven, tmp_path):
    """A diagonal that is driven twice has no line: its program drives the wrong one."""
    found = surveyed(shop_driving(machine, driven, seed), tmp_path)
    assert found.files.after_um is None
    assert "step-mismatch" in found.files.codes
    assert found.files.lines == (("plan.setups",) if driven in ORDERS else ())


@pytest.mark.parametrize("driven", spread(ORDERS, 2), ids=str)
def test_positions_show_which_diagonal_is_driven(driven, tmp_path):
    """A machine without setup codes may drive its setups in any sequence."""
    found = surveyed(shop_driving("no codes", driven, 7100), tmp_path)
    assert not [each for each in found.findings if each.severity != "info"]
    assert found.files.after_um < 0.5 * found.files.before_um


@pytest.mark.parametrize("driven", spread(ORDERS, 2), ids=str)
def test_exchanged_codes_are_named_and_corrected_without_driving_again(driven, tmp_path):
    """Where the code of a complete setup was right, the positions name the setups instead."""
    shop = shop_driving("all", driven, 7200)
    found = surveyed(shop, tmp_path / "recorded", files=False)
    (line,) = [
        str(each.message.arguments["line"])
        for each in found.findings
        if each.severity == "error"
    ]
    assert line == ("plc.signals.setup.offset" if "ppp" in driven else "plc.signals.setup")
    corrected_in_place(shop, found, tmp_path)


@pytest.mark.parametrize("again", spread(range(2), 2))
def test_diagonals_with_their_right_names_are_not_exchanged(again, tmp_path):
    """Few readings may agree by chance with other names and less noise than any machine has."""
    found = surveyed(shop_of("nothing", again, machine="stopped"), tmp_path)
    assert found.files.lines == ()
    assert found.files.after_um < 0.5 * found.files.before_um


@pytest.mark.parametrize(
    ("machine", "cause"),
    spread([*product(["all", "stopped"], ["nothing", "rate", "stop bit late"])], 2),
)
def test_a_harmless_statement_has_no_cause(cause, machine, tmp_path):
    """Nothing is named, and nothing is held back for ever."""
    found = surveyed(shop_of(cause, machine=machine), tmp_path, files=False)
    assert not [
        each
        for each in found.findings
        if each.severity != "info" and each.code != "signals-absent"
    ]
    assert found.passes == found.wanted


@pytest.mark.parametrize("machine", ["stopped", "none"])
def test_a_box_that_shows_in_its_third_axis_alone_is_named(machine, tmp_path):
    """The diagonal turns so little that the steps of X and Y fit the file."""
    shop = Shop(
        3,
        machine,
        "other box",
        size=(540.0, 220.0, 250.0),
        driven_size=(540.0, 220.0, 270.0),
        line="volume.size_mm",
    )
    found = surveyed(shop, tmp_path, files=False)
    named = [
        (after, each.message.arguments)
        for after, each in zip(found.after, found.findings, strict=True)
        if each.severity == "error"
    ]
    assert [str(each["line"]) for _, each in named] == [shop.line]
    assert float(str(named[0][1]["value"]).strip("[]").split(", ")[2]) == pytest.approx(
        270.0, abs=0.1
    )
    assert named[0][0] <= 5
    later = {each.code for each in found.findings if each.setup not in ("", "ppp")}
    assert later <= {"no-signals", "signals-absent"}, (
        "what the line explains is not raised again"
    )


def test_two_orders_of_axes_that_make_the_same_steps_are_named_together(tmp_path):
    """Y and Z make the same step, and no register shows which of them moves."""
    shop = replace(
        shop_of("axis order", machine="stopped"),
        size=(280.0, 180.0, 180.0),
        order="zyx",
        back=True,
    )
    found = surveyed(shop, tmp_path, files=False)
    values = [
        each.message.arguments["value"]
        for each in found.findings
        if each.message is not None and "line" in each.message.arguments
    ]
    assert values == ['"yzx" or "zyx"']


@pytest.mark.parametrize("machine", spread(["all", "stopped"], 2))
def test_a_wrong_order_is_named_in_the_line_that_decides_it(machine, tmp_path):
    """The orders of the repeats go before the order of the volume: a new survey states them. The
    file that follows the advice finds every pass in the same logs."""
    shop = shop_of("axis order", machine=machine)
    stated = '[plan]\naxis_orders = ["{}", "xyz"]\n'
    text = survey_of(shop).replace("[plan]\n", stated.format("xyz"), 1)
    found = surveyed(shop, tmp_path / "recorded", text=text, files=False)
    advice = [
        (each.message.arguments["line"], each.message.arguments["value"])
        for each in found.findings
        if each.severity == "error" and "line" in each.message.arguments
    ]
    assert advice == [("plan.axis_orders", f'["{shop.order}"]')]
    right = text.replace(stated.format("xyz"), f'[plan]\naxis_orders = ["{shop.order}"]\n')
    again = surveyed(shop, tmp_path / "right", text=right, files=False)
    assert again.passes == again.wanted
    assert not [each for each in again.findings if each.severity == "error"]


def test_a_program_of_one_order_is_named_where_the_survey_alternates(tmp_path):
    """The first diagonal is driven as stated; the second is not, by its third stop."""
    shop = shop_of("axis order", machine="all")
    text = survey_of(replace(shop, order="xyz", value="xyz"))
    stated = "[plan]\naxis_orders = {}\nalternate_orders = true\n"
    text = text.replace("[plan]\n", stated.format('["xyz", "yzx", "zxy"]'), 1)
    shop = replace(shop, order="xyz", value="xyz")
    found = surveyed(shop, tmp_path / "recorded", text=text, files=False)
    advice = [
        (each.message.arguments["line"], each.message.arguments["value"])
        for each in found.findings
        if each.severity == "error" and "line" in each.message.arguments
    ]
    assert set(advice) == {("plan.axis_orders", '["xyz"]')}
    right = text.replace(stated.format('["xyz", "yzx", "zxy"]'), stated.format('["xyz"]'))
    again = surveyed(shop, tmp_path / "right", text=right, files=False)
    assert again.passes == again.wanted
    assert not [each for each in again.findings if each.severity == "error"]


def test_a_pressure_in_another_unit_is_named_with_its_scale(tmp_path):
    """760 mmHg is no pressure of 760 hPa where [environment] states sea level."""
    shop = next(
        shop
        for number in range(50)
        if (shop := draw(KINDS.index("pressure") + len(KINDS) * number)).value == "mmHg"
    )
    found = surveyed(shop, tmp_path, files=False)
    (first, *_) = [each for each in found.findings if each.code == "conditions-held"]
    assert first.message.arguments["line"] == "plc.signals.air_pressure_hpa.scale"
    assert float(first.message.arguments["value"]) == pytest.approx(0.1333224, rel=1e-5)


@pytest.mark.parametrize(
    ("machine", "back", "again", "setup"),
    spread(
        [
            (machine, back, again, setup)
            for machine in ("stopped", "no positions")
            for back, again in ((False, (1,)), (True, (1,)), (True, (1, 2)))
            for setup in ("ppp", "npp")
        ],
        5,
    ),
)
def test_a_missing_first_stop_is_the_one_cause_of_its_pass(
    machine, back, again, setup, tmp_path
):
    """The machine does not stand at the first stop. The steps are those of a program in the order
    YZX until the pass ends. The pass driven again, alone or with its way back, makes the survey
    whole."""
    shop = replace(
        shop_of("nothing"),
        machine=machine,
        back=back,
        faults=(Fault("skipped", setup, 1, 0, 0),),
        again=((setup, again),),
    )
    found = surveyed(shop, tmp_path, files=False)
    loud = [each for each in found.findings if each.code != "signals-absent"]
    assert [(each.code, each.setup, each.stop) for each in loud] == [("stop-lost", setup, 0)]
    assert loud[0].message.key == "stop-lost.first"
    assert found.passes == found.wanted + len(again) - 1


@pytest.mark.parametrize("back", spread([True, False], 2))
def test_an_order_that_begins_like_a_missing_first_stop_is_named_without_signals(
    back, tmp_path
):
    """The steps of YZX are those of XYZ from the second stop on; the seventh stop tells them
    apart."""
    shop = replace(shop_of("axis order", machine="none"), order="yzx", back=back)
    found = surveyed(shop, tmp_path, files=False)
    assert [
        (after, each.message.arguments["line"])
        for after, each in zip(found.after, found.findings, strict=True)
        if each.severity != "info" and each.code != "no-signals"
    ] == [(7, "volume.axis_order")]


@pytest.mark.parametrize("back", spread([True, False], 2))
def test_a_missing_first_stop_without_signals_leaves_the_next_pass_whole(back, tmp_path):
    shop = replace(
        shop_of("nothing"),
        machine="none",
        back=back,
        faults=(Fault("skipped", "ppp", 1, 0, 0),),
    )
    found = surveyed(shop, tmp_path, files=False)
    loud = [each for each in found.findings if each.code != "no-signals"]
    assert [(each.code, each.setup, each.stop) for each in loud] == [("stop-lost", "ppp", 0)]
    assert found.passes == found.wanted - 1


def test_an_order_of_a_long_pass_is_named_at_its_last_stop(tmp_path):
    """Only the last stop of ten tells the order YZX from a missing first stop."""
    shop = replace(shop_of("axis order", machine="stopped"), order="yzx", back=False)
    found = surveyed(shop, tmp_path, files=False, increments=3)
    (after, named), *more = [
        (after, each)
        for after, each in zip(found.after, found.findings, strict=True)
        if each.severity != "info" and each.code != "signals-absent"
    ]
    assert (after, named.message.arguments["line"]) == (10, "volume.axis_order")
    assert not more


LONGER_Z = replace(
    shop_of("other box"), size=(300.0, 200.0, 150.0), driven_size=(300.0, 200.0, 300.0)
)


@pytest.mark.parametrize(
    ("shop", "line"), [(draw(244), "plc.signals.z_mm.offset"), (LONGER_Z, "volume.size_mm")]
)
def test_two_causes_that_fit_alike_are_separated_by_the_move_that_is_named(
    shop, line, tmp_path
):
    """A shifted Z may count the other way round, and a longer Z shortens the laser's steps along X
    and Y, until Z moves."""
    found = surveyed(shop, tmp_path, files=False)
    (after, alike), (then, named), *_ = [
        (after, each)
        for after, each in zip(found.after, found.findings, strict=True)
        if each.message is not None and "stops" in each.message.arguments
    ]
    assert (
        after,
        alike.message.key,
        alike.message.arguments["axis"],
        alike.message.arguments["stop"],
    ) == (
        3,
        "step-mismatch.alike",
        "Z",
        3,
    )
    assert (then, named.message.arguments["line"]) == (4, line)
