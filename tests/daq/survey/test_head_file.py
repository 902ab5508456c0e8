"""The calibration file of a head: the same bytes back, fields refused by name, never another
head's."""

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError, UsageError
from stepdiag.daq.survey.file import load_survey, parse_survey
from stepdiag.daq.survey.head_file import (
    CALIBRATED,
    AxisTable,
    CrosstalkTable,
    DetectorTable,
    HeadFile,
    HeadIdentity,
    LeverTable,
    LightTable,
    Measured,
    UncertaintyTable,
    parse_head_file,
    render_head_file,
    require_measured,
    require_owner,
)
from testkit.exact.heads import head_file, survey_section, write_head_file
from testkit.timeline import survey_text

number = st.floats(-1e6, 1e6)
axis = st.builds(
    AxisTable,
    sign=st.sampled_from([1, -1]),
    kind=st.sampled_from(["polynomial", "erf"]),
    coefficients_um=st.lists(number, min_size=1, max_size=6).map(tuple),
    low=st.floats(-1.0, -0.1),
    high=st.floats(0.1, 1.0),
    u_um=st.floats(0, 10),
)
detector = st.builds(
    DetectorTable, x=axis, y=axis, sum_min=st.floats(0, 1e6), rotation_mrad=number
)


texts = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cs"], exclude_characters="\0")
)
"""No command line can hold a NUL, and no settings file may."""


@given(qd=detector, psd2=detector, dead=number, reference=texts)
def test_what_is_written_is_read(qd, psd2, dead, reference):
    identity = HeadIdentity(
        id="4D 7", format="fourdof", date="2026-02-28", reference=reference
    )
    file = head_file(
        head=identity,
        qd=qd,
        psd2=psd2,
        lever=LeverTable(dead_path_mm=dead),
        crosstalk=CrosstalkTable(psd1_leak=(0.1, -2.0)),
    )
    text = render_head_file(file)
    assert parse_head_file(text.encode("utf-8"), "head.toml") == file
    assert render_head_file(parse_head_file(text.encode("utf-8"), "head.toml")) == text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'date = "2026-03-31"',
            'date = "2026-02-30"',
            'head.toml: head.date: expected a day such as "2026-03-31", found 2026-02-30',
        ),
        ('date = "2026-03-31"', 'date = "yesterday"', "head.toml: head.date"),
        ("sign = 1", "sign = 0", "head.toml: qd.x.sign"),
        ("low = -0.9", "low = 0.95", "head.toml: qd.x.high: expected a value above low"),
        ("[qd.x]", "[qd.X]", "head.toml: qd.X: expected one of"),
        ('id = "4D-001"', 'id = ""', "head.toml: head.id"),
        ("[head]", "[head", "head.toml: expected TOML"),
    ],
)
def test_a_wrong_field_is_named(old, new, message):
    text = render_head_file(head_file())
    assert old in text
    with pytest.raises(UsageError) as refused:
        parse_head_file(text.replace(old, new, 1).encode(), "head.toml")
    assert message in str(refused.value)


def section(**changes):
    survey = parse_survey(
        survey_text(setups=("fourdof-z",), signals=survey_section("/dev/null1")),
        "survey.toml",
    )
    return msgspec.structs.replace(survey.head, **changes)


def test_the_file_of_another_head_is_refused():
    """Its curves would give numbers that look right."""
    require_owner(head_file(), section(), "head.toml")
    with pytest.raises(
        DataError,
        match=r"head.toml: head.id: expected '4D-002', the head of the survey, found '4D-001'",
    ):
        require_owner(head_file(), section(id="4D-002"), "head.toml")
    with pytest.raises(DataError, match=r"head.toml: head.format: expected 'tqd'"):
        require_owner(head_file(), section(format="tqd"), "head.toml")


def test_a_survey_with_the_file_of_another_head_is_refused_before_it_is_driven(tmp_path):
    (tmp_path / "survey.toml").write_text(
        survey_text(
            setups=("fourdof-z",), signals=survey_section("/dev/null1", name="4D-002")
        )
    )
    write_head_file(tmp_path / "head.toml")
    with pytest.raises(DataError, match=r"head.toml: head.id: expected '4D-002'"):
        load_survey(tmp_path / "survey.toml")
    write_head_file(
        tmp_path / "head.toml",
        head=HeadIdentity(id="4D-002", format="fourdof", date="2026-03-31"),
    )
    assert load_survey(tmp_path / "survey.toml").head.id == "4D-002"


