#!/usr/bin/python3
"""The DISPLAY program of the LinuxCNC rig: an operator without a screen, run by the control with the system's Python.

It switches the machine on, homes it, and then speaks JSON lines over the Unix socket named in STEPDIAG_RIG: out goes
the control's state, as often as a fast PLC would look; in come ``{"run": program}``, ``{"captured": count}`` and
``{"quit": true}``. It presses cycle start wherever a program halts.
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
PINS = {
    **{f"motor-{joint}": f"joint.{joint}.motor-pos-cmd" for joint in range(3)},
    **{f"commanded-{joint}": f"joint.{joint}.pos-cmd" for joint in range(3)},
    "setup": "motion.analog-out-00",
    "count": "motion.analog-out-01",
}
BITS = {"stopped": "motion.digital-out-00", "in-position": "motion.in-position"}


def wired() -> "hal.component":
    """Return a HAL component whose pins are netted to the control's own."""
    rig = hal.component("rig")
    for pin in PINS:
        rig.newpin(pin, hal.HAL_FLOAT, hal.HAL_IN)
    for pin in BITS:
        rig.newpin(pin, hal.HAL_BIT, hal.HAL_IN)
    rig.newpin("captured", hal.HAL_FLOAT, hal.HAL_OUT)
    rig.ready()
    for pin, source in {**PINS, **BITS}.items():
        net = f"motor-{pin[-1]}" if pin.startswith("motor") else f"rig-{pin}"
        subprocess.run(["halcmd", "net", net, source, "=>", f"rig.{pin}"], check=True)
    subprocess.run(["halcmd", "net", "rig-captured", "rig.captured", "=>", "motion.analog-in-00"], check=True)
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


def obey(order: dict, rig: "hal.component", command: "linuxcnc.command") -> bool:
    """Carry out one order; return False for the last one."""
    if "run" in order:
        command.program_open(order["run"])
        command.wait_complete()
        command.auto(linuxcnc.AUTO_RUN, 0)  # not waited for: the state must go on being told
    if "captured" in order:
        rig["captured"] = float(order["captured"])
    return "quit" not in order


def state_of(rig: "hal.component", status: "linuxcnc.stat", started: int) -> dict:
    """Return what the rig wants to know of this moment."""
    now = time.monotonic_ns()
    return {
        "time_ns": now,
        "motor_mm": [rig[f"motor-{joint}"] for joint in range(3)],
        "commanded_mm": [rig[f"commanded-{joint}"] for joint in range(3)],
        "setup": round(rig["setup"]),
        "count": round(rig["count"]),
        "stopped": bool(rig["stopped"]),
        "in_position": bool(rig["in-position"]),
        "running": status.interp_state != linuxcnc.INTERP_IDLE,
        "started": started,
    }


def serve(link: socket.socket, rig: "hal.component", command: "linuxcnc.command", status: "linuxcnc.stat") -> None:
    """Publish states and obey orders until told to quit or the rig has gone."""
    errors = linuxcnc.error_channel()
    received, started, resumed_s = b"", 0, 0.0
    while True:
        status.poll()
        if status.interp_state == linuxcnc.INTERP_PAUSED and time.monotonic() - resumed_s > 0.2:
            command.auto(linuxcnc.AUTO_RESUME)
            resumed_s = time.monotonic()
        state = state_of(rig, status, started)
        if (error := errors.poll()) and error[0] in (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR):
            state["error"] = error[1]
        link.sendall(json.dumps(state).encode() + b"\n")
        with contextlib.suppress(BlockingIOError):
            received += link.recv(65536, socket.MSG_DONTWAIT)
        *orders, received = received.split(b"\n")
        for order in map(json.loads, orders):
            started += "run" in order
            if not obey(order, rig, command):
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
