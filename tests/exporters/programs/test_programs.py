"""NC programs: a reader that knows nothing of the writer finds exactly the commanded stops, in
every dialect."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.names import BODY_DIAGONALS, SETUP_NUMBERS
from stepdiag.base.volume import Volume
from stepdiag.exporters.programs import (
    CONTROLS,
    Sequence,
    Signals,
    default_decimals,
    default_signals,
    nc_programs,
    program_name,
)
from stepdiag.exporters.programs.settings import program_section, program_template
from testkit.exact.nc import RefusedError, Walk, walk_program
from testkit.stops import diagonal_stops_mm, linear_stops_mm

VOLUME = Volume(origin_mm=(-100.0, 0.0, -300.0), size_mm=(500.0, 400.0, 300.0), increments=4)
PLAIN = Sequence(name="hall 3", volume=VOLUME)
REGISTER = {name: number for number, name in SETUP_NUMBERS.items()}


def walks(sequence: Sequence, control: str, **how: object) -> dict[str, Walk]:
    return {
        program.setup: walk_program(program.data, control)
        for program in nc_programs(sequence, control, **how)
    }


def commanded(sequence: Sequence, setup: str) -> np.ndarray:
    """The stops of all passes of a setup, by the solver's geometry."""
    base = setup.partition("+")[0]
    out = (
        diagonal_stops_mm(sequence.volume, base, sequence.axis_order)
        if base in BODY_DIAGONALS
        else linear_stops_mm(sequence.volume, base)
    )
    there_and_back = [out, out[::-1]] if sequence.return_pass else [out]
    return np.concatenate(there_and_back * sequence.repeats)


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize(
    ("repeats", "named"),
    [(1, b"axis order yzx"), (2, b"axis order yzx zxy"), (3, b"yzx zxy xyz")],
)
def test_a_program_names_the_orders_that_it_drives(control, repeats, named):
    sequence = replace(
        PLAIN,
        setups=("ppp",),
        repeats=repeats,
        axis_orders=("yzx", "zxy", "xyz"),
        overrun_mm=0.0,
    )
    (program,) = nc_programs(sequence, control)
    (line,) = [line for line in program.data.splitlines() if b"axis order" in line.lower()]
    assert line.lower().strip(b" ;)\r").endswith(named)


sequences = st.builds(
    Sequence,
    name=st.sampled_from(["hall 3", "VF-2 (old) #4", "Fräse"]),
    volume=st.builds(
        lambda low, step, n: Volume(
            origin_mm=low, size_mm=tuple(n * each for each in step), increments=n
        ),
        st.tuples(*[st.integers(-900, 900).map(float)] * 3),
        st.tuples(*[st.integers(1, 80_000).map(lambda um: um / 1000)] * 3),
        st.integers(1, 5),
    ),
    setups=st.lists(
        st.sampled_from([*REGISTER, "ppp+1", "npp+12"]), min_size=1, max_size=4, unique=True
    ).map(tuple),
    axis_order=st.permutations("xyz").map("".join),
    return_pass=st.booleans(),
    repeats=st.integers(1, 2),
    feed_mm_min=st.sampled_from([100.0, 2000.0, 1234.5]),
    dwell_s=st.sampled_from([0.5, 2.0, 10.0]),
    overrun_mm=st.sampled_from([0.0, 5.0, 0.25]),
)


@pytest.mark.parametrize("control", CONTROLS)
@settings(max_examples=10)
@given(sequence=sequences)
def test_the_program_stops_exactly_where_the_survey_commands(
    control: str, sequence: Sequence
) -> None:
    """Same positions to the last digit, right setup number, counter +1 at every stop through the
    whole survey."""
    count = 0
    for setup, walk in walks(sequence, control).items():
        stops = commanded(sequence, setup)
        np.testing.assert_allclose(
            [stand.position for stand in walk.stands], stops, rtol=0, atol=1e-9
        )
        assert [stand.count for stand in walk.stands] == list(
            range(count + 1, count + 1 + len(stops))
        )
        assert {stand.setup for stand in walk.stands} == {REGISTER[setup.partition("+")[0]]}
        assert {stand.dwell_s for stand in walk.stands} == {sequence.dwell_s}
        assert walk.feeds == {sequence.feed_mm_min}
        count += len(stops)


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("setup", ["pnp", "linear-y"])
def test_every_stop_of_a_pass_is_approached_from_one_side(control: str, setup: str) -> None:
    """Within a pass no axis ever turns round, its first stop included: the backlash of every moving
    axis is taken up."""
    walk = walks(replace(PLAIN, setups=(setup,), repeats=2), control)[setup]
    stops = [stand.position for stand in walk.stands]
    length = len(stops) // 4
    assert len(walk.path) == len(stops) + 4  # one approach a pass, and nothing else moves
    for number in range(4):
        driven = np.array(walk.path[number * (length + 1) : (number + 1) * (length + 1)])
        steps = np.diff(driven, axis=0)
        travel = np.sign(driven[-1] - driven[1])
        assert (steps * travel >= 0).all()
        np.testing.assert_allclose(steps[0], 5.0 * travel)


