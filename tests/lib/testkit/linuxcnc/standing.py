"""What a control does while it stands: the states of a program's stops, and the end of a
compensation's coming and going."""

import time

from testkit.linuxcnc.rig import Control, State


def stands(control: Control, program: bytes) -> list[State]:
    """Drive a program and return the state late in each stop: the last one that was seen standing
    with that counter."""
    seen: dict[int, State] = {}

    def watch(state: State) -> None:
        if state.stopped:
            seen[state.count] = state

    before, control.on_state = control.on_state, watch
    control.run(program)
    control.on_state = before
    return list(seen.values())


def settled(control: Control) -> None:
    """Wait until the compensation has come in or gone: the joints have stopped following the slew
    limit."""
    places = [control.state.motor_mm]
    while len(places) < 10 or places[-10] != places[-1]:
        time.sleep(0.05)
        places.append(control.state.motor_mm)
        assert len(places) < 400, places[-1]
