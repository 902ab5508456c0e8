#!/usr/bin/python3
"""The DISPLAY program of the LinuxCNC rig: an operator without a screen, run by the control with
the system's Python.

It switches the machine on, homes it, and then speaks JSON lines over the Unix socket named in
STEPDIAG_RIG: out goes the control's state, as often as a fast PLC would look; in come ``{"run":
program}``, ``{"set": [pin, value]}`` and ``{"quit": true}``. It presses cycle start wherever a
program halts.
"""

import contextlib
import json
import os
import socket
import subprocess
import time

import hal
import linuxcnc

PERIOD_S = 0.004
MOTORS = [f"motor-{joint}" for joint in range(3)]
SIGNALS = {
    "setup": "setup",
    "count": "count",
    **{f"commanded-{n}": f"position-{axis}" for n, axis in enumerate("xyz")},
}
"""Signals of stepdiag.hal, which the product's own component reads too: the rig sees what the
survey sees."""
BITS = {"stopped": "stopped", "in-position": "in-position"}


def wired() -> "hal.component":
    """Return a HAL component whose pins are netted to the control's own."""
    rig = hal.component("rig")
    for pin in (*MOTORS, *SIGNALS):
        rig.newpin(pin, hal.HAL_FLOAT, hal.HAL_IN)
    for pin in BITS:
        rig.newpin(pin, hal.HAL_BIT, hal.HAL_IN)
    rig.ready()
    for pin in MOTORS:
        subprocess.run(["halcmd", "net", pin, f"rig.{pin}"], check=True)
    for pin, signal in {**SIGNALS, **BITS}.items():
        subprocess.run(["halcmd", "net", f"stepdiag-{signal}", f"rig.{pin}"], check=True)
    return rig


def switched_on(command: "linuxcnc.command", status: "linuxcnc.stat") -> None:
    """Reset the emergency stop, switch on and home all joints."""
    for state in (linuxcnc.STATE_ESTOP_RESET, linuxcnc.STATE_ON):
        command.state(state)
        command.wait_complete()
    for joint in range(3):
        command.home(joint)
    while not all(status.homed[:3]):
        time.sleep(0.02)
        status.poll()
    command.mode(linuxcnc.MODE_AUTO)
    command.wait_complete()


def obey(order: dict, command: "linuxcnc.command") -> bool:
    """Carry out one order; return False for the last one."""
    if "run" in order:
        command.program_open(order["run"])
        command.wait_complete()
        command.auto(linuxcnc.AUTO_RUN, 0)  # not waited for: the state must go on being told
    if "set" in order:
        subprocess.run(["halcmd", "setp", *order["set"]], check=True)
    return "quit" not in order


def state_of(rig: "hal.component", status: "linuxcnc.stat", started: int) -> dict:
    """Return what the rig wants to know of this moment."""
    now = time.monotonic_ns()
    return {
        "time_ns": now,
        "motor_mm": [rig[pin] for pin in MOTORS],
        "commanded_mm": [rig[f"commanded-{joint}"] for joint in range(3)],
        "setup": round(rig["setup"]),
        "count": round(rig["count"]),
        "stopped": bool(rig["stopped"]),
        "in_position": bool(rig["in-position"]),
        "running": status.interp_state != linuxcnc.INTERP_IDLE,
        "started": started,
    }


def serve(
    link: socket.socket,
    rig: "hal.component",
    command: "linuxcnc.command",
    status: "linuxcnc.stat",
) -> None:
    """Publish states and obey orders until told to quit or the rig has gone."""
    errors = linuxcnc.error_channel()
    received, started, resumed_s = b"", 0, 0.0
    while True:
        status.poll()
        if (
            status.interp_state == linuxcnc.INTERP_PAUSED
            and time.monotonic() - resumed_s > 0.2
        ):
            command.auto(linuxcnc.AUTO_RESUME)
            resumed_s = time.monotonic()
        state = state_of(rig, status, started)
        if (error := errors.poll()) and error[0] in (
            linuxcnc.NML_ERROR,
            linuxcnc.OPERATOR_ERROR,
        ):
            state["error"] = error[1]
        link.sendall(json.dumps(state).encode() + b"\n")
        with contextlib.suppress(BlockingIOError):
            received += link.recv(65536, socket.MSG_DONTWAIT)
        *orders, received = received.split(b"\n")
        for order in map(json.loads, orders):
            started += "run" in order
            if not obey(order, command):
                return
        time.sleep(PERIOD_S)


def main() -> None:
    """Connect to the rig, switch the machine on and serve."""
    with socket.socket(socket.AF_UNIX) as link:
        link.connect(os.environ["STEPDIAG_RIG"])
        rig = wired()
        command, status = linuxcnc.command(), linuxcnc.stat()
        status.poll()
        switched_on(command, status)
        serve(link, rig, command, status)


if __name__ == "__main__":
    main()