LEFT = [
    ("fanuc", {"#5021": 100.0, "#5041": 87.5}, "WORK IS NOT MACHINE POS"),
    ("fanuc", {"#5043": 0.01}, "WORK IS NOT MACHINE POS"),
    ("fanuc", {"#4016": 68.0}, "G68 ROTATION IS ACTIVE"),
    ("fanuc", {"#4016": 68.2}, "G68 ROTATION IS ACTIVE"),
    ("fanuc", {"#4011": 51.0}, "G51 SCALING IS ACTIVE"),
    ("fanuc", {"#4022": 51.1}, "G51.1 MIRROR IS ACTIVE"),
    (
        "siemens",
        {"$AA_IM2": 250.0, "$AA_IB2": 249.0},
        "Stopped: machine and basic position differ, a transformation is active",
    ),
    (
        "heidenhain",
        {"ID210 NR6": -1.0},
        "stopped: the working plane is tilted, PLANE RESET first",
    ),
    ("heidenhain", {"ID280 NR1": -1.0}, "stopped: M128 is active, M129 first"),
    (
        "heidenhain",
        {"ID210 NR2": 12.5},
        "stopped: a rotation is active, reset cycle 10 first",
    ),
    (
        "heidenhain",
        {"ID210 NR3": 1.0},
        "stopped: a mirror image is active, reset cycle 8 first",
    ),
    (
        "heidenhain",
        {"ID210 NR4 IDX3": 0.5},
        "stopped: a scaling is active, reset cycle 11 first",
    ),
]


@pytest.mark.parametrize(("control", "left", "words"), LEFT)
def test_what_was_left_active_stops_the_program_by_name_before_the_first_move(
    control: str, left: dict[str, float], words: str
) -> None:
    """A rotation, a shift, a transformation: the axes would drive elsewhere than the survey
    says."""
    (program,) = nc_programs(replace(PLAIN, setups=("ppp",)), control)
    with pytest.raises(RefusedError, match=re.escape(words)):
        walk_program(program.data, control, left)


@pytest.mark.parametrize(
    ("control", "checks"), [("fanuc", 4), ("siemens", 1), ("heidenhain", 7), ("linuxcnc", 0)]
)
def test_a_program_says_what_it_checks_and_what_it_cannot_see(
    control: str, checks: int
) -> None:
    """Once a program, and the header has it in words; offsets that a block leaves out by itself
    stop nothing."""
    harmless = {"fanuc": {"#5021": 12.5, "#5041": 12.5}, "siemens": {"$AA_IW1": 12.5}}.get(
        control, {}
    )
    (program,) = nc_programs(replace(PLAIN, setups=("ppp",)), control)
    walk = walk_program(program.data, control, harmless)
    assert walk.checks == checks
    header = " ".join(walk.comments[:20]).lower()
    assert "it does not see" in header
    assert ("stops by name" in header) == bool(checks)


@pytest.mark.parametrize("control", CONTROLS)
def test_comments_say_setup_pass_stop_and_axis(control: str) -> None:
    """The comment before each stop names it in words; the header says how far the axes travel,
    overrun included."""
    walk = walks(replace(PLAIN, setups=("npp",)), control)["npp"]
    said = [comment.lower().replace(" -", ":") for comment in walk.stand_comments]
    assert said[:3] == [
        "npp pass 1 stop 1 of 13: first stop",
        "npp pass 1 stop 2 of 13: x moves",
        "npp pass 1 stop 3 of 13: y moves",
    ]
    assert said[14] == "npp pass 2 stop 2 of 13: z moves"
    assert any("x from -105 to 405" in comment.lower() for comment in walk.comments)


