"""A real control drives the programs of `exporters.programs`: it stands where they say, and waits
for its answer."""

import socket
import struct
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.setups import setup_code
from stepdiag.base.volume import Volume
from stepdiag.exporters.programs import Sequence, nc_programs, passes_of
from testkit.linuxcnc.rig import Control, State, linuxcnc
from testkit.linuxcnc.standing import stands

pytestmark = [pytest.mark.system, pytest.mark.control]

VOLUME = Volume(
    origin_mm=(-200.0, -100.0, -150.0), size_mm=(400.0, 200.0, 150.0), increments=2
)
SWIFT = Sequence(name="rig", volume=VOLUME, feed_mm_min=90000.0, dwell_s=0.1, overrun_mm=5.0)


@pytest.fixture(scope="class")
def control() -> Iterator[Control]:
    with linuxcnc(swift=True) as control:
        yield control


class TestPrograms:
    """The programs on a control without any compensation."""

    def test_the_control_stands_exactly_where_the_survey_commands(
        self, control: Control
    ) -> None:
        """Every stop of outward and return pass, with its setup and counter, in position, and
        nothing left on afterwards."""
        sequence = replace(SWIFT, setups=("npp", "linear-z"))
        for program in nc_programs(sequence, "linuxcnc"):
            driven = stands(control, program.data)
            wanted = [
                stop for each in passes_of(sequence, program.setup) for stop in each.stops
            ]
            assert [state.count for state in driven] == [stop.count for stop in wanted]
            assert {state.setup for state in driven} == {
                setup_code(program.setup, SWIFT.setups)
            }
            assert all(state.in_position for state in driven)
            positions = [stop.position_mm for stop in wanted]
            np.testing.assert_allclose(
                [state.commanded_mm for state in driven], positions, rtol=0, atol=1e-6
            )
            after = control.wait_for(lambda state: not state.running)
            assert (after.setup, after.stopped) == (0, False)

    def test_the_handshake_holds_the_control(self, control: Control) -> None:
        """Without the answer the control stays at its first stop; each answer, written over Modbus,
        lets it go on to the next."""
        sequence = replace(
            SWIFT,
            volume=replace(VOLUME, increments=1),
            setups=("linear-x",),
            return_pass=False,
            handshake=True,
        )
        program = nc_programs(sequence, "linuxcnc")[0].data
        with socket.create_connection(("127.0.0.1", control.plc_port)) as plc:
            since_ns: dict[int, int] = {}
            answered: list[int] = []

            def answer(state: State) -> None:
                if not state.stopped or state.count in answered:
                    return
                if (
                    state.time_ns - since_ns.setdefault(state.count, state.time_ns)
                    > 500_000_000
                ):
                    answered.append(state.count)
                    plc.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 6, 100, state.count))

            control.on_state = answer
            control.run(program)
        assert answered == [1, 2]

    def test_the_head_is_commissioned_at_the_places_of_the_program(
        self, control: Control, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The control stands at five places of each other axis at both ends without a word to the
        PLC, and at the run's stops with one."""
        for name, seconds in (("JOG_S", 0.4), ("WOBBLE_S", 0.6), ("DARK_S", 0.4)):
            monkeypatch.setattr(f"stepdiag.exporters.programs.jogs.{name}", seconds)
        sequence = replace(SWIFT, setups=("fourdof-x",), return_pass=False, commission=True)
        (program,) = nc_programs(sequence, "linuxcnc")
        stood: dict[tuple[float, ...], list[int]] = {}

        def watch(state: State) -> None:
            if state.in_position and not state.stopped and state.setup == 21:
                stood.setdefault(tuple(np.round(state.commanded_mm, 4)), []).append(
                    state.time_ns
                )

        control.on_state = watch
        control.run(program.data)
        places = {
            place for place, times in stood.items() if times[-1] - times[0] > 250_000_000
        }
        for x in (-200.0, 200.0):
            wanted = {
                (x, -100.0 + beside, -150.0) for beside in (-0.3, -0.15, 0.0, 0.15, 0.3)
            }
            wanted |= {(x, -100.0, -150.0 + beside) for beside in (-0.3, -0.15, 0.15, 0.3)}
            assert {tuple(np.round(place, 4)) for place in wanted} <= places
