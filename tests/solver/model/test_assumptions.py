"""Usual sizes by class of machine: one table, from which the defaults come."""

import math
from dataclasses import asdict

import pytest

from stepdiag.base.conditions.assumptions import CLASSES, FEEDBACKS, Assumptions, usual_sizes


def test_an_ordinary_machine_with_screws_is_the_default():
    defaults = asdict(Assumptions())
    assert {name: defaults[name] for name in usual_sizes()} == usual_sizes()


def test_every_class_states_the_same_sizes():
    assert {frozenset(sizes) for sizes in CLASSES.values()} == {
        frozenset(CLASSES["ordinary"])
    }
    assert {frozenset(sizes) for sizes in FEEDBACKS.values()} == {frozenset(CLASSES)}


@pytest.mark.parametrize("feedback", FEEDBACKS)
def test_a_worse_class_has_larger_sizes(feedback):
    good, ordinary, poor = (usual_sizes(machine, feedback) for machine in CLASSES)
    assert all(0 < good[name] < ordinary[name] < poor[name] < math.inf for name in good)


@pytest.mark.parametrize("machine", CLASSES)
def test_a_scale_leaves_smaller_waves_than_a_screw(machine):
    assert (
        usual_sizes(machine, "scale")["between_um"]
        < usual_sizes(machine, "screw")["between_um"]
    )