@pytest.mark.parametrize("control", CONTROLS)
def test_the_handshake_holds_every_stop_until_its_counter_is_captured(control: str) -> None:
    """The wait stands inside the dwell, before ``stopped`` goes off."""
    heidenhain = Signals(
        begin="FN 20: WAIT FOR SYNC\nFN 19: PLC=+{setup}/+0",
        stand="FN 20: WAIT FOR SYNC\nFN 19: PLC=+{setup}/+{count}",
        leave="FN 20: WAIT FOR SYNC\nFN 19: PLC=+{setup}/+0",
        wait="FN 20: WAIT FOR W100=={count}",
        end="FN 20: WAIT FOR SYNC\nFN 19: PLC=+0/+0",
    )
    signals = heidenhain if control == "heidenhain" else None
    walk = walks(replace(PLAIN, setups=("ppp",), handshake=True), control, signals=signals)[
        "ppp"
    ]
    assert all(stand.waited for stand in walk.stands)
    assert not any(stand.waited for stand in walks(PLAIN, control)["ppp"].stands)


@pytest.mark.parametrize(
    ("control", "names"),
    [
        ("fanuc", ["O8001", "O8002", "O8101", "O8011"]),
        ("siemens", ["STEP_PPP.MPF", "STEP_NPP.MPF", "STEP_PPP_1.MPF", "STEP_LINEAR_X.MPF"]),
        ("heidenhain", ["STEP_PPP.H", "STEP_NPP.H", "STEP_PPP_1.H", "STEP_LINEAR_X.H"]),
        ("linuxcnc", ["step_ppp.ngc", "step_npp.ngc", "step_ppp_1.ngc", "step_linear_x.ngc"]),
    ],
)
def test_the_operator_is_told_the_name_that_the_file_has(
    control: str, names: list[str]
) -> None:
    """Issue 7 sends the operator to program O8002 for npp."""
    sequence = replace(PLAIN, setups=("ppp", "npp", "ppp+1", "linear-x"))
    assert [program.name for program in nc_programs(sequence, control)] == names
    assert [program_name(sequence, control, setup) for setup in sequence.setups] == names


def test_a_position_that_the_control_would_round_is_refused() -> None:
    """400 mm in 7 increments lies between the microns of a Fanuc: the axis would stand up to 0.5 µm
    beside the solver's stop."""
    sequence = replace(PLAIN, volume=replace(VOLUME, increments=7))
    with pytest.raises(
        UsageError, match=r"\(ppp\), stop 2, x.*whole input increments of 0\.001 mm"
    ):
        nc_programs(sequence, "fanuc")
    fine = replace(PLAIN, volume=replace(VOLUME, size_mm=(500.0, 400.0, 300.0004)))
    with pytest.raises(UsageError, match=r"axis|z"):
        nc_programs(fine, "fanuc")
    assert nc_programs(fine, "fanuc", decimals=4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"feed_mm_min": 0.0}, r"plan\.feed_mm_min: expected a number above 0, found 0\.0"),
        ({"dwell_s": float("nan")}, r"plan\.dwell_s: expected a number above 0, found nan"),
        (
            {"overrun_mm": -1.0},
            r"plan\.overrun_mm: expected a number of 0 or above, found -1\.0",
        ),
        ({"repeats": 0}, r"plan\.repeats: expected 1 or more, found 0"),
        (
            {"axis_order": "xxy"},
            r"volume\.axis_order: expected each of x, y, z once, found 'xxy'",
        ),
        (
            {"setups": ("ppq",)},
            r"plan\.setups: expected one of ppp, .*, found 'ppq'; did you mean 'ppp'",
        ),
        (
            {"setups": ("ppp", "ppp")},
            r"plan\.setups: expected at least one setup, no setup twice",
        ),
        ({"setups": ()}, r"plan\.setups: .*found none"),
        ({"repeats": 400}, r"plan: expected at most 32767 stops"),
    ],
)
def test_a_sequence_that_cannot_be_driven_is_refused(
    change: dict[str, object], message: str
) -> None:
    """By field, with what was found and expected, whichever control is asked."""
    with pytest.raises(UsageError, match=message):
        nc_programs(replace(PLAIN, **change), "siemens")


def test_what_only_the_builder_knows_is_asked() -> None:
    """The PLC operand of Heidenhain's wait has no default; an unknown control and an unknown
    placeholder are named."""
    with pytest.raises(
        UsageError, match=r"heidenhain: program\.wait: expected the block that waits"
    ):
        nc_programs(replace(PLAIN, handshake=True), "heidenhain")
    with pytest.raises(
        UsageError,
        match=r"controller: expected one of fanuc, siemens, heidenhain, linuxcnc, found 'okuma'",
    ):
        nc_programs(PLAIN, "okuma")
    with pytest.raises(
        UsageError,
        match=r"program\.stand: expected only \{count\} and \{setup\}, found \{stop\}",
    ):
        Signals(begin="", stand="M{stop}", leave="", wait="", end="")
    with pytest.raises(UsageError, match=r"program\.begin: expected text with"):
        Signals(begin="M{setup", stand="", leave="", wait="", end="")


