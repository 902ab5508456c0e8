"""Another plan in a survey file: what a person wrote around it stays, and what cannot be written is
refused."""

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.survey.amended import extends, with_plan
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.models import BeamOffset, Plan
from stepdiag.daq.survey.template import template
from testkit.running.survey_files import SMALLEST

BARE = SMALLEST.lstrip()
SPREAD = f"""{BARE}[plan]
setups = [
  "ppp", # first
  "npp",
]
[[plan.beam_offset]]
setup = "npp"
offset_mm = [0.0, 0.0, 40.0]

[plc]
port = 503
"""
PLANS = st.builds(
    lambda setups, repeats, back, shifted: Plan(
        setups=tuple(setups),
        repeats=repeats,
        return_pass=back,
        beam_offset=tuple(
            BeamOffset(setup=setup, offset_mm=(0.0, at, 0.0)) for setup, at in shifted
        ),
    ),
    st.lists(
        st.sampled_from(["ppp", "npp", "pnp", "ppn", "linear-x", "linear-y"]),
        min_size=1,
        unique=True,
    ),
    st.integers(1, 5),
    st.booleans(),
    st.lists(
        st.tuples(st.sampled_from(["ppp", "ppn"]), st.sampled_from([40.0, -0.5])), max_size=3
    ),
)


@pytest.mark.parametrize("text", [template(), BARE, SPREAD, BARE.rstrip("\n")])
@settings(max_examples=40)
@given(plan=PLANS)
def test_the_plan_is_the_one_given_and_all_else_is_as_it_was(text: str, plan: Plan) -> None:
    before = parse_survey(text, "survey.toml")
    plan = msgspec.structs.replace(
        before.plan,
        **{
            name: getattr(plan, name)
            for name in ("setups", "repeats", "return_pass", "beam_offset")
        },
    )
    amended = with_plan(text, plan, "survey.toml")
    assert parse_survey(amended, "survey.toml") == msgspec.structs.replace(before, plan=plan)
    assert with_plan(amended, plan, "survey.toml") == amended
    remarks = [line for line in text.splitlines() if line.startswith("#")]
    assert [line for line in amended.splitlines() if line.startswith("#")] == remarks


def test_what_the_survey_cannot_hold_is_refused() -> None:
    """A run of a head that is not there; a plan in a form that no line can be changed of."""
    with pytest.raises(UsageError, match="fourdof-x"):
        with_plan(BARE, Plan(setups=("ppp", "fourdof-x")), "survey.toml")
    inline = 'plan = { setups = ["ppp"] }\n' + BARE
    with pytest.raises(UsageError, match="plan"):
        with_plan(inline, Plan(setups=("ppp", "npp")), "survey.toml")


FACES = with_plan(BARE, Plan(setups=("ppp", "face-xy-pp", "linear-x")), "survey.toml")


@pytest.mark.parametrize(
    ("changes", "goes_on"),
    [
        ({}, True),
        ({"setups": ("ppp", "face-xy-pp", "linear-x", "face-yz-pp")}, True),
        ({"beam_offset": (BeamOffset(setup="linear-x", offset_mm=(0.0, 100.0, 0.0)),)}, True),
        # the machine shows 102 for the face that was driven as 101
        ({"setups": ("body-ppp", "ppp", "face-xy-pp", "linear-x")}, False),
        ({"setups": ("ppp", "face-xy-pp")}, False),
        ({"setups": ("ppp", "face-xy-pp", "linear-x", "linear-y"), "repeats": 2}, False),
    ],
)
def test_logs_go_on_with_further_setups_alone(
    changes: dict[str, object], goes_on: bool
) -> None:
    plan = msgspec.structs.replace(parse_survey(FACES, "survey.toml").plan, **changes)
    assert extends(with_plan(FACES, plan, "survey.toml"), FACES) is goes_on