def test_a_run_of_the_head_needs_its_calibration_and_a_stand_that_can_be():
    def refusal(head):
        with pytest.raises(UsageError) as refused:
            parse_survey(survey_text(setups=("fourdof-z",), signals=head), "survey.toml")
        return str(refused.value)

    assert "head.calibration: expected the head's id and calibration file" in refusal(
        survey_section("/dev/null1", name="")
    )
    wrong = '[head.z]\nbeam = "+x"\ndetector_x = "+x"\ndetector_y = "+y"\n'
    assert 'head.z.beam: expected +z or -z, found "+x"' in refusal(
        survey_section("/dev/null1", rest=wrong)
    )
    twice = '[head.z]\nbeam = "-z"\ndetector_x = "+x"\ndetector_y = "-x"\n'
    assert (
        "head.z: expected beam, detector_x and detector_y along three different axes"
        in refusal(survey_section("/dev/null1", rest=twice))
    )


fields = st.fixed_dictionaries(
    {},
    optional={
        "qd": st.builds(
            DetectorTable,
            x=st.none() | axis,
            rotation_mrad=st.none() | number,
            dark=st.none() | st.tuples(number, number, number),
        ),
        "lever": st.builds(LeverTable, dead_path_mm=number),
        "light": st.builds(
            LightTable,
            sums=st.tuples(*[st.floats(1e-3, 1e6)] * 3),
            within=st.floats(1e-3, 0.5),
        ),
        "crosstalk": st.builds(
            CrosstalkTable, psd1_leak=st.none() | st.tuples(number, number)
        ),
        "measured": st.dictionaries(
            st.sampled_from(CALIBRATED),
            st.just(Measured(by="fourdof commission", on="2026-11-26")),
        ),
        "uncertainty": st.just(
            UncertaintyTable(of=("a", "b"), u=(0.5, 2.0), correlation=(-0.25,))
        ),
    },
)


@given(fields)
def test_a_file_with_fields_absent_is_read_as_it_was_written(given_fields):
    file = HeadFile(
        head=HeadIdentity(id="4D-9", format="fourdof", date="2026-11-26", version=2),
        **given_fields,
    )
    assert parse_head_file(render_head_file(file).encode(), "head.toml") == file
    absent = file.absent()
    assert ("lever" in absent) == (file.lever is None)
    assert ("qd.x" in absent) == (file.qd.x is None)
    assert ("crosstalk.psd1_leak" in absent) == (file.crosstalk.psd1_leak is None)
    with pytest.raises(DataError, match="next: `stepdiag fourdof commission`"):
        require_measured(file, "head.toml")


def test_a_file_of_before_has_every_field_and_does_not_state_what_measured_it():
    file = parse_head_file(render_head_file(head_file()).encode(), "head.toml")
    assert (file.absent(), file.measured) == ([], {})
    require_measured(file, "head.toml")
    with pytest.raises(
        DataError,
        match=r"psd1\.y.*found no measurement of psd1\.y; next: `stepdiag fourdof commission`",
    ):
        require_measured(file.with_axis("psd1", "y", None), "head.toml")


@pytest.mark.parametrize(
    "changes",
    [
        {"lever": LeverTable(dead_path_mm=30.0, scale=-0.9995)},
        {"qd": DetectorTable(x=AxisTable(low=-1.5))},
        {"psd1": DetectorTable(y=AxisTable(coefficients_um=(0.0, float("nan"))))},
        {"uncertainty": UncertaintyTable(of=("lever",), u=())},
    ],
)
def test_what_the_reader_refuses_is_never_written(tmp_path, changes):
    with pytest.raises(UsageError):
        write_head_file(tmp_path / "head.toml", **changes)
    assert not list(tmp_path.iterdir())


def test_uncertainties_and_correlations_make_a_covariance():
    table = UncertaintyTable(
        of=("a", "b", "c"), u=(1.0, 2.0, 3.0), correlation=(0.5, 0.0, -1.0)
    )
    assert table.covariance().tolist() == [
        [1.0, 1.0, 0.0],
        [1.0, 4.0, -6.0],
        [0.0, -6.0, 9.0],
    ]


def test_floats_of_numpy_are_written_as_numbers():
    """One distance gives the slope's share a float of numpy, whose repr names its type: no file was
    written."""
    file = head_file()
    lever = msgspec.structs.replace(
        file.lever,
        scale=np.float64(1.0),
        u_mm=np.float64(0.25),
        u_scale=np.float64(0.05) / 3**0.5,
    )
    again = parse_head_file(
        render_head_file(msgspec.structs.replace(file, lever=lever)).encode(), "head.toml"
    )
    assert again.lever == lever