@pytest.mark.parametrize("control", CONTROLS)
def test_the_template_of_the_section_states_the_defaults(control: str) -> None:
    """Uncommented and read back it gives the same program; a machine changes the lines it needs
    otherwise."""
    template = program_template(default_signals(control), default_decimals(control))
    stated = re.sub(r"^# (?=\[program\]|[a-z]+ = )", "", template, flags=re.MULTILINE)
    section = program_section(stated, "p.toml", control)
    assert section.decimals == default_decimals(control)
    signals = section.signals(Signals(begin="", stand="", leave="", wait="", end=""))
    assert nc_programs(PLAIN, control, signals=signals) == nc_programs(PLAIN, control)


def test_a_machine_says_how_its_plc_is_told() -> None:
    """M functions instead of macro outputs: they stand where the default's blocks stood, and the
    header says whose they are."""
    text = '[program]\nbegin = "M{setup}"\nstand = "M80"\nleave = "M81"\nend = "M82"\n'
    signals = program_section(text, "p.toml", "fanuc").signals(default_signals("fanuc"))
    program = nc_programs(replace(PLAIN, setups=("npp",)), "fanuc", signals=signals)[
        0
    ].data.decode()
    assert program.count("\r\nM80\r\nG04 X2.\r\nM81\r\n") == 26
    assert "#1133" not in program
    assert "AS THE PROFILE OF THIS MACHINE STATES THEM" in program
    for wrong, message in (
        (
            'stop = "M80"',
            (
                r"p\.toml: program\.stop: expected one of begin, decimals, end, leave, stand, "
                r"wait, "
                r"found the unknown name stop"
            ),
        ),
        ("stand = 80", r"p\.toml: program\.stand: expected "),
        (
            'stand = "M{axis}"',
            r"program\.stand: expected only \{count\} and \{setup\}, found \{axis\}",
        ),
    ):
        with pytest.raises(UsageError, match=message):
            program_section(f"[program]\n{wrong}", "p.toml", "fanuc").signals(
                default_signals("fanuc")
            )


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("n", [1, 4])
def test_a_run_that_commissions_the_head_jogs_at_both_ends_and_stops_where_it_did(
    control: str, n: int
) -> None:
    """Stops, counters and setup are those of the plain run; five places of each other axis, all
    come to from below, at both ends."""
    plain = replace(
        PLAIN, volume=replace(VOLUME, increments=n), setups=("fourdof-y", "fourdof-x")
    )
    before, after = (
        walks(replace(plain, commission=commission), control) for commission in (False, True)
    )
    for setup, axis in (("fourdof-x", 0), ("fourdof-y", 1)):
        assert after[setup].stands == before[setup].stands
        path = np.array(after[setup].path)
        beside = np.round(path - np.array(VOLUME.origin_mm), 6)
        others = [other for other in range(3) if other != axis]
        for end in (0.0, VOLUME.size_mm[axis]):
            here = beside[beside[:, axis] == end][:, others]
            for across in range(2):
                places = here[(here[:, 1 - across] == 0.0) & (here[:, across] != 0.0)][
                    :, across
                ]
                assert places.tolist() == [-0.3, -0.15, 0.15, 0.3]
        sideways = np.diff(beside[:, others], axis=0)
        to_lead = (beside[1:, others] == -0.4).all(axis=1)
        assert (sideways[~to_lead] >= 0.0).all()
        assert np.count_nonzero(to_lead) == 6


@pytest.mark.parametrize("control", CONTROLS)
def test_the_operator_is_asked_to_wobble_twice_and_to_block_the_beam_once(
    control: str,
) -> None:
    (program,) = nc_programs(replace(PLAIN, setups=("fourdof-z",), commission=True), control)
    said = program.data.decode().lower()
    assert [
        said.count(words)
        for words in ("wobble the pointing", "block the beam", "free the beam")
    ] == [2, 1, 1]
    (plain,) = nc_programs(replace(PLAIN, setups=("ppp",), commission=True), control)
    assert plain.data == nc_programs(replace(PLAIN, setups=("ppp",)), control)[0].data


def test_jogs_beyond_the_travel_are_refused() -> None:
    limits = {"x": (-100.2, 500.0), "y": (-10.0, 500.0), "z": (-310.0, 10.0)}
    nc_programs(replace(PLAIN, setups=("fourdof-y",)), "siemens", travel_mm=limits)
    with pytest.raises(SafetyError, match=r"-100\.4"):
        nc_programs(
            replace(PLAIN, setups=("fourdof-y",), commission=True),
            "siemens",
            travel_mm=limits,
        )
